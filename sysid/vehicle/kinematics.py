"""Planar kinematics of a tracked or differential-drive robot (frames: :mod:`sysid.vehicle.frames`).

Symbols and equation numbers are the thesis's (chapter 2): body frame b with x forward, y left,
z up; inertial frame i with X, Y in the floor; yaw ψ counter-clockwise positive; r the sprocket
radius [m], B the distance of the track centre lines [m], ω the sprocket speeds [rad/s].

Every function is pure and written with operators, so that floats, NumPy and JAX arrays all work;
functions that need a sine take the namespace as ``xp`` (``numpy``, ``jax.numpy``, or ``math`` for
plain floats, which is some ten times faster than NumPy on scalars).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError

Real: TypeAlias = Any
"""A float, or a NumPy or JAX array of floats that broadcasts against the other arguments."""


@dataclass(frozen=True)
class Geometry:
    """What turns sprocket speeds into the motion of the body.

    Attributes:
        r: sprocket radius [m].
        B: distance between the centre lines of the tracks [m].

    A length that a compiler traces is not checked.

    Raises:
        ModelError: a length is not positive and finite.
    """

    r: Real = 0.0215
    B: Real = 0.186

    def __post_init__(self) -> None:
        for name, value in (("sprocket radius r", self.r), ("track distance B", self.B)):
            if isinstance(value, int | float) and not (math.isfinite(value) and value > 0):
                raise ModelError(f"the {name} is {value}: give a length in metres above 0")


def body_velocity(omega_l: Real, omega_r: Real, geometry: Geometry) -> tuple[Real, Real]:
    """Return the forward speed Vx [m/s] and the yaw rate ψ̇ [rad/s] of the body.

    Vx = (r/2)(ω_L + ω_R),  Vy = 0,  ψ̇ = (r/B)(ω_R − ω_L)     (thesis 2.13)
    """
    forward = 0.5 * geometry.r * (omega_l + omega_r)
    yaw_rate = geometry.r / geometry.B * (omega_r - omega_l)
    return forward, yaw_rate


def wheel_speeds(forward: Real, yaw_rate: Real, geometry: Geometry) -> tuple[Real, Real]:
    """Return the sprocket speeds ω_L, ω_R [rad/s] of a forward speed and a yaw rate.

    ω_L = (Vx − ψ̇B/2)/r,  ω_R = (Vx + ψ̇B/2)/r     (thesis 2.13, inverted)
    """
    sideways = 0.5 * geometry.B * yaw_rate
    return (forward - sideways) / geometry.r, (forward + sideways) / geometry.r


def step_pose(
    x: Real,
    y: Real,
    psi: Real,
    forward: Real,
    yaw_rate: Real,
    dt: Real,
    xp: Any = np,
    lateral: Real | None = None,
) -> tuple[Real, Real, Real]:
    """Move a pose along the arc of constant Vx and ψ̇ for ``dt`` seconds; exact, not Euler.

    The chord of the arc has length Vx·dt·sin(a)/a with a = ψ̇·dt/2, in the direction ψ + a;
    this solves (2.14) exactly for constant speeds, straight lines (a = 0) included.

    Args:
        x, y: position in the inertial frame [m].
        psi: yaw [rad].
        forward: Vx [m/s].
        yaw_rate: ψ̇ [rad/s].
        dt: duration [s]; negative runs the arc backwards.
        xp: array namespace with ``cos`` and ``sin``.
        lateral: Vy to the left [m/s]; None for tracks that roll.

    Returns:
        The new x, y [m] and ψ [rad], ψ wrapped to (−π, π].
    """
    half = 0.5 * yaw_rate * dt
    # sin(a)/a without a branch: value 1 and derivative 0 at a = 0, for floats and traced arrays.
    # Below the smallest normal numbers a quotient has few digits left, so that they count as 0.
    straight = abs(half) < 1e-300
    chord = forward * dt * (xp.sin(half) + straight) / (half + straight)
    if lateral is not None:
        aside = lateral * dt * (xp.sin(half) + straight) / (half + straight)
        x, y = x - aside * xp.sin(psi + half), y + aside * xp.cos(psi + half)
    return (
        x + chord * xp.cos(psi + half),
        y + chord * xp.sin(psi + half),
        wrap_angle(psi + 2.0 * half),
    )


def chained_arcs(
    along: Array, turn: Array, aside: Array | None = None, start: Sequence[float] = (0.0, 0.0, 0.0)
) -> Array:
    """Poses x, y, ψ (not wrapped) at the ends of arcs driven one after the other, (N + 1, 3).

    Args:
        along, turn: length [m] and angle [rad] of each arc, (N,).
        aside: way to the left in each, (N,) [m]; None for tracks that roll.
        start: x, y [m], ψ [rad].
    """
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    middle, chord = heading[:-1] + 0.5 * turn, np.sinc(turn / (2.0 * np.pi))
    c, s = chord * np.cos(middle), chord * np.sin(middle)
    east, north = along * c, along * s
    if aside is not None:
        east, north = east - aside * s, north + aside * c
    x, y = (
        at + np.concatenate([[0.0], np.cumsum(way)])
        for at, way in zip(start, (east, north), strict=False)
    )
    return np.column_stack([x, y, heading])


def seen_from(psi: Array | float, change: Array) -> Array:
    """Ways forward and to the left, (…, 2) [m], of ways in the plane (…, 2) seen at headings ψ."""
    c, s = np.cos(psi), np.sin(psi)
    x, y = change[..., 0], change[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def wrap_angle(angle: Real) -> Real:
    """Return the angle [rad] plus the multiple of 2π that brings it into (−π, π]."""
    wrapped = math.pi - (math.pi - angle) % (2.0 * math.pi)
    # A remainder that rounds up to 2π would give −π, which the half-open interval leaves out.
    return wrapped + 2.0 * math.pi * (wrapped <= -math.pi)
