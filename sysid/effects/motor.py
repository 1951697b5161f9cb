"""Effects of the motor and its driver: heating, and freewheeling instead of braking.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
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
    State,
    Texts,
    TorquePart,
)
from sysid.effects.programmes import COASTING, HOT, LEVELS, REPEAT
from sysid.effects.supply import USUAL_EMF

P = Mapping[str, Signal]


def _thermal(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # a warm winding resists its current T − ε ω, ω amid the sample: a linear equation for T
    by_current = p["by_current"] > 0.5
    warm = p["loss"] * s[0]
    lost = warm / (1.0 + warm)
    turns = p["emf"] * 0.5 * (c.w + c.w_free)
    remaining = (torque - lost * (torque - turns)) / (1.0 - lost * p["emf"] * 0.5 * c.b)
    current = (remaining - turns - p["emf"] * 0.5 * c.b * remaining) / c.gain
    driven = xp.where(p["by_current"] < -0.5, xp.abs(c.drive), c.drive**2)
    heats = xp.where(by_current, current**2 * (1.0 + warm), driven)
    heat = s[0] + p["warming"] * (heats - s[0])
    return xp.where(by_current, remaining, torque * (1.0 - warm)), (heat,)


def _coast(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    falling = xp.abs(w) < xp.abs(c.w)
    return xp.where(falling, c.w + (w - c.w) / p["ratio"], w), s


LETS_GO = 1e5
"""Decay rates beyond this are no freewheeling at all."""

FALLS, FALLS_TO_DRIVE, OUTRUNS, AT_ZERO, ONE_WAY = (float(k) for k in range(5))
"""Values of ``released``: when the driver lets go, and until when."""


def _rolling(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    fade = kept ** p["viscous"]
    when, acts = p["released"], 1.0 * (p["rate"] < LETS_GO)
    falls = acts * (when < OUTRUNS - 0.5)
    outruns = acts * (xp.abs(when - OUTRUNS) < 0.5)
    # shares of 0 or 1, not choices: they make the compiled step a quarter faster
    return {
        "fade": fade,
        "drop": p["rate"] * dt * xp.sqrt(fade),
        "falls": falls,
        "at_zero": falls + acts * (xp.abs(when - AT_ZERO) < 0.5),
        "outruns": outruns,
        "one_way": acts * (when > ONE_WAY - 0.5),
        "caught": outruns + acts * (xp.abs(when - FALLS_TO_DRIVE) < 0.5),
    }


def _freewheel(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: the command before this one
    falls = (c.drive * s[0] > 0.0) & (xp.abs(c.drive) < xp.abs(s[0]))
    speed, side = xp.abs(c.w), xp.sign(c.w)
    # the diode takes its voltage while the switch does not conduct, and drives nothing by itself
    ahead = c.torque * side  # the drive's speed in the direction of motion
    lost = p["diode"] * c.gain * (1.0 - xp.minimum(xp.abs(c.drive), 1.0))
    lost = xp.where(ahead >= 0.0, xp.minimum(lost, xp.abs(c.torque)), lost)
    w = w - c.b * lost * xp.sign(c.torque)
    released = xp.where(c.drive == 0.0, p["at_zero"], xp.where(falls, p["falls"], 0.0))
    released = released + xp.where((ahead >= 0.0) & (ahead < speed), p["outruns"], 0.0)
    rolling = xp.maximum(speed * p["fade"] - p["drop"], ahead * p["caught"])
    rolling = xp.maximum(rolling, 0.0)
    # a current of one sign pulls and never brakes: of rolling and driving the faster one is left
    slower = xp.where(ahead >= 0.0, p["one_way"], 0.0) * xp.maximum(rolling - side * w, 0.0)
    return w + released * (side * rolling - w) + side * slower, (c.drive + 0.0 * s[0],)


_NUMBERS = ("rate", "viscous")


EFFECTS = (
    Effect(
        "thermal-fade",
        "motor",
        Place.TORQUE,
        Texts(
            "θ_h ḣ = d² − h; T → T(1 − l h), |d| in place of d² where d switches a supply on for a "
            "share of time; or θ_h ḣ = i² (1 + l h) − h with the current i = (T − ε ω)/(1 + l h)",
            "The motor weakens as it warms up.",
            "After long hard driving the same command reaches less speed, and recovers in rest.",
            "A minute of full drive, then the first test again, then rest, then again.",
        ),
        (
            EffectParameter("loss", "", 0.0, 0.0, 20.0, (0.15, 0.35, 1.0, 2.0, 2.0, 0.15)),
            EffectParameter("time", "s", 30.0, 5.0, 300.0, (20.0, 60.0, 20.0, 15.0, 60.0, 40.0)),
            EffectParameter("emf", "", USUAL_EMF, 0.0, 1.0, (USUAL_EMF,), at_limit=True),
            EffectParameter(
                "by_current", "", 0.0, -1.0, 1.0, (0.0,) * 3 + (1.0,) * 2 + (-1.0,), choice=True
            ),
        ),
        _thermal,
        lambda xp, p, dt, kept: {"warming": 1.0 - xp.exp(-dt / p["time"])},
        part=TorquePart.DRIVE,
        memory=Memory(
            1,
            at_rest=lambda w, d: (0.0 * w,),
        ),
        laws=(
            Law(("loss", "time"), choices={"by_current": 0.0}),
            Law(
                ("loss", "time"),
                choices={"by_current": -1.0},
                sentence="It warms with the share of time that it is switched on.",
            ),
            Law(
                ("loss", "time", "emf"),
                choices={"by_current": 1.0},
                sentence="Its current warms the winding, whose resistance then grows: it shows "
                "most where it pulls hard, hardly at the speed that it reaches in the end.",
            ),
        ),
        hints=Hints(
            electric=True,
            programmes=(HOT, REPEAT),
            gathers=True,
        ),
    ),
    Effect(
        "coast-asymmetry",
        "motor",
        Place.SPEED,
        Texts(
            "another τ while |ω| falls",
            "It slows down with another time constant than it speeds up with.",
            "Rises fit, falls do not.",
            "Steps up and down of the same size.",
        ),
        (EffectParameter("ratio", "", 1.0, 0.2, 6.0, (0.6, 1.8)),),
        _coast,
        hints=Hints(
            electric=True,
            ties=("freewheel",),
            programmes=(COASTING, LEVELS),
        ),
    ),
    Effect(
        "freewheel",
        "motor",
        Place.SPEED,
        Texts(
            "ω̇ = −r sign ω − β ω/τ while the command is 0, or falls, too (or while the wheel "
            "outruns it), down to 0 (or until the drive catches it); with a current of one sign "
            "the slower fall of this and τ ω̇ = T − ω, where the diode takes δ K (1 − |d|) of T",
            "The driver lets go instead of braking.",
            "Falls are nearly straight lines, or longer than rises; rises are exponentials.",
            "Steps to zero from several speeds, and steps down to lower ones.",
        ),
        (
            EffectParameter(
                "rate",
                "speed/s",
                1e6,
                0.001,
                100.0,
                (0.4, 1.0, 3.0) * 3 + (0.8, 0.05) * 2,
                kinks=True,
                at_limit=True,
            ),
            EffectParameter("viscous", "", 0.0, 0.0, 0.6, (0.0,) * 9 + (0.0, 0.15) * 2),
            EffectParameter(
                "released",
                "",
                FALLS,
                FALLS,
                ONE_WAY,
                (FALLS,) * 3
                + (OUTRUNS,) * 3
                + (FALLS_TO_DRIVE,) * 3
                + (AT_ZERO,) * 2
                + (ONE_WAY,) * 2,
                choice=True,
            ),
            # 0.7 V of a supply of 7 V; more is a dead zone
            EffectParameter(
                "diode", "drive", 0.0, 0.0, 0.1, (0.0,) * 11 + (0.03,) * 2, at_limit=True
            ),
        ),
        _freewheel,
        _rolling,
        memory=Memory(
            1,
            at_rest=lambda w, d: (d + 0.0 * w,),
        ),
        laws=(
            Law(
                _NUMBERS,
                choices={"released": FALLS},
                sentence="It does so at a command of zero and after a command that falls.",
            ),
            Law(
                _NUMBERS,
                choices={"released": FALLS_TO_DRIVE},
                sentence="It does so at a command of zero and after a command that falls, until "
                "the drive catches it.",
            ),
            Law(
                _NUMBERS,
                choices={"released": OUTRUNS},
                sentence="It does so while the wheel outruns the drive, until that catches it.",
            ),
            Law(
                _NUMBERS,
                choices={"released": AT_ZERO},
                sentence="It does so at a command of zero only, as if all switches opened then.",
            ),
            Law(
                (*_NUMBERS, "diode"),
                choices={"released": ONE_WAY},
                sentence="Its current flows one way only, as through the diode of a bridge of one "
                "quadrant: it pulls and never brakes, but against a reversal.",
            ),
        ),
        hints=Hints(
            electric=True,
            ties=("coast-asymmetry",),
            programmes=(COASTING, LEVELS),
        ),
    ),
)
