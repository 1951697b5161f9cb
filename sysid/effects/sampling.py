"""How a log was made: readings that come a part of a sample late are no effect of the machine.

A speed that is counted over a sample (ticks of an encoder, differenced) is the mean over it, half a
sample late, and a command that is passed on between two readings acts later by that part. Both are
searched like an effect, beside effects and by the same rule, so that neither takes what is the
other's; they then belong to the model before as much as to the model after.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Past, Place, Signal, State


def _late(
    xp: Any, y: Signal, s: State, p: Mapping[str, Signal], c: Context
) -> tuple[Signal, State]:
    return y + p["share"] * (s[0] - y), (y,)


def _late_on(xp: Any, y: Signal, past: Past, p: Mapping[str, Signal], c: Context) -> Signal:
    return y + p["share"] * (past(y, xp.ones_like(p["share"])) - y)


SAMPLING = Effect(
    "sampling-lag",
    "sensor",
    Place.READING,
    "y(k) = (1 − φ) ω(k) + φ ω(k − 1)",
    "Readings come a part of a sample late: a speed counted over a sample, or a command passed on "
    "between two readings.",
    "Every response begins the same part of a sample late.",
    "Fast reversals.",
    (EffectParameter("share", "1", 0.0, 0.0, 1.0, (0.5,)),),
    _late,
    states=1,
    on_past=_late_on,
)
