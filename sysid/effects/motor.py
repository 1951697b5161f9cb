"""Effects inside the motor and gear: they change the torque or the speed it makes.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects import inverses
from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, StartsFrom, State
from sysid.effects.programmes import (
    COASTING,
    CRUISE,
    HOT,
    LEVELS,
    ONE_AND_OTHER,
    RAMPS,
    REPEAT,
    RESTS,
    REVERSALS,
    STAIRCASE,
)

P = Mapping[str, Signal]


def _sticking(xp: Any, torque: Signal, level: Signal, c: Context) -> Signal:
    """Torque after dry friction of ``level``, implicit in time, so that it sticks exactly.

    ω⁺ = ω_free + b T; friction takes from T what would bring ω⁺ to zero, at most ``level``.
    """
    to_stop = torque + c.w_free / c.b
    return torque - xp.minimum(xp.maximum(to_stop, -level), level)


def _coulomb(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return _sticking(xp, torque, p["level"], c), s


def _stiction(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    slow = xp.exp(-((c.w / p["speed"]) ** 2))
    return _sticking(xp, torque, p["level"] + p["excess"] * slow, c), s


def _amid(torque: Signal, c: Context) -> Signal:
    """Speed in the middle of a step under a torque."""
    return 0.5 * (c.w + c.w_free + c.b * torque)


def _drag(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # resistance at the speed amid the step, predicted with that at its start: second order
    w = _amid(torque - p["drag"] * c.w * xp.abs(c.w), c)
    return torque - p["drag"] * w * xp.abs(w), s


def _bias(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - p["load"], s


def _viscous(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    more = p["ratio"] - 1.0
    w = _amid(torque - more * xp.minimum(c.w, 0.0), c)
    return torque - more * xp.minimum(w, 0.0), s


def _coupling(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - p["share"] * c.torque_other, s


def _together(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    """Shares of the deviations from steady speed that a sample leaves: own and the other's.

    exp(−M⁻¹ dt) of M = [[τ_1, m], [m, τ_2]], m = μ √(τ_1 τ_2), in closed form.
    """
    if kept.shape[-1] != 2:
        return {"own": kept, "other": 0.0 * kept}
    rate = -xp.log(xp.maximum(kept, 1e-9))  # dt/τ
    free = 1.0 / (1.0 - p["share"] ** 2)
    mean = 0.5 * free * (rate + rate[..., ::-1])
    half = 0.5 * free * (rate - rate[..., ::-1])
    mixed = free * p["share"] * xp.sqrt(rate * rate[..., ::-1])
    apart = xp.sqrt(half**2 + mixed**2 + 1e-12)
    ratio = xp.exp(-mean) * xp.sinh(apart) / apart
    return {"own": xp.exp(-mean) * xp.cosh(apart) - ratio * half, "other": ratio * mixed}


def _inertia(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    if w.shape[-1] != 2:
        return w, s
    deviation = c.w - (w - c.w_free) / c.b
    # a track that sticks neither feels the other one nor moves it
    stands = (w == 0.0) & (c.w == 0.0) & (xp.abs(c.torque) < c.holds)
    apart = (p["share"] == 0.0) | stands[..., :1] | stands[..., 1:]
    # both less one is the other: turning the tracks round would cost most of a compiled step
    other = deviation[..., :1] + deviation[..., 1:] - deviation
    coupled = (p["own"] - (1.0 - c.b)) * deviation + p["other"] * other
    return w + xp.where(apart, 0.0, coupled), s


def _warming(xp: Any, p: P, dt: float, kept: Signal) -> dict[str, Signal]:
    return {"warming": 1.0 - xp.exp(-dt / p["time"])}


def _thermal(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    heat = s[0] + p["warming"] * (c.drive**2 - s[0])
    return torque * (1.0 - p["loss"] * s[0]), (heat,)


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


def _cold(w: Signal, d: Signal) -> State:
    return (0.0 * w,)


def _touching(w: Signal, d: Signal) -> State:
    return (1.0 + 0.0 * w, w)


def _last_command(w: Signal, d: Signal) -> State:
    return (d + 0.0 * w,)


def _ripple(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    turned = p["per_turn"] * xp.where(p["of_wheel"] > 0.5, c.turned, c.counted)
    return w + p["cosine"] * xp.cos(turned) + p["sine"] * xp.sin(turned), s


_GAPS = (0.15, 0.6, 2.0) * 3

LOAD_BIAS = Effect(
    "load-bias",
    "motor",
    Place.TORQUE,
    "T → T − b",
    "A constant load pulls one way.",
    "Without command it creeps, or equal commands of either sign reach different speeds.",
    "Equal steps in both directions and rests.",
    (EffectParameter("load", "speed", 0.0, -0.8, 0.8, (0.05, -0.05), "speed"),),
    _bias,
    inverse=inverses.against_bias,
    ties=("sensor-bias",),
    programmes=(RESTS, COASTING),
    level=True,
)

EFFECTS = (
    Effect(
        "cross-coupling",
        "motor",
        Place.TORQUE,
        "T → T − g T_other",
        "One side's torque loads the other through the body.",
        "A side gives way a little whenever the other one pulls.",
        "One side at a constant command while the other steps.",
        (EffectParameter("share", "", 0.0, -0.6, 0.6, (0.1, -0.1), "one"),),
        _coupling,
        inverse=inverses.against_coupling,
        couples=True,
        opposite="One side's torque helps the other through the body.",
        programmes=(ONE_AND_OTHER, REVERSALS),
    ),
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
        "quadratic-drag",
        "motor",
        Place.TORQUE,
        "T → T − q ω|ω|",
        "Resistance grows with the square of speed.",
        "High speeds fall short, and settle faster than low ones.",
        "Steps at many levels.",
        (EffectParameter("drag", "1/speed", 0.0, 0.0, 2.0, (0.15, 0.5), "speed"),),
        _drag,
        inverse=inverses.against_drag,
        ties=("concave-gain",),
        rare=True,
        programmes=(LEVELS, COASTING),
    ),
    Effect(
        "viscous-asymmetry",
        "motor",
        Place.TORQUE,
        "viscous term × ratio for ω < 0",
        "Viscous resistance differs between the directions.",
        "One direction is both slower and quicker to settle.",
        "Steps of equal size in both directions.",
        (EffectParameter("ratio", "", 1.0, 0.4, 2.5, (0.85, 1.2), "one"),),
        _viscous,
        inverse=inverses.against_viscous,
        programmes=(LEVELS, COASTING),
        reverses=True,
    ),
    LOAD_BIAS,
    Effect(
        "coulomb-friction",
        "motor",
        Place.TORQUE,
        "T → T − c sign ω; sticks while |T| ≤ c",
        "Dry friction: a constant resistance while moving, standstill below it.",
        "It stands at small commands and stops sooner than it should.",
        "A slow staircase through zero, and coasting from speed.",
        (
            EffectParameter(
                "level",
                "speed",
                0.0,
                0.0,
                3.0,
                (0.05, 0.15, 0.3),
                "speed",
                kinks=True,
                as_command=True,
            ),
        ),
        _coulomb,
        inverse=inverses.against_coulomb,
        holds=lambda p: p["level"],
        ties=("stiction", "dead-zone"),
        programmes=(STAIRCASE, COASTING, RAMPS),
        weakens=True,
    ),
    Effect(
        "stiction",
        "motor",
        Place.TORQUE,
        "T → T − (c + c_s e^{−(ω/v)²}) sign ω",
        "It takes more to break away than to keep moving.",
        "It starts with a jump at a higher command than the one at which it stops.",
        "Slow ramps up from rest and down to rest.",
        (
            EffectParameter(
                "level",
                "speed",
                0.0,
                0.0,
                3.0,
                (0.04, 0.1),
                "speed",
                kinks=True,
                at_null=True,
                as_command=True,
            ),
            EffectParameter(
                "excess", "speed", 0.0, 0.0, 1.5, (0.08, 0.15), "speed", kinks=True, as_command=True
            ),
            EffectParameter("speed", "speed", 0.1, 0.01, 0.35, (0.05, 0.15), "speed", kinks=True),
        ),
        _stiction,
        inverse=inverses.against_stiction,
        holds=lambda p: p["level"] + p["excess"],
        ties=("coulomb-friction",),
        programmes=(RAMPS, STAIRCASE),
        weakens=True,
    ),
    Effect(
        "inertial-coupling",
        "motor",
        Place.SPEED,
        "τ ω̇ = T − ω − m ω̇_other, m = μ √(τ τ_other)",
        "The body's mass and yaw inertia tie both sides: one speeds up, the other feels it.",
        "A side twitches whenever the other one speeds up or slows down, not while it pulls.",
        "One side at a constant command while the other steps, then both together and opposed.",
        (EffectParameter("share", "", 0.0, -0.9, 0.9, (0.25, -0.25), "one"),),
        _inertia,
        _together,
        shared=True,
        couples=True,
        programmes=(ONE_AND_OTHER, REVERSALS),
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
