"""Effect: one physical phenomenon as one pure step, the identity at its null value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from sysid.effects.programmes import LEVELS, REVERSALS, Programme

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


class TorquePart(Enum):
    """Which part of the torque an effect changes; they act in this order.

    A weight does not fade with the winding, and dry friction answers to all that pulls: with the
    weight behind it a shaft that friction holds would creep for ever.
    """

    DRIVE = "what supply, bridge and motor make of the command"
    LOAD = "what acts on the shaft from outside: weights, slopes, the other track"
    FRICTION = "what resists the motion of the shaft"


class CommandPart(Enum):
    """Which part of the way of a command an effect changes; they act in this order, delays first.

    A ramp passes through a dead zone at its own rate.
    """

    STICK = "the curve of whoever commands"
    CONTROLLER = "how fast a controller lets the command change"
    DRIVE = "limits, dead zones and lags of what it drives"


FRICTION_BEFORE_LOADS, LIMITS_BEFORE_RAMPS, ORDER = 1, 2, 3
"""Orders of the chain: that of older files, which name none, where weights and the fading of a warm
motor act behind friction; that of ``TorquePart``, where limits and dead zones of a bridge act
before the ramp of the controller that commands it; and that of ``CommandPart``."""


class StartsFrom(Enum):
    """What the search for an effect starts from; all but the first are read off the data."""

    LISTED = "the starting values of its parameters"
    CLIP_LEVEL = "the level at which readings pile up, for its first parameter"
    WAVES = "the strongest waves of the errors over the wheel's angle, for its waves"
    RAMPS = "the steepest motion that lasts, for its first parameter"
    SIGNS = "cores fitted to readings whose signs are recovered, which it is taken to have lost"


class Length(Enum):
    """What another length of the vehicle does just as well as an effect between tracks and ground.

    Where the lengths are estimated from the pose, such an effect is none.
    """

    RADIUS = "r"
    TRACK_DISTANCE = "B"


@dataclass(frozen=True, eq=False)
class Context:
    """What an effect may look at besides the signal it changes; arrays have one entry a track.

    What is not given is nothing: effects of a place look at a part of it only.

    Attributes:
        dt: sample time [s].
        t: time since the start of the record [s].
        w: speed before the step.
        w_free: speed that the step would reach without torque.
        b: speed reached per unit of torque within the step.
        torque: torque of the step, in units of steady speed (T = K d).
        torque_other: that of the other track (zero where there is none).
        driven: what the drive makes of the torque, before loads and friction; what loads take is
            the difference to the signal that reaches the friction.
        drive: command as it was given, before any effect.
        turned: angle of the wheel, integrated from its speed [rad].
        counted: angle integrated from the measurements before this one [rad].
        holds: torque with which dry friction holds a track at standstill.
        gain: K, steady speed at full drive.
        log: which of several logs the sample belongs to, from 0.
    """

    dt: float
    t: Signal = 0.0
    w: Signal = 0.0
    w_free: Signal = 0.0
    b: Signal = 0.0
    torque: Signal = 0.0
    torque_other: Signal = 0.0
    drive: Signal = 0.0
    turned: Signal = 0.0
    counted: Signal = 0.0
    holds: Signal = 0.0
    gain: Signal = 1.0
    log: Signal = 0.0
    driven: Signal = 0.0


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes:
        name: as shown.
        unit: unit; ``speed`` stands for the unit of the output, ``drive`` for full drive.
        null: value at which the effect does nothing.
        lower, upper: physical bounds; where the unit is one of ``speed``, in typical speeds.
        starts: values a search starts from, tried together with those of the other parameters, in
            the same units.
        in_samples: whether bounds and starts of a time count in samples.
        choice: whether it is one of its starts and never in between: tried, not searched.
        stepwise: whether a run changes with it by jumps, so that no slope says where to go: it is
            looked for on ever finer grids.
        kinks: whether a run's slope in it jumps where a sample passes an edge: its interval is
            read off the likelihood, not off slopes.
        jumps: the same where the run itself jumps.
        at_null: whether it may stay at its null value where others show the effect; else an effect
            whose first parameter a search leaves there is not named.
        at_limit: whether it may end on the other bound, which is the method's and not physics.
        edge: +1 or −1 for an edge on the axis of the command, upward or downward: between two
            neighbouring commands of a log its position is not determined.
        as_command: whether it is also shown as the command that just overcomes it.
        as_rate: whether an error of a servo, it is also shown as the speed that this error holds.
        measured_as: key of a mission's ``vehicle.supply`` under which a bench measures it.
        as_seen: whether it may be larger than ``upper`` where the samples show so many waves of the
            angle: of an axis that moves by little, a thousandth of a wheel's turn each.
    """

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    starts: tuple[float, ...]
    in_samples: bool = False
    choice: bool = False
    stepwise: bool = False
    kinks: bool = False
    jumps: bool = False
    at_null: bool = False
    at_limit: bool = False
    edge: int = 0
    as_command: bool = False
    as_rate: bool = False
    measured_as: str = ""
    as_seen: bool = False

    @property
    def size(self) -> float:
        """Its typical size: the largest start."""
        return max(map(abs, self.starts)) or 0.1

    def start(self, k: int) -> float:
        """Its value in the k-th start of its effect."""
        return self.starts[min(k, len(self.starts) - 1)]


