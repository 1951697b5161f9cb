"""Effects between the tracks and the ground: they change what speeds do to the pose.

Forward speed v = r(ω_L + ω_R)/2 and yaw rate ψ̇ = r(ω_R − ω_L)/B before slip.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Length, Place, Signal, State
from sysid.effects.programmes import TURNS

P = Mapping[str, Signal]


def _slip(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # w holds both track speeds in its last axis; both lose a share that grows with turning
    left, right = w[..., 0], w[..., 1]
    turning = xp.abs(right - left) / xp.maximum(xp.abs(right) + xp.abs(left), 1e-6)
    return w * (1.0 - p["share"] * turning[..., None]), s


def _radius(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return w * p["rho"], s


def _width(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    mean = 0.5 * (w[..., :1] + w[..., 1:])
    return mean + p["ratio"] * (w - mean), s


def _slip_in_numbers(value: float, error: float, side: int) -> str:
    return (
        f"Wheels or tracks slip where the robot turns: on the spot they lose "
        f"{100 * value:.3g} ± {100 * error:.2g} % of their way."
    )


def _radius_in_numbers(value: float, error: float, side: int) -> str:
    return (
        f"The {('left', 'right')[side]} side rolls {value:.4g} ± {error:.2g} times as far a turn "
        "as its radius says, so that equal wheel speeds drive a circle."
    )


def _width_in_numbers(value: float, error: float, side: int) -> str:
    return (
        f"Every turn is {value:.4g} ± {error:.2g} times what the distance B says: left "
        f"and right act at {1.0 / value:.4g} B."
    )


SLIP, SLIP_SHARE = "track-slip", "share"
"""The effect, and its parameter, that another floor changes."""

EFFECTS = (
    Effect(
        SLIP,
        "vehicle",
        Place.POSE,
        "v → v(1 − i |ω_R − ω_L| / (|ω_R| + |ω_L|))",
        "Wheels or tracks slip where the robot turns.",
        "Turns fall short of what the wheels say; straight runs do not.",
        "Turns of several radii, straight runs between them.",
        (EffectParameter(SLIP_SHARE, "", 0.0, 0.0, 0.9, (0.1, 0.3), "one"),),
        _slip,
        shared=True,
        ties=("track-width",),
        programmes=(TURNS,),
        in_numbers=_slip_in_numbers,
    ),
    Effect(
        "radius-mismatch",
        "vehicle",
        Place.POSE,
        "one side's effective radius × ρ",
        "One side rolls farther per turn than the other.",
        "Equal wheel speeds drive a circle.",
        "Long straight runs.",
        (EffectParameter("rho", "", 1.0, 0.7, 1.4, (0.95, 1.05), "one"),),
        _radius,
        programmes=(TURNS,),
        length=Length.RADIUS,
        in_numbers=_radius_in_numbers,
    ),
    Effect(
        "track-width",
        "vehicle",
        Place.POSE,
        "yaw rate × B/B_eff",
        "Left and right act at another distance than they are apart.",
        "Every turn falls short by one factor.",
        "Turns on the spot and turns of several radii.",
        (EffectParameter("ratio", "", 1.0, 0.4, 2.0, (0.9, 1.1), "one"),),
        _width,
        shared=True,
        ties=("track-slip",),
        programmes=(TURNS,),
        length=Length.TRACK_DISTANCE,
        in_numbers=_width_in_numbers,
    ),
)
