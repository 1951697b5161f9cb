"""Runs of one mission and one plant side by side, in a compiled loop.

The loop is :class:`sysid.robot.mission.loop.Loop` itself on traced numbers, one run of it, which
JAX makes into many. A run that has ended goes on unseen: its figures are those of its last sample.
Both clocks of a mission are arrays for it, in blocks of samples.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError, SysidError
from sysid.robot.mission.batch.figures import (
    FAILED,
    NOTHING,
    Driven,
    Figures,
    figures_of,
    joined,
    stacked,
)
from sysid.robot.mission.batch.pool import PROCESSES, Job
from sysid.robot.mission.batch.sampler import Numbers, Samples
from sysid.robot.mission.batch.setup import PlantVariant, Setup
from sysid.robot.mission.clearance import off_line
from sysid.robot.mission.loop import COLUMNS, Loop, LoopState, Tick, Verdict, ticks
from sysid.robot.mission.noise import generator
from sysid.robot.mission.simulator import LIMITS, closed_loop, simulate
from sysid.runners.compiled import compiled, jax_module

BLOCK = 32
"""Samples between two looks at whether all runs have ended: a tenth of a usual mission."""

Pattern = tuple[int, int]
"""Control instants before a sample and together with it."""


@dataclass(frozen=True, eq=False)
class Block:
    """Some samples one after the other.

    Attributes:
        t, dt: of every sample [s], (BLOCK,).
        kinds: its pattern, as an index into all patterns, (BLOCK,).
        instants: its control instants, padded with zeros, (BLOCK, most) [s].
    """

    t: Array
    dt: Array
    kinds: Index
    instants: Array


class Clock:
    """The samples of a mission, in blocks, made as they are asked for and kept.

    The instants of both clocks differ from sample to sample in number, of which there are few
    kinds; a compiled loop has a branch for each.

    Args:
        dt: of the plant [s].
        period: of control [s].

    Attributes:
        patterns: in the order in which they first occur; it grows with the blocks.
    """

    def __init__(self, dt: float, period: float) -> None:
        self._ticks: Iterator[Tick] = ticks(dt, period)
        self._rows: list[list[Tick]] = []
        self.patterns: list[Pattern] = []

    def block(self, k: int) -> Block:
        while len(self._rows) <= k:
            rows = list(islice(self._ticks, BLOCK))
            self._rows.append(rows)
            for tick in rows:
                pattern = (len(tick.before), len(tick.now))
                if pattern not in self.patterns:
                    self.patterns.append(pattern)
        rows = self._rows[k]
        most = max(1, *(sum(p) for p in self.patterns))
        instants = np.zeros((len(rows), most))
        for row, tick in zip(instants, rows, strict=True):
            both = (*tick.before, *tick.now)
            row[: len(both)] = both
        return Block(
            np.array([tick.t for tick in rows]),
            np.array([tick.dt for tick in rows]),
            np.array([self.patterns.index((len(r.before), len(r.now))) for r in rows]),
            instants,
        )


BATCH_SIZE = 1024
"""Runs side by side at most. Their states fit into a core's cache, and a call of compiled code
costs little beside them. The result of a run does not depend on it beyond rounding."""

RUNS_ALONE = 64
"""Runs that a process is given at a time where they go one by one: to wire the plant anew costs as
much as a few."""


class NotCompiledError(ModelError):
    """Something of a mission cannot be traced; the sentence says what."""


@dataclass(frozen=True, eq=False)
class BatchRunner:
    """The runs of one setup by one of its plants, side by side or one by one.

    Attributes:
        which: of the setup's plants.
        batch_size: runs side by side; fewer are padded.
        shown: columns of the log that are handed out of every sample.
        alone: whether the runs go one after the other, in NumPy.
    """

    setup: Setup
    which: int
    batch_size: int
    shown: tuple[str, ...] = ("x", "y", "psi")
    alone: bool = False

    @property
    def variant(self) -> PlantVariant:
        """The plant, wired."""
        return self.setup.plant_variants[self.which]

    @cached_property
    def clock(self) -> Clock:
        """The samples of plant and control."""
        return Clock(self.variant.robot.dt, self.setup.mission.control.period)

    def of(self, samples: Samples, recorded: bool = False) -> Driven:
        """Run samples to their ends."""
        noise = [self.setup.noise_seed(s) for s in samples.seeds]
        return self.drive(samples.numbers, noise, recorded)

    def drive(self, numbers: Numbers, seeds: Sequence[int], recorded: bool = False) -> Driven:
        """Run them all to their ends, one by one on the cores that there are.

        Args:
            numbers: what differs from run to run, runs along axis 0.
            seeds: of the sensors' noise, one a run.
            recorded: whether what is shown of the samples is kept.
        """
        size, n = RUNS_ALONE if self.alone else self.batch_size, len(seeds)
        parts = [
            (Numbers(*(v[at] for v in numbers)), tuple(seeds[k] for k in at), recorded)
            for at in np.array_split(np.arange(n), -(-n // size))
        ]
        if self.alone and len(parts) > 1:
            return joined(list(self._job.results(parts, PROCESSES)))
        return joined([self.part(part) for part in parts])

    def part(self, part: tuple[Numbers, tuple[int, ...], bool]) -> Driven:
        """As :meth:`drive`, at most ``batch_size`` runs where they go side by side."""
        numbers, seeds, recorded = part
        if not self.alone:
            return self._together(numbers, seeds, recorded)
        each = [(numbers.run(k), seed) for k, seed in enumerate(seeds)]
        return joined([self._single(run, seed, recorded) for run, seed in each])

    @cached_property
    def _job(self) -> Job:
        return Job(_parts_of, (self.setup, self.which, self.batch_size, self.shown, True))

    def _single(self, numbers: Numbers, seed: int, recorded: bool) -> Driven:
        """One run in NumPy; one that gives no numbers counts as failed."""
        mission, robot = self.variant.single(numbers)
        try:
            result = simulate(mission, robot, seed, self.variant.robot)
        except ModelError:
            rows = np.full((int(recorded), len(self.shown), 1), np.nan)
            return Driven(stacked([NOTHING]), np.zeros(len(rows)), rows)
        figures = stacked([figures_of(result, robot.dt)])
        if not recorded:
            return Driven(figures, np.zeros(0), np.zeros((0, len(self.shown), 1)))
        rows = np.stack([result.log[name] for name in self.shown], axis=1)[:, :, None]
        return Driven(figures, result.log["t"], rows)

    def _together(self, numbers: Numbers, seeds: Sequence[int], recorded: bool) -> Driven:
        jax = jax_module()
        jnp, n = jax.numpy, len(seeds)
        rows = np.minimum(np.arange(self.batch_size), n - 1)
        numbers = jax.tree.map(lambda values: jnp.asarray(values[rows]), numbers)
        noise = self._noise([seeds[k] for k in rows])
        state, ended = self._starts(numbers), self._nothing
        times, kept = [np.zeros(0)], [np.zeros((0, len(self.shown), n))]
        for k in itertools.count():
            block = self.clock.block(k)
            program = self._program(tuple(self.clock.patterns))
            at = block.t, block.dt, block.kinds, block.instants
            (state, ended), shown = program(numbers, state, ended, at, next(noise))
            if recorded:
                times.append(block.t)
                kept.append(np.asarray(shown)[..., :n])
            if bool(np.all(np.asarray(ended.verdict) != Verdict.GOES_ON)):
                break
        figures = Figures(*(np.asarray(column)[:n].copy() for column in ended))
        t = np.concatenate(times)
        before_all_ended = t <= figures.time_s.max()
        return Driven(figures, t[before_all_ended], np.concatenate(kept)[before_all_ended])

    def check(self) -> None:
        """Trace one run without running it; raises whatever keeps it from being compiled."""
        assert self._types

    # ------------------------------------------------------------------------------ one run

    def _loop(self, numbers: Numbers) -> Loop:
        """The loop of one run, on traced numbers."""
        variant, xp = self.variant, jax_module().numpy
        mission, robot = (
            variant.sampler.varied(numbers),
            variant.robot_of(numbers.theta, numbers.slip),
        )
        there = mission.scene()
        scene = variant.scene._replace(
            start=there.start, obstacles=there.obstacles, car=there.car, floor=there.floor
        )
        return closed_loop(mission, robot, scene, xp, variant.shaper)

    def _start(self, numbers: Any) -> LoopState:
        """Before the first sample, after the steps without drive that bring it to rest."""
        jax = jax_module()
        jnp, loop = jax.numpy, self._loop(numbers)
        state = loop.start()
        plant, nothing = jnp.asarray(state.plant, jnp.float64), jnp.zeros(2)
        steps = self.variant.settling_steps
        if steps:
            plant = jax.lax.fori_loop(0, steps, lambda _, x: loop.plant.step(x, nothing)[0], plant)
        settled: LoopState = jax.tree.map(jnp.asarray, state._replace(plant=plant))
        return settled

    def _sampled(self, pattern: Pattern) -> Callable[..., Any]:
        """One sample of one run with so many control instants before it and with it."""
        before, now = pattern

        def sample(numbers: Any, state: Any, at: tuple[Any, Any, Any], draws: Any) -> Any:
            jnp = jax_module().numpy
            t, dt, instants = at
            early = tuple(instants[k] for k in range(before))
            late = tuple(instants[before + k] for k in range(now))
            loop = self._loop(numbers)
            after, row = loop.sample(state, Tick(t, dt, early, late), draws)
            row = jnp.stack([jnp.asarray(value, jnp.float64) for value in row[: len(COLUMNS)]])
            broken = ~jnp.all(jnp.isfinite(row)) | jnp.any(jnp.abs(row[3:5]) >= LIMITS.wheel_speed)
            verdict = jnp.where(broken, FAILED, after.verdict)
            return after, _after_sample(loop, after, verdict, t), row

        return sample

    @cached_property
    def _types(self) -> Any:
        """Types of the state's numbers after a sample, which it begins with as well."""
        jax, one = jax_module(), self.variant.nominal
        state = jax.eval_shape(self._start, one)
        draws = tuple(np.zeros(s.draws) for s in self.variant.scene.sensors.values())
        at = (0.0, 0.0, np.zeros(1))
        after = jax.eval_shape(self._sampled((0, 1)), one, state, at, draws)[0]
        if jax.tree.structure(state) != jax.tree.structure(after) or any(
            a.shape != b.shape for a, b in zip(*map(jax.tree.leaves, (state, after)), strict=True)
        ):
            raise NotCompiledError("the state of a law changes its shape from step to step")
        return jax.tree.map(lambda a, b: jax.numpy.result_type(a.dtype, b.dtype), state, after)

    # ----------------------------------------------------------------------------- many runs

    @property
    def _nothing(self) -> Any:
        jnp = jax_module().numpy
        zeros: Any = [jnp.zeros(self.batch_size)] * (len(Figures._fields) - 1)
        return Figures(jnp.zeros(self.batch_size, jnp.int64), *zeros)

    @cached_property
    def _starts(self) -> Callable[..., Any]:
        jax, types = jax_module(), self._types

        def starts(numbers: Any) -> Any:
            state = jax.vmap(self._start)(numbers)
            return jax.tree.map(lambda value, kind: value.astype(kind), state, types)

        program: Callable[..., Any] = jax.jit(starts)
        return program

    @cached_property
    def _programs(self) -> dict[tuple[Pattern, ...], Callable[..., Any]]:
        """Compiled blocks by the patterns of both clocks that they know."""
        return {}

    def _program(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        if patterns not in self._programs:
            self._programs[patterns] = compiled(self._block(patterns))
        return self._programs[patterns]

    def _block(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        jax = jax_module()
        jnp, types = jax.numpy, self._types
        branches = [jax.vmap(self._sampled(p), in_axes=(0, 0, None, 0)) for p in patterns]
        shown = np.array([COLUMNS.index(name) for name in self.shown], dtype=np.intp)

        def added(before: Figures, seen: Figures) -> Figures:
            farthest = jnp.maximum(before.max_deviation_m, seen.max_deviation_m)
            return seen._replace(max_deviation_m=farthest, effort=before.effort + seen.effort)

        def block(numbers: Any, state: Any, ended: Any, clock: Any, noise: Any) -> Any:
            def sample(carried: Any, given: Any) -> Any:
                state, ended = carried
                (t, dt, kind, instants), draws = given

                def one(branch: Any) -> Any:
                    def run(state: Any) -> Any:
                        after, seen, row = branch(numbers, state, (t, dt, instants), draws)
                        columns = (
                            jnp.broadcast_to(v, (self.batch_size,)).astype(e.dtype)
                            for v, e in zip(seen, ended, strict=True)
                        )
                        return jax.tree.map(jnp.asarray, after, types), Figures(*columns), row

                    return run

                state, seen, row = jax.lax.switch(kind, [one(b) for b in branches], state)
                over = ended.verdict != Verdict.GOES_ON
                both = zip(ended, added(ended, seen), strict=True)
                ended = Figures(*(jnp.where(over, a, b) for a, b in both))
                return (state, ended), row.T[shown]

            return jax.lax.scan(sample, (state, ended), (clock, noise))

        return block

    def _noise(self, seeds: Sequence[int]) -> Iterator[Any]:
        """Standard normal numbers of each block, (BLOCK, batch_size, count) for each sensor."""
        jnp = jax_module().numpy
        named = [
            ({s: generator(s, name) for s in seeds}, sensor.draws)
            for name, sensor in self.variant.scene.sensors.items()
        ]
        while True:
            arrays = []
            for streams, n in named:
                numbers = {s: stream.standard_normal((BLOCK, n)) for s, stream in streams.items()}
                arrays.append(jnp.asarray(np.stack([numbers[s] for s in seeds], axis=1)))
            yield tuple(arrays)


def _after_sample(loop: Loop, state: LoopState, verdict: Any, t: Any) -> Figures:
    """The figures of one run after a sample; largest deviation and effort of this sample alone."""
    pose, progress, scene, command = state.body.pose, state.progress, loop.scene, state.command
    aside = off_line(pose.x, pose.y, scene.start, scene.goal, loop.xp)
    effort: Any = (command.v_cmd**2 + command.psi_cmd**2) * loop.plant.dt
    return Figures(verdict, t, *pose, progress.path_length, progress.clearance, aside, effort)


def _parts_of(given: tuple[Any, ...]) -> Callable[[Any], Driven]:
    return BatchRunner(*given).part


def why_not_at_once(setup: Setup) -> str:
    """What keeps the runs of a setup from going side by side; empty for nothing.

    A law or a plant that takes its numbers for Python's, by ``if``, ``float`` or a function of
    NumPy, can be run and not traced.
    """
    for which in range(len(setup.plants)):
        try:
            BatchRunner(setup, which, 1).check()
        except SysidError as error:
            return str(error)
        except Exception as error:  # whatever a law of another package raises on traced numbers
            first = str(error).strip().partition("\n")[0]
            return f"{_culprit(setup, which, error)} cannot be compiled ({first})"
    return ""


def _culprit(setup: Setup, which: int, error: BaseException) -> str:
    """The part whose method was running when it failed."""
    mission, variant = setup.mission, setup.plant_variants[which]
    parts = {
        type(getattr(mission, role)): f"the law of {role}"
        for role in ("guidance", "control", "navigation", "motion")
    }
    parts |= {type(s): f"the sensor {name}" for name, s in variant.scene.sensors.items()}
    plant = f"the plant {setup.plants[which].name}"
    parts |= {type(variant.robot): plant, type(setup.plants[which]): plant}
    culprit, place = "the loop of the mission", error.__traceback__
    while place is not None:
        culprit = parts.get(type(place.tb_frame.f_locals.get("self")), culprit)
        place = place.tb_next
    return culprit
