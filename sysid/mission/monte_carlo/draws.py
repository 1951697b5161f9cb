"""What differs from run to run, drawn once, in NumPy: the same for one run alone and for many."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.errors import ModelError
from sysid.mission.clearance import inside
from sysid.mission.monte_carlo.varied_plant import VariedPlant
from sysid.mission.noise import generator
from sysid.mission.spec import Mission
from sysid.mission.variation import Variation

TRIES = 200
"""Draws of one run, of which one must be feasible. Where one in twenty is, all of these fail in one
run of thirty thousand; where fewer are, the plant is known too poorly to be drawn."""

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


class Draws(NamedTuple):
    """What K runs of one plant differ in.

    Attributes:
        seeds: of the runs.
        theta: the plant's parameters, (K, n).
        start: X, Y [m], ψ [rad], (K, 3).
        obstacles: X, Y of every obstacle [m], (K, obstacles, 2).
        slip: share of the way lost in a turn on the spot, (K,).
        inputs: the numbers behind them, standard normal before infeasible ones were drawn again,
            (K, m); see :attr:`Drawing.names`.
        redrawn: draws that were not feasible, (K,).
    """

    seeds: tuple[int, ...]
    theta: Array
    start: Array
    obstacles: Array
    slip: Array
    inputs: Array
    redrawn: Index


@dataclass(frozen=True, eq=False)
class Drawing:
    """How the runs of one mission and one plant are drawn.

    A run's numbers come from its own stream, in one order, and all of them are drawn whatever
    varies: to leave a quantity out changes no other. A draw that nobody could drive (parameters
    outside their bounds or an unstable plant; a start or goal inside an obstacle) is drawn again
    as a whole: what remains is the distribution on the condition that it can be driven.

    Attributes:
        mission: nominal.
        plant: what drives.
        variation: what varies, and by how much.
    """

    mission: Mission
    plant: VariedPlant
    variation: Variation

    @cached_property
    def _edges(self) -> tuple[int, int, int, int]:
        """Ends of model, start, obstacles, and floor with friction in a run's numbers."""
        obstacles = 4 + 2 * len(self.mission.obstacles)
        return 1, 4, obstacles, obstacles + 2

    @cached_property
    def varying(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Names of what varies, with the places of their numbers."""
        v, (_, _, floor, end) = self.variation, self._edges
        found: list[tuple[str, tuple[int, ...]]] = []
        if v.parameters and self.plant.size:
            found.append(("parameters", tuple(range(end, end + self.plant.size))))
        for k, part in enumerate(("x", "y", "psi")):
            if getattr(v.start, part):
                found.append((f"start.{part}", (1 + k,)))
        if v.obstacles:
            found.extend(
                (f"obstacles[{k + 1}]", (4 + 2 * k, 5 + 2 * k))
                for k in range(len(self.mission.obstacles))
            )
        if v.friction.slip:
            found.append(("friction.slip", (floor,)))
        if v.friction.dry and self.plant.has_friction:
            found.append(("friction.dry", (floor + 1,)))
        return tuple(found)

    @cached_property
    def moves_obstacles(self) -> bool:
        """Whether the places of obstacles differ from run to run."""
        return bool(self.variation.obstacles) and bool(self.mission.obstacles)

    def draw(self, seeds: Sequence[int]) -> Draws:
        """The numbers of these runs.

        Raises:
            ModelError: one run has no feasible draw.
        """
        total = self._edges[-1] + self.plant.size
        streams = [generator(s, "variation") for s in seeds]
        z = np.array([s.standard_normal(total) for s in streams]).reshape(len(seeds), total)
        redrawn = np.zeros(len(seeds), dtype=np.intp)
        found = self._made(seeds, z, redrawn)
        bad = np.flatnonzero(~self._feasible(found))
        for _ in range(TRIES - 1):
            if not len(bad):
                return found
            redrawn[bad] += 1
            # the model is chosen once: whether it can be driven is no reason to take another
            z[bad, 1:] = [streams[k].standard_normal(total)[1:] for k in bad]
            found = self._made(seeds, z, redrawn)
            bad = bad[~self._feasible(_rows(found, bad))]
        if not len(bad):
            return found
        raise ModelError(
            f"of {TRIES} draws for the run of seed {seeds[int(bad[0])]} none could be driven "
            "(parameters in their bounds, a stable plant, start and goal outside of obstacles): "
            "vary less, or identify the plant from a longer log"
        )

    def _made(self, seeds: Sequence[int], z: Array, redrawn: Index) -> Draws:
        v, mission = self.variation, self.mission
        _, start, floor, end = self._edges
        parts = zip((v.start.x, v.start.y, v.start.psi), mission.start, z[:, 1:4].T, strict=True)
        at = np.reshape([(o.x, o.y) for o in mission.obstacles], (1, -1, 2))
        moved = v.obstacles.deviation(z[:, start:floor]).reshape(len(z), -1, 2)
        dry = 1.0 + v.friction.dry.deviation(z[:, floor + 1])
        numbers = z[:, end:] if v.parameters else 0.0 * z[:, end:]
        used = [k for _, places in self.varying for k in places]
        return Draws(
            tuple(seeds),
            self.plant.drawn(numbers, np.maximum(dry, 0.0)),
            np.stack([value + s.deviation(column) for s, value, column in parts], axis=1),
            at + moved,
            np.minimum(np.abs(v.friction.slip.deviation(z[:, floor])), MOST_SLIP),
            z[:, used],
            redrawn,
        )

    def _feasible(self, d: Draws) -> NDArray[np.bool_]:
        mission = self.mission
        radii = np.array([o.radius for o in mission.obstacles])
        stands = np.array([o.velocity == (0.0, 0.0) for o in mission.obstacles], dtype=bool)
        found = np.ones(len(d.seeds), dtype=bool)
        always = np.ones(len(radii), dtype=bool)
        to_reach = (mission.goal, *mission.waypoints, *mission.path)
        # an obstacle that moves goes away again from what is to be reached later
        for point, counts in (
            (d.start[:, :2], always),
            *((np.array([p]), stands) for p in to_reach),
        ):
            apart = np.hypot(*np.moveaxis(d.obstacles - point[:, None], -1, 0))
            found &= np.all((apart > radii) | ~counts, axis=1)
        for polygon in mission.polygons:
            found &= [not inside(polygon, (x, y)) for x, y, _ in d.start.tolist()]
        if self._varies_theta:
            found[found] = self.plant.feasible(d.theta[found])
        return found

    @cached_property
    def _varies_theta(self) -> bool:
        return bool({"parameters", "friction.dry"} & {name for name, _ in self.varying})


def _rows(d: Draws, at: Index) -> Draws:
    """Some of the runs."""
    return Draws(
        tuple(d.seeds[k] for k in at.tolist()),
        d.theta[at],
        d.start[at],
        d.obstacles[at],
        d.slip[at],
        d.inputs[at],
        d.redrawn[at],
    )


MOST_SLIP = 0.9
"""Share of the way that slip takes at most: a robot that loses more does not turn."""
