"""Escapes from the traps of a potential field: a virtual obstacle, or along the wall."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from sysid.robot.mission.clearance import nearest_point
from sysid.robot.mission.contracts import Disc, GuidanceInputs, Pose, References, Scene, State, Wall
from sysid.robot.mission.guidance.around_law import AroundLaw
from sysid.robot.mission.guidance.field import (
    InitialTurn,
    PotentialField,
    acting_points,
)
from sysid.robot.mission.guidance.traps import TRAP, Watch
from sysid.robot.mission.traits import Hold
from sysid.runners.trees import chosen
from sysid.vehicle.kinematics import Real, wrap_angle

FAR = 1e6
"""Where a virtual obstacle that is not needed lies [m]: nothing there acts."""


@dataclass(frozen=True)
class WallRule:
    """How a robot follows the surface of what holds it.

    Attributes:
        distance: to the surface, as a share of the field's range: inside it, clear of a body.
        turn: heading towards or away from the surface [rad] for each such distance off.
        ahead: a surface lies ahead where the cosine of its bearing is above this: a robot that
            drives at it along another one has to turn before it.
        leave: it leaves where it is this much [m] closer to the goal than where it was held: two
            steps of progress.
        settled: after this way [m] it remembers where it is …
        round: … and has been all around after this way [m] more …
        back: … within this distance [m] of that place.
    """

    distance: float = 0.4
    turn: float = 1.0
    ahead: float = 0.5
    leave: float = 2.0 * TRAP.progress
    settled: float = 0.5
    round: float = 1.0
    back: float = 0.2


WALL = WallRule()

VIRTUAL_OBSTACLES = 8
"""So many fill a trap a few times the field's range deep; who needs more gets nowhere."""


class EscapeState(NamedTuple):
    """What the field, the watch and the way out remember."""

    turn: InitialTurn
    watch: Watch
    hold: Real
    out: State