@dataclass(frozen=True)
class Wave:
    """A wave over the angle of the wheel, whose phase is another in every record.

    Attributes:
        cosine, sine: its parameters.
        line: parameter of the waves a rad.
        of_wheel: parameter of what the angle is integrated from: 1 for the wheel's speed, 0 for the
            measurements.
        of_speed: whether they are shares of the speed.
        of_torque: whether they are a resistance to the torque, which shows after the motor's lag.
    """

    cosine: str
    sine: str
    line: str = "per_turn"
    of_wheel: str = "of_wheel"
    of_speed: bool = False
    of_torque: bool = False


Step = Callable[[Any, Signal, State, Mapping[str, Signal], Context], tuple[Signal, State]]
"""(xp, signal, state, parameters, context) → (signal, state)."""


Inverse = Callable[[Any, Signal, Mapping[str, Signal], Context], Signal]
"""(xp, signal that is wanted behind the effect, parameters, context) → signal in front of it.

Of the context it may look at ``t``, ``w``, ``torque``, ``torque_other`` and ``driven``.
"""

Constants = Callable[[Any, Mapping[str, Signal], float, Signal], dict[str, Signal]]
"""(xp, parameters, dt, share of its speed that a track keeps in a sample) → parameters."""

OnRecord = Callable[[Signal, Mapping[str, Signal], float], Signal]
"""(wheel speeds of a record (N, 2), parameters, dt) → the same behind the effect."""

Sideways = Callable[[Any, Signal, Signal, Mapping[str, Signal]], Signal]
"""(xp, forward speed [m/s], yaw rate [rad/s], parameters) → speed to the left [m/s]."""

InNumbers = Callable[[float, float, int], str]
"""(value, standard error, side: 0 left, 1 right, −1 both) → sentence."""


@dataclass(frozen=True, eq=False)
class Law:
    """One of several ways in which an effect shows.

    Attributes:
        parameters: those it searches; those of the other laws do nothing.
        in_numbers: between tracks and ground, the sentence with its first parameter.
        as_radius: whether a smaller radius of both tracks does just the same.
        as_lag: whether measurements that come late do nearly the same.
        choices: in the chain, the values of the effect's parameters with ``choice`` that stand
            for this law; each law has some of the starts.
        sentence: in the chain, what it is in plain words, after the effect's own.
        of_speed: whether its parameter is a share of the way for each rad/s of the wheels.
        of_changes: whether it loses way while the vehicle speeds up or slows down, as another law
            of the effect does in another manner.
    """

    parameters: tuple[str, ...]
    in_numbers: InNumbers | None = None
    as_radius: bool = False
    as_lag: bool = False
    choices: Mapping[str, float] = field(default_factory=dict)
    sentence: str = ""
    of_speed: bool = False
    of_changes: bool = False


