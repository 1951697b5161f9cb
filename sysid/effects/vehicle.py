"""Effects between the tracks and the ground: they change what speeds do to the pose.

Forward speed v = r(ω_L + ω_R)/2 and yaw rate ψ̇ = r(ω_R − ω_L)/B before slip.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, State

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


EFFECTS = (
    Effect(
        "track-slip",
        "vehicle",
        Place.POSE,
        "v → v(1 − i |ω_R − ω_L| / (|ω_R| + |ω_L|))",
        "Wheels or tracks slip where the robot turns.",
        "Turns fall short of what the wheels say; straight runs do not.",
        "Turns of several radii, straight runs between them.",
        (EffectParameter("share", "", 0.0, 0.0, 0.9, (0.1, 0.3), "one"),),
        _slip,
        shared=True,
        ties=("track-width",),
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
    ),
)
