"""A sensor: the distance to a radio beacon, with the errors that all sensors can have."""

from typing import Any, ClassVar

from sysid.robot.mission.contracts import SensorInputs, State
from sysid.robot.mission.sensors.imperfect import ImperfectSensor, NotNegative, Reals
from sysid.robot.mission.settings import Coordinate, Positive
from sysid.vehicle.kinematics import Real


class Beacon(ImperfectSensor):
    """Reads √((X − x)² + (Y − y)²) [m].

    Attributes:
        x, y: place of the beacon [m].
    """

    measured: ClassVar[tuple[str, ...]] = ("beacon_distance",)

    x: Coordinate = 0.0
    y: Coordinate = 0.0
    rate: Positive = 5.0
    noise: NotNegative = (0.02,)

    def measure(
        self, memory: State, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[State, Reals]:
        """The distance at this sample; nothing is remembered."""
        place = inputs.body.pose
        return memory, (xp.hypot(place.x - self.x, place.y - self.y),)