@dataclass(frozen=True)
class Escaping(AroundLaw):
    """A potential field that notices that it holds the robot, and leads it out.

    Attributes:
        out: the way out, which says what the field is to see and changes its references.
    """

    law: PotentialField
    out: "VirtualObstacles | AlongWall"

    def start(self, scene: Scene, xp: Any) -> EscapeState:
        watch = Watch(scene.to_goal(scene.start, xp), scene.start.x, scene.start.y)
        turn = self.law.start(scene, xp)
        return EscapeState(turn, watch, int(Hold.NOTHING), self.out.start(xp))

    def step(
        self, state: EscapeState, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[EscapeState, References]:
        pose, t = inputs.estimate.pose, inputs.t
        turning = state.turn.remaining(pose.psi, xp) > 0.0
        pushed = self.law.is_pushed(pose, inputs.scene, t, xp)
        trapped = state.watch.trapped & pushed & xp.logical_not(turning)
        named = self.law.hold_at(*state.watch.middle(xp), inputs.scene, t, xp)
        hold = xp.where(trapped, named, state.hold)
        way: Any = self.out
        out, seen = way.step(state.out, trapped, state.watch, inputs, dt, xp)
        turn, references = self.law.step(state.turn, inputs._replace(scene=seen), dt, xp)
        references = way.lead(out, references, inputs, xp)
        watch = chosen(trapped | turning, state.watch.restarted(pose, xp), state.watch, xp)
        watch = watch.after(pose, seen.to_goal(pose, xp), dt, self.law.rho0, xp)
        busy = references.detour | references.gives_up
        said = xp.where(references.hold != 0, references.hold, hold)
        references = references._replace(hold=xp.where(busy, said, int(Hold.NOTHING)))
        return EscapeState(turn, watch, hold, out), references

    def to_go(self, state: EscapeState, pose: Pose, scene: Scene, xp: Any) -> Real:
        return self.law.to_go(state.turn, pose, scene, xp)


# A virtual obstacle -------------------------------------------------------------------------------


class VirtualState(NamedTuple):
    """The virtual obstacles so far.

    Attributes:
        places: of each [m]; far away where there is none.
        rho: distance to the goal where the first of these was put [m].
        way: driven since then [m].
        active: whether the robot has not yet come nearer than that.
        gave_up: whether one more would have been needed, or the way grew too long.
    """

    places: tuple[tuple[Real, Real], ...]
    used: Real
    rho: Real
    way: Real
    active: Real
    gave_up: Real


@dataclass(frozen=True)
class VirtualObstacles:
    """Where the robot is held a point is put that repels like an obstacle and so fills the trap.

    They go once the robot is closer to the goal than where it was held, and nothing repels it.

    Attributes:
        field: by whose gains they repel.
    """

    field: PotentialField

    def start(self, xp: Any) -> VirtualState:
        return VirtualState(((FAR, FAR),) * VIRTUAL_OBSTACLES, 0, xp.inf, 0.0, False, False)

    def step(
        self, out: VirtualState, trapped: Any, watch: Watch, inputs: GuidanceInputs, dt: Real,
        xp: Any,
    ) -> tuple[VirtualState, Scene]:  # fmt: skip
        scene = inputs.scene
        rho = scene.to_goal(inputs.estimate.pose, xp)
        free = xp.logical_not(self.field.is_pushed(inputs.estimate.pose, scene, inputs.t, xp))
        passed = out.active & (rho < out.rho - WALL.leave) & free
        full = out.used >= VIRTUAL_OBSTACLES
        added = trapped & xp.logical_not(full)
        x, y = watch.middle(xp)
        places = []
        for k, (px, py) in enumerate(out.places):
            px, py = xp.where(passed, FAR, px), xp.where(passed, FAR, py)
            here = added & (out.used == k)
            places.append((xp.where(here, x, px), xp.where(here, y, py)))
        going_on = out.active & xp.logical_not(passed)
        first = added & xp.logical_not(going_on)
        way = xp.where(first, 0.0, out.way + abs(inputs.estimate.speed) * dt)
        # Each of them may be gone around once.
        too_long = going_on & (way > 2.0 * math.pi * self.field.rho0 * VIRTUAL_OBSTACLES)
        out = VirtualState(
            places=tuple(places),
            used=out.used + xp.where(added, 1, 0),
            rho=xp.where(first, rho, out.rho),
            way=way,
            active=going_on | added,
            gave_up=out.gave_up | (trapped & full) | too_long,
        )
        discs = tuple(Disc(px, py, 0.0) for px, py in out.places)
        return out, scene._replace(obstacles=(*scene.obstacles, *discs))

    def lead(
        self, out: VirtualState, references: References, inputs: GuidanceInputs, xp: Any
    ) -> References:
        """The field's own, at the speed that real obstacles allow."""
        pose, scene = inputs.estimate.pose, inputs.scene
        acting = acting_points(scene, pose.x, pose.y, inputs.t, xp)
        speed = self.field.speed(pose.x, pose.y, scene.goal, acting, xp)
        return references._replace(
            speed=xp.where(references.speed > 0.0, speed, 0.0),  # not in the turn on the spot
            detour=out.active,
            gives_up=out.gave_up,
        )


# Along the wall -----------------------------------------------------------------------------------


class WallState(NamedTuple):
    """Where and how a surface is followed.

    Attributes:
        side: 1 with the surface on the left, −1 on the right.
        rho: distance to the goal where it began [m].
        way: driven since then [m].
        x, y: place that ends a round [m].
        gave_up: whether the robot has been all around.
    """

    following: Real
    side: Real
    rho: Real
    way: Real
    x: Real
    y: Real
    gave_up: Real


@dataclass(frozen=True)
class AlongWall:
    """The surface that holds the robot is followed until the goal lies away from it and is closer.

    Who comes back to where the round began has found no such place, and there is none: the goal is
    walled off (the rule of the Bug algorithms; Lumelsky and Stepanov 1987).

    Attributes:
        distance: at which it is followed [m].
    """

    distance: float

    def start(self, xp: Any) -> WallState:
        return WallState(False, 1.0, xp.inf, 0.0, 0.0, 0.0, False)

    def step(
        self, out: WallState, trapped: Any, watch: Watch, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[WallState, Scene]:
        """Begin where it is trapped, end where the goal is closer and lies off the surface."""
        scene, body = inputs.scene, inputs.estimate
        pose, rho = body.pose, scene.to_goal(body.pose, xp)
        gap, nx, ny = nearest_surface(scene, pose, inputs.t, None, xp)[:3]
        off = (scene.goal[0] - pose.x) * nx + (scene.goal[1] - pose.y) * ny
        leaves = out.following & (rho < out.rho - WALL.leave) & (off >= 0.0)
        begins = trapped & xp.logical_not(out.following) & (gap < FAR)
        # Of both directions along the surface the one that is nearer to its heading.
        along = nx * xp.sin(pose.psi) - ny * xp.cos(pose.psi)
        way = xp.where(begins, 0.0, out.way + abs(body.speed) * dt)
        unsettled = begins | (way < WALL.settled)
        x, y = xp.where(unsettled, pose.x, out.x), xp.where(unsettled, pose.y, out.y)
        back = xp.hypot(pose.x - x, pose.y - y) < WALL.back
        round_over = out.following & back & (way >= WALL.settled + WALL.round)
        return WallState(
            following=(out.following & xp.logical_not(leaves)) | begins,
            side=xp.where(begins, xp.where(along >= 0.0, 1.0, -1.0), out.side),
            rho=xp.where(begins, rho, out.rho),
            way=way,
            x=x,
            y=y,
            gave_up=out.gave_up | round_over,
        ), scene

    def lead(
        self, out: WallState, references: References, inputs: GuidanceInputs, xp: Any
    ) -> References:
        """Along the surface at a distance; between two surfaces in the middle."""
        pose, scene = inputs.estimate.pose, inputs.scene
        gap, nx, ny, opposite = nearest_surface(scene, pose, inputs.t, out.side, xp)
        distance = xp.minimum(self.distance, 0.5 * (gap + opposite))
        off = xp.clip(WALL.turn * (gap - distance) / self.distance, -1.0, 1.0)
        along = xp.arctan2(out.side * nx, -out.side * ny)
        psi = wrap_angle(xp.where(gap < FAR, along, pose.psi) + out.side * off)
        return references._replace(
            psi=xp.where(out.following, psi, references.psi),
            detour=out.following,
            gives_up=out.gave_up,
            hold=xp.where(out.gave_up, int(Hold.NO_WAY_THROUGH), references.hold),
        )


def nearest_surface(
    scene: Scene, pose: Pose, t: Real, side: Real | None, xp: Any
) -> tuple[Real, Real, Real, Real]:
    """The nearest surface: its distance, the direction away from it, and what lies opposite.

    Args:
        t: now [s].
        side: only what is ahead or on this side counts, 1 left or −1 right; None for everything.

    Returns:
        Distance [m], the unit vector from the surface to the robot in X and Y, and the distance of
        the nearest surface that does not count [m]; a distance is far where there is nothing.
    """
    gap, nx, ny, opposite = FAR, 1.0, 0.0, FAR
    cos, sin = xp.cos(pose.psi), xp.sin(pose.psi)
    for px, py, radius in _near_points(scene, pose, t, xp):
        dx, dy = pose.x - px, pose.y - py
        rho = xp.maximum(xp.hypot(dx, dy), 1e-6)
        ux, uy, distance = dx / rho, dy / rho, rho - radius
        beside = True
        if side is not None:
            ahead = -(ux * cos + uy * sin) > WALL.ahead
            beside = ahead | (side * (ux * sin - uy * cos) > 0.0)
        nearer = beside & (distance < gap)
        opposite = xp.where(beside, opposite, xp.minimum(opposite, distance))
        gap = xp.where(nearer, distance, gap)
        nx, ny = xp.where(nearer, ux, nx), xp.where(nearer, uy, ny)
    return gap, nx, ny, opposite


def _near_points(scene: Scene, pose: Pose, t: Real, xp: Any) -> list[tuple[Real, Real, Real]]:
    """The point of each obstacle and the nearest of each piece of a wall, with the radius [m]."""
    points = [(o.x, o.y, o.radius) for o in (o.at(t) for o in scene.obstacles)]
    pieces = [Wall(piece) for wall in scene.walls for piece in pairwise(wall.points)]
    return points + [(*nearest_point(w, pose.x, pose.y, xp), 0.0) for w in pieces]


def leading_out(field: PotentialField) -> PotentialField | Escaping:
    """The field with the way out that it names."""
    if field.escape == "virtual-obstacle":
        return Escaping(field, VirtualObstacles(field))
    if field.escape == "wall":
        return Escaping(field, AlongWall(WALL.distance * field.rho0))
    return field
