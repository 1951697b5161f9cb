"""Effects of a position servo alone: its command is the position to be reached, its reading that.

In the chain T is then the set point and ω the position that the servo's own loop holds.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    OF_SERVO,
    Context,
    Effect,
    EffectParameter,
    Hints,
    Memory,
    Place,
    Signal,
    State,
    Texts,
    TorquePart,
)
from sysid.effects.programmes import RAMPS, REVERSALS, TOP

P = Mapping[str, Signal]


def _play(xp: Any, y: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    """The arm stays where it is until a side of the gap pushes it."""
    half = 0.5 * p["gap"]
    arm = xp.minimum(xp.maximum(s[0], y - half), y + half)
    return arm, (arm,)


def _full_voltage(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    """Of the error T − y the loop answers to no more than what gives the motor its full voltage.

    A set point that is farther off then pulls no harder: the arm goes on at the speed of that
    voltage. A limit on the set point itself would let the loop catch up behind it. The error is
    that amid the sample, y = (ω + ω_free + b T)/2.
    """
    amid, own = 0.5 * (c.w + c.w_free), 1.0 - 0.5 * c.b
    return xp.minimum(xp.maximum(torque, (amid - p["error"]) / own), (amid + p["error"]) / own), s


EFFECTS = (
    Effect(
        "servo-speed-limit",
        "motor",
        Place.TORQUE,
        Texts(
            "T → y + clip(T − y, ±e)",
            "The servo turns no faster than its motor at full voltage, which it has beyond some "
            "error.",
            "Large steps are ramps of one slope; small steps are not affected.",
            "Steps of very different size.",
        ),
        (
            EffectParameter(
                "error", "speed", 1e6, 0.01, 3.0, (0.1, 0.3, 0.8), kinks=True, as_rate=True
            ),
            EffectParameter(OF_SERVO, "", 0.0, 0.0, 1.0, (1.0,), choice=True),
        ),
        _full_voltage,
        part=TorquePart.DRIVE,
        hints=Hints(
            ties=("rate-limit",),
            programmes=(TOP, REVERSALS),
        ),
    ),
    Effect(
        "position-play",
        "motor",
        Place.READING,
        Texts(
            "y → min(max(y_before, y − g/2), y + g/2)",
            "Play between the servo and what is read: the servo's loop is exact, the arm behind it "
            "moves only where a side of the gap pushes it.",
            "Positions fall short by half the gap on either side; after a reversal the arm waits, "
            "then starts at full speed.",
            "Small steps back and forth, and slow ramps.",
        ),
        (
            EffectParameter("gap", "speed", 0.0, 0.0, 0.8, (0.03, 0.1, 0.3), kinks=True),
            EffectParameter(OF_SERVO, "", 0.0, 0.0, 1.0, (1.0,), choice=True),
        ),
        _play,
        memory=Memory(
            1,
        ),
        hints=Hints(
            ties=("coulomb-friction",),
            programmes=(REVERSALS, RAMPS),
            reverses=True,
        ),
    ),
)
