"""Guidance: initial orientation, artificial potential field, speed and yaw references.

Plain floats and ``math`` throughout: guidance runs once a control period on a handful of numbers,
where array libraries would cost more than the arithmetic. Equations are the thesis's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.mission.spec import GuidanceSpec, Mission, Obstacle
from sysid.vehicle.kinematics import wrap_angle

Pose = tuple[float, float, float]
"""X [m], Y [m] and ψ [rad] in the inertial frame."""

NEAREST = 1e-6
"""Distances below this [m] count as this: the field is not defined in an obstacle's point."""


@dataclass(frozen=True)
class References:
    """What guidance asks of control.

    Attributes:
        speed: V_ref [m/s].
        psi: ψ_ref [rad] in (−π, π].
        rho_goal: distance to the goal [m].
        arrived: the "end of simulation" signal: the goal is within the tolerance.
    """

    speed: float
    psi: float
    rho_goal: float
    arrived: bool


@dataclass(frozen=True)
class InitialTurn:
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

    sense: int = 0
    reference: float = 0.0

    @classmethod
    def plan(cls, start: Pose, goal: tuple[float, float]) -> "InitialTurn":
        """Return the turn a start pose and a goal ask for; exactly behind counts as left."""
        x, y, psi = start
        bearing = wrap_angle(math.atan2(goal[1] - y, goal[0] - x) - psi)
        if abs(bearing) <= 0.5 * math.pi:
            return cls()
        sense = 1 if bearing > 0 else -1
        return cls(sense, wrap_angle(psi + sense * 0.75 * math.pi))

    def remaining(self, psi: float) -> float:
        """Return the angle still to turn before the heading lies in the goal's sector [rad]."""
        if self.sense == 0:
            return 0.0
        # Measured from the sector's middle: its near edge lies a quarter of π before it. A heading
        # that overshot the far edge has left the sector the other way and is done as well.
        to_middle: float = self.sense * wrap_angle(self.reference - psi)
        return max(0.0, to_middle - 0.25 * math.pi)

    def after(self, psi: float) -> "InitialTurn":
        """Return the turn that is left at heading ``psi``: this one, or none once in the sector."""
        return self if self.remaining(psi) > 0.0 else InitialTurn()


def attractive_force(
    x: float, y: float, goal: tuple[float, float], spec: GuidanceSpec
) -> tuple[float, float]:
    """Return F_att: −K(q − q_g) for ρ_g ≤ d, −dK(q − q_g)/ρ_g beyond (4.20, 4.24); in X and Y."""
    dx, dy = x - goal[0], y - goal[1]
    distance = math.hypot(dx, dy)
    gain = spec.K if distance <= spec.d else spec.K * spec.d / distance
    return -gain * dx, -gain * dy


def repulsive_force(
    x: float, y: float, obstacle: Obstacle, spec: GuidanceSpec
) -> tuple[float, float]:
    """Return F_rep = η(1/ρ − 1/ρ₀)(1/ρ²)∇ρ for ρ ≤ ρ₀, 0 for ρ > ρ₀ (4.22–4.25); in X and Y.

    ρ is the distance to the obstacle's point and ∇ρ the unit vector away from it. The print gives
    ρ ≤ ρ₀ for both cases.
    """
    dx, dy = x - obstacle.x, y - obstacle.y
    rho = max(math.hypot(dx, dy), NEAREST)
    if rho > spec.rho0:
        return 0.0, 0.0
    gain = spec.eta * (1.0 / rho - 1.0 / spec.rho0) / (rho * rho * rho)
    return gain * dx, gain * dy


def total_force(
    x: float,
    y: float,
    goal: tuple[float, float],
    obstacles: Sequence[Obstacle],
    spec: GuidanceSpec,
) -> tuple[float, float]:
    """Return F = F_att + Σ F_rep over the obstacles (4.26–4.28); in X and Y."""
    fx, fy = attractive_force(x, y, goal, spec)
    for obstacle in obstacles:
        rx, ry = repulsive_force(x, y, obstacle, spec)
        fx, fy = fx + rx, fy + ry
    return fx, fy


def speed_reference(
    x: float,
    y: float,
    goal: tuple[float, float],
    obstacles: Sequence[Obstacle],
    spec: GuidanceSpec,
) -> float:
    """Return V_d = V_max θʰ/(θʰ + Δʰ) [m/s], Δ = K_g/ρ_g + Σ K_i/ρ_i (4.30, 4.31).

    The sum runs over the obstacles within ρ₀ only (thesis 6.2.5).
    """
    delta = spec.Kg / max(math.hypot(x - goal[0], y - goal[1]), NEAREST)
    for obstacle in obstacles:
        rho = max(math.hypot(x - obstacle.x, y - obstacle.y), NEAREST)
        if rho <= spec.rho0:
            delta += spec.Ki / rho
    ratio: float = (delta / spec.theta) ** spec.h  # dividing by θʰ keeps large h within floats
    return spec.v_max / (1.0 + ratio)


def guide(mission: Mission, pose: Pose, turn: InitialTurn) -> tuple[References, InitialTurn]:
    """Return the references at an estimated pose, and what is left of the initial turn.

    Args:
        mission: goal, obstacles, tolerance and gains.
        pose: estimated X, Y [m], ψ [rad].
        turn: the initial turn as the previous call left it.

    Returns:
        The references, and the turn to pass to the next call. While turning, the speed reference
        is zero; then ψ_d = atan2(F_Y, F_X) (4.29) and V_d of (4.31).
    """
    x, y, psi = pose
    goal = mission.goal
    rho_goal = math.hypot(x - goal[0], y - goal[1])
    arrived = rho_goal <= mission.tolerance
    turn = turn.after(psi)
    if turn.sense:
        return References(0.0, turn.reference, rho_goal, arrived), turn
    fx, fy = total_force(x, y, goal, mission.obstacles, mission.guidance)
    speed = speed_reference(x, y, goal, mission.obstacles, mission.guidance)
    # Where the forces cancel exactly no direction is better than the present one.
    heading = math.atan2(fy, fx) if fx or fy else psi
    return References(speed, heading, rho_goal, arrived), turn
