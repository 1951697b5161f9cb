"""Runs of one mission and one plant, batched in a compiled loop.

The loop is :class:`sysid.robot.mission.loop.Loop` itself on traced numbers, one run of it, which
JAX makes into many. A run that has ended goes on unseen: its figures are those of its last sample.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.fitting.compiled import compiled, jax_module
from sysid.robot.mission.contracts import Pose, Scene
from sysid.robot.mission.loop import COLUMNS, Loop, Tick, Verdict
from sysid.robot.mission.monte_carlo.clock import BLOCK, Clock, Pattern
from sysid.robot.mission.monte_carlo.figures import FAILED, Figures
from sysid.robot.mission.monte_carlo.sampler import Samples
from sysid.robot.mission.monte_carlo.setup import PlantVariant, Setup
from sysid.robot.mission.noise import block as noise_block
from sysid.robot.mission.noise import generator
from sysid.robot.mission.simulator import LIMITS, closed_loop
from sysid.vehicle.kinematics import wrap_angle


class Numbers(NamedTuple):
    """What a compiled run takes: one row of :class:`Samples`."""

    theta: Any
    start: Any
    obstacles: Any
    slip: Any
    physics: Any


class NotCompiledError(ModelError):
    """Something of a mission cannot be traced; the sentence says what."""


@dataclass(frozen=True, eq=False)
class CompiledRuns:
    """The runs of one setup by one of its plants.

    Attributes:
        setup: mission, plants, what varies.
        batch_size: runs side by side; fewer are padded.
    """

    setup: Setup
    which: int
    batch_size: int

    @property
    def variant(self) -> PlantVariant:
        """The plant, wired."""
        return self.setup.plant_variants[self.which]

    @cached_property
    def clock(self) -> Clock:
        """The samples of plant and control."""
        return Clock(self.variant.robot.dt, self.setup.mission.control.period)

    @cached_property
    def _programs(self) -> dict[tuple[Pattern, ...], Callable[..., Any]]:
        """Compiled blocks by the patterns of both clocks that they know."""
        return {}

    def figures(
        self, samples: Samples, seen: Callable[[Array, Array], None] | None = None
    ) -> Figures:
        """Run them all to their ends.

        Args:
            samples: at most ``batch_size`` runs.
            seen: takes the verdicts (n, batch_size) and X, Y [m], ψ [rad] (n, 3, batch_size) of
                each block.

        Returns:
            Their figures, in this order.
        """
        _, jnp = _jax()
        n = len(samples.seeds)
        rows = np.minimum(np.arange(self.batch_size), n - 1)
        numbers = Numbers(*(jnp.asarray(getattr(samples, f)[rows]) for f in Numbers._fields))
        noise = self._noise([samples.seeds[k] for k in rows])
        state, ended = self._begin(numbers)
        k = 0
        while True:
            block = self.clock.block(k)
            program = self._program(tuple(self.clock.patterns))
            (state, ended), shown = program(
                numbers, state, ended, (block.t, block.dt, block.kinds, block.instants), next(noise)
            )
            if seen is not None:
                seen(*map(np.asarray, shown))
            if bool(np.all(np.asarray(ended.verdict) != Verdict.GOES_ON)):
                return Figures(*(np.asarray(column)[:n].copy() for column in ended))
            k += 1

    def check(self) -> None:
        """Trace one run without running it; raises whatever keeps it from being compiled."""
        assert self._types

    # ------------------------------------------------------------------------------ one run

    def _loop(self, numbers: Numbers) -> Loop:
        """The loop of one run, on traced numbers."""
        _, jnp = _jax()
        variant = self.variant
        robot = variant.robot_of(numbers.theta, numbers.slip)
        return closed_loop(self.setup.mission, robot, self._scene(numbers), jnp, variant.shaper)

    def _scene(self, numbers: Numbers) -> Scene:
        scene = self.variant.scene
        if self.setup.variation.start:
            x, y, psi = (numbers.start[k] for k in range(3))
            scene = scene._replace(start=Pose(x, y, wrap_angle(psi)))
        if self.variant.sampler.moves_obstacles:
            moved = (
                o._replace(x=numbers.obstacles[k, 0], y=numbers.obstacles[k, 1])
                for k, o in enumerate(scene.obstacles)
            )
            scene = scene._replace(obstacles=tuple(moved))
        physics = self.variant.sampler.physics
        if physics.size:
            scene = physics.scene(scene, [numbers.physics[k] for k in range(physics.size)])
        return scene

    def _start(self, numbers: Numbers) -> Any:
        return settled(self._loop(numbers), self.variant.settling_steps)

    def _sampled(self, pattern: Pattern) -> Callable[..., tuple[Any, Any]]:
        """One sample of one run with so many control instants before it and with it."""
        before, now = pattern

        def sample(numbers: Numbers, state: Any, at: tuple[Any, Any, Any], draws: Any) -> Any:
            t, dt, instants = at
            early = tuple(instants[k] for k in range(before))
            late = tuple(instants[before + k] for k in range(now))
            loop = self._loop(numbers)
            after, row = loop.sample(state, Tick(t, dt, early, late), draws)
            return after, self._figures(loop, after, row)

        return sample

    def _figures(self, loop: Loop, state: Any, row: tuple[Any, ...]) -> Figures:
        """The figures of one run after a sample, the deviation that of this sample."""
        _, jnp = _jax()
        seen = jnp.stack([jnp.asarray(value, jnp.float64) for value in row[: len(COLUMNS)]])
        broken = ~jnp.all(jnp.isfinite(seen)) | jnp.any(jnp.abs(seen[3:5]) >= LIMITS.wheel_speed)
        pose, progress = state.body.pose, state.progress
        (x0, y0, _), (xg, yg) = loop.scene.start, loop.scene.goal
        dx, dy, length = pose.x - x0, pose.y - y0, jnp.hypot(xg - x0, yg - y0)
        along = length > 0.0  # no line: the distance from the point itself
        aside = jnp.abs(dy * (xg - x0) - dx * (yg - y0)) / jnp.where(along, length, 1.0)
        return Figures(
            jnp.where(broken, FAILED, state.verdict),
            row[0],
            pose.x,
            pose.y,
            pose.psi,
            progress.path_length,
            progress.clearance,
            jnp.where(along, aside, jnp.hypot(dx, dy)),
        )

    # ----------------------------------------------------------------------------- many runs

    def _begin(self, numbers: Numbers) -> tuple[Any, Figures]:
        """First states of all runs, in the types that they keep, and figures of none."""
        _, jnp = _jax()
        state = self._starts(numbers)
        zeros = [jnp.zeros(self.batch_size)] * (len(Figures._fields) - 1)
        return state, Figures._make((jnp.zeros(self.batch_size, jnp.int64), *zeros))

    @cached_property
    def _starts(self) -> Callable[..., Any]:
        return first_states(self._start, self._types)

    @cached_property
    def _types(self) -> Any:
        return state_types(self._start, self._sampled((0, 1)), self._example, self._counts)

    @property
    def _counts(self) -> tuple[int, ...]:
        return tuple(s.draws for s in self.variant.scene.sensors.values())

    @property
    def _example(self) -> Numbers:
        mission, plant = self.setup.mission, self.variant.sampler.plant
        obstacles = np.array([(o.x, o.y) for o in mission.obstacles]).reshape(-1, 2)
        physics = self.variant.sampler.physics.nominal
        return Numbers(plant.theta, np.array(mission.start), obstacles, np.float64(0.0), physics)

    def _program(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        if patterns not in self._programs:
            self._programs[patterns] = compiled(self._block(patterns))
        return self._programs[patterns]

    def _block(self, patterns: tuple[Pattern, ...]) -> Callable[..., Any]:
        """All runs through a block of samples."""
        jax, jnp = _jax()
        types = self._types
        branches = [
            jax.vmap(self._sampled(pattern), in_axes=(0, 0, None, 0)) for pattern in patterns
        ]

        def keep(value: Any, kind: Any) -> Any:
            return jnp.asarray(value, kind)

        def block(numbers: Numbers, state: Any, ended: Figures, clock: Any, noise: Any) -> Any:
            def sample(carried: tuple[Any, Figures], given: Any) -> Any:
                state, ended = carried
                (t, dt, kind, instants), draws = given

                def one(branch: Any) -> Any:
                    def run(state: Any) -> Any:
                        after, seen = branch(numbers, state, (t, dt, instants), draws)
                        seen = Figures(
                            *(jnp.broadcast_to(v, (self.batch_size,)).astype(e.dtype)
                              for v, e in zip(seen, ended, strict=True))
                        )  # fmt: skip
                        return jax.tree.map(keep, after, types), seen

                    return run

                state, seen = jax.lax.switch(kind, [one(b) for b in branches], state)
                farthest = jnp.maximum(ended.max_deviation_m, seen.max_deviation_m)
                seen = seen._replace(max_deviation_m=farthest)
                over = ended.verdict != Verdict.GOES_ON
                ended = Figures(*(jnp.where(over, a, b) for a, b in zip(ended, seen, strict=True)))
                return (state, ended), (ended.verdict, jnp.stack([ended.x, ended.y, ended.psi]))

            return jax.lax.scan(sample, (state, ended), (clock, noise))

        return block

    def _noise(self, seeds: list[int]) -> Iterator[Any]:
        """Standard normal numbers of each block, (BLOCK, batch_size, count) for each sensor."""
        _, jnp = _jax()
        named = [
            ([generator(self.setup.noise_seed(s), name) for s in seeds], sensor.draws)
            for name, sensor in self.variant.scene.sensors.items()
        ]
        while True:
            yield tuple(
                jnp.asarray(np.stack([noise_block(s, n, BLOCK) for s in streams], axis=1))
                for streams, n in named
            )


def first_states(start: Callable[..., Any], types: Any) -> Callable[..., Any]:
    """First states of all runs, compiled, in the types that they keep."""
    jax, _ = _jax()

    def starts(numbers: Any) -> Any:
        state = jax.vmap(start)(numbers)
        return jax.tree.map(lambda value, kind: value.astype(kind), state, types)

    program: Callable[..., Any] = jax.jit(starts)
    return program


def state_types(
    start: Callable[..., Any], sampled: Callable[..., Any], one: Any, counts: Iterable[int]
) -> Any:
    """Types of the state's numbers after a sample, which it begins with as well.

    Args:
        start, sampled: the first state of a run, and one sample of it.
        one: what differs from run to run, of one of them.
        counts: numbers that each sensor draws.

    Raises:
        NotCompiledError: a law's state has another shape after a step than before.
    """
    jax, jnp = _jax()
    state = jax.eval_shape(start, one)
    draws = tuple(np.zeros(n) for n in counts)
    after = jax.eval_shape(sampled, one, state, (0.0, 0.0, np.zeros(1)), draws)[0]
    if jax.tree.structure(state) != jax.tree.structure(after) or any(
        a.shape != b.shape for a, b in zip(*map(jax.tree.leaves, (state, after)), strict=True)
    ):
        raise NotCompiledError("the state of a law changes its shape from step to step")
    return jax.tree.map(lambda a, b: jnp.result_type(a.dtype, b.dtype), state, after)


def settled(loop: Loop, steps: int) -> Any:
    """State before the first sample, after so many steps without drive, traced."""
    jax, jnp = _jax()
    state = loop.start()
    plant, nothing = jnp.asarray(state.plant, jnp.float64), jnp.zeros(2)
    if steps:
        plant = jax.lax.fori_loop(0, steps, lambda _, x: loop.plant.step(x, nothing)[0], plant)
    return jax.tree.map(jnp.asarray, state._replace(plant=plant))


def _jax() -> tuple[Any, Any]:
    """JAX and its array functions, imported where they are needed."""
    jax = jax_module()
    return jax, jax.numpy
