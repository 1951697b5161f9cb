"""Resistance to motion: dry, viscous and air friction, and a constant load.

Torque is counted in units of steady speed: τ ω̇ = T − ω with T = K d.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sysid.effects.base import (
    Context,
    Effect,
    EffectParameter,
    Hints,
    Law,
    Place,
    Signal,
    State,
    Texts,
    TorquePart,
)
from sysid.effects.programmes import COASTING, LEVELS, RAMPS, RESTS, STAIRCASE
from sysid.effects.supply import USUAL_EMF

P = Mapping[str, Signal]


HEAVIEST = 30.0
"""Dry friction in units of the usual speed: what hardly moves is slow beside the speed that its
commands would reach without."""


def _sticking(xp: Any, torque: Signal, level: Signal, hold: Signal, c: Context) -> Signal:
    """Torque after dry friction of ``level``, with which it sticks exactly.

    ω⁺ = ω_free + b T; friction takes from T what would bring ω⁺ to zero, at most ``level``. Where
    the speed passes zero within the step, friction turns with it: ω = A + (ω − A) e^(−t/τ) with
    A = T − level sign ω ends at zero; from there it holds, or what exceeds it accelerates for the
    rest of the step.

    Args:
        hold: torque with which it holds at zero.
    """
    to_stop = torque + c.w_free / c.b
    plain = torque - xp.minimum(xp.maximum(to_stop, -level), level)
    way, kept = xp.sign(c.w), 1.0 - c.b
    at_zero = torque + (c.w_free - kept * c.w) / c.b
    towards = at_zero - level * way
    passes = way * (c.w_free + c.b * (torque - level * way)) < 0.0
    remaining = towards / xp.where(passes, towards - c.w, 1.0)  # of the speed's distance, at zero
    rest = 1.0 - kept / xp.where(passes, remaining, 1.0)
    going = xp.where(xp.abs(at_zero) > hold, rest * (at_zero + level * way), 0.0)
    return xp.where(passes, (going - c.w_free) / c.b, plain)


def _coulomb(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    """Dry friction c + s |M + L| of a contact between the torque M of the motor and a load L.

    Of T = K d the back-emf takes nearly all of the viscous term 1, so that M = T − ω. The load
    resists, L = T − (the signal that reaches the friction); as an external torque that helps the
    motion it is T_e = −L, so that this is the published |M − T_e| (Duclusaud, Passault, Padois,
    Ly: Extended friction models for the physics simulation of servo actuators, 2025, model M3).
    What is left of both, M − L, only accelerates; a gear that holds a weight still carries it. Of a
    load that rests it counts both sides: there s is half of a share of the motor's torque alone.
    """
    level = p["level"] + p["of_load"] * xp.abs(torque + 2.0 * (c.driven - torque) - c.w)
    # of a servo T is the set point, ω the position: friction takes what would move it
    to_stay = torque + (c.w_free - c.w) / c.b
    short = torque - xp.minimum(xp.maximum(to_stay, -p["level"]), p["level"])
    return xp.where(p["of_servo"] > 0.5, short, _sticking(xp, torque, level, level, c)), s


def _stiction(xp: Any, torque: Signal, s: State, p: P, c: Context) -> tuple[Signal, State]:
    slow = xp.exp(-((c.w / p["speed"]) ** 2))
    level = p["level"] + p["excess"] * slow
    return _sticking(xp, torque, level, p["level"] + p["excess"], c), s


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
    # τ ω̇ = ρ T − ν ω is solved exactly for the direction in which it turns amid the step
    constant, ratio, kept = p["by_constant"] > 0.5, p["ratio"], 1.0 - c.b
    viscous = xp.where(constant, 1.0 + p["emf"] * (ratio**2 - 1.0), ratio)
    driven = torque * xp.where(constant, ratio, 1.0)
    settled, fades = driven / viscous, xp.maximum(kept, 1e-12) ** viscous
    more = settled + (c.w - settled) * fades - (kept * c.w + c.b * torque)
    return torque + xp.where(_amid(torque, c) < 0.0, more / c.b, 0.0), s


STANDS = 0.05
"""Share of the larger of speed and torque below which a track counts as at standstill: there
friction acts against the torque, otherwise against the motion."""


def _onward(xp: Any, torque: Signal, c: Context) -> Signal:
    """The direction against which friction acts: that of the motion, at rest that of the torque.

    None where nothing is wanted: there friction may do its work.
    """
    moves = xp.abs(c.w) > STANDS * xp.maximum(xp.abs(c.w), xp.abs(torque))
    onward = xp.where(moves, xp.sign(c.w), xp.sign(torque))
    return xp.where(torque == 0.0, 0.0, onward)


def _against_coulomb(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """The x with x − (c + s |x + 2 L − ω|) sign ω = T, in the direction against which it acts.

    L is what loads take. Of a servo the set point beyond the wanted one, T + c sign(T − y).
    """
    way, beside = _onward(xp, torque, c), 2.0 * (c.driven - torque) - c.w
    wanted = torque + beside + p["level"] * way
    against = xp.where(wanted * way >= 0.0, 1.0 - p["of_load"], 1.0 + p["of_load"])
    short = torque + p["level"] * xp.sign(torque - c.w)
    return xp.where(p["of_servo"] > 0.5, short, wanted / against - beside)


def _against_stiction(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + c + c_s e^{−(ω/v)²} in the direction against which friction acts."""
    slow = xp.exp(-((c.w / p["speed"]) ** 2))
    return torque + (p["level"] + p["excess"] * slow) * _onward(xp, torque, c)


