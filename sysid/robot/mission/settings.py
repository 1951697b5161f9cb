"""Base of every section of a mission file: keys with types and bounds, validated and immutable.

A law is such a section itself: its fields are the keys a mission may give it, its methods the law.
"""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, PlainValidator

from sysid.data.yaml_files.settings import Coordinate as Coordinate
from sysid.data.yaml_files.settings import Gain as Gain
from sysid.data.yaml_files.settings import Positive as Positive
from sysid.data.yaml_files.settings import Settings as Settings
from sysid.data.yaml_files.source import shown
from sysid.robot.mission.contracts import Pose, Scene, State
from sysid.robot.mission.traits import ControlAdvice, GuidanceAdvice, GuidanceTraits
from sysid.vehicle.kinematics import Real


class Search(NamedTuple):
    """Marks a key as a gain to be tuned: within these bounds a sensible value lies."""

    low: float
    high: float


class TunedSettings(Settings):
    """Base of laws with gains to be tuned: their keys marked by :class:`Search`."""

    @property
    def gains(self) -> Mapping[str, tuple[float, float]]:
        """The keys that are gains to be tuned, each with the bounds of a sensible search."""
        return {
            name: (mark.low, mark.high)
            for name, field in type(self).model_fields.items()
            for mark in field.metadata
            if isinstance(mark, Search)
        }

    def with_gains(self, values: Mapping[str, Real]) -> Self:
        """The same law with other values of its gains, which are taken as they are."""
        return self.model_copy(update=dict(values))

    @property
    def uses_plant(self) -> bool:
        """Whether it needs the answer of the identified plant, which is then measured."""
        return False


class AxisSettings(TunedSettings):
    """Base of laws of one axis of a controller (:class:`sysid.robot.mission.axis.AxisLaw`)."""


class GuidanceSettings(Settings):
    """Base of guidance laws: obstacles do not act, and the way to go is that to the goal."""

    @property
    def reach(self) -> float:
        """Distance from an obstacle's point within which it changes the way [m]."""
        return 0.0

    @property
    def advice(self) -> GuidanceAdvice:
        return GuidanceAdvice()

    @property
    def traits(self) -> GuidanceTraits:
        return GuidanceTraits()

    def to_go(self, state: State, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The way still to go from a pose [m]."""
        return scene.to_goal(pose, xp)


IDENTIFIED = "identified"
"""Everything that the plant holds and that can be undone."""

Compensate = tuple[str, ...] | str
"""Ids of effects, or :data:`IDENTIFIED`."""


def _effects(value: Any) -> Compensate:
    """Ids of effects that can be undone."""
    from sysid.effects.compensation import can_be_compensated

    if value == IDENTIFIED:
        return IDENTIFIED
    named = [value] if isinstance(value, str) else value
    known = can_be_compensated()
    if not isinstance(named, list | tuple) or not all(id in known for id in named):
        raise ValueError(
            f"compensate is {shown(value)}: write {IDENTIFIED}, or a list of invertible effects, "
            f"which are {', '.join(known)}"
        )
    return tuple(named)


class ControlSettings(TunedSettings):
    """Base of controllers.

    Attributes:
        period: time between two commands [s].
        compensate: effects of the plant to make up for, or ``identified``: all that can be undone.
    """

    period: Annotated[float, Field(ge=1e-4, le=60)] = 0.1
    compensate: Annotated[Compensate, PlainValidator(_effects)] = ()

    @property
    def advice(self) -> ControlAdvice:
        return ControlAdvice()
