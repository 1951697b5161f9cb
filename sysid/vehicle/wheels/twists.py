"""From a wanted motion of the body to wheel speeds and steering angles, and back.

Both ways are least squares in m/s: of twists by the root of the mean square of the velocities that
the wheels would have, of wheels by the velocity at their contacts. What is left over is said.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.vehicle.wheels.constraints import (
    RANK_TOLERANCE,
    Angles,
    Scale,
    free_motions,
    rank,
    rows_of,
)
from sysid.vehicle.wheels.mobility import ROUNDING, nearest_turn
from sysid.vehicle.wheels.wheel import Wheel, velocity_at

MOST_LIMITED = 6
"""Wheels with limits whose ways of rolling can all be tried: 2⁶ take a fifth of a second."""

_EDGE = 1e-9
"""How far [rad] an angle that lies on a limit may stand beyond it by rounding."""


def steered(wheel: Wheel, twist: Array) -> float:
    """The steering angle for a twist: of two, the one within the limits, or the nearer one."""
    vx, vy = velocity_at(wheel.position, twist)
    if math.hypot(vx, vy) <= ROUNDING * (1.0 + float(np.abs(twist).max())):
        return wheel.angle  # the body turns about this wheel: any angle will do
    angle = wheel.angle + nearest_turn(math.atan2(vy, vx) - wheel.heading - wheel.angle)
    if wheel.angle_limits is None:
        return angle
    low, high = wheel.angle_limits
    turns = (angle, angle - math.pi, angle + math.pi)
    inside = (a for a in turns if low - _EDGE <= a <= high + _EDGE)
    return min(max(next(inside, angle), low), high)


def within_limits(z: Array, basis: Array, wheels: Sequence[Wheel], scale: Scale) -> Array:
    """The scaled twist nearest to z within a space, for which wheels need not turn too far.

    The velocity of a wheel's axis must lie between its directions at both limits, forward or
    backward: two inequalities for each way, so that for each choice of ways the twists are a cone.
    The nearest one of {y: G y ≥ 0} is w + Gᵀλ with min |w + Gᵀλ| over λ ≥ 0 (Moreau 1962).

    Args:
        z: wanted, (3,), in the space.
        basis: of the space, orthonormal, (3, d).
    """
    from scipy.optimize import nnls

    limited = [w for w in wheels if w.angle_limits and np.ptp(w.angle_limits) < math.pi]
    if not limited:
        return z
    if len(limited) > MOST_LIMITED:
        raise UsageError(
            f"{len(limited)} steered wheels have limits, of which {MOST_LIMITED} can be kept at "
            "once: leave out angle_limits of the others"
        )
    wanted = basis.T @ z
    best, error = np.zeros(basis.shape[1]), float(np.linalg.norm(wanted))
    for walls in _cones(limited, basis, scale):
        push = walls.T @ nnls(walls.T, -wanted)[0]
        if float(np.linalg.norm(push)) < error - ROUNDING:
            best, error = wanted + push, float(np.linalg.norm(push))
    nearest: Array = basis @ best
    return nearest


def _cones(wheels: Sequence[Wheel], basis: Array, scale: Scale) -> Iterator[Array]:
    """The inequalities G y ≥ 0, (2k, d), of every choice of ways in which wheels may roll."""
    pairs = []
    for wheel in wheels:
        low, high = wheel.angle_limits or (0.0, 0.0)
        between = rows_of([wheel.sliding_row(low), wheel.sliding_row(high)])
        pairs.append(np.array([[1.0], [-1.0]]) * between @ scale.matrix @ basis)
    for signs in product((1.0, -1.0), repeat=len(pairs)):
        yield np.vstack([sign * pair for sign, pair in zip(signs, pairs, strict=True)])


@dataclass(frozen=True)
class WheelCommand:
    """What one wheel does at a twist.

    Attributes:
        speed: [rad/s]; None where a caster finds no steady angle.
        angle: steering angle [rad]; None of wheels without one, and of such a caster.
        over: speed over the wheel's largest speed; None where that is not known.
    """

    speed: float | None
    angle: float | None = None
    over: float | None = None


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Wheel speeds and steering angles for a wanted twist.

    Attributes:
        wanted: ξ = (Vx, Vy, ψ̇), (3,) [m/s, m/s, rad/s].
        possible: the twist nearest to it that no wheel has to slide for, (3,).
        wheels: what each wheel does at the possible twist, by name.
        residual: root of the mean square of the velocity that the wheels lack of the wanted twist
            [m/s].
        exact: whether the wanted twist is possible, within :data:`RANK_TOLERANCE`.
    """

    wanted: Array
    possible: Array
    wheels: Mapping[str, WheelCommand]
    residual: float
    exact: bool

    @property
    def impossible(self) -> Array:
        """What of the wanted twist the wheels cannot give, (3,)."""
        rest = self.wanted - self.possible
        return np.where(np.abs(rest) <= ROUNDING * np.linalg.norm(self.wanted), 0.0, rest)

    @property
    def slowdown(self) -> float:
        """By how much speeds exceed what motors reach; 1 where none does."""
        return max(1.0, *(w.over or 0.0 for w in self.wheels.values()))