def _against_drag(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + q ω|ω|."""
    return torque + p["drag"] * c.w * xp.abs(c.w)


def _against_bias(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + b."""
    return torque + p["load"]


def _against_viscous(xp: Any, torque: Signal, p: P, c: Context) -> Signal:
    """T → T + (ratio − 1) min(ω, 0), or (T + ε (ratio² − 1) min(ω, 0))/ratio for ω < 0."""
    constant, w = p["by_constant"] > 0.5, xp.minimum(c.w, 0.0)
    more = xp.where(constant, p["emf"] * (p["ratio"] ** 2 - 1.0), p["ratio"] - 1.0)
    return (torque + more * w) / xp.where(constant & (c.w < 0.0), p["ratio"], 1.0)


LOAD_BIAS = Effect(
    "load-bias",
    "motor",
    Place.TORQUE,
    Texts(
        "T → T − b",
        "A constant load pulls one way.",
        "Without command it creeps, or equal commands of either sign reach different speeds.",
        "Equal steps in both directions and rests.",
    ),
    (EffectParameter("load", "speed", 0.0, -0.8, 0.8, (0.05, -0.05)),),
    _bias,
    inverse=_against_bias,
    hints=Hints(
        ties=("sensor-bias",),
        programmes=(RESTS, COASTING),
        level=True,
    ),
)

_LEVEL = EffectParameter(
    "level", "speed", 0.0, 0.0, HEAVIEST, (0.04, 0.1), kinks=True, at_null=True, as_command=True
)

EFFECTS = (
    Effect(
        "quadratic-drag",
        "motor",
        Place.TORQUE,
        Texts(
            "T → T − q ω|ω|",
            "Resistance grows with the square of speed.",
            "High speeds fall short, and settle faster than low ones.",
            "Steps at many levels.",
        ),
        (EffectParameter("drag", "1/speed", 0.0, 0.0, 20.0, (0.15, 0.5, 2.0)),),
        _drag,
        part=TorquePart.FRICTION,
        inverse=_against_drag,
        hints=Hints(
            ties=("concave-gain",),
            rare=True,
            programmes=(LEVELS, COASTING),
        ),
    ),
    Effect(
        "viscous-asymmetry",
        "motor",
        Place.TORQUE,
        Texts(
            "viscous term × ratio for ω < 0; or T × ratio and viscous term × (ε ratio² + 1 − ε)",
            "Viscous resistance differs between the directions.",
            "One direction is both slower and quicker to settle.",
            "Steps of equal size in both directions.",
        ),
        (
            EffectParameter("ratio", "", 1.0, 0.4, 2.5, (0.85, 1.2) * 2),
            EffectParameter("emf", "", USUAL_EMF, 0.0, 1.0, (USUAL_EMF,) * 4, at_limit=True),
            EffectParameter("by_constant", "", 0.0, 0.0, 1.0, (0.0,) * 2 + (1.0,) * 2, choice=True),
        ),
        _viscous,
        part=TorquePart.DRIVE,
        inverse=_against_viscous,
        laws=(
            Law(("ratio",), choices={"by_constant": 0.0}),
            Law(
                ("ratio", "emf"),
                choices={"by_constant": 1.0},
                sentence="The constant of the motor differs, for torque and back-emf alike, as "
                "with brushes off the neutral: the resistance is electric.",
            ),
        ),
        hints=Hints(
            programmes=(LEVELS, COASTING),
            reverses=True,
        ),
    ),
    LOAD_BIAS,
    Effect(
        "coulomb-friction",
        "motor",
        Place.TORQUE,
        Texts(
            "T − L → T − L − (c + s |T + L − ω|) sign ω with the load L; sticks while |T − L| is "
            "no larger. Of a servo with set point T and position y: T → T − c sign ẏ; sticks while "
            "|T − y| ≤ c",
            "Dry friction: a constant resistance while moving, standstill below it.",
            "No motion at small commands, and early stops.",
            "A slow staircase through zero, and coasting from speed.",
        ),
        (
            replace(_LEVEL, starts=(0.05, 0.15, 0.3, 0.03, 0.03, 0.03, 0.1, 0.3)),
            EffectParameter(
                "of_load", "", 0.0, 0.0, 0.6, (0.0,) * 3 + (0.1, 0.25) + (0.0,) * 3, kinks=True
            ),
            EffectParameter(
                "by_load", "", 0.0, 0.0, 1.0, (0.0,) * 3 + (1.0,) * 2 + (0.0,) * 3, choice=True
            ),
            EffectParameter("of_servo", "", 0.0, 0.0, 1.0, (0.0,) * 5 + (1.0,) * 3, choice=True),
        ),
        _coulomb,
        part=TorquePart.FRICTION,
        inverse=_against_coulomb,
        holds=lambda p: p["level"] / (1.0 - p["of_load"]),
        laws=(
            Law(("level",), choices={"by_load": 0.0, "of_servo": 0.0}),
            Law(
                ("level", "of_load"),
                choices={"by_load": 1.0, "of_servo": 0.0},
                sentence="It grows with the torque that is transmitted, as in a worm or planetary "
                "gear.",
            ),
            Law(
                ("level",),
                choices={"of_servo": 1.0},
                sentence="Within this distance of the set point the servo's loop pushes less than "
                "friction holds: there the servo stays.",
            ),
        ),
        hints=Hints(
            ties=("stiction", "dead-zone", "dead-time", "position-play"),
            programmes=(STAIRCASE, COASTING, RAMPS),
        ),
    ),
    Effect(
        "stiction",
        "motor",
        Place.TORQUE,
        Texts(
            "T → T − (c + c_s e^{−(ω/v)²}) sign ω",
            "It takes more to break away than to keep moving.",
            "It starts with a jump at a higher command than the one at which it stops.",
            "Slow ramps up from rest and down to rest.",
        ),
        (
            _LEVEL,
            replace(_LEVEL, name="excess", starts=(0.08, 0.15), at_null=False),
            EffectParameter("speed", "speed", 0.1, 0.01, 0.35, (0.05, 0.15), kinks=True),
        ),
        _stiction,
        part=TorquePart.FRICTION,
        inverse=_against_stiction,
        holds=lambda p: p["level"] + p["excess"],
        hints=Hints(
            ties=("coulomb-friction", "dead-time"),
            programmes=(RAMPS, STAIRCASE),
        ),
    ),
)
