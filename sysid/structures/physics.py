"""What the dynamics of a vehicle's drives say besides outputs: ground, torques, friction.

A family registers what it knows with ``@ground_effects.register`` and the like.
"""

from functools import singledispatch

from sysid.data.record import Array
from sysid.effects.compensation import Identified
from sysid.effects.ground import Ground
from sysid.structures.base import Structure
from sysid.vehicle.motors import TorqueSource


@singledispatch
def ground_effects(structure: Structure, theta: Array) -> Ground:
    """Effects between tracks and ground: they change the pose, no output; none by default."""
    return Ground()


@singledispatch
def identified_effects(structure: Structure, theta: Array) -> Identified:
    """Effects between commands and torques, for who makes up for them; none by default."""
    return Identified()


@singledispatch
def torques(structure: Structure, theta: Array) -> TorqueSource | None:
    """The motors as sources of torque; None where the dynamics give speeds only."""
    return None


@singledispatch
def friction_entries(structure: Structure) -> tuple[int, ...]:
    """Entries of θ that are dry friction: another floor or grease changes them together."""
    return ()
