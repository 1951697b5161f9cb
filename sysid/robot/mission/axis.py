"""One axis of a controller, forward speed or yaw: inputs and protocol of its law.

A law of an axis turns what is asked and what is believed into one command. It is the same for both
axes as far as it can be: its error is in m/s or rad, its command in shares of full drive.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

from sysid.vehicle.kinematics import Geometry, Real

State = Any
"""What a law remembers; see :mod:`sysid.robot.mission.contracts`."""


class FirstOrder(NamedTuple):
    """The identified plant along one axis, as a first-order lag: τ v̇ = g d − v.

    Attributes:
        gain: g, steady speed at full drive [m/s, or rad/s of the yaw].
        lag: τ [s].
    """

    gain: Real
    lag: Real


class Nominal(NamedTuple):
    """What laws that need a model know of the plant: its answer to both commands.

    Attributes:
        speed: from V_cmd to the forward speed.
        yaw: from ψ_cmd to the yaw rate.
    """

    speed: FirstOrder
    yaw: FirstOrder


PUBLISHED = Nominal(FirstOrder(0.43, 0.2), FirstOrder(2.0 * 0.43 / Geometry().B, 0.2))
"""The thesis's robot, where no plant was asked."""


class AxisInputs(NamedTuple):
    """What the law of an axis knows at a control instant ``t`` [s].

    The *motion* of an axis is what the plant answers a command with: the forward speed itself, or
    the yaw rate. The error is that of the speed, or of the yaw angle.

    Attributes:
        error: asked less believed [m/s, rad], of angles the short way.
        rate: rate of change of what is believed [m/s², rad/s].
        wanted: motion that the reference itself asks for: V_ref [m/s], ψ̇_ref [rad/s].
        wanted_rate: V̇_ref [m/s²]; 0 for the yaw.
        motion: motion that navigation believes [m/s, rad/s].
        low, high: limits of the command [drive].
        applied: what of the last command acted, as far as is known [drive].
    """

    t: Real
    error: Real
    rate: Real
    wanted: Real
    wanted_rate: Real
    motion: Real
    low: Real
    high: Real
    applied: Real
    plant: FirstOrder


@runtime_checkable
class AxisLaw(Protocol):
    """From what is asked and believed along one axis to its command, within its limits."""

    @property
    def gains(self) -> Mapping[str, tuple[float, float]]:
        """The keys that are gains to be tuned, each with the bounds of a sensible search."""

    @property
    def uses_plant(self) -> bool:
        """Whether it reads ``inputs.plant``: what the identified plant answers is then measured."""

    def with_gains(self, values: Mapping[str, Real]) -> "AxisLaw":
        """The same law with other values of its gains, which are taken as they are."""

    def start(self, scene: Any, xp: Any) -> State: ...

    def step(self, state: State, inputs: AxisInputs, dt: Real, xp: Any) -> tuple[State, Real]:
        """The command [drive] in [low, high]."""
