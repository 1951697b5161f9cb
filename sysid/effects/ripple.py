"""Effects that repeat with every turn of a wheel.

Angles are integrated from the wheel's speed, or counted from its measurements, from zero at the
start of a record.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Law,
    Memory,
    Place,
    Signal,
    StartsFrom,
    State,
    Texts,
    Wave,
)
from sysid.effects.programmes import COASTING, CRUISE, LEVELS

P = Mapping[str, Signal]


def _wave(xp: Any, p: P, c: Context, names: tuple[str, str, str], part: Signal) -> Signal:
    """A wave over the angle, its mean over the sample that follows.

    Args:
        names: parameters of cosine, sine and waves a rad.
        part: what the counted angle lacks at the start of the sample [rad].
    """
    cosine, sine, line = (p[name] for name in names)
    half = 0.5 * line * c.dt * c.w
    angle = line * xp.where(p["of_wheel"] > 0.5, c.turned, c.counted + part) + half
    size = xp.maximum(xp.abs(half), 1e-6)
    return xp.sin(size) / size * (cosine * xp.cos(angle) + sine * xp.sin(angle))


def _kept(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    return {"kept": kept}


def _ripple(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: the speed that a torque over the angle has made so far
    part = 0.5 * c.dt * w
    # measurements are counted up to the one before: the last part of the way is this one's
    counted = c.counted + xp.where(p["of_speed"] > 0.5, part, 0.0)
    angle = p["per_turn"] * xp.where(p["of_wheel"] > 0.5, c.turned, counted)
    cosine = p["cosine"] + p["share_cosine"] * w
    sine = p["sine"] + p["share_sine"] * w
    torque = _wave(xp, p, c, ("load_cosine", "load_sine", "load_per_turn"), part)
    made = p["kept"] * s[0] - (1.0 - p["kept"]) * torque
    return w + cosine * xp.cos(angle) + sine * xp.sin(angle) + s[0], (made,)


def _gravity(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    part = 0.5 * c.dt * c.w
    one = {**p, "cosine": p["cosine"] + p["geared_cosine"], "sine": p["sine"] + p["geared_sine"]}
    return torque - _wave(xp, one, c, ("cosine", "sine", "per_turn"), part), s


OFTEN = 1.5
"""What pulls more often than this in a rad of the reading is no weight but a ripple of the torque.

A weight hangs on the shaft that is read, or behind a gear that slows it down.
"""

HEAVIEST = 100.0
"""A weight in units of the usual speed: what hangs under each command only swings a little from one
to the next, and a pendulum of 60 in a log with an usual speed of 1.7 ended on a bound of 30."""

HEAVIEST_GEARED = 1.5
"""The same behind a gear, whose part in a rad is free: a far heavier one that turns but little is
a spring."""

_OF_WHEEL = EffectParameter("of_wheel", "", 1.0, 0.0, 1.0, (1.0, 0.0), choice=True)


def _pair(name: str, most: float, unit: str = "speed") -> tuple[EffectParameter, ...]:
    """Cosine and sine of a wave."""
    parts = (f"{name}cosine", f"{name}sine")
    return tuple(EffectParameter(part, unit, 0.0, -most, most, (0.02,)) for part in parts)


EFFECTS = (
    Effect(
        "gravity-load",
        "motor",
        Place.TORQUE,
        Texts(
            "T → T − a sin(n·angle + φ)",
            "A load by the sine of the angle: a weight on an arm, a pendulum, a wheel out of "
            "balance.",
            "Faster on one side of a turn, slower on the other, the more so when it turns slowly.",
            "Long stretches of slow constant speed at several levels.",
        ),
        (
            *_pair("", HEAVIEST),
            *_pair("geared_", HEAVIEST_GEARED),
            EffectParameter("per_turn", "1/rad", 1.0, 0.02, OFTEN, (1.0,)),
            _OF_WHEEL,
            EffectParameter("geared", "", 0.0, 0.0, 1.0, (0.0, 1.0), choice=True),
        ),
        _gravity,
        waves=(
            Wave("cosine", "sine", of_torque=True),
            Wave("geared_cosine", "geared_sine", of_torque=True),
        ),
        laws=(
            Law(("cosine", "sine"), choices={"geared": 0.0}),
            Law(
                ("geared_cosine", "geared_sine", "per_turn"),
                choices={"geared": 1.0},
                sentence="Where it comes n times in a rad of the reading, n is the gear between.",
            ),
        ),
        hints=Hints(
            ties=("speed-ripple",),
            programmes=(CRUISE, COASTING),
            starts_from=StartsFrom.WAVES,
        ),
    ),
    Effect(
        "speed-ripple",
        "motor",
        Place.READING,
        Texts(
            "ω + a sin(n·angle + φ), or ω(1 + e sin(n·angle + φ)), or T − a sin(n·angle + φ)",
            "Speed pulsates with the wheel's angle: an eccentric sprocket or a bent axle.",
            "A wave whose frequency grows with speed.",
            "Long stretches of constant speed at several levels.",
        ),
        (
            *_pair("", 0.3),
            EffectParameter("per_turn", "1/rad", 1.0, 0.3, 20.0, (1.0, 2.0, 3.0), as_seen=True),
            _OF_WHEEL,
            *_pair("share_", 0.9, ""),
            EffectParameter("of_speed", "", 0.0, 0.0, 1.0, (0.0, 1.0, 0.0), choice=True),
            *_pair("load_", 1.5),
            EffectParameter("load_per_turn", "1/rad", 2.0, OFTEN, 20.0, (2.0, 3.0), as_seen=True),
            EffectParameter("of_load", "", 0.0, 0.0, 1.0, (0.0, 0.0, 1.0), choice=True),
        ),
        _ripple,
        _kept,
        memory=Memory(
            1,
            at_rest=lambda w, d: (0.0 * w,),
        ),
        waves=(
            Wave("cosine", "sine"),
            Wave("share_cosine", "share_sine", of_speed=True),
            Wave("load_cosine", "load_sine", "load_per_turn", of_torque=True),
        ),
        laws=(
            Law(("cosine", "sine", "per_turn"), choices={"of_speed": 0.0, "of_load": 0.0}),
            Law(
                ("share_cosine", "share_sine", "per_turn"),
                choices={"of_speed": 1.0, "of_load": 0.0},
                sentence="It grows with speed and turns over with the direction, as of a code "
                "wheel, a gear or a sprocket off its centre.",
            ),
            Law(
                ("load_cosine", "load_sine", "load_per_turn"),
                choices={"of_speed": 0.0, "of_load": 1.0},
                sentence="It is a torque, which the inertia smooths the more the faster it turns, "
                "as of a motor's magnets or of teeth that bind.",
            ),
        ),
        hints=Hints(
            ties=("gravity-load",),
            programmes=(CRUISE, LEVELS),
            starts_from=StartsFrom.WAVES,
        ),
    ),
)
