"""The field's repulsion for obstacles that move: the improved potential field (thesis 4.5)."""

from typing import Any

from sysid.robot.mission.contracts import Body, Disc
from sysid.vehicle.kinematics import Real

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