NO_LAW = Law(())
"""Of an effect that has no laws."""


def nothing(
    xp: Any, signal: Signal, state: State, parameters: Mapping[str, Signal], context: Context
) -> tuple[Signal, State]:
    """The step of an effect that is no step of the chain."""
    return signal, state


@dataclass(frozen=True)
class Texts:
    """An effect in words, for reports and documentation.

    Attributes:
        equation: what it does, as a formula.
        sentence: what it is, in plain words.
        looks_like: what it looks like in data.
        experiment: what a robot should do to show it.
        opposite: the sentence where the first parameter lies below its null value, for an effect
            that then does the opposite; empty where the sentence holds on both sides.
        by_hand: what distinguishes it from its ties where no command can, and what is then seen;
            empty where commands suffice.
        between_edges: what a log does not determine where no command lies between the possible
            positions of an ``edge``, as the end of a sentence.
    """

    equation: str
    sentence: str
    looks_like: str
    experiment: str
    opposite: str = ""
    by_hand: str = ""
    between_edges: str = ""


@dataclass(frozen=True)
class Memory:
    """What an effect carries from step to step, for whoever runs the chain.

    Attributes:
        states: how many states.
        at_rest: (speed, drive) → its states in steady motion; None where every state then equals
            the signal the effect acts on.
        of_inputs: whether its states are simply its own last inputs, or follow from the commands
            alone: such an effect acts before others on a command, and after them on a reading.
    """

    states: int = 0
    at_rest: Callable[[Signal, Signal], State] | None = None
    of_inputs: bool = False


@dataclass(frozen=True)
class OnGround:
    """What an effect between tracks and ground is to those that fit poses.

    Attributes:
        on_record: for one with a memory, the effect on the wheel speeds of a record that begins in
            steady motion, as fits need it often; None takes one sample after the other.
        sideways: the speed to the left that it gives the body, from what the other effects leave of
            the speeds; None for none.
        length: the length that its parameter scales; None for none.
        in_numbers: the sentence with its parameter.
    """

    on_record: OnRecord | None = None
    sideways: Sideways | None = None
    length: Length | None = None
    in_numbers: InNumbers | None = None


@dataclass(frozen=True)
class Hints:
    """What the search of a diagnosis knows of an effect before it sees a log.

    Attributes:
        ties: effects that many logs cannot distinguish from it.
        rare: whether one of its ties is preferred where a log cannot distinguish them.
        programmes: commands that show it, the best first.
        gathers: whether it comes on slowly over the log, and explains nothing that changes at once.
        level: whether it shifts torque or reading by a constant, which a base with a level of its
            own holds already: it is then not offered.
        beyond_sampling: whether it only shifts or smooths in time: up to half a sample it is how
            the log was sampled (a difference over a sample is half of one late) and is not named.
        exchanges: its parameter that is a lag of first order like the motor's own: both may change
            places.
        reverses: whether only commands of both signs can show it, so that an actuator without a
            negative side is not asked to.
        electric: whether it is of a supply, a bridge or a winding, which a command that is a
            position (of a rudder, a valve) does not drive.
    """

    ties: tuple[str, ...] = ()
    rare: bool = False
    programmes: tuple[Programme, ...] = (LEVELS, REVERSALS)
    starts_from: StartsFrom = StartsFrom.LISTED
    gathers: bool = False
    level: bool = False
    beyond_sampling: bool = False
    exchanges: str = ""
    reverses: bool = False
    electric: bool = False