@dataclass(frozen=True, eq=False)
class ForwardKinematics:
    """The twist from measured wheel speeds.

    Attributes:
        twist: ξ, (3,) [m/s, m/s, rad/s].
        rolling: how much faster the rim of each wheel with a speed moves than the ground [m/s].
        sliding: how fast the contact of each fixed or steerable wheel moves to its left [m/s].
        residual: root of the mean square of all of these: 0 where the wheels agree, and a sign of
            slip, of wrong lengths or of wrong angles where they do not.
        agree: whether it is below :data:`RANK_TOLERANCE` of the fastest rim.
    """

    twist: Array
    rolling: Mapping[str, float]
    sliding: Mapping[str, float]
    residual: float
    agree: bool


def inverse(
    wheels: Sequence[Wheel], twist: Sequence[float], angles: Angles | None = None
) -> InverseKinematics:
    """What the wheels do for a wanted twist of the body.

    Steerable wheels are turned to it, within their limits, unless their angle is given; the rest
    is the projection of the twist on what the sliding constraints leave free.

    Args:
        twist: Vx, Vy [m/s], ψ̇ [rad/s] in the body frame.
        angles: steering angles that are held [rad].
    """
    wanted = np.array(twist, dtype=np.float64)
    if wanted.shape != (3,) or not np.isfinite(wanted).all():
        raise UsageError("a twist is three finite numbers: Vx and Vy in m/s, yaw rate in rad/s")
    scale, steered_angles = Scale.of(wheels), dict(angles or {})
    turned = [w for w in wheels if w.kind == "steerable" and w.name not in steered_angles]
    free = {w.name for w in turned}
    rigid = [w for w in wheels if w.constrains and w.name not in free]
    possible = _allowed(wanted, rigid, turned, steered_angles, scale)
    at = steered_angles | {w.name: steered(w, possible) for w in turned}
    lacking = float(np.linalg.norm(scale.scaled(wanted - possible)))
    size = float(np.linalg.norm(scale.scaled(wanted)))
    return InverseKinematics(
        wanted,
        possible,
        {w.name: _command(w, possible, at.get(w.name)) for w in wheels},
        lacking,
        lacking <= RANK_TOLERANCE * size,
    )


def forward(
    wheels: Sequence[Wheel], speeds: Mapping[str, float], angles: Angles | None = None
) -> ForwardKinematics:
    """The twist from wheel speeds, by least squares over rolling and sliding constraints.

    min over ξ of Σ (r cos γ ω − J1 ξ)² over wheels with a speed + Σ (C1 ξ)² over fixed and
    steerable wheels, in (m/s)².

    Args:
        speeds: ω by name [rad/s], of all wheels or some.
        angles: steering angles [rad]; those of the description unless given.
    """
    wrong = [name for name, speed in speeds.items() if not math.isfinite(speed)]
    if wrong:
        raise UsageError(f"the speed of {wrong[0]} is {speeds[wrong[0]]}: give a finite number")
    at, scale = angles or {}, Scale.of(wheels)
    loose = [w.name for w in wheels if w.kind == "caster" and w.name in speeds and w.name not in at]
    if loose:
        raise UsageError(
            f"the speed of the caster {loose[0]} is of no use without its angle; "
            "give its angle, or omit its speed"
        )
    rolling = [w for w in wheels if w.name in speeds]
    rigid = [w for w in wheels if w.constrains]
    roll = rows_of([w.rolling_row(at.get(w.name)) for w in rolling])
    slide = rows_of([w.sliding_row(at.get(w.name)) for w in rigid])
    rows = np.vstack([roll, slide]) @ scale.matrix
    rims = np.array([w.rolling_radius * speeds[w.name] for w in rolling])
    target = np.concatenate([rims, np.zeros(len(rigid))])
    z, _, order, _ = np.linalg.lstsq(rows, target, rcond=RANK_TOLERANCE)
    if order < 3:
        named = ", ".join(speeds) or "none"
        raise UsageError(
            f"the speeds of {named} leave the motion open: give those of more wheels, or describe "
            "what keeps the body from the other motions"
        )
    rest = target - rows @ z
    fastest = float(np.abs(target).max(initial=0.0))
    residual = _exact(math.sqrt(float(np.mean(rest**2))), fastest)
    return ForwardKinematics(
        twist=scale.matrix @ z,
        rolling={w.name: float(v) for w, v in zip(rolling, rest, strict=False)},
        sliding={w.name: -float(v) for w, v in zip(rigid, rest[len(rolling) :], strict=True)},
        residual=residual,
        agree=residual <= RANK_TOLERANCE * fastest,
    )


