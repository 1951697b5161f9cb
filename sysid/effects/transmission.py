"""Play between motor and wheel.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, State
from sysid.effects.programmes import RAMPS, REVERSALS

P = Mapping[str, Signal]


FINE, MOST_PARTS = 0.05, 4
"""A gap is crossed in parts of a sample no longer than this [s], at most so many."""

MOST_AT_WHEEL = 0.9
"""Most of the viscous term that acts on the wheel and not on the motor."""


def _parts(dt: float) -> int:
    return int(min(max(-(-dt // FINE), 1), MOST_PARTS))


def _loose(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    # of the viscous term 1 the wheel alone keeps the share β, the motor alone 1 − β
    part = xp.log(xp.maximum(kept, 1e-9)) / _parts(dt)
    left = 1.0 - xp.minimum(p["coast"] * (1.0 - p["inertia"]), MOST_AT_WHEEL)
    return {
        "joined": part,
        "alone": part * left / p["inertia"],
        "reach": 1.0 / left,
        "coasting": part * p["coast"],
    }


def _backlash(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: place of the motor within the gap (-1 ... 1) and its speed; w is the speed of both joined
    place, motor = s
    half = xp.maximum(0.5 * p["gap"], 1e-9)
    target = p["reach"] * (w - c.w_free) / c.b
    towards = (w - (1.0 - c.b) * c.w) / c.b  # what both joined approach, so that they reach w
    wheel, parts = c.w, _parts(c.dt)
    keeps_motor, keeps_wheel = xp.exp(p["alone"]), xp.exp(p["coasting"])
    for _ in range(parts):
        alone = target + (motor - target) * keeps_motor
        coasting = wheel * keeps_wheel
        moved = 0.5 * (motor + alone - wheel - coasting) * (c.dt / parts) / half
        apart = xp.abs(place + moved) < 1.0
        side = xp.sign(moved)
        # share of the part until they touch, with the momentum that both then have; 0 if they do
        free = (side - place) / xp.where(moved == 0.0, 1.0, moved)
        free = xp.minimum(xp.maximum(free, 0.0), 1.0)
        struck = p["inertia"] * (target + (motor - target) * xp.exp(p["alone"] * free))
        struck = struck + (1.0 - p["inertia"]) * wheel * xp.exp(p["coasting"] * free)
        together = towards + (struck - towards) * xp.exp(p["joined"] * (1.0 - free))
        wheel = xp.where(apart, coasting, together)
        motor = xp.where(apart, alone, together)
        place = xp.where(apart, place + moved, side)
    return xp.where(p["gap"] > 0.0, wheel, w), (place, xp.where(p["gap"] > 0.0, motor, w))


def _touching(w: Signal, d: Signal) -> State:
    return (1.0 + 0.0 * w, w)


_GAPS = (0.15, 0.6, 2.0) * 3

EFFECTS = (
    Effect(
        "backlash",
        "motor",
        Place.SPEED,
        "a gap g between motor and wheel; in it the wheel coasts at the rate γ/τ and the motor, "
        "with the share α of the inertia, obeys α τ ω̇ = T − (1 − γ (1 − α)) ω",
        "Play in the gear: at each reversal the wheel waits until the gap is crossed.",
        "A short pause after each reversal, none in one direction.",
        "Frequent reversals at several speeds.",
        (
            EffectParameter("gap", "rad", 0.0, 0.0, 12.0, _GAPS, stepwise=True),
            EffectParameter(
                "inertia", "", 1.0, 0.1, 1.0, (1.0,) * 3 + (0.8,) * 3 + (0.4,) * 3, kinks=True
            ),
            EffectParameter(
                "coast", "", 0.0, 0.0, 3.0, (1.0,) * 3 + (0.4,) * 3 + (0.2,) * 3, kinks=True
            ),
        ),
        _backlash,
        _loose,
        states=2,
        at_rest=_touching,
        programmes=(REVERSALS, RAMPS),
        reverses=True,
    ),
)
