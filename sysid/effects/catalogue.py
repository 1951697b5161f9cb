"""The catalogue: every known effect by id, in the order in which the chain applies them."""

from functools import cache

from sysid.effects import actuator, motor, sensor, vehicle
from sysid.effects.base import Effect, Place
from sysid.errors import UsageError
from sysid.extensions import loaded, points

CHANGED = Effect(
    "changed-parameter",
    "any",
    Place.SAMPLES,
    "K, τ → other values",
    "The model is of another robot, or of this one in another state: its gain or time constant "
    "differs on this log.",
    "Every response is larger, smaller, faster or slower by one factor.",
    "Steps of several sizes, on the log of the model and on this one.",
    (),
    lambda xp, signal, state, parameters, context: (signal, state),
)
"""Competes with the effects when a model is given; it changes the model's own core."""


def about(id: str) -> Effect:
    """The effect called ``id``, or the changed parameter."""
    return CHANGED if id == CHANGED.id else effect(id)


@cache
def catalogue() -> dict[str, Effect]:
    """Effects that have a step, by id; other packages add theirs as ``sysid.effects``.

    Quantisation, held telemetry and dropouts are read off the samples and have no step.
    """
    found = {e.id: e for e in (*actuator.EFFECTS, *motor.EFFECTS, *sensor.EFFECTS)}
    found |= {e.id: e for e in vehicle.EFFECTS}
    for point in points("sysid.effects").values():
        effect: Effect = loaded(point, "effect")
        found.setdefault(effect.id, effect)
    return found


def effect(id: str) -> Effect:
    """The effect called ``id``.

    Raises:
        UsageError: there is none of that name.
    """
    if id not in catalogue():
        raise UsageError(f"no effect {id!r}; the catalogue holds {', '.join(catalogue())}")
    return catalogue()[id]


def chain_effects() -> tuple[Effect, ...]:
    """Those that act between command and reading, in the chain's order.

    Within the command delays come first and effects with memory last, within the reading effects
    with memory come first: what has none can then be computed for a whole record at once.
    """
    found = [e for e in catalogue().values() if e.place not in (Place.POSE, Place.SAMPLES)]
    return tuple(sorted(found, key=_rank))


def _rank(e: Effect) -> tuple[int, int]:
    memory = 0 if e.on_past else 2 if e.states else 1
    return list(Place).index(e.place), -memory if e.place is Place.READING else memory
