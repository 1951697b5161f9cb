"""Backlash between motor and wheel.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Memory,
    Place,
    Signal,
    State,
    Texts,
)
from sysid.effects.programmes import RAMPS, REVERSALS

P = Mapping[str, Signal]


FINE, MOST_PARTS = 0.05, 4
"""A gap is crossed in parts of a sample no longer than this [s], at most so many."""

MOST_AT_WHEEL = 0.9
"""Most of the viscous term that acts on the wheel and not on the motor."""

LEAST_LOAD = 0.02
"""A lighter wheel than this share of the inertia stops at once where it rubs."""


def _parts(dt: float) -> int:
    return int(min(max(-(-dt // FINE), 1), MOST_PARTS))


def _loose(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    # of the viscous term 1 the wheel alone keeps the share β, the motor alone 1 − β
    part = xp.log(xp.maximum(kept, 1e-9)) / _parts(dt)
    remaining = 1.0 - xp.minimum(p["coast"] * (1.0 - p["inertia"]), MOST_AT_WHEEL)
    coasts = xp.exp(part * p["coast"])
    alone, joined = xp.exp(part * remaining / p["inertia"]), xp.exp(part)
    stops = p["rub"] / xp.maximum(1.0 - p["inertia"], LEAST_LOAD)
    return {
        "joined": joined,
        "joined_bend": _bend(xp, joined),
        "alone": alone,
        "alone_bend": _bend(xp, alone),
        "coasts": coasts,
        "coasts_bend": _bend(xp, coasts),
        "stops": -part * stops * xp.sqrt(coasts),
        "reach": 1.0 / remaining,
    }


def _bend(xp: Any, keeps: Signal) -> Signal:
    return 2.0 * (1.0 - xp.sqrt(keeps)) ** 2


def _share(p: P, name: str, part: Signal) -> Signal:
    """keeps^part by the parabola through its beginning, middle and end: the step is stepped often.

    Args:
        p: what is left of a deviation after the whole, under ``name``, and its ``_bend``.
        part: 0 to 1.
    """
    return 1.0 - part * (1.0 - p[name] + p[name + "_bend"] * (1.0 - part))


def _rubbed(xp: Any, wheel: Signal, most: Signal) -> Signal:
    """The wheel's speed on its own after dry friction, which takes ``most`` and ends at rest."""
    return wheel - xp.minimum(xp.maximum(wheel, -most), most)


def _together(xp: Any, speed: Signal, towards: Signal, part: Signal, p: P) -> Signal:
    """The speed of motor and wheel in contact after a part, dry friction of the wheel included."""
    keeps = _share(p, "joined", part)
    way = xp.sign(xp.where(speed == 0.0, towards, speed))
    target = towards - way * p["rub"]
    reached = target + (speed - target) * keeps
    passes = reached * way < 0.0
    remaining = 1.0 - speed / xp.where(passes, speed - reached, 1.0)
    back = xp.where(xp.abs(towards) > p["rub"], towards + way * p["rub"], 0.0)
    return xp.where(passes, back * (1.0 - keeps) * remaining, reached)


def _backlash(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: place of the motor within the gap (-1 ... 1) and its speed; w is the speed of both joined
    place, motor = s
    parts = _parts(c.dt)
    scale = 0.5 * c.dt / parts / xp.maximum(0.5 * p["gap"], 1e-9)
    target = p["reach"] * (w - c.w_free) / c.b
    towards = (w - (1.0 - c.b) * c.w) / c.b  # what both joined approach, so that they reach w
    wheel, share = c.w, p["inertia"]

    for _ in range(parts):
        alone = target + (motor - target) * p["alone"]
        coasting = _rubbed(xp, wheel * p["coasts"], p["stops"])
        moved = (motor + alone - wheel - coasting) * scale
        apart = xp.abs(place + moved) < 1.0
        side = xp.where(moved == 0.0, place, xp.sign(moved))
        # share of the part until they touch, with the momentum that both then have; 0 if they do
        free = (side - place) / xp.where(moved == 0.0, 1.0, moved)
        free = xp.minimum(xp.maximum(free, 0.0), 1.0)
        hits = target + (motor - target) * _share(p, "alone", free)
        hit = _rubbed(xp, wheel * _share(p, "coasts", free), p["stops"] * free)
        struck = share * hits + (1.0 - share) * hit
        together = _together(xp, struck, towards, 1.0 - free, p)
        wheel = xp.where(apart, coasting, together)
        motor = xp.where(apart, alone, together)
        place = xp.where(apart, place + moved, side)
    return xp.where(p["gap"] > 0.0, wheel, w), (place, xp.where(p["gap"] > 0.0, motor, w))


def _touching(w: Signal, d: Signal) -> State:
    return (1.0 + 0.0 * w, w)


_GAPS = (0.1, 0.5, 1.5) * 3


def _each(*values: float) -> tuple[float, ...]:
    """A value for each of the starting gaps."""
    return tuple(v for v in values for _ in range(3))


EFFECTS = (
    Effect(
        "backlash",
        "motor",
        Place.SPEED,
        Texts(
            "a gap g between motor and wheel; in it the wheel obeys "
            "(1 − α) (τ ω̇ + γ ω) = −c sign ω and the motor, with the share α of the inertia, "
            "α τ ω̇ = T − (1 − γ (1 − α)) ω",
            "Play in the gear: at each reversal the wheel waits until the gap is crossed.",
            "A short pause after each reversal, none in one direction.",
            "Frequent reversals at several speeds.",
        ),
        (
            EffectParameter("gap", "rad", 0.0, 0.0, 12.0, _GAPS, stepwise=True),
            EffectParameter("inertia", "", 1.0, 0.1, 1.0, _each(1.0, 0.9, 0.4), kinks=True),
            EffectParameter(
                "coast", "", 0.0, 0.0, 6.0, _each(1.0, 1.0, 0.2), kinks=True, at_limit=True
            ),
            EffectParameter("rub", "speed", 0.0, 0.0, 0.5, _each(0.0, 0.02, 0.02), kinks=True),
        ),
        _backlash,
        _loose,
        memory=Memory(
            2,
            at_rest=_touching,
        ),
        hints=Hints(
            ties=("coulomb-friction",),  # its wheel rubs: a gap of nothing is friction
            rare=True,
            programmes=(REVERSALS, RAMPS),
            reverses=True,
        ),
    ),
)
