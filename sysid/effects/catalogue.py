"""The catalogue: every known effect by id, in the order in which the chain applies them."""

from functools import cache
from importlib.metadata import entry_points

from sysid.effects import actuator, motor, sensor, vehicle
from sysid.effects.base import Effect, Place
from sysid.errors import UsageError


@cache
def catalogue() -> dict[str, Effect]:
    """Effects that have a step, by id; other packages add theirs as ``sysid.effects``.

    Quantisation and dropouts are read off the samples and have no step.
    """
    found = {e.id: e for e in (*actuator.EFFECTS, *motor.EFFECTS, *sensor.EFFECTS)}
    found |= {e.id: e for e in vehicle.EFFECTS}
    for point in entry_points(group="sysid.effects"):
        effect: Effect = point.load()
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
    """Those that act between command and reading, in the chain's order."""
    return tuple(e for e in catalogue().values() if e.place is not Place.POSE)
