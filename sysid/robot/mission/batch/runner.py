"""Runs of one mission and one plant side by side, in a compiled loop.

The loop is :class:`sysid.robot.mission.loop.Loop` itself on traced numbers, one run of it, which
JAX makes into many. A run that has ended goes on unseen: its figures are those of its last sample.
Both clocks of a mission are arrays for it, in blocks of samples.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError
from sysid.robot.mission.batch.setup import PlantVariant, Setup
from sysid.robot.mission.loop import COLUMNS, Loop, LoopState, Tick, Verdict, ticks
from sysid.robot.mission.noise import generator
from sysid.robot.mission.simulator import LIMITS
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

FAILED = 6
"""The verdict, beside those of the loop, of a run whose plant or law gives no numbers."""


class NotCompiledError(ModelError):
    """Something of a mission cannot be traced; the sentence says what."""


@dataclass(frozen=True, eq=False)
class BatchRunner(ABC):
    """The runs of one setup by one of its plants; a kind says what differs and what is kept.

    Attributes:
        batch_size: runs side by side; fewer are padded.
        figures: named tuple of what a run comes to, its ``verdict`` first.
    """

    setup: Setup
    which: int
    batch_size: int

    figures: ClassVar[Callable[..., Any]]

    @property
    @abstractmethod
    def example(self) -> Any:
        """A tuple of what differs from run to run, of one of them."""

    @abstractmethod
    def loop(self, numbers: Any) -> Loop:
        """The loop of one run, on traced numbers."""

    @abstractmethod
    def after_sample(self, loop: Loop, state: LoopState, verdict: Any) -> Any:
        """The figures of one run after a sample, those that add up of this sample alone."""

    @abstractmethod
    def added(self, before: Any, seen: Any) -> Any:
        """The figures so far: ``seen`` with those that add up."""

    @abstractmethod
    def shown(self, figures: Any, row: Any) -> Any:
        """What is handed out of every sample.

        Args:
            row: :data:`sysid.robot.mission.loop.COLUMNS` of every run, (columns, batch_size).
        """

    @property
    def variant(self) -> PlantVariant:
        """The plant, wired."""
        return self.setup.plant_variants[self.which]

    @cached_property
    def clock(self) -> Clock:
        """The samples of plant and control."""
        return Clock(self.variant.robot.dt, self.setup.mission.control.period)

    def run(
        self, numbers: Any, seeds: Sequence[int], recorded: bool = False
    ) -> tuple[Any, Array, Any]:
        """Run them all to their ends.

        Args:
            numbers: a tuple of what differs from run to run, runs along axis 0; at most
                ``batch_size`` of them.
            seeds: of the sensors' noise, one a run.
            recorded: whether what is shown of the samples is kept.

        Returns:
            The figures; of what is recorded the instants, (T,) [s], and the values, (T, …, runs).
        """
        jax = jax_module()
        jnp, n = jax.numpy, len(seeds)
        rows = np.minimum(np.arange(self.batch_size), n - 1)
        numbers = jax.tree.map(lambda values: jnp.asarray(values[rows]), numbers)
        noise = self._noise([seeds[k] for k in rows])
        state, ended = self._starts(numbers), self._nothing
        times, kept = [np.zeros(0)], list[Any]()
        for k in itertools.count():
            block = self.clock.block(k)
            program = self._program(tuple(self.clock.patterns))
            at = block.t, block.dt, block.kinds, block.instants
            (state, ended), shown = program(numbers, state, ended, at, next(noise))
            if recorded:
                times.append(block.t)
                kept.append(jax.tree.map(lambda values: np.asarray(values)[..., :n], shown))
            if bool(np.all(np.asarray(ended.verdict) != Verdict.GOES_ON)):
                break
        figures = self.figures(*(np.asarray(column)[:n].copy() for column in ended))
        values = jax.tree.map(lambda *parts: np.concatenate(parts), *kept) if kept else None
        return figures, np.concatenate(times), values

    def check(self) -> None:
        """Trace one run without running it; raises whatever keeps it from being compiled."""
        assert self._types

    # ------------------------------------------------------------------------------ one run

    def _start(self, numbers: Any) -> LoopState:
        """Before the first sample, after the steps without drive that bring it to rest."""
        jax = jax_module()
        jnp, loop = jax.numpy, self.loop(numbers)
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
            loop = self.loop(numbers)
            after, row = loop.sample(state, Tick(t, dt, early, late), draws)
            row = jnp.stack([jnp.asarray(value, jnp.float64) for value in row[: len(COLUMNS)]])
            broken = ~jnp.all(jnp.isfinite(row)) | jnp.any(jnp.abs(row[3:5]) >= LIMITS.wheel_speed)
            verdict = jnp.where(broken, FAILED, after.verdict)
            return after, self.after_sample(loop, after, verdict)._replace(time_s=t), row

        return sample

    @cached_property
    def _types(self) -> Any:
        """Types of the state's numbers after a sample, which it begins with as well."""
        jax, one = jax_module(), self.example
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
        zeros = [jnp.zeros(self.batch_size)] * (len(self.figures._fields) - 1)  # type: ignore[attr-defined]
        return self.figures(jnp.zeros(self.batch_size, jnp.int64), *zeros)

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
                        return jax.tree.map(jnp.asarray, after, types), self.figures(*columns), row

                    return run

                state, seen, row = jax.lax.switch(kind, [one(b) for b in branches], state)
                over = ended.verdict != Verdict.GOES_ON
                both = zip(ended, self.added(ended, seen), strict=True)
                ended = self.figures(*(jnp.where(over, a, b) for a, b in both))
                return (state, ended), self.shown(ended, row.T)

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
