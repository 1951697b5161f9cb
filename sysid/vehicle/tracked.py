"""The tracked vehicle: parameters of its motion on the ground."""

import math
from dataclasses import dataclass, field

from sysid.errors import ModelError
from sysid.vehicle.kinematics import Geometry, Real

G = 9.81
"""Acceleration of free fall, as the thesis takes it [m/s²]."""


@dataclass(frozen=True)
class TrackedVehicle:
    """A body on two tracks.

    Attributes:
        geometry: sprocket radius r and distance B of the track centre lines [m].
        contact_length: L of a track on the ground [m].
        track_width: b of a track [m].
        mass: of the whole vehicle [kg] (thesis, table 5.2).
        yaw_inertia: J about the vertical through the centre of mass [kg m²] (thesis, 5.7).
        centre: how far the centre of mass lies ahead of the middle of the contact areas [m].
        height: of the centre of mass above the floor [m]; 0 moves no load between the tracks.

    A number that a compiler traces is not checked.

    Raises:
        ModelError: a number is no length, mass or inertia, or the centre of mass lies beyond the
            tracks.
    """

    geometry: Geometry = field(default_factory=Geometry)
    contact_length: Real = 0.14
    track_width: Real = 0.04
    mass: Real = 1.592
    yaw_inertia: Real = 0.0652
    centre: Real = 0.0
    height: Real = 0.0

    def __post_init__(self) -> None:
        for name, unit in (
            ("contact_length", "metres"),
            ("track_width", "metres"),
            ("mass", "kilograms"),
            ("yaw_inertia", "kg m²"),
        ):
            value = getattr(self, name)
            if _plain(value) and not (math.isfinite(value) and value > 0):
                said = name.replace("_", " ")
                raise ModelError(f"the vehicle's {said} is {value}: give {unit} above 0")
        if _plain(self.height) and not (math.isfinite(self.height) and self.height >= 0):
            raise ModelError(
                f"the centre of mass lies {self.height} m above the floor: give at least 0"
            )
        known = _plain(self.centre) and _plain(self.contact_length)
        if known and not abs(self.centre) < 0.5 * self.contact_length:
            raise ModelError(
                f"the centre of mass lies {self.centre} m from the middle of tracks of "
                f"{self.contact_length} m: it must lie between their ends, or the vehicle tips"
            )

    @property
    def weight(self) -> Real:
        """mg [N]."""
        return self.mass * G


def _plain(value: Real) -> bool:
    return isinstance(value, int | float)
