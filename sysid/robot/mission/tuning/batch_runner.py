"""Runs of one mission with many sets of gains, compiled in batches or sequential.

As in :mod:`sysid.robot.mission.monte_carlo.compiled` it is the loop itself that is traced; what
differs from run to run are the gains and the plant's parameters.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from os import cpu_count
from typing import Any, NamedTuple, cast

import numpy as np

from sysid import processes
from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.fitting.compiled import compiled, jax_module
from sysid.robot.mission.loop import COLUMNS, Loop, Tick, Verdict
from sysid.robot.mission.monte_carlo.clock import BLOCK, Clock, Pattern
from sysid.robot.mission.monte_carlo.compiled import first_states, settled, state_types
from sysid.robot.mission.monte_carlo.figures import FAILED
from sysid.robot.mission.monte_carlo.setup import PlantVariant, Setup
from sysid.robot.mission.noise import block as noise_block
from sysid.robot.mission.noise import generator
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.simulator import LIMITS, closed_loop, simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.criteria import Driven

BATCH_SIZE = 1024
"""Runs side by side at most: their states fit into a core's cache."""


RUNS_ALONE = 64
"""Runs that a process is given at a time where they go one by one: to wire the plant anew costs as
much as a few."""


class Runs(NamedTuple):
    """What differs from run to run.

    Attributes:
        gains: of the controller, (K, g).
        theta: parameters of the plant, (K, n).
        seeds: of the sensors' noise, one a run.
    """

    gains: Array
    theta: Array
    seeds: tuple[int, ...]

    def rows(self, at: Any) -> "Runs":
        """Some of them."""
        return Runs(self.gains[at], self.theta[at], tuple(self.seeds[k] for k in at))


class Tally(NamedTuple):
    """What a run has come to so far; see :class:`~sysid.robot.mission.tuning.criteria.Driven`."""

    verdict: Any
    time_s: Any
    clearance: Any
    effort: Any


