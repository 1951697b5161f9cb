"""Effects between tracks and ground: they change the pose that wheel speeds produce.

Forward speed v = r(ω_L + ω_R)/2 and yaw rate ψ̇ = r(ω_R − ω_L)/B before slip.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Law,
    Length,
    Memory,
    OnGround,
    Place,
    Signal,
    State,
    Texts,
    nothing,
)
from sysid.effects.lag import followed, lagging
from sysid.effects.programmes import LEVELS, REVERSALS, TURNS

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


MOST_LOST = 0.95
"""Share of the way that a track loses at most."""


def _lost(xp: Any, w: Signal, p: P) -> Signal:
    """Speeds of which both tracks lose a share, more where the wheels turn faster."""
    fast = 0.5 * (xp.abs(w[..., :1]) + xp.abs(w[..., 1:]))
    return w * (1.0 - xp.minimum(p["share"] + p["growth"] * fast, MOST_LOST))


def _both(w: Signal) -> Signal:
    return 0.5 * (w[..., :1] + w[..., 1:])


INSTANT = 1e-9
"""Seconds for each rad/s in which a ground that never lets go carries a side along [s²/rad]."""


def _longitudinal_constants(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """What a lag needs, and by how much the ground carries a side along in a sample [rad/s]."""
    return {**lagging(xp, p, dt, kept), "reach": dt / xp.maximum(p["spin"], INSTANT)}


def _longitudinal(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: speeds that follow, speeds they follow, speeds that the ground has carried the sides to
    carried = xp.clip(w, s[2] - p["reach"], s[2] + p["reach"])
    way = _lost(xp, carried, p)
    follows = p["decay"] * s[0] + p["earlier"] * s[1] + p["now"] * way
    return way + _both(follows - way), (follows, way, carried)


def _lag(p: P) -> float:
    """The lag of both tracks [s]."""
    return float(np.ravel(p["lag"])[0])


def _longitudinal_record(w: Signal, p: P, dt: float) -> Signal:
    way = _lost(np, _carried(w, float(np.ravel(p["spin"])[0]), dt), p)
    return way + _both(followed(way, _lag(p), dt) - way)


def _carried(w: Signal, spin: float, dt: float) -> Signal:
    """Speeds to which the ground carries both sides of a record, (N, 2): no faster than it can."""
    reach = dt / max(spin, INSTANT)
    out = np.array(w, dtype=np.float64)
    for side in out.T:
        (jumps,) = np.nonzero(np.abs(np.diff(side)) > reach)
        if not len(jumps):
            continue
        speeds, k = side.tolist(), 1  # numbers of Python: one by one they are read much faster
        for jump in (jumps + 1).tolist():
            k = max(k, jump)
            while k < len(speeds) and abs(speeds[k] - speeds[k - 1]) > reach:
                up = speeds[k] > speeds[k - 1]
                speeds[k] = speeds[k - 1] + (reach if up else -reach)
                k += 1
        side[:] = speeds
    return out


def _scrub(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    follows = p["decay"] * s[0] + p["earlier"] * s[1] + p["now"] * w
    late = follows - w
    return w + late - _both(late), (follows, w)


def _scrub_record(w: Signal, p: P, dt: float) -> Signal:
    late = followed(w, _lag(p), dt) - w
    return w + late - _both(late)


def _sideways(xp: Any, forward: Signal, yaw_rate: Signal, p: P) -> Signal:
    """A centre of rotation off the middle, and a slide against the centripetal acceleration."""
    return -(p["ahead"][..., 0] + p["drift"][..., 0] * forward) * yaw_rate


def _in_numbers(text: str, scale: int = 1) -> Callable[[float, float, int], str]:
    """A sentence with value and standard error, both times ``scale``, in its places."""
    return lambda value, error, side: text.format(scale * value, scale * error)


_drift_in_numbers = _in_numbers(
    "The vehicle slides outwards in turns that it drives, {:.3g} ± {:.2g} mm/s for each m/s² of "
    "centripetal acceleration; a position that comes as many ms later than the heading looks "
    "alike.",
    1000,
)
_share_in_numbers = _in_numbers(
    "Wheels or tracks slip in straight drive, too: they lose {:.3g} ± {:.2g} % of the distance at "
    "any speed, if the given radius is right.",
    100,
)
_growth_in_numbers = _in_numbers(
    "Wheels or tracks slip more the faster they turn: at 10 rad/s they lose {:.3g} ± {:.2g} % of "
    "the distance; no radius does that.",
    1000,
)
_load_in_numbers = _in_numbers(
    "Wheels or tracks slip while they speed up and slow down: the vehicle's speed follows theirs "
    "with a lag of {:.3g} ± {:.2g} s; no radius does that.",
)
_scrub_in_numbers = _in_numbers(
    "Turning follows the wheels with a lag, as wheels or tracks scrub and the body's inertia holds "
    "it: {:.3g} ± {:.2g} s.",
)
_slip_in_numbers = _in_numbers(
    "Wheels or tracks slip where the robot turns: on the spot they lose {:.3g} ± {:.2g} % of the "
    "distance.",
    100,
)


def _ahead_in_numbers(value: float, error: float, side: int) -> str:
    where = "ahead of" if value > 0.0 else "behind"
    return (
        f"The centre of rotation lies {abs(value):.3g} ± {error:.2g} m {where} the logged point, "
        "which slides sideways in every turn: the centre of mass is off the middle, or the logged "
        "point is."
    )


def _spin_in_numbers(value: float, error: float, side: int) -> str:
    return (
        "Wheels or tracks spin and slide where they change their speed faster than the ground can "
        f"carry the vehicle along: by {1.0 / value:.3g} ± {error / value**2:.2g} rad/s each second."
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
        Texts(
            "v → v(1 − i |ω_R − ω_L| / (|ω_R| + |ω_L|))",
            "Wheels or tracks slip where the robot turns.",
            "Turns fall short of what the wheels say; straight runs do not.",
            "Turns of several radii, straight runs between them.",
        ),
        (EffectParameter(SLIP_SHARE, "", 0.0, 0.0, 0.9, (0.1, 0.3)),),
        _slip,
        shared=True,
        on_ground=OnGround(
            in_numbers=_slip_in_numbers,
        ),
        hints=Hints(
            ties=("track-width",),
            programmes=(TURNS,),
        ),
    ),
    Effect(
        "radius-mismatch",
        "vehicle",
        Place.POSE,
        Texts(
            "one side's effective radius × ρ",
            "One side rolls farther per turn than the other.",
            "Equal wheel speeds drive a circle.",
            "Long straight runs.",
        ),
        (EffectParameter("rho", "", 1.0, 0.7, 1.4, (0.95, 1.05)),),
        _radius,
        on_ground=OnGround(
            length=Length.RADIUS,
            in_numbers=_radius_in_numbers,
        ),
        hints=Hints(
            programmes=(TURNS,),
        ),
    ),
    Effect(
        "track-width",
        "vehicle",
        Place.POSE,
        Texts(
            "yaw rate × B/B_eff",
            "Left and right act at another distance than they are apart.",
            "Every turn falls short by one factor.",
            "Turns on the spot and turns of several radii.",
        ),
        (EffectParameter("ratio", "", 1.0, 0.4, 2.0, (0.9, 1.1)),),
        _width,
        shared=True,
        on_ground=OnGround(
            length=Length.TRACK_DISTANCE,
            in_numbers=_width_in_numbers,
        ),
        hints=Hints(
            ties=("track-slip",),
            programmes=(TURNS,),
        ),
    ),
    Effect(
        "longitudinal-slip",
        "vehicle",
        Place.POSE,
        Texts(
            "|v̇_L|, |v̇_R| ≤ r/σ, v → v(1 − i − j|ω|), λ v̇′ = v − v′",
            "Wheels or tracks slip in straight drive, too: on ice, in loose soil, under load.",
            "The way falls short of what the wheels say, in turns and in straight runs alike.",
            "Straight runs at several speeds with hard starts and stops, with a measured radius; "
            "the same on another ground.",
        ),
        (
            EffectParameter("share", "", 0.0, 0.0, 0.9, (0.1,)),
            EffectParameter("growth", "s/rad", 0.0, 0.0, 0.2, (0.01,), at_null=True),
            EffectParameter("lag", "s", 0.0, 0.0, 2.0, (0.1,), at_null=True),
            EffectParameter(
                "spin", "s²/rad", 0.0, 0.0, 1.0, (0.005, 0.015, 0.04, 0.12), at_null=True
            ),
        ),
        _longitudinal,
        _longitudinal_constants,
        memory=Memory(
            3,
        ),
        shared=True,
        laws=(
            Law(("share",), _share_in_numbers, as_radius=True),
            Law(("growth",), _growth_in_numbers, of_speed=True),
            Law(("lag",), _load_in_numbers, as_lag=True, of_changes=True),
            Law(("spin",), _spin_in_numbers, of_changes=True),
        ),
        on_ground=OnGround(
            on_record=_longitudinal_record,
        ),
        hints=Hints(
            programmes=(LEVELS, REVERSALS),
        ),
    ),
    Effect(
        "lateral-slip",
        "vehicle",
        Place.POSE,
        Texts(
            "v_y = −(a + β v) ψ̇",
            "The vehicle slides sideways in turns.",
            "Its place moves to the side where it turns on the spot, or outwards in arcs; the turn "
            "itself is what the wheels say.",
            "Turns on the spot and arcs at several speeds, to both sides, with the middle's place.",
        ),
        (
            EffectParameter("ahead", "m", 0.0, -1.0, 1.0, (0.01,), at_null=True),
            EffectParameter("drift", "s", 0.0, 0.0, 1.0, (0.05,), at_null=True),
        ),
        nothing,
        shared=True,
        laws=(Law(("ahead",), _ahead_in_numbers), Law(("drift",), _drift_in_numbers, as_lag=True)),
        on_ground=OnGround(
            sideways=_sideways,
        ),
        hints=Hints(
            programmes=(TURNS,),
        ),
    ),
    Effect(
        "scrub-lag",
        "vehicle",
        Place.POSE,
        Texts(
            "λ ψ̈ = ψ̇_wheels − ψ̇",
            "Turning follows the wheels with a lag: wheels or tracks scrub before the body turns.",
            "Turns begin late and end late; forward motion does not.",
            "Turns that start, stop and change their side, on the spot and while driving.",
        ),
        (EffectParameter("lag", "s", 0.0, 0.0, 2.0, (0.1,)),),
        _scrub,
        lagging,
        memory=Memory(
            2,
        ),
        shared=True,
        laws=(Law(("lag",), _scrub_in_numbers, as_lag=True),),
        on_ground=OnGround(
            on_record=_scrub_record,
        ),
        hints=Hints(
            programmes=(TURNS, REVERSALS),
        ),
    ),
)
