"""Guidance by an artificial potential field, after a turn on the spot towards goals behind.

Equations are the thesis's; obstacles that move repel as in the improved field (thesis 4.5).
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from sysid.data.record import Array
from sysid.robot.mission.clearance import nearest_point
from sysid.robot.mission.contracts import Body, Disc, GuidanceInputs, Point, Pose, References, Scene
from sysid.robot.mission.settings import Gain, GuidanceSettings, Positive
from sysid.robot.mission.traits import GuidanceAdvice, GuidanceTraits, Hold
from sysid.vehicle.kinematics import Real, wrap_angle

BRAKING = 0.3
"""Deceleration with which robot and obstacle are thought to avoid each other [m/s²]: a robot of the
thesis's size that comes to rest from its 0.3 m/s in a second, on any floor."""

CLOSEST = 0.02
"""What is left of a distance after braking counts as at least this [m]: the push stays finite."""


def moves(disc: Disc) -> bool:
    """Whether an obstacle moves, or may move in another run of a batch."""
    vx, vy = disc.vx, disc.vy
    return not (isinstance(vx, int | float) and isinstance(vy, int | float) and vx == vy == 0)


def braked_distance(body: Body, disc: Disc, xp: Any) -> tuple[Real, Real, Real, Real]:
    """ρ' = ρ − v²/2a: what is left of the distance when both have braked.

    v is the speed at which robot and obstacle approach, 0 where they part; a obstacle at rest keeps
    its ρ, as published.

    Returns:
        ρ' [m], v [m/s], and the relative velocity across the line between both in X and Y [m/s].
    """
    dx, dy = body.pose.x - disc.x, body.pose.y - disc.y
    rho = xp.maximum(xp.hypot(dx, dy), 1e-6)
    nx, ny = -dx / rho, -dy / rho  # from the robot to the obstacle
    wx = body.speed * xp.cos(body.pose.psi) - disc.vx
    wy = body.speed * xp.sin(body.pose.psi) - disc.vy
    along = wx * nx + wy * ny
    rests = (disc.vx == 0) & (disc.vy == 0)
    v = xp.where(rests, 0.0, xp.maximum(along, 0.0))
    gap = xp.maximum(rho - v * v / (2.0 * BRAKING), xp.minimum(rho, CLOSEST))
    return gap, v, wx - along * nx, wy - along * ny


def moving_force(body: Body, disc: Disc, eta: float, rho0: float, xp: Any) -> tuple[Real, Real]:
    """F = η(1/ρ' − 1/ρ₀)(1/ρ'²)(∇ρ + v/(aρ)·w) for ρ' ≤ ρ₀, 0 beyond; in X and Y.

    ρ' is the distance left after braking, v the speed of approach and w the relative velocity
    across the line between both: −∇ of ½η(1/ρ' − 1/ρ₀)², which is the published field's where
    v = 0. A robot is pushed earlier, the faster both approach, and to the side on which it passes.
    After Ge and Cui (2002), Dynamic motion planning for mobile robots using potential field method.
    """
    gap, v, wx, wy = braked_distance(body, disc, xp)
    dx, dy = body.pose.x - disc.x, body.pose.y - disc.y
    rho = xp.maximum(xp.hypot(dx, dy), 1e-6)
    push = eta * (1.0 / gap - 1.0 / rho0) / (gap * gap)
    outside = gap > rho0
    across = v / (BRAKING * rho)
    return (
        xp.where(outside, 0.0, push * (dx / rho + across * wx)),
        xp.where(outside, 0.0, push * (dy / rho + across * wy)),
    )


NEAREST = 1e-6
"""Distances below this [m] count as this: the field is not defined in an obstacle's point."""

CANCELS = 0.5
"""A force below this share of the attraction, in the middle of where a robot goes to and fro, means
a local minimum: at the minimum itself it is nothing, and half is reached only at the edge of the
orbits of a robot that cannot stand still."""


class InitialTurn(NamedTuple):
    """The turn on the spot that a goal behind the robot asks for (thesis 6.2.4).

    Around the start pose the plane has a front area, |bearing| ≤ π/2, and two rear sectors, left
    (π/2, π] and right (−π, −π/2). A goal in a rear sector makes the robot turn on the spot until
    its heading lies in that sector; then the field takes over. The thesis prints ±π as the yaw
    reference, which only gives the sense of rotation: wrapped, −π becomes +π and the robot would
    turn the long way round. The middle of the sector, ±3π/4, is the reference here: it has the
    same sense from every heading of the turn, and exceeds a yaw command limit as ±π does.

    Attributes:
        sense: +1 turns left, −1 right, 0 not at all (finished or never needed).
        reference: yaw reference, the middle of the sector [rad], inertial.
    """

    sense: Real = 0.0
    reference: Real = 0.0

    @classmethod
    def plan(cls, start: Pose, goal: tuple[Real, Real], xp: Any = np) -> "InitialTurn":
        """Return the turn a start pose and a goal ask for; exactly behind counts as left."""
        x, y, psi = start
        bearing = wrap_angle(xp.arctan2(goal[1] - y, goal[0] - x) - psi)
        side = xp.where(bearing > 0, 1.0, -1.0)
        sense = xp.where(abs(bearing) <= 0.5 * math.pi, 0.0, side)
        middle = wrap_angle(psi + sense * 0.75 * math.pi)
        return cls(sense, xp.where(sense == 0, 0.0, middle))

    def remaining(self, psi: Real, xp: Any = np) -> Real:
        """Return the angle still to turn before the heading lies in the goal's sector [rad]."""
        # Measured from the sector's middle: its near edge lies a quarter of π before it. A heading
        # that overshot the far edge has left the sector the other way and is done as well.
        to_middle = self.sense * wrap_angle(self.reference - psi)
        return xp.where(self.sense == 0, 0.0, xp.maximum(0.0, to_middle - 0.25 * math.pi))

    def after(self, psi: Real, xp: Any = np) -> "InitialTurn":
        """Return the turn that is left at heading ``psi``: this one, or none once in the sector."""
        unfinished = self.remaining(psi, xp) > 0.0
        return InitialTurn(
            xp.where(unfinished, self.sense, 0.0), xp.where(unfinished, self.reference, 0.0)
        )


