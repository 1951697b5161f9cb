"""Effects inside the motor and gear: they change the torque or the speed it makes.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from typing import Any

from sysid.effects.base import Context, Effect, EffectParameter, Place, Signal, State

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


def _drag(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - p["drag"] * c.w * xp.abs(c.w), s


def _bias(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - p["load"], s


def _viscous(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - xp.where(c.w < 0.0, (p["ratio"] - 1.0) * c.w, 0.0), s


def _coupling(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    return torque - p["share"] * (c.torque[..., ::-1] if c.torque.shape[-1] > 1 else 0.0), s


def _thermal(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    share = 1.0 - xp.exp(-c.dt / p["time"])
    heat = s[0] + share * (c.drive**2 - s[0])
    return torque * (1.0 - p["loss"] * s[0]), (heat,)


def _coast(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    falling = xp.abs(w) < xp.abs(c.w)
    return xp.where(falling, c.w + (w - c.w) / p["ratio"], w), s


def _freewheel(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    most = p["rate"] * c.dt
    held = c.w - xp.sign(c.w) * most
    slower = xp.abs(w) < xp.abs(held)
    letting_go = (c.torque * c.w >= 0.0) & (xp.abs(c.torque) < xp.abs(c.w)) & slower
    return xp.where(letting_go & (held * c.w > 0.0), held, w), s


def _backlash(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    # s: place of the motor within the gap [rad] and speed of the wheel; the core is the motor
    place, wheel = s
    ahead = place + (w - wheel) * c.dt
    half = 0.5 * p["gap"]
    inside = xp.abs(ahead) < half
    coasting = wheel + (c.w_free / xp.where(c.w == 0.0, 1.0, c.w) - 1.0) * wheel * xp.where(
        c.w == 0.0, 0.0, 1.0
    )
    speed = xp.where(inside, coasting, w)
    return speed, (xp.minimum(xp.maximum(ahead, -half), half), speed)


def _ripple(xp: Any, w: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    n = p["per_turn"]
    return w + p["cosine"] * xp.cos(n * c.angle) + p["sine"] * xp.sin(n * c.angle), s


EFFECTS = (
    Effect(
        "cross-coupling",
        "motor",
        Place.TORQUE,
        "T → T − g T_other",
        "One track's torque loads the other through the body.",
        "A track gives way a little whenever the other one pulls.",
        "One track at a constant command while the other steps.",
        (EffectParameter("share", "", 0.0, -0.6, 0.6, (0.1, -0.1), "one"),),
        _coupling,
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
            EffectParameter("loss", "", 0.0, 0.0, 0.9, (0.15, 0.35), "one"),
            EffectParameter("time", "s", 30.0, 5.0, 300.0, (20.0, 60.0), "one"),
        ),
        _thermal,
        states=1,
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
        ties=("concave-gain",),
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
    ),
    Effect(
        "load-bias",
        "motor",
        Place.TORQUE,
        "T → T − b",
        "A constant load pulls one way.",
        "Without command it creeps, or equal commands of either sign reach different speeds.",
        "Equal steps in both directions and rests.",
        (EffectParameter("load", "speed", 0.0, -0.8, 0.8, (0.05, -0.05), "speed"),),
        _bias,
        ties=("sensor-bias",),
    ),
    Effect(
        "coulomb-friction",
        "motor",
        Place.TORQUE,
        "T → T − c sign ω; sticks while |T| ≤ c",
        "Dry friction: a constant resistance while moving, standstill below it.",
        "It stands at small commands and stops sooner than it should.",
        "A slow staircase through zero, and coasting from speed.",
        (EffectParameter("level", "speed", 0.0, 0.0, 0.9, (0.05, 0.15, 0.3), "speed"),),
        _coulomb,
        ties=("stiction", "dead-zone"),
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
            EffectParameter("level", "speed", 0.0, 0.0, 0.9, (0.04, 0.1), "speed"),
            EffectParameter("excess", "speed", 0.0, 0.0, 0.9, (0.08, 0.15), "speed"),
            EffectParameter("speed", "speed", 0.1, 0.01, 0.5, (0.05, 0.15), "speed"),
        ),
        _stiction,
        ties=("coulomb-friction",),
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
    ),
    Effect(
        "freewheel",
        "motor",
        Place.SPEED,
        "|ω̇| ≤ r while the command lets go",
        "The driver lets go instead of braking: near-linear decay.",
        "Falls are straight lines, rises are exponentials.",
        "Steps to zero from several speeds.",
        (EffectParameter("rate", "speed/s", 1e6, 0.02, 100.0, (0.5, 1.5, 4.0), "speed"),),
        _freewheel,
        ties=("coast-asymmetry",),
    ),
    Effect(
        "backlash",
        "motor",
        Place.READING,
        "a gap g between motor and wheel",
        "Play in the gear: at each reversal the wheel waits until the gap is crossed.",
        "A short pause after each reversal, none in one direction.",
        "Frequent reversals at several speeds.",
        (EffectParameter("gap", "rad", 0.0, 0.0, 6.0, (0.2, 0.6, 1.5), "one"),),
        _backlash,
        states=2,
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
            EffectParameter("per_turn", "1/rad", 1.0, 0.5, 20.0, (1.0,), "one"),
        ),
        _ripple,
    ),
)
