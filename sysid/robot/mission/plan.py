"""The references of guidance without a plant: its field, its path, and where it ends."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.robot.mission.clearance import box_around, point_clearance
from sysid.robot.mission.contracts import (
    Body,
    Disc,
    Guidance,
    GuidanceInputs,
    HasPotential,
    Pose,
    Scene,
)
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.spec import Mission


@dataclass(frozen=True)
class FlowRule:
    """How ways along the references are followed.

    Attributes:
        step: length of one step [m]: a fifth of the tolerance a mission has by default.
        detour: a way this many times longer than the straight line leads nowhere.
        still: a way that came less than this [m] forward in 50 steps has ended.
        apart: ends closer together than this [m] are one place.
        cells: points along each side of the map of the field.
        margin: room around start, goal and obstacles [m]: the range of the published field.
    """

    step: float = 0.02
    detour: float = 6.0
    still: float = 0.1
    apart: float = 0.15
    side: int = 13
    cells: int = 61
    margin: float = 0.7


FLOW = FlowRule()

FACTORS = (0.25, 0.5, 1.0, 1.75, 2.5)
"""A gain is shown at these multiples of its value."""


@dataclass(frozen=True, eq=False)
class Curves:
    """One quantity against a distance, for several values of one gain.

    Attributes:
        values: of the gain, the mission's own in the middle.
        distance: to the goal or to an obstacle's point [m], (N,).
        quantity: (values, N).
    """

    gain: str
    values: tuple[float, ...]
    distance: Array
    quantity: Array


@dataclass(frozen=True, eq=False)
class Plan:
    """What a guidance law makes of a scene.

    Attributes:
        way: the way from the start along the references, (N, 2) [m].
        length_m: of the way [m].
        min_clearance_m: smallest distance from it to a surface [m]; None where there is none.
        time_s: at the references of speed [s]; None where it does not arrive.
        ends: places where ways from all over the map end that are not the goal, (x, y) [m].
        arriving_share: share of these ways that lead to the goal.
        x, y: the map, (M,) each [m].
        psi, speed: references on the map, (M, M): rows are y [rad, m/s].
        potential: on the map, (M, M); None where the law has none.
        attraction, repulsion: size of the force of a potential field; None for other laws.
        speeds: reference of speed without obstacles, for the gains that shape it.
    """

    way: Array
    arrives: bool
    length_m: float
    min_clearance_m: float | None
    time_s: float | None
    ends: tuple[tuple[float, float], ...]
    arriving_share: float
    x: Array
    y: Array
    psi: Array
    speed: Array
    potential: Array | None
    attraction: Curves | None
    repulsion: Curves | None
    speeds: tuple[Curves, ...]

    def summary(self) -> dict[str, Any]:
        """Everything but the maps and curves, as plain values for a JSON document."""
        return {
            "way": {
                "arrives": self.arrives,
                "length_m": self.length_m,
                "min_clearance_m": self.min_clearance_m,
                "time_s": self.time_s,
                "end": {"x": float(self.way[-1, 0]), "y": float(self.way[-1, 1])},
            },
            "ends_besides_goal": [{"x": x, "y": y} for x, y in self.ends],
            "arriving_share": self.arriving_share,
        }


def plan(mission: Mission) -> Plan:
    """Follow a mission's guidance without a plant: a point that follows its references exactly.

    Obstacles that move are taken where they are at the start.
    """
    law, scene = mission.way_guidance, mission.scene()
    x, y = _map(scene)
    start = np.array([[scene.start.x, scene.start.y]])
    ways, arrived, times = _followed(law, scene, start)
    way = ways[:, 0][np.isfinite(ways[:, 0, 0])]
    if not arrived[0]:  # it ends where it first came to the place that it did not leave
        way = way[: 1 + int(np.argmax(np.hypot(*(way - way[-1]).T) < FLOW.still))]
    ends, share = _ends(law, scene, x, y)
    grid_x, grid_y = np.meshgrid(x, y)
    psi, speed = _references(law, scene, grid_x, grid_y)
    clearance = float(np.min(point_clearance(scene, way[:, 0], way[:, 1], 0.0, np)))
    potential = None
    if isinstance(mission.guidance, HasPotential):
        potential = np.asarray(mission.guidance.potential(grid_x, grid_y, scene, np))
    published = mission.guidance if isinstance(mission.guidance, PotentialField) else None
    return Plan(
        way=way,
        arrives=bool(arrived[0]),
        length_m=float(np.sum(np.hypot(*np.diff(way, axis=0).T))),
        min_clearance_m=clearance if math.isfinite(clearance) else None,
        time_s=float(times[0]) if arrived[0] else None,
        ends=ends,
        arriving_share=share,
        x=x,
        y=y,
        psi=psi,
        speed=speed,
        potential=potential,
        attraction=None if published is None else _attraction(published),
        repulsion=None if published is None else _repulsion(published),
        speeds=() if published is None else _speeds(published),
    )


def _map(scene: Scene) -> tuple[Array, Array]:
    points = ((scene.start.x, scene.start.y), *scene.path, *scene.targets)
    low, high = box_around(points, scene.obstacles, scene.walls, FLOW.margin)
    (left, bottom), (right, top) = low, high
    return np.linspace(left, right, FLOW.cells), np.linspace(bottom, top, FLOW.cells)


def _references(law: Guidance, scene: Scene, x: Array, y: Array) -> tuple[Array, Array]:
    """References at standstill at each place, after any turn on the spot."""
    towards = np.arctan2(scene.goal[1] - y, scene.goal[0] - x)
    here = scene._replace(start=Pose(x, y, towards))
    seen = GuidanceInputs(0.0, Body(Pose(x, y, towards), 0.0 * x, 0.0 * x), here)
    with np.errstate(all="ignore"):
        references = law.step(law.start(here, np), seen, 0.0, np)[1]
    return references.psi + 0.0 * x, references.speed + 0.0 * x


def _followed(law: Guidance, scene: Scene, starts: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Ways along the references, (steps, starts, 2), whether each arrives, and when [s].

    A way is NaN after its end.
    """
    x, y = starts.T.copy()
    psi = np.arctan2(scene.goal[1] - y, scene.goal[0] - x)
    here = scene._replace(start=Pose(x, y, psi))
    straight = float(np.max(np.hypot(scene.goal[0] - x, scene.goal[1] - y)))
    straight += sum(math.dist(a, b) for a, b in zip(scene.way, scene.way[1:], strict=False))
    state, t = law.start(here, np), np.zeros_like(x)
    arrived, going = np.zeros(len(x), dtype=bool), np.ones(len(x), dtype=bool)
    ways = [np.column_stack([x, y])]
    dt = np.zeros_like(x)
    for k in range(1, math.ceil(FLOW.detour * max(straight, 1.0) / FLOW.step)):
        seen = GuidanceInputs(t, Body(Pose(x, y, psi), 0.0 * x, 0.0 * x), here)
        with np.errstate(all="ignore"):
            state, references = law.step(state, seen, dt, np)
        psi = references.psi + 0.0 * x
        arrived |= going & references.arrived
        going &= ~arrived & np.isfinite(psi)
        if k > 50:
            back = ways[k - 51]
            going &= np.hypot(x - back[:, 0], y - back[:, 1]) > FLOW.still
        if not going.any():
            break
        dt = np.where(going, FLOW.step / np.maximum(references.speed, 1e-3), 0.0)
        t = t + dt
        x = np.where(going, x + FLOW.step * np.cos(psi), x)
        y = np.where(going, y + FLOW.step * np.sin(psi), y)
        ways.append(np.where(going[:, None], np.column_stack([x, y]), np.nan))
    return np.array(ways), arrived, t


