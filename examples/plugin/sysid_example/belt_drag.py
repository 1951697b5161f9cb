"""An effect that couples tracks: a slipping belt drags each side towards the other's speed."""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Place,
    Signal,
    State,
    Texts,
)
from sysid.effects.programmes import ONE_AND_OTHER, REVERSALS


def _drag(
    xp: Any, torque: Signal, state: State, p: Mapping[str, Signal], c: Context
) -> tuple[Signal, State]:
    # signals hold both tracks in their last axis; a single track is its own other one
    apart = c.w - c.w[..., ::-1]
    return torque - p["drag"] * apart * abs(apart), state


BELT_DRAG = Effect(
    "belt-drag",
    "motor",
    Place.TORQUE,
    Texts(
        "T → T − k (ω − ω_other) |ω − ω_other|",
        "A slipping belt drags each side towards the other, the more the more they differ.",
        "A side runs faster than commanded where the other one is faster.",
        "One side at a constant command while the other steps.",
    ),
    (EffectParameter("drag", "1/speed", 0.0, 0.0, 3.0, (0.1, 0.5)),),
    _drag,
    couples=True,
    hints=Hints(
        ties=("cross-coupling", "inertial-coupling"),
        programmes=(ONE_AND_OTHER, REVERSALS),
    ),
)
