"""Random samples of what varies between runs, by NumPy: the same for one run and for many."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError
from sysid.robot.mission.batch.physics import PhysicsSampler
from sysid.robot.mission.batch.varied_plant import Flags, VariedPlant
from sysid.robot.mission.contracts import TurnsTracks
from sysid.robot.mission.noise import generator
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import Variation
from sysid.vehicle.floor import Polygon

TRIES = 200
"""Draws of a start and of obstacles, of which one must be free: where one in twenty is, all of
these fail in one run of thirty thousand."""

TRIES_OF_PLANT = 20
"""Draws of a plant's parameters, of which one should be feasible. Where half of them are, all fail
in one run of a million; where hardly any is, more would only cost time."""

_FIRST = 2**47
"""The first seed of a run, of as many: among a million two alike are less likely than one in two
hundred, and nobody types one by chance."""


def run_seeds(seed: int, runs: int) -> list[int]:
    """The seed of every run of a batch; each of them replays its run alone."""
    return [
        int(np.random.SeedSequence((seed, k)).generate_state(1, np.uint64)[0]) % _FIRST + _FIRST
        for k in range(runs)
    ]


def is_run_seed(seed: int) -> bool:
    """Whether a seed is that of a run of a batch: they all have fifteen digits, others have not."""
    return seed >= _FIRST


class Numbers(NamedTuple):
    """What one run differs in, plain or traced, or many runs along axis 0; see :class:`Samples`."""

    theta: Any
    start: Any
    obstacles: Any
    slip: Any
    physics: Any
    gains: Any

    def run(self, k: int) -> "Numbers":
        """One of many runs, in plain numbers."""
        return Numbers(*(values[k].tolist() for values in self))


class Samples(NamedTuple):
    """What K runs of one plant differ in.

    Attributes:
        theta: the plant's parameters, (K, n).
        start: X, Y [m], ψ [rad], (K, 3).
        obstacles: X, Y of every obstacle [m], (K, obstacles, 2).
        slip: slip in a turn on the spot, (K,).
        inputs: the numbers behind them, standard normal before infeasible ones were drawn again,
            (K, m); see :attr:`Sampler.names`.
        redrawn: draws that were not feasible, (K,).
        pulled: whether the plant's parameters were drawn less far than their errors say, (K,).
        physics: of vehicle and floor, (K, numbers); see :class:`PhysicsSampler`.
    """

    seeds: tuple[int, ...]
    theta: Array
    start: Array
    obstacles: Array
    slip: Array
    inputs: Array
    redrawn: Index
    pulled: Flags
    physics: Array

    @property
    def numbers(self) -> Numbers:
        """What the runs take."""
        drawn = self.theta, self.start, self.obstacles, self.slip, self.physics
        return Numbers(*drawn, np.zeros((len(self.seeds), 0)))


@dataclass(frozen=True, eq=False)
class Sampler:
    """How the runs of one mission and one plant are drawn.

    A run's numbers come from streams of its own, and all of them are drawn whatever varies: to
    leave a quantity out changes no other. A draw that cannot be driven (parameters outside their
    bounds or an unstable plant; a start or goal inside an obstacle) is drawn again: what remains is
    the distribution on the condition that it can be driven. Where hardly any draw of a plant is
    feasible, because its log does not determine some directions of θ, those are drawn less far; a
    path of one input that would be unstable by itself stays as estimated.

    Attributes:
        gains: names of the controller's gains that are not drawn but given to each run.
    """

    mission: Mission
    plant: VariedPlant
    variation: Variation
    gains: tuple[str, ...] = ()

    @property
    def _floor(self) -> int:
        """Place of slip in a run's numbers, behind start and obstacles; dry friction follows."""
        return 3 + 2 * len(self.mission.obstacles)

    @cached_property
    def varying(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Names of what varies, with the indices of their numbers."""
        v, floor = self.variation, self._floor
        varying: list[tuple[str, tuple[int, ...]]] = []
        if v.parameters and self.plant.size:
            varying.append(("parameters", tuple(range(floor + 2, floor + 2 + self.plant.size))))
        for k, part in enumerate(("x", "y", "psi")):
            if getattr(v.start, part):
                varying.append((f"start.{part}", (k,)))
        if v.obstacles:
            varying.extend(
                (f"obstacles[{k + 1}]", (3 + 2 * k, 4 + 2 * k))
                for k in range(len(self.mission.obstacles))
            )
        if self.slips:
            varying.append(("friction.slip", (floor,)))
        if v.friction.dry and self.plant.has_friction:
            varying.append(("friction.dry", (floor + 1,)))
        first = floor + 2 + self.plant.size
        varying.extend((name, (first + k,)) for k, name in enumerate(self.physics.names))
        return tuple(varying)

    @cached_property
    def physics(self) -> PhysicsSampler:
        """How mass and soils are drawn."""
        return PhysicsSampler(self.mission, self.variation)

    @property
    def slips(self) -> bool:
        """Whether a slip varies: a motion that turns the tracks has its own."""
        turns = isinstance(self.mission.motion, TurnsTracks)
        return bool(self.variation.friction.slip) and not turns

    @cached_property
    def moves_obstacles(self) -> bool:
        """Whether the places of obstacles differ from run to run."""
        return bool(self.variation.obstacles) and bool(self.mission.obstacles)

    def draw(self, seeds: Sequence[int]) -> Samples:
        """The numbers of these runs."""
        z, again, bad = _drawn(seeds, "places", self._floor + 2, self._free, TRIES)
        if len(bad):
            raise ModelError(
                f"in {TRIES} draws for the run of seed {seeds[int(bad[0])]} start or goal lay "
                "inside an obstacle: vary start and obstacles less"
            )
        start, obstacles, slip, dry = self._placed(z)
        theta, p, redrawn, pulled = self._plants(seeds, dry)
        used = [k for _, indices in self.varying for k in indices]
        q = np.array([generator(s, "vehicle").standard_normal(self.physics.size) for s in seeds])
        inputs = np.concatenate([z, p, q], axis=1)[:, used]
        again = again + redrawn
        physics = self.physics.drawn(q)
        return Samples(tuple(seeds), theta, start, obstacles, slip, inputs, again, pulled, physics)

    def varied(self, numbers: Numbers) -> Mission:
        """The mission of one run; its numbers are taken as they are."""
        mission = self.mission
        changed: dict[str, Any] = {}
        if self.variation.start:
            changed["start"] = tuple(numbers.start[k] for k in range(3))
        if self.moves_obstacles:
            changed["obstacles"] = tuple(
                o.model_copy(update={"x": numbers.obstacles[k][0], "y": numbers.obstacles[k][1]})
                for k, o in enumerate(mission.obstacles)
            )
        if self.gains:
            values = {name: numbers.gains[k] for k, name in enumerate(self.gains)}
            changed["control"] = cast(TunedSettings, mission.control).with_gains(values)
        physics = [numbers.physics[k] for k in range(self.physics.size)]
        varied = mission.model_copy(update=changed)
        return varied.with_physics(self.physics.overrides(physics))

    def _plants(self, seeds: Sequence[int], dry: Array) -> tuple[Array, Array, Index, Flags]:
        """θ, the numbers behind it, draws made again, and which were pulled."""
        pulled = np.zeros(len(seeds), dtype=bool)
        if not self._varies_theta:
            z = np.zeros((len(seeds), self.plant.size))
            return self.plant.drawn(z, dry), z, np.zeros(len(seeds), dtype=np.intp), pulled
        factor = 1.0 if self.variation.parameters else 0.0

        def feasible(z: Array, runs: Index) -> Flags:
            thetas = self.plant.drawn(factor * z, dry[runs])
            return self.plant.feasible(self.plant.settled(thetas))

        z, again, bad = _drawn(seeds, "parameters", self.plant.size, feasible, TRIES_OF_PLANT)
        drawn = self.plant.drawn(factor * z, dry)
        theta = self.plant.settled(drawn)
        pulled = np.any(theta != drawn, axis=1)
        if len(bad):
            theta[bad] = self.plant.pulled(factor * z[bad], dry[bad])
            pulled[bad] = True
        return theta, z, again, pulled

    def _placed(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """Start, obstacles, slip and factor of dry friction from the numbers of runs."""
        v, mission, floor = self.variation, self.mission, self._floor
        parts = zip((v.start.x, v.start.y, v.start.psi), mission.start, z[:, :3].T, strict=True)
        start = np.stack([value + s.deviation(column) for s, value, column in parts], axis=1)
        at = np.reshape([(o.x, o.y) for o in mission.obstacles], (1, -1, 2))
        moved = v.obstacles.deviation(z[:, 3:floor]).reshape(len(z), -1, 2)
        slip = np.minimum(np.abs(v.friction.slip.deviation(z[:, floor])), MOST_SLIP)
        dry = np.maximum(1.0 + v.friction.dry.deviation(z[:, floor + 1]), 0.0)
        return start, at + moved, slip, dry

    def _free(self, z: Array, runs: Index) -> Flags:
        """Which runs begin outside of obstacles and can reach what they have to."""
        mission = self.mission
        start, obstacles, _, _ = self._placed(z)
        radii = np.array([o.radius for o in mission.obstacles])
        stands = np.array([o.velocity == (0.0, 0.0) for o in mission.obstacles], dtype=bool)
        free = np.ones(len(z), dtype=bool)
        always = np.ones(len(radii), dtype=bool)
        to_reach = (mission.goal, *mission.waypoints, *mission.path)
        # an obstacle that moves goes away again from what is to be reached later
        for point, counts in ((start[:, :2], always), *((np.array([p]), stands) for p in to_reach)):
            apart = np.hypot(*np.moveaxis(obstacles - point[:, None], -1, 0))
            free &= np.all((apart > radii) | ~counts, axis=1)
        for polygon in mission.polygons:
            free &= ~Polygon(polygon).contains(start[:, 0], start[:, 1], np)
        return free

    @cached_property
    def _varies_theta(self) -> bool:
        return bool({"parameters", "friction.dry"} & {name for name, _ in self.varying})


def _drawn(
    seeds: Sequence[int],
    name: str,
    size: int,
    feasible: Callable[[Array, Index], Flags],
    tries: int,
) -> tuple[Array, Index, Index]:
    """Standard normal numbers (K, size) of each run's stream, drawn again until they are feasible.

    Args:
        feasible: (numbers of some runs, which runs) → flags.

    Returns:
        The numbers, how many draws of each run were made again, and which runs remain infeasible.
    """
    streams = [generator(s, name) for s in seeds]
    z = np.array([s.standard_normal(size) for s in streams]).reshape(len(seeds), size)
    redrawn, bad = np.zeros(len(seeds), dtype=np.intp), np.arange(len(seeds))
    for k in range(tries):
        bad = bad[~feasible(z[bad], bad)]
        if not len(bad) or k == tries - 1:
            break
        redrawn[bad] += 1
        z[bad] = [streams[int(b)].standard_normal(size) for b in bad]
    return z, redrawn, bad


MOST_SLIP = 0.9
"""Share of the way that slip takes at most: a robot that loses more does not turn."""