def _ends(
    law: Guidance, scene: Scene, x: Array, y: Array
) -> tuple[tuple[tuple[float, float], ...], float]:
    """Where ways from all over the map end besides the goal, and the share that arrives."""
    grid = np.meshgrid(np.linspace(x[0], x[-1], FLOW.side), np.linspace(y[0], y[-1], FLOW.side))
    starts = np.column_stack([g.ravel() for g in grid])
    starts = starts[point_clearance(scene, starts[:, 0], starts[:, 1], 0.0, np) > 0]
    ways, arrived, _ = _followed(law, scene, starts)
    last = np.array([w[np.isfinite(w[:, 0])][-1] for w in ways.transpose(1, 0, 2)])
    places: list[tuple[float, float]] = []
    for px, py in last[~arrived]:
        inside = x[0] <= px <= x[-1] and y[0] <= py <= y[-1]
        if inside and all(math.dist(p, (px, py)) > FLOW.apart for p in places):
            places.append((float(px), float(py)))
    return tuple(places), float(np.mean(arrived)) if len(arrived) else 0.0


def _curves(
    law: PotentialField, gain: str, distance: Array, quantity: Callable[[PotentialField], Array]
) -> Curves:
    """A quantity of the law at several values of one gain."""
    values = tuple(f * getattr(law, gain) for f in FACTORS)
    laws = (law.model_copy(update={gain: v}) for v in values)
    return Curves(gain, values, distance, np.array([quantity(each) for each in laws]))


def _attraction(law: PotentialField) -> Curves:
    """Size of the attraction against the distance to the goal (thesis 6.25)."""
    x = np.linspace(0.0, max(4.0, 2.0 * law.d), 161)
    return _curves(law, "K", x, lambda g: abs(g.attraction(-x, 0.0, (0.0, 0.0))[0]))


def _repulsion(law: PotentialField) -> Curves:
    """Size of the repulsion against the distance to an obstacle's point (thesis 6.26)."""
    x, point = np.linspace(0.15, 1.2 * law.rho0, 161), Disc(0.0, 0.0, 0.0)
    return _curves(law, "eta", x, lambda g: abs(g.repulsion(x, 0.0 * x, point)[0]))


def _speeds(law: PotentialField) -> tuple[Curves, ...]:
    """V_d against the distance to the goal without obstacles (thesis 6.27, 6.29, 6.30)."""
    x = np.linspace(0.0, 5.0, 201)

    def speed(gains: PotentialField) -> Array:
        return np.asarray(gains.speed(x, 0.0 * x, (0.0, 0.0), ()))

    return tuple(_curves(law, gain, x, speed) for gain in ("theta", "h", "Kg"))