def speeds_determine_motion(wheels: Sequence[Wheel]) -> bool:
    """Whether the speeds of all wheels but casters, at the present angles, determine the motion."""
    rolling = [w.rolling_row() for w in wheels if w.kind != "caster"]
    sliding = [w.sliding_row() for w in wheels if w.constrains]
    return rank(rows_of([*rolling, *sliding]), Scale.of(wheels)) == 3


def largest_speed(wheels: Sequence[Wheel], direction: Sequence[float]) -> float | None:
    """The largest multiple of a twist that the wheels reach.

    Args:
        direction: a twist (Vx, Vy, ψ̇).

    Returns:
        The factor; 0 where the wheels cannot give this twist, None where no wheel that turns has
        a largest speed.
    """
    speeds = inverse(wheels, direction)
    if not speeds.exact:
        return 0.0
    shares = [w.over for w in speeds.wheels.values() if w.over]
    return 1.0 / max(shares) if shares else None


def _exact(rest: float, size: float) -> float:
    return 0.0 if rest <= ROUNDING * size else rest


def _allowed(
    wanted: Array,
    rigid: Sequence[Wheel],
    turned: Sequence[Wheel],
    steered_angles: Angles,
    scale: Scale,
) -> Array:
    """The nearest twist for which no rigid wheel slides and no turned one passes its limits."""
    basis = free_motions(rows_of([w.sliding_row(steered_angles.get(w.name)) for w in rigid]), scale)
    z = scale.scaled(wanted)
    size = float(np.linalg.norm(z))
    kept = within_limits(basis @ (basis.T @ z), basis, turned, scale)
    if _exact(float(np.linalg.norm(z - kept)), size) == 0.0:
        return wanted
    twist: Array = scale.matrix @ np.where(np.abs(kept) <= ROUNDING * size, 0.0, kept)
    return twist


def _command(wheel: Wheel, twist: Array, angle: float | None) -> WheelCommand:
    """Speed and angle of one wheel at a twist that is possible."""
    if wheel.kind == "caster":
        angle = _trailing(wheel, twist)
        if angle is None:
            return WheelCommand(None)
    elif wheel.kind == "steerable":
        angle = wheel.angle if angle is None else angle
    speed = float(np.dot(wheel.rolling_row(angle), twist)) / wheel.rolling_radius
    over = None if wheel.max_speed is None else abs(speed) / wheel.max_speed
    return WheelCommand(speed, angle, over)


def _trailing(wheel: Wheel, twist: Array) -> float | None:
    """The angle at which a caster trails steadily; None where its axis moves too slowly for that.

    Its contact does not slide when |v| sin(θ − φ) = d ψ̇, with v of direction θ the velocity of the
    axis; of the two solutions the one that lies behind the axis is stable.
    """
    vx, vy = velocity_at(wheel.position, twist)
    speed, swing = math.hypot(vx, vy), wheel.offset * float(twist[2])
    if speed == 0.0:
        return wheel.angle if swing == 0.0 else None
    if abs(swing) > speed:
        return None
    lead = math.asin(swing / speed)
    trails = -lead if wheel.offset > 0 else math.pi + lead
    return math.remainder(math.atan2(vy, vx) + trails - wheel.heading, 2.0 * math.pi)
