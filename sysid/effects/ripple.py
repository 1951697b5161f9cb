"""What comes again with every turn of a wheel."""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, StartsFrom, State
from sysid.effects.programmes import CRUISE, LEVELS

P = Mapping[str, Signal]


def _ripple(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    turned = p["per_turn"] * xp.where(p["of_wheel"] > 0.5, c.turned, c.counted)
    return w + p["cosine"] * xp.cos(turned) + p["sine"] * xp.sin(turned), s


EFFECTS = (
    Effect(
        "speed-ripple",
        "motor",
        Place.READING,
        "ω + a sin(n·angle + φ)",
        "Speed pulsates with the wheel's angle: an eccentric sprocket or a bent axle.",
        "A wave whose frequency grows with speed.",
        "Long stretches of constant speed at several levels.",
        (
            EffectParameter("cosine", "speed", 0.0, -0.3, 0.3, (0.02,), "speed"),
            EffectParameter("sine", "speed", 0.0, -0.3, 0.3, (0.02,), "speed"),
            EffectParameter("per_turn", "1/rad", 1.0, 0.3, 20.0, (1.0, 2.0, 3.0), "one"),
            EffectParameter("of_wheel", "", 1.0, 0.0, 1.0, (1.0, 0.0), choice=True),
        ),
        _ripple,
        programmes=(CRUISE, LEVELS),
        starts_from=StartsFrom.WAVES,
        wave=("cosine", "sine"),
    ),
)
