"""Effect: one physical phenomenon as one pure step that does nothing at its null value."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

Signal = Any
"""An array of the namespace ``xp`` in use (numpy or jax.numpy), one entry a track."""

State = tuple[Signal, ...]


class Place(Enum):
    """Where in the chain command → torque → speed → reading an effect acts."""

    COMMAND = "command"
    TORQUE = "torque"
    SPEED = "speed"
    READING = "reading"
    POSE = "pose"
    SAMPLES = "samples"


@dataclass(frozen=True, eq=False)
class Context:
    """What an effect may look at besides the signal it changes; arrays have one entry a track.

    Attributes:
        dt: sample time [s].
        t: time since the start of the record [s].
        w: speed before the step.
        w_free: speed that the step would reach without torque.
        b: speed reached per unit of torque within the step.
        torque: torque of the step, in units of steady speed (T = K d).
        torque_other: that of the other track (zero where there is none).
        drive: command as it was given, before any effect.
        turned: angle of the wheel, integrated from its speed [rad].
        counted: angle integrated from the readings before this one [rad].
        holds: torque with which dry friction holds a track that stands.
    """

    dt: float
    t: Signal
    w: Signal
    w_free: Signal
    b: Signal
    torque: Signal
    torque_other: Signal
    drive: Signal
    turned: Signal
    counted: Signal
    holds: Signal


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes:
        name: as shown.
        unit: unit; ``speed`` stands for the unit of the output, ``drive`` for full drive.
        null: value at which the effect does nothing.
        lower, upper: physical bounds, in the units of the signal it is scaled by.
        scaled_by: ``drive``, ``speed``, ``dt`` or ``one``: what bounds and starts are multiples of.
        starts: values a search starts from, tried together with those of the other parameters.
        choice: whether it is one of its starts and never in between: tried, not searched.
        stepwise: whether a run changes with it by jumps, so that no slope says where to go: it is
            looked for on ever finer grids.
        kinks: whether a run's slope in it jumps where a sample passes an edge: its interval is
            read off the likelihood, not off slopes.
        jumps: the same where the run itself jumps.
    """

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    starts: tuple[float, ...]
    scaled_by: str = "one"
    choice: bool = False
    stepwise: bool = False
    kinks: bool = False
    jumps: bool = False


Step = Callable[[Any, Signal, State, Mapping[str, Signal], Context], tuple[Signal, State]]
"""(xp, signal, state, parameters, context) → (signal, state)."""


Constants = Callable[[Any, Mapping[str, Signal], float, Signal], dict[str, Signal]]
"""(xp, parameters, dt, share of its speed that a track keeps in a sample) → numbers."""

Past = Callable[[Signal, Signal], Signal]
"""(signal over a record, whole samples a track) → the signal so much earlier."""


@dataclass(frozen=True)
class Effect:
    """One phenomenon of the catalogue.

    Attributes:
        id: its name, as in the catalogue.
        stage: ``actuator``, ``motor``, ``vehicle`` or ``sensor``.
        place: where in the chain its step acts.
        equation: what it does, as a formula.
        sentence: what it is, in plain words.
        looks_like: what it looks like in data.
        experiment: what a robot should do to show it.
        parameters: its numbers.
        step: the one implementation, over numpy and jax.numpy alike.
        constants: (xp, parameters, dt, kept) → further numbers that the step reads beside the
            parameters and that do not change from step to step.
        states: how many states it carries.
        on_past: (xp, signal, past, parameters, context) → the effect on a whole record at once,
            for one whose states are simply its own last inputs, newest first.
        at_rest: (speed, drive) → its states in steady motion; None where every state then equals
            the signal the effect acts on.
        holds: (parameters) → torque with which it holds a track that stands.
        shared: whether all tracks share its parameters.
        undone: (reading, parameters) → the reading without the effect, where that is known: what
            a first reading says of the speed.
        ties: effects that many logs cannot tell from it.
        rare: whether one of these is rather named where a log cannot tell.
        couples: whether it ties tracks to each other, so that a single one cannot have it.
        opposite: the sentence where the first number lies below its null value, for an effect that
            then does the opposite; empty where the sentence holds on both sides.
    """

    id: str
    stage: str
    place: Place
    equation: str
    sentence: str
    looks_like: str
    experiment: str
    parameters: tuple[EffectParameter, ...]
    step: Step
    constants: Constants | None = None
    states: int = 0
    on_past: Callable[[Any, Signal, Past, Mapping[str, Signal], Context], Signal] | None = None
    at_rest: Callable[[Signal, Signal], State] | None = None
    holds: Callable[[Mapping[str, Signal]], Signal] | None = None
    shared: bool = False
    undone: Callable[[Signal, Mapping[str, Signal]], Signal] | None = None
    ties: tuple[str, ...] = ()
    rare: bool = False
    couples: bool = False
    opposite: str = ""
