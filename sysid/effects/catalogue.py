"""The catalogue: every known effect by id, in the order in which the chain applies them."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from sysid.effects import (
    actuator,
    coupling,
    friction,
    motor,
    ripple,
    samples,
    sensor,
    servo,
    supply,
    transmission,
    vehicle,
)
from sysid.effects.base import (
    FRICTION_BEFORE_LOADS,
    LIMITS_BEFORE_RAMPS,
    ORDER,
    CommandPart,
    Effect,
    Hints,
    Place,
    Texts,
    TorquePart,
    nothing,
)
from sysid.effects.by_log import BY_LOG
from sysid.effects.conformance import fault
from sysid.effects.programmes import LEVELS, REPEAT
from sysid.effects.sensor import SAMPLING
from sysid.errors import UsageError
from sysid.extensions import loaded, points, unusable

CHANGED = Effect(
    "changed-parameter",
    "any",
    Place.SAMPLES,
    Texts(
        "K, τ → other values",
        "The model is of another robot, or of this one in another state: its gain or time constant "
        "differs on this log.",
        "Every response is larger, smaller, faster or slower by one factor.",
        "Steps of several sizes, on the log of the model and on this one.",
    ),
    (),
    nothing,
    hints=Hints(
        programmes=(LEVELS, REPEAT),
    ),
)
"""Competes with the effects when a model is given; it changes the model's own core."""

STAGES = (
    actuator,
    supply,
    coupling,
    friction,
    motor,
    transmission,
    ripple,
    servo,
    sensor,
    vehicle,
)
"""Where effects with a step are, in the order in which they act within a place of the chain (or a
part of the torque)."""

_WITHOUT_STEP = {e.id: e for e in (CHANGED, *samples.EFFECTS)}

DELAY = actuator.INPUT_DELAY
"""What shifts a command in time."""

NOT_NAMED = {**BY_LOG, SAMPLING.id: SAMPLING}
"""Searched beside effects and by the same rule, but matters of the logs."""

LEVEL = friction.LOAD_BIAS
"""What gives a base a level of its own, where zero of the log is no physical zero."""


def about(id: str) -> Effect:
    """The effect called ``id``, one of the samples or the changed parameter included."""
    return _WITHOUT_STEP.get(id) or effect(id)


def is_known(id: str) -> bool:
    """Whether ``about`` knows the effect."""
    return id in _WITHOUT_STEP or id in catalogue()


@cache
def catalogue() -> dict[str, Effect]:
    """Effects that have a step, by id; other packages add theirs as ``sysid.effects``.

    Quantisation, held telemetry and dropouts are read off the samples and have no step.
    """
    effects = {e.id: e for stage in STAGES for e in stage.EFFECTS}
    for point in points("sysid.effects").values():
        effect = loaded(point, "effect")
        if not isinstance(effect, Effect):
            raise unusable(point, "effect", "is no sysid.effects.base.Effect")
        if effect.id in effects or effect.id in _WITHOUT_STEP:
            raise unusable(point, "effect", f"has the name of another one, {effect.id}")
        if wrong := fault(effect):
            raise unusable(point, "effect", wrong)
        effects[effect.id] = effect
    return effects


def effect(id: str) -> Effect:
    """The effect called ``id``, what differs between logs and how they were made included."""
    if id in NOT_NAMED:
        return NOT_NAMED[id]
    if id not in catalogue():
        raise UsageError(f"no effect {id!r}; the catalogue holds {', '.join(catalogue())}")
    return catalogue()[id]


def chain_effects() -> tuple[Effect, ...]:
    """Effects of the catalogue that act between command and reading, in the chain's order."""
    return in_chain(e for e in catalogue().values() if e.place not in (Place.POSE, Place.SAMPLES))


def in_chain(effects: Iterable[Effect], order: int = ORDER) -> tuple[Effect, ...]:
    """Effects between command and reading in the order in which they act.

    Within the command delays come first, then the stick, the controller and what it drives, of
    which effects with memory come last. Within the reading those come first: what has none can then
    be computed for a whole record at once. Within the torque the drive comes first, then loads,
    then friction.

    Args:
        order: ``ORDER``, or an earlier one, in which models were stored.
    """
    if order == FRICTION_BEFORE_LOADS:
        # all that reaches the friction then counts as what the drive makes
        effects = (replace(e, part=TorquePart.DRIVE) for e in effects)
    return tuple(sorted(effects, key=lambda e: _rank(e, order)))


def ground_effects() -> tuple[Effect, ...]:
    """Those that act between tracks and ground, in the order in which they act."""
    return tuple(e for e in catalogue().values() if e.place is Place.POSE)


def _rank(e: Effect, order: int) -> tuple[int, int]:
    memory = 0 if e.memory.of_inputs else 2 if e.memory.states else 1
    within = -memory if e.place is Place.READING else memory
    if e.place is Place.COMMAND and order > LIMITS_BEFORE_RAMPS:
        within = 0 if e.memory.of_inputs else 10 * list(CommandPart).index(e.command_part) + memory
    if e.place is Place.TORQUE and order != FRICTION_BEFORE_LOADS:
        within = list(TorquePart).index(e.part)
    return list(Place).index(e.place), within
