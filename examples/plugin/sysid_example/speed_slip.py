"""An effect between tracks and ground: both tracks slip more the faster they run."""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    OnGround,
    Place,
    Signal,
    State,
    Texts,
)
from sysid.effects.programmes import CRUISE, Programme

DASHES = Programme(
    "drive straight at several speeds, one after the other.",
    lambda: [(6.0, size, size) for size in (0.2, 0.4, 0.6, 0.8, 1.0, 0.5, 0.3)],
)
"""An experiment of one's own: (seconds, left share, right share) of the largest command."""


def _slip(
    xp: Any, omega: Signal, state: State, p: Mapping[str, Signal], c: Context
) -> tuple[Signal, State]:
    return omega * (1.0 - p["loss"] * xp.abs(omega)), state


def _in_numbers(value: float, error: float, side: int) -> str:
    return (
        f"Tracks slip more the faster they run: at 10 rad/s they lose {1e3 * value:.3g} ± "
        f"{1e3 * error:.2g} % of their way."
    )


SPEED_SLIP = Effect(
    "speed-slip",
    "vehicle",
    Place.POSE,
    Texts(
        "ω → ω (1 − s|ω|)",
        "Tracks slip more the faster they run.",
        "Fast stretches are shorter than the wheels say, slow ones are not.",
        "Straight runs at several speeds.",
    ),
    (EffectParameter("loss", "1/speed", 0.0, 0.0, 0.05, (0.005,)),),
    _slip,
    shared=True,
    on_ground=OnGround(
        in_numbers=_in_numbers,
    ),
    hints=Hints(
        ties=("radius-mismatch",),
        programmes=(DASHES, CRUISE),
    ),
)
