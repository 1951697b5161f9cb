"""A magnetometer of two axes: the earth's field seen from the body, and iron that bends it."""

from typing import Annotated, Any, ClassVar

from pydantic import Field, field_validator

from sysid.robot.mission.contracts import Pose, SensorInputs, State
from sysid.robot.mission.sensors.imperfect import AboveZero, ImperfectSensor, NotNegative, Reals
from sysid.robot.mission.settings import Coordinate, Positive
from sysid.vehicle.kinematics import Real

IRON_SIZE = 0.1
"""[m] A piece of iron has a size: its field grows no further at distances of this order."""


class Magnetometer(ImperfectSensor):
    """Reads the magnetic field in the body frame, ``mag_x`` forward and ``mag_y`` left [µT].

    Undisturbed, m = H·(cos(ψ − north), −sin(ψ − north)), so that ψ = north + atan2(−m_y, m_x)
    (thesis 4.3). Magnets and iron on the robot itself turn with it: ``bias``. Iron in the world is
    magnetised along the earth's field ĥ and adds the field of a dipole,
    s·(3(ĥ·d)d/R² − ĥ)/R³ with d from the iron to the robot and R² = |d|² + 0.1².

    Range and resolution are those of the AK8963 in the MPU-9250 (±4912 µT in steps of 0.15 µT);
    0.5 µT of noise at 100 measurements a second and 1 µT of bias left after calibration are
    assumed.

    Attributes:
        field: horizontal field of the earth H [µT]; 20 in middle latitudes.
        north: heading of magnetic north in the frame of the mission [rad].
        iron: places of iron, each [X, Y, s], X and Y in m and s in µT: its field a metre beside it.
    """

    measured: ClassVar[tuple[str, ...]] = ("mag_x", "mag_y")

    rate: Positive = 100.0
    noise: NotNegative = (0.05,)
    bias_std: NotNegative = (1.0,)
    saturation: AboveZero | None = (4912.0,)
    resolution: NotNegative = (0.15,)
    field: Positive = 20.0
    north: Annotated[float, Field(ge=-6.2832, le=6.2832)] = 0.0
    iron: tuple[tuple[Coordinate, Coordinate, Coordinate], ...] = ()

    @field_validator("iron", mode="before")
    @classmethod
    def _places(cls, value: Any) -> Any:
        places = () if value is None else value
        if not isinstance(places, list | tuple) or not all(
            isinstance(place, list | tuple) and len(place) == 3 for place in places
        ):
            raise ValueError("iron must be a list of places: write iron: [[x, y, strength]]")
        return tuple(tuple(place) for place in places)

    def measure(
        self, memory: State, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[State, Reals]:
        """The field at this place, turned into the body frame."""
        pose = inputs.body.pose
        along_x, along_y = self.world_field(pose, xp)
        c, s = xp.cos(pose.psi), xp.sin(pose.psi)
        return memory, (c * along_x + s * along_y, c * along_y - s * along_x)

    def world_field(self, pose: Pose, xp: Any) -> tuple[Real, Real]:
        """The field along X and Y at a place [µT], the earth's and that of iron."""
        hx, hy = xp.cos(self.north), xp.sin(self.north)
        bx, by = self.field * hx, self.field * hy
        for x, y, strength in self.iron:
            dx, dy = pose.x - x, pose.y - y
            square = dx * dx + dy * dy + IRON_SIZE**2
            along = 3.0 * (hx * dx + hy * dy) / square
            size = strength / (square * xp.sqrt(square))
            bx, by = bx + size * (along * dx - hx), by + size * (along * dy - hy)
        return bx, by