@dataclass(frozen=True)
class Effect:
    """One phenomenon of the catalogue: what every effect says, and optional traits.

    Attributes:
        id: its name, as in the catalogue.
        stage: ``actuator``, ``motor``, ``vehicle`` or ``sensor``.
        place: where in the chain its step acts.
        texts: it in words.
        parameters: each with unit, bounds and null value.
        step: the one implementation, over numpy and jax.numpy alike.
        constants: (xp, parameters, dt, kept) → further parameters that the step reads beside the
            parameters and that do not change from step to step.
        part: of an effect on the torque, which part of it: the order in which they act.
        command_part: of an effect on the command, which part of its way.
        memory: what it carries from step to step.
        holds: (parameters) → torque with which it holds a track at standstill.
        undone: (reading, parameters) → the reading without the effect, where that is known: what
            a first reading says of the speed.
        inverse: how the command, or the torque, is chosen so that what is wanted is left of it;
            None where that is not possible, or not without knowing what comes.
        shared: whether all tracks share its parameters.
        couples: whether it ties tracks to each other: a single one cannot have it, and the search
            moves the parameters of all tracks together, because those of one change the others'
            runs.
        laws: its laws where it has several, the simplest first. Between tracks and ground each is
            reported by itself. In the chain one acts at a time: the data choose, and a later one
            only where it is worth more than its parameters cost.
        waves: its waves over the wheel's angle; a law with one has it among its parameters.
        on_ground: what it is to poses.
        hints: what a search knows of it.
    """

    id: str
    stage: str
    place: Place
    texts: Texts
    parameters: tuple[EffectParameter, ...]
    step: Step
    constants: Constants | None = None
    part: TorquePart = TorquePart.LOAD
    command_part: CommandPart = CommandPart.DRIVE
    memory: Memory = Memory()
    holds: Callable[[Mapping[str, Signal]], Signal] | None = None
    undone: Callable[[Signal, Mapping[str, Signal]], Signal] | None = None
    inverse: Inverse | None = None
    shared: bool = False
    couples: bool = False
    laws: tuple[Law, ...] = ()
    waves: tuple[Wave, ...] = ()
    on_ground: OnGround = OnGround()
    hints: Hints = Hints()

    @property
    def of_motion(self) -> bool:
        """Whether only what a motor turns or moves has it: what acts on a torque or a speed."""
        return self.stage == "motor" or self.place in (Place.TORQUE, Place.SPEED)

    def law(self, chosen: Mapping[str, float]) -> Law | None:
        """The law of the chain that values of its choices stand for; None where it has none."""
        fits = (x for x in self.laws if x.choices and x.choices.items() <= chosen.items())
        return next(fits, None)

    def searched(self, chosen: Mapping[str, float]) -> tuple[str, ...]:
        """Parameters that a search moves: all but choices and what belongs to other laws."""
        law = self.law(chosen)
        names = tuple(p.name for p in self.parameters if not p.choice)
        return names if law is None else tuple(n for n in names if n in law.parameters)


def sides_of(effect: Effect, inputs: int, outputs: int) -> Sequence[int]:
    """Tracks on which an effect has parameters of its own; −1 where all share them.

    An effect of the command has them at each input: two outputs of one input share them, and each
    of several inputs of one output has its own.
    """
    if effect.shared or (effect.place is Place.COMMAND and inputs < outputs):
        return (-1,)
    return range(inputs if effect.place is Place.COMMAND else outputs)


OF_SERVO = "of_servo"
"""The choice by which an effect has a law of servos (1) and others (0).

Of a servo the command is the position to be reached, the reading the position: in the chain T is
then the set point and ω the position, and laws of torque and speed say nothing.
"""


def of_servo(effect: Effect) -> Effect:
    """The effect with its laws of servos only; as it is where it has none."""
    return _where(effect, 1.0)


def of_motor(effect: Effect) -> Effect:
    """The effect without its laws of servos."""
    return _where(effect, 0.0)


def is_of_servo(effect: Effect) -> bool:
    """Whether an effect has laws of servos only."""
    return any(p.name == OF_SERVO and set(p.starts) == {1.0} for p in effect.parameters)


def _where(effect: Effect, value: float) -> Effect:
    choice = next((p for p in effect.parameters if p.name == OF_SERVO), None)
    if choice is None:
        return effect
    rows = [k for k, v in enumerate(choice.starts) if v == value]
    parameters = tuple(
        replace(p, starts=tuple(p.starts[k] for k in rows) if len(p.starts) > 1 else p.starts)
        for p in effect.parameters
    )
    laws = tuple(law for law in effect.laws if law.choices.get(OF_SERVO) == value)
    return replace(effect, parameters=parameters, laws=laws)
