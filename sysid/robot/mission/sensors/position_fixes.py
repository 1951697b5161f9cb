"""Position fixes from outside: motion capture, satellites."""

import math
from typing import Any, ClassVar

from sysid.robot.mission.contracts import SensorInputs, State
from sysid.robot.mission.sensors.imperfect import ImperfectSensor, NotNegative, Reals
from sysid.robot.mission.settings import Positive
from sysid.vehicle.kinematics import Real


class PositionFixes(ImperfectSensor):
    """Reads the position X, Y in the inertial frame, ``fix_x`` and ``fix_y`` [m].

    The defaults are those of satellite positioning with carrier phase (u-blox ZED-F9P, data sheet:
    0.01 m horizontally), ten fixes a second; motion capture is better by a factor of ten or more,
    satellites without corrections worse by a hundred.
    """

    measured: ClassVar[tuple[str, ...]] = ("fix_x", "fix_y")

    rate: Positive = 10.0
    noise: NotNegative = (0.01 / math.sqrt(10.0),)

    def measure(
        self, memory: State, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[State, Reals]:
        return memory, (inputs.body.pose.x, inputs.body.pose.y)