class PotentialField(GuidanceSettings):
    """Gains of the potential field and of the references (thesis 4.19–4.31, 6.2.5).

    While the initial turn lasts the speed reference is zero; then ψ_d = atan2(F_Y, F_X) (4.29) and
    V_d of (4.31).

    Attributes:
        K: attraction.
        d: distance to the goal where the parabolic attraction becomes conic [m].
        rho0: distance to an obstacle's point within which it repels [m].
        eta: repulsion.
        v_max: largest speed reference [m/s].
        theta, h: shape of the speed reference V_max θʰ/(θʰ + Δʰ).
        Kg, Ki: weight of the goal and of each obstacle in range in Δ [m].
        escape: the way out of a local minimum or an oscillation: none, a virtual obstacle where the
            robot is held, or along the wall that holds it.
    """

    K: Positive = 0.15
    d: Positive = 2.0
    rho0: Positive = 0.7
    eta: Gain = 0.05
    v_max: Positive = 0.3
    theta: Positive = 2.0
    h: Annotated[float, Field(gt=0, le=10)] = 1.0
    Kg: Gain = 0.4
    Ki: Gain = 1.0
    escape: Literal["none", "virtual-obstacle", "wall"] = "none"

    @property
    def reach(self) -> float:
        """Distance from an obstacle's point within which it repels [m]."""
        return self.rho0

    @property
    def advice(self) -> GuidanceAdvice:
        return GuidanceAdvice(
            faster="raise v_max",
            slower="lower v_max",
            wider="raise eta or rho0",
            closer="lower eta" if self.eta > 0 else "",
            escape="set guidance.escape to wall" if self.escape == "none" else "",
        )

    @property
    def traits(self) -> GuidanceTraits:
        """Published references, which no limit changes."""
        return GuidanceTraits(top_speed=self.v_max)

    def start(self, scene: Scene, xp: Any) -> InitialTurn:
        return InitialTurn.plan(scene.start, scene.goal, xp)

    def step(
        self, state: InitialTurn, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[InitialTurn, References]:
        """References at the estimated pose, and what is left of the initial turn."""
        scene, pose = inputs.scene, inputs.estimate.pose
        x, y, psi = pose
        turn = state.after(psi, xp)
        acting = acting_points(scene, x, y, inputs.t, xp)
        moving = [o for o in acting if moves(o)]
        resting = [o for o in acting if not moves(o)] if moving else acting
        fx, fy = self.force(x, y, scene.goal, resting, xp)
        for o in moving:
            rx, ry = moving_force(inputs.estimate, o, self.eta, self.rho0, xp)
            fx, fy = fx + rx, fy + ry
        speed = self.speed(x, y, scene.goal, acting, xp)
        # Where the forces cancel exactly no direction is better than the present one.
        heading = xp.where((fx == 0) & (fy == 0), psi, xp.arctan2(fy, fx))
        turning = turn.sense != 0
        return turn, References(
            speed=xp.where(turning, 0.0, speed),
            psi=xp.where(turning, turn.reference, heading),
            arrived=scene.to_goal(pose, xp) <= scene.tolerance,
        )

    def potential(self, x: Real, y: Real, scene: Scene, xp: Any) -> Real:
        """U whose −∇U is the force: ½Kρ_g² or dKρ_g − ½Kd² (4.19), Σ ½η(1/ρ − 1/ρ₀)² (4.21)."""
        rho_g = xp.hypot(x - scene.goal[0], y - scene.goal[1])
        near, far = 0.5 * self.K * rho_g**2, self.K * self.d * (rho_g - 0.5 * self.d)
        total = xp.where(rho_g <= self.d, near, far)
        for o in acting_points(scene, x, y, 0.0, xp):
            rho = xp.maximum(xp.hypot(x - o.x, y - o.y), NEAREST)
            push = 0.5 * self.eta * (1.0 / rho - 1.0 / self.rho0) ** 2
            total = total + xp.where(rho <= self.rho0, push, 0.0)
        return total

    def hold(self, scene: Scene, t: Array, x: Array, y: Array) -> Hold:
        """A local minimum or an oscillation; nothing where nothing repelled."""
        if not np.any(self.is_pushed(Pose(x, y, 0.0), scene, t)):
            return Hold.NOTHING
        now, middle = float(t[-1]), (float(x.mean()), float(y.mean()))
        # Of several legs it was on the one whose goal the forces cancel before, if any.
        legs = (scene._replace(goal=goal) for goal in scene.targets)
        holds = [Hold(int(self.hold_at(*middle, leg, now))) for leg in legs]
        return Hold.LOCAL_MINIMUM if Hold.LOCAL_MINIMUM in holds else Hold.OSCILLATION

    def to_go(self, state: InitialTurn, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The distance to the goal plus the track travel B/2·|angle| still to turn [m]."""
        still_to_turn = state.remaining(pose.psi, xp)
        return scene.to_goal(pose, xp) + 0.5 * scene.geometry.B * still_to_turn

    def is_pushed(self, pose: Pose, scene: Scene, t: Real, xp: Any = np) -> Any:
        """Whether anything repels at a place."""
        acting = acting_points(scene, pose.x, pose.y, t, xp)
        fx, fy = self.force(pose.x, pose.y, scene.goal, acting, xp)
        ax, ay = self.attraction(pose.x, pose.y, scene.goal, xp)
        return (fx != ax) | (fy != ay)

    def hold_at(self, x: Real, y: Real, scene: Scene, t: Real, xp: Any = np) -> Real:
        """What holds a robot that goes to and fro about a place, as a number of :class:`Hold`."""
        fx, fy = self.force(x, y, scene.goal, acting_points(scene, x, y, t, xp), xp)
        pull = xp.hypot(*self.attraction(x, y, scene.goal, xp))
        return xp.where(
            xp.hypot(fx, fy) < CANCELS * pull, int(Hold.LOCAL_MINIMUM), int(Hold.OSCILLATION)
        )

    def attraction(self, x: Real, y: Real, goal: Point, xp: Any = np) -> Point:
        """Return F_att: −K(q − q_g) for ρ_g ≤ d, −dK(q − q_g)/ρ_g beyond (4.20, 4.24); in X and
        Y."""
        dx, dy = x - goal[0], y - goal[1]
        distance = xp.hypot(dx, dy)
        beyond = self.K * self.d / xp.maximum(distance, self.d)
        gain = xp.where(distance <= self.d, self.K, beyond)
        return -gain * dx, -gain * dy

    def repulsion(self, x: Real, y: Real, obstacle: Disc, xp: Any = np) -> Point:
        """Return F_rep = η(1/ρ − 1/ρ₀)(1/ρ²)∇ρ for ρ ≤ ρ₀, 0 for ρ > ρ₀ (4.22–4.25); in X and Y.

        ρ is the distance to the obstacle's point and ∇ρ the unit vector away from it. The print
        gives ρ ≤ ρ₀ for both cases.
        """
        dx, dy = x - obstacle.x, y - obstacle.y
        rho = xp.maximum(xp.hypot(dx, dy), NEAREST)
        push = self.eta * (1.0 / rho - 1.0 / self.rho0) / (rho * rho * rho)
        outside = rho > self.rho0
        return xp.where(outside, 0.0, push * dx), xp.where(outside, 0.0, push * dy)

    def force(
        self, x: Real, y: Real, goal: Point, obstacles: Sequence[Disc], xp: Any = np
    ) -> Point:
        """Return F = F_att + Σ F_rep over the obstacles (4.26–4.28); in X and Y."""
        fx, fy = self.attraction(x, y, goal, xp)
        for obstacle in obstacles:
            rx, ry = self.repulsion(x, y, obstacle, xp)
            fx, fy = fx + rx, fy + ry
        return fx, fy

    def speed(self, x: Real, y: Real, goal: Point, obstacles: Sequence[Disc], xp: Any = np) -> Real:
        """Return V_d = V_max θʰ/(θʰ + Δʰ) [m/s], Δ = K_g/ρ_g + Σ K_i/ρ_i (4.30, 4.31).

        The sum runs over the obstacles within ρ₀ only (thesis 6.2.5).
        """
        delta = self.Kg / xp.maximum(xp.hypot(x - goal[0], y - goal[1]), NEAREST)
        for obstacle in obstacles:
            rho = xp.maximum(xp.hypot(x - obstacle.x, y - obstacle.y), NEAREST)
            delta = delta + xp.where(rho <= self.rho0, self.Ki / rho, 0.0)
        ratio = (delta / self.theta) ** self.h  # dividing by θʰ keeps large h within floats
        return self.v_max / (1.0 + ratio)


def acting_points(scene: Scene, x: Real, y: Real, t: Real, xp: Any = np) -> tuple[Disc, ...]:
    """The points that repel at ``t``: those of the obstacles, and of each wall the nearest one.

    A wall acts as one obstacle, however many pieces it is drawn in (thesis 4.22: q_obs).
    """
    walls = (Disc(*nearest_point(wall, x, y, xp), 0.0) for wall in scene.walls)
    return (*(o.at(t) for o in scene.obstacles), *walls)
