"""Effects of the motor and its driver.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, State
from sysid.effects.programmes import COASTING, HOT, LEVELS, REPEAT

P = Mapping[str, Signal]


def _warming(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    return {"warming": 1.0 - xp.exp(-dt / p["time"])}


def _thermal(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    heat = s[0] + p["warming"] * (c.drive**2 - s[0])
    return torque * (1.0 - p["loss"] * s[0]), (heat,)


def _cold(w: Signal, d: Signal) -> State:
    return (0.0 * w,)


def _coast(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    falling = xp.abs(w) < xp.abs(c.w)
    return xp.where(falling, c.w + (w - c.w) / p["ratio"], w), s


LETS_GO = 1e5
"""Decay rates beyond this are no freewheeling at all."""


def _rolling(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    fade = kept ** p["viscous"]
    return {
        "fade": fade,
        "drop": p["rate"] * dt * xp.sqrt(fade),
        "outrun": 1.0 * (p["overrun"] > 0.5) * (p["rate"] < LETS_GO),
        "falling": 1.0 * (p["overrun"] <= 0.5) * (p["rate"] < LETS_GO),
    }


def _freewheel(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: the command before this one
    falls = (c.drive * s[0] > 0.0) & (xp.abs(c.drive) < xp.abs(s[0]))
    speed, side = xp.abs(c.w), xp.sign(c.w)
    ahead = c.torque * side  # the drive's speed in the direction of motion
    # shares of 0 or 1, not choices: they make the compiled step a quarter faster
    outruns = xp.where((ahead >= 0.0) & (ahead < speed), p["outrun"], 0.0)
    released = xp.where((c.drive == 0.0) | falls, p["falling"], 0.0)
    rolling = xp.maximum(speed * p["fade"] - p["drop"], ahead * p["caught"])
    rolling = xp.maximum(rolling, 0.0)
    return w + (outruns + released) * (side * rolling - w), (c.drive + 0.0 * s[0],)


def _last_command(w: Signal, d: Signal) -> State:
    return (d + 0.0 * w,)


EFFECTS = (
    Effect(
        "thermal-fade",
        "motor",
        Place.TORQUE,
        "θ_h ḣ = d² − h; T → T(1 − l h)",
        "The motor weakens as it warms up.",
        "After long hard driving the same command reaches less speed, and recovers in rest.",
        "A minute of full drive, then the first test again, then rest, then again.",
        (
            EffectParameter("loss", "", 0.0, 0.0, 2.5, (0.15, 0.35, 1.0), "one"),
            EffectParameter("time", "s", 30.0, 5.0, 300.0, (20.0, 60.0, 20.0), "one"),
        ),
        _thermal,
        _warming,
        states=1,
        at_rest=_cold,
        programmes=(HOT, REPEAT),
    ),
    Effect(
        "coast-asymmetry",
        "motor",
        Place.SPEED,
        "another τ while |ω| falls",
        "It slows down with another time constant than it speeds up with.",
        "Rises fit, falls do not.",
        "Steps up and down of the same size.",
        (EffectParameter("ratio", "", 1.0, 0.2, 6.0, (0.6, 1.8), "one"),),
        _coast,
        ties=("freewheel",),
        programmes=(COASTING, LEVELS),
    ),
    Effect(
        "freewheel",
        "motor",
        Place.SPEED,
        "ω̇ = −r sign ω − β ω/τ while the command is 0 or falls (or while the wheel outruns it), "
        "down to 0 (or until the drive catches it)",
        "The driver lets go instead of braking: near-linear decay.",
        "Falls are straight lines, rises are exponentials.",
        "Steps to zero from several speeds.",
        (
            EffectParameter(
                "rate", "speed/s", 1e6, 0.02, 100.0, (0.4, 1.0, 3.0) * 3, "speed", kinks=True
            ),
            EffectParameter(
                "overrun", "", 0.0, 0.0, 1.0, (0.0,) * 3 + (1.0,) * 3 + (0.0,) * 3, choice=True
            ),
            EffectParameter("caught", "", 0.0, 0.0, 1.0, (0.0,) * 3 + (1.0,) * 6, choice=True),
            EffectParameter("viscous", "", 0.0, 0.0, 0.6, (0.0,), "one"),
        ),
        _freewheel,
        _rolling,
        states=1,
        at_rest=_last_command,
        ties=("coast-asymmetry",),
        programmes=(COASTING, LEVELS),
    ),
)