@dataclass(frozen=True, eq=False)
class BatchRunner:
    """One mission and its plant, driven with gains of all kinds.

    Attributes:
        names: of the gains, in the order of their columns.
        batch_size: runs side by side; fewer are padded.
        recorded: whether speed and yaw are wanted, sample by sample.
        alone: whether the runs go one after the other.
    """

    setup: Setup
    names: tuple[str, ...]
    batch_size: int
    recorded: bool
    alone: bool = False

    @property
    def variant(self) -> PlantVariant:
        """The plant, wired."""
        return self.setup.plant_variants[0]

    @property
    def mission(self) -> Mission:
        """The mission."""
        return self.variant.sampler.mission

    def with_gains(self, gains: Any) -> Mission:
        """The mission with gains, numbers or traced ones."""
        control = cast(TunedSettings, self.mission.control)
        named = {name: gains[k] for k, name in enumerate(self.names)}
        return self.mission.model_copy(update={"control": control.with_gains(named)})

    # ----------------------------------------------------------------------------- one by one

    def drive(self, runs: Runs) -> Driven:
        """All runs to their ends, side by side, or one by one on the cores that there are."""
        if not self.alone:
            return self.together(runs)
        at = np.array_split(np.arange(len(runs.seeds)), -(-len(runs.seeds) // RUNS_ALONE))
        if len(at) == 1:
            return self.one_by_one(runs)
        runner = replace(self, setup=self.setup.plain())
        with processes.pool(cpu_count()) as pool:
            return joined(list(pool.map(runner.one_by_one, [runs.rows(rows) for rows in at])))

    def one_by_one(self, runs: Runs) -> Driven:
        """Run after run, in NumPy; a run that gives no numbers counts as failed."""
        return joined([self._one(runs.rows([k])) for k in range(len(runs.seeds))])

    def _one(self, run: Runs) -> Driven:
        robot = self.variant.resting(run.theta[0], 0.0)
        mission = self.with_gains(run.gains[0].tolist())
        try:
            result = simulate(mission, robot, run.seeds[0], self.variant.robot)
        except ModelError:
            nothing, row = np.full(1, np.nan), np.full((1, 1), np.nan)
            return Driven(np.array([FAILED]), nothing, nothing, nothing, np.zeros(1), row, row)
        log, clear = result.log, result.min_clearance_m
        effort = float(np.sum(log["v_cmd"] ** 2 + log["psi_cmd"] ** 2)) * robot.dt
        rows = slice(None) if self.recorded else slice(0)
        return Driven(
            np.array([Verdict[result.outcome.name]]),
            np.array([result.time_s]),
            np.array([np.inf if clear is None else clear]),
            np.array([effort]),
            np.asarray(log["t"][rows]),
            log["v"][rows, None],
            log["psi"][rows, None],
        )

    # --------------------------------------------------------------------------- side by side

    def together(self, runs: Runs) -> Driven:
        """All of them, ``batch_size`` at a time."""
        parts = []
        for at in range(0, len(runs.seeds), self.batch_size):
            chosen = np.arange(at, min(at + self.batch_size, len(runs.seeds)))
            padded = np.minimum(np.arange(at, at + self.batch_size), chosen[-1])
            parts.append(self._chunk(runs.rows(padded), len(chosen)))
        return joined(parts)

    def _chunk(self, runs: Runs, n: int) -> Driven:
        jnp = jax_module().numpy
        numbers = jnp.asarray(runs.gains), jnp.asarray(runs.theta)
        noise = self._noise(runs.seeds)
        state = self._starts(numbers)
        zeros = [jnp.zeros(self.batch_size)] * (len(Tally._fields) - 1)
        tally = Tally(jnp.zeros(self.batch_size, jnp.int64), *zeros)
        rows: list[tuple[Array, Array, Array]] = []
        k = 0
        while True:
            block = self._clock.block(k)
            program = self._program(tuple(self._clock.patterns))
            clock = (block.t, block.dt, block.kinds, block.instants)
            state, tally, seen = program(numbers, state, tally, clock, next(noise))
            if self.recorded:
                v, psi = (np.asarray(s)[:, :n] for s in seen)
                rows.append((block.t, v, psi))
            if bool(np.all(np.asarray(tally.verdict) != Verdict.GOES_ON)):
                break
            k += 1
        ended = Tally(*(np.asarray(column)[:n].copy() for column in tally))
        if not rows:
            return Driven(*ended, np.zeros(0), np.zeros((0, n)), np.zeros((0, n)))
        t, v, psi = (np.concatenate(column) for column in zip(*rows, strict=True))
        kept = t <= ended.time_s.max()
        return Driven(*ended, t[kept], v[kept], psi[kept])

    @cached_property
    def _clock(self) -> Clock:
        return Clock(self.variant.robot.dt, self.mission.control.period)

    @cached_property
    def _programs(self) -> dict[tuple[Pattern, ...], Callable[..., Any]]:
        """Compiled blocks by the patterns of both clocks that they know."""
        return {}

    def _loop(self, gains: Any, theta: Any) -> Loop:
        robot = self.variant.robot_of(theta, 0.0)
        mission, xp = self.with_gains(gains), jax_module().numpy
        return closed_loop(mission, robot, self.variant.scene, xp, self.variant.shaper)

    def _start(self, numbers: tuple[Any, Any]) -> Any:
        return settled(self._loop(*numbers), self.variant.settling_steps)

    @cached_property
    def _starts(self) -> Callable[..., Any]:
        return first_states(self._start, self._types)

    @cached_property
    def _types(self) -> Any:
        one = np.ones(len(self.names)), self.variant.sampler.plant.theta
        counts = (s.draws for s in self.variant.scene.sensors.values())
        return state_types(self._start, self._sampled((0, 1)), one, counts)

    def _sampled(self, pattern: Pattern) -> Callable[..., Any]:
        """One sample of one run with so many control instants before it and with it."""
        before, now = pattern
        indices = [COLUMNS.index(name) for name in ("v", "psi")]

        def sample(numbers: tuple[Any, Any], state: Any, at: Any, draws: Any) -> Any:
            jnp = jax_module().numpy
            t, dt, instants = at
            early = tuple(instants[k] for k in range(before))
            late = tuple(instants[before + k] for k in range(now))
            loop = self._loop(*numbers)
            after, row = loop.sample(state, Tick(t, dt, early, late), draws)
            seen = jnp.stack([jnp.asarray(value, jnp.float64) for value in row[: len(COLUMNS)]])
            broken = ~jnp.all(jnp.isfinite(seen)) | jnp.any(
                jnp.abs(seen[3:5]) >= LIMITS.wheel_speed
            )
            command = after.command
            tally = Tally(
                jnp.where(broken, FAILED, after.verdict),
                t,
                after.progress.clearance,
                (command.v_cmd**2 + command.psi_cmd**2) * loop.plant.dt,
            )
            return after, tally, tuple(seen[k] for k in indices)

        return sample

    def _program(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        if patterns not in self._programs:
            self._programs[patterns] = compiled(self._block(patterns))
        return self._programs[patterns]

    def _block(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        """All runs through a block of samples."""
        jax = jax_module()
        jnp, types = jax.numpy, self._types
        branches = [jax.vmap(self._sampled(p), in_axes=(0, 0, None, 0)) for p in patterns]

        def block(numbers: Any, state: Any, tally: Tally, clock: Any, noise: Any) -> Any:
            def sample(carried: tuple[Any, Tally], given: Any) -> Any:
                state, tally = carried
                (t, dt, kind, instants), draws = given

                def one(branch: Any) -> Any:
                    def run(state: Any) -> Any:
                        after, seen, row = branch(numbers, state, (t, dt, instants), draws)
                        seen = Tally(
                            *(jnp.broadcast_to(v, (self.batch_size,)).astype(e.dtype)
                              for v, e in zip(seen, tally, strict=True))
                        )  # fmt: skip
                        return jax.tree.map(jnp.asarray, after, types), seen, row

                    return run

                state, seen, row = jax.lax.switch(kind, [one(b) for b in branches], state)
                seen = seen._replace(effort=tally.effort + seen.effort)
                over = tally.verdict != Verdict.GOES_ON
                tally = Tally(*(jnp.where(over, a, b) for a, b in zip(tally, seen, strict=True)))
                return (state, tally), row if self.recorded else ()

            (state, tally), rows = jax.lax.scan(sample, (state, tally), (clock, noise))
            return state, tally, rows

        return block

    def _noise(self, seeds: tuple[int, ...]) -> Iterator[Any]:
        """Standard normal numbers of each block, (BLOCK, batch_size, count) for each sensor."""
        jnp = jax_module().numpy
        named = [
            ({s: generator(s, name) for s in dict.fromkeys(seeds)}, sensor.draws)
            for name, sensor in self.variant.scene.sensors.items()
        ]
        while True:
            arrays = []
            for streams, n in named:
                numbers = {s: noise_block(stream, n, BLOCK) for s, stream in streams.items()}
                arrays.append(jnp.asarray(np.stack([numbers[s] for s in seeds], axis=1)))
            yield tuple(arrays)


def joined(parts: list[Driven]) -> Driven:
    """Runs one after the other, with as many rows as the longest: others hold their last."""
    t = max((part.t for part in parts), key=len)
    v, psi = (
        [np.pad(part[k], ((0, len(t) - len(part.t)), (0, 0)), "edge") for part in parts]
        for k in (5, 6)
    )
    return Driven(
        np.concatenate([part.verdict for part in parts]),
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.clearance for part in parts]),
        np.concatenate([part.effort for part in parts]),
        t,
        np.concatenate(v, axis=1),
        np.concatenate(psi, axis=1),
    )
