"""Properties that a wrapper of a guidance law takes over from it."""

from dataclasses import dataclass

from sysid.robot.mission.contracts import Guidance
from sysid.robot.mission.traits import GuidanceAdvice, GuidanceTraits


@dataclass(frozen=True)
class AroundLaw:
    """A law of guidance around another, whose reach, advice and traits it has.

    Attributes:
        law: from a pose to references.
    """

    law: Guidance

    @property
    def reach(self) -> float:
        return self.law.reach

    @property
    def advice(self) -> GuidanceAdvice:
        return self.law.advice

    @property
    def traits(self) -> GuidanceTraits:
        return self.law.traits
