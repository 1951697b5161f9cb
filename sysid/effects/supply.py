"""Effects of the battery and of the bridge between it and the motor.

A motor's current counts as the torque that it makes, in units of steady speed: T − ε ω, where ε is
the share of the viscous term that is the back-emf. At stall it is K d.
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
from sysid.effects.programmes import (
    COASTING,
    HOT,
    LEVELS,
    ONE_AND_OTHER,
    REPEAT,
    REVERSALS,
    STAIRCASE,
    TOP,
)

P = Mapping[str, Signal]

STRAIGHT, STEEPEST = 1e-6, 30.0
"""Below this bend [1/s] a curve is straight; the largest power of e of one that is tried."""

MOST_LOSS = 0.1
"""Share of its voltage that a battery loses at most in a second at full drive: beyond, it would be
empty before a log has twenty commands."""

USUAL_EMF = 0.85
"""Share of the back-emf in the viscous term of a motor with its gear, until a log determines it:
one under commands of a single size cannot, as it then acts like another gain."""

MOST_DEAD = 0.3
"""Share of a period that the switches of a bridge wait at most, microseconds of tens. What takes
more of the command is friction."""

LEAST_EMF = 0.3
"""A smaller share of back-emf makes a current of the command alone: a limit of the current is then
one of the command, and a dead time a dead zone."""


def _amid(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """Where between its ends the speed of a sample stands for all of it.

    The end feels torque of long ago less: ∫ e^{−(dt−t)/τ} ω dt/τ of a speed that settles.
    """
    x = xp.maximum(-xp.log(xp.maximum(kept, 1e-9)), 1e-3)
    remaining = xp.exp(-x)
    return {"amid": (1.0 - x * remaining / (1.0 - remaining)) / (1.0 - remaining)}


def _sag(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    load = xp.mean(xp.abs(c.drive), axis=-1, keepdims=True)
    # a bridge takes the motor's current for the share d that it is on, and a motor the share
    # v d − ε ω/K of its current at stall, ω amid the sample: a linear equation for v
    d = torque / c.gain
    share = p["sag"] / (1.0 - p["sag"])
    current, slope = _current(0.0 * torque, p, c)
    drawn = xp.mean(d * d * slope, axis=-1, keepdims=True)
    returned = xp.mean(d * current / c.gain, axis=-1, keepdims=True)
    remaining = (1.0 - share * returned) / (1.0 + share * drawn)
    return torque * xp.where(p["current"] > 0.5, remaining, 1.0 - p["sag"] * load), s


def _current(torque: Signal, p: P, c: Context) -> tuple[Signal, Signal]:
    """A motor's current T − ε ω, ω amid the sample, and its slope in T."""
    slope = 1.0 - p["emf"] * p["amid"] * c.b
    return slope * torque - p["emf"] * (c.w + p["amid"] * (c.w_free - c.w)), slope


