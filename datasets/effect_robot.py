"""The robot of ``effect_twin.py`` in numbers: a plain track, and one number for each effect.

Every effect is a number of its own that does nothing at its default. Speeds and torques are in
rad/s: a torque is the speed that it would hold.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING or __package__:
    from sysid_datasets.outside_effects import NONE, Outside
else:  # run as a file, from a checkout in which nothing is installed
    from outside_effects import NONE, Outside

PWM_FULL = 20000.0
"""Pulse width of full drive [µs]."""

RADIUS, DISTANCE = 0.0215, 0.186
"""r of the sprockets and B between the track centres [m]."""

WARM = 0.3
"""h₀: the mean squared drive at which ``fade`` is the share of the gain lost."""


@dataclass(frozen=True)
class Track:
    """One track; speeds and torques in rad/s (a torque is the speed it would hold)."""

    gain: float = 20.0
    """K: speed at full drive."""
    time_constant: float = 0.25
    """τ [s]."""
    gain_factor: float = 1.0
    """K on this log over K of the clean robot."""
    time_constant_factor: float = 1.0
    """τ on this log over τ of the clean robot."""
    delay: float = 0.0
    """θ: dead time of the command beyond the hold [s]."""
    rate_limit: float = math.inf
    """r: fastest change of the drive [1/s]."""
    dead_forward: float = 0.0
    """δ+: drive below which nothing passes forward."""
    dead_backward: float = 0.0
    """δ−: the same backward."""
    dead_jump: float = 0.0
    """j: drive that appears at once at the edge of the dead zone."""
    saturation: float = math.inf
    """s: largest drive either way."""
    concavity: float = 0.0
    """κ: d → d (1 − κ|d|)."""
    backward_gain: float = 1.0
    """ρ: d → ρ d for d < 0."""
    fade: float = 0.0
    """l: share of the gain lost once the heat h is WARM."""
    fade_time: float = 30.0
    """θ_h of the heat θ_h dh/dt = d² − h [s]."""
    actuator_lag: float = 0.0
    """λ of the drive λ dd'/dt = d − d' [s]."""
    dead_time: float = 0.0
    """δ: what the bridge's dead time takes of the drive, by the sign of the current T − ω."""
    current_limit: float = math.inf
    """l: largest |T − ω| [rad/s]."""
    coupling: float = 0.0
    """g: T → T − g T_other."""
    load: float = 0.0
    """b: T → T − b."""
    drag: float = 0.0
    """q: T → T − q ω|ω| [s/rad]."""
    coulomb: float = 0.0
    """c: sliding friction, T → T − c sign ω; a track at rest stays while |T| ≤ c."""
    breakaway: float = 0.0
    """c_s − c: what a track at rest holds beyond c; falls as exp(−(ω/v_s)²)."""
    stribeck_speed: float = 1.0
    """v_s [rad/s]."""
    backward_viscous: float = 1.0
    """ρ: τ dω/dt = T − ρ ω for ω < 0."""
    coast_ratio: float = 1.0
    """τ while |ω| falls over τ while it grows."""
    freewheel: float = 0.0
    """Share of braking that is lost while the driver lets go; 1 is all."""
    freewheel_decay: float = 10.0
    """r: |ω| falls at this rate then [rad/s²]."""
    freewheel_overrun: float = 0.0
    """1: it lets go of a wheel that outruns the drive, too; 0: at zero or a falling command."""
    backlash: float = 0.0
    """g: gap between motor and wheel [rad]; while it is crossed the wheel coasts."""
    radius_ratio: float = 1.0
    """Effective over nominal radius; changes the pose alone."""
    sensor_lag: float = 0.0
    """λ of the reading λ dy/dt = ω − y [s]."""
    ripple: float = 0.0
    """a: the reading is ω + a sin(n angle + φ)."""
    ripple_lines: float = 1.0
    """n: periods in a turn."""
    ripple_from_reading: float = 0.0
    """1: the angle is the sum of the readings; 0: it is that of the wheel."""
    sensor_bias: float = 0.0
    """b: added to the reading."""
    unsigned: float = 0.0
    """Above 0 the reading is |ω|."""
    sensor_limit: float = math.inf
    """s: the reading is clipped to ±s."""
    noise_last: float = 0.0
    """1: the noise enters behind unsigned and clip (electronics); 0: before them (the shaft)."""
    quantum: float = 0.0
    """Step of the readings."""
    dropout_share: float = 0.0
    """Share of the readings that are lost, in bursts of 1 to 4."""
    dropout_holds: float = 0.0
    """1: a lost reading repeats the last one; 0: it is 0."""
    outside: Outside = NONE
    """An effect outside the catalogue."""


@dataclass(frozen=True)
class Robot:
    """Two tracks (left, right) and what they share."""

    tracks: tuple[Track, Track] = (Track(), Track())
    sag: float = 0.0
    """s: d → d (1 − s (|d_L| + |d_R|)/2)."""
    discharge: float = 0.0
    """b: d → d (1 − b t), t since the start of the log [1/s]."""
    inertia: float = 0.0
    """μ: τ ω̇ + μ √(τ τ_other) ω̇_other = T − ω, through the mass of the body."""
    slip: float = 0.0
    """i: both tracks lose i |ω_R − ω_L|/(|ω_R| + |ω_L|) of their way."""
    width_ratio: float = 1.0
    """B_eff/B: the yaw rate is divided by it."""