def _limit(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # the T whose own current, after what it does within the sample, is at the limit
    current, slope = _current(torque, p, c)
    kept = xp.minimum(xp.maximum(current, -p["limit"]), p["limit"])
    return torque + (kept - current) / slope, s


def _dead_time(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # what is lost grows with the current up to the ripple, beyond which it is the whole share;
    # the current is that which is left, so that no sample overshoots
    full = xp.abs(c.gain)
    lost = p["share"] * full
    current, slope = _current(torque, p, c)
    way = current / xp.maximum(p["ripple"] * full + slope * lost, 1e-9)
    way = xp.minimum(xp.maximum(way, -1.0), 1.0)
    return torque - xp.where(torque == 0.0, 0.0, lost * way), s


def _battery(xp: Any, d: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # who asks without a state, as what makes up for effects, knows no charge: then none is taken
    taken = s[0] if s else 0.0 * d
    return _discharged(xp, d, taken, p, c), (taken + _taken(xp, c),) if s else s


def _full(w: Signal, d: Signal) -> State:
    return (0.0 * d,)


def _taken(xp: Any, c: Context) -> Signal:
    """Charge that all motors take in a sample, the same for each of them."""
    return c.dt * xp.mean(c.drive * c.drive, axis=-1, keepdims=True) + 0.0 * c.drive


def _discharged(xp: Any, d: Signal, taken: Signal, p: P, c: Context) -> Signal:
    bend = xp.where(xp.abs(p["bend"]) < STRAIGHT, STRAIGHT, p["bend"])
    curved = xp.expm1(xp.minimum(bend * taken, STEEPEST)) / bend
    return d * (1.0 - p["loss"] * xp.where(p["charge"] > 0.5, curved, c.t))


EMPTY = 0.1
"""Share of its strength below which no command makes up for an empty battery."""


def _charged(xp: Any, d: Signal, p: P, c: Context) -> Signal:
    """d → d/(1 − b t); of a charge that is taken nothing is known ahead."""
    loss = xp.where(p["charge"] > 0.5, 0.0, p["loss"])
    return d / xp.maximum(1.0 - loss * c.t, EMPTY)


def _through_dead_time(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + δ K clip(i/ρ, ±1), i = T − ε ω; none where nothing is wanted."""
    full = xp.abs(c.gain)
    way = (torque - p["emf"] * c.w) / xp.maximum(p["ripple"] * full, 1e-9)
    lost = p["share"] * full * xp.minimum(xp.maximum(way, -1.0), 1.0)
    return torque + xp.where(torque == 0.0, 0.0, lost)


_BY_CURRENT = (
    "It falls with the current that both motors take, as by the resistance of a battery: most when "
    "they start."
)

_BY_CHARGE = (
    "It does so by the charge that the motors take, most under large commands, not while they rest."
)

EFFECTS = (
    Effect(
        "supply-sag",
        "actuator",
        Place.TORQUE,
        Texts(
            "T → T(1 − s(|d_L| + |d_R|)/2), or T → v T with "
            "1 − v = s/(1 − s)·(d_L i_L + d_R i_R)/2, i = v d − ε ω/K",
            "The supply voltage drops under load, so one side slows when the other is driven.",
            "A side is slower when the other one is driven too, whatever its direction.",
            "One side at a constant command while the other steps.",
        ),
        (
            EffectParameter(
                "sag", "", 0.0, 0.0, 0.9, (0.15, 0.35) + (0.1, 0.35) * 2, measured_as="sag"
            ),
            EffectParameter("emf", "", USUAL_EMF, 0.0, 1.0, (USUAL_EMF,), at_limit=True),
            EffectParameter(
                "current", "", 0.0, 0.0, 2.0, (0.0, 0.0, 1.0, 1.0, 2.0, 2.0), choice=True
            ),
        ),
        _sag,
        _amid,
        part=TorquePart.DRIVE,
        laws=(
            Law(("sag",), choices={"current": 0.0}),
            Law(("sag",), choices={"current": 1.0}, sentence=_BY_CURRENT),
            Law(("sag", "emf"), choices={"current": 2.0}, sentence=_BY_CURRENT),
        ),
        shared=True,
        hints=Hints(
            electric=True,
            ties=("concave-gain",),
            programmes=(ONE_AND_OTHER, LEVELS),
        ),
    ),
    Effect(
        "dead-time",
        "actuator",
        Place.TORQUE,
        Texts(
            "T → T − δ K clip(i/ρ, ±1) while d ≠ 0, i = T − ε ω",
            "Both switches of a leg of the bridge wait at each pulse: the sign of the current "
            "takes voltage away.",
            "No motion at small commands; braking is stronger than driving.",
            "A slow staircase through zero, and reversals from speed.",
        ),
        (
            EffectParameter("share", "drive", 0.0, 0.0, MOST_DEAD, (0.04, 0.1, 0.04, 0.1)),
            EffectParameter("emf", "", 1.0, LEAST_EMF, 1.0, (0.9, 0.9, 0.9, 0.9)),
            EffectParameter("ripple", "", 0.0, 0.0, 0.3, (0.0, 0.0, 0.03, 0.03)),
        ),
        _dead_time,
        _amid,
        part=TorquePart.DRIVE,
        inverse=_through_dead_time,
        hints=Hints(
            electric=True,
            ties=("dead-zone", "coulomb-friction", "stiction"),
            programmes=(STAIRCASE, REVERSALS, COASTING),
        ),
    ),
    Effect(
        "current-limit",
        "actuator",
        Place.TORQUE,
        Texts(
            "T → ε ω + clip(T − ε ω, ±l)",
            "The bridge limits the current to that of a blocked motor at a certain command: "
            "acceleration is limited, speed is not.",
            "After large steps the speed changes in straight lines, up and down; small steps are "
            "not affected.",
            "Steps of very different size, and reversals from speed.",
        ),
        (
            EffectParameter(
                "limit", "speed", 1e6, 0.03, 2.5, (0.2, 0.5, 1.0), kinks=True, as_command=True
            ),
            EffectParameter("emf", "", 1.0, LEAST_EMF, 1.0, (1.0, 1.0, 1.0)),
        ),
        _limit,
        _amid,
        part=TorquePart.DRIVE,
        hints=Hints(
            electric=True,
            ties=("input-saturation",),
            programmes=(TOP, REVERSALS),
        ),
    ),
    Effect(
        "battery-discharge",
        "actuator",
        Place.COMMAND,
        Texts(
            "d → d(1 − b t), or d → d(1 − b (exp(c q) − 1)/c) with q̇ = (d_L² + d_R²)/2",
            "The battery empties: everything slows with time.",
            "The same command reaches less speed late in the log.",
            "The same sequence at the beginning and the end of a long run.",
        ),
        (
            EffectParameter(
                "loss",
                "1/s",
                0.0,
                0.0,
                MOST_LOSS,
                (0.0005, 0.002, 0.001, 0.004, 0.001, 0.004),
                measured_as="loss",
            ),
            EffectParameter("bend", "1/s", 0.0, -0.1, 2.0, (0.0,) * 4 + (-0.02, 0.1)),
            EffectParameter(
                "charge", "", 0.0, 0.0, 2.0, (0.0, 0.0, 1.0, 1.0, 2.0, 2.0), choice=True
            ),
        ),
        _battery,
        memory=Memory(
            1,
            at_rest=_full,
            of_inputs=True,
        ),
        inverse=_charged,
        shared=True,
        laws=(
            Law(("loss",), choices={"charge": 0.0}),
            Law(("loss",), choices={"charge": 1.0}, sentence=_BY_CHARGE),
            Law(
                ("loss", "bend"),
                choices={"charge": 2.0},
                sentence=_BY_CHARGE + " Its open-circuit voltage falls along a curve.",
            ),
        ),
        hints=Hints(
            electric=True,
            programmes=(REPEAT, HOT),
            gathers=True,
        ),
    ),
)
