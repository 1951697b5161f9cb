"""Drawbar pull of a tracked vehicle against slip, its limits and inverse."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.runners import floats
from sysid.runners.loops import bisected
from sysid.vehicle.ground.resistance import compaction_resistance
from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.shear import thrust
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

_ROUNDS, _TRIED = 6, 33
"""The largest pull is looked for among 33 slips, then among 33 between the neighbours of the best,
six times: that places the slip within 1e-7, where the pull is flat to rounding."""
_HALVINGS = 50
"""Of an interval of 1: to 1e-15."""
_HALVINGS_OF_SLOPE = 34
"""To 1e-10 rad: each asks for a largest pull anew."""
_STEEPEST = math.radians(89.0)


def pressure_of(vehicle: TrackedVehicle, slope: Real = 0.0, xp: Any = np) -> Pressure:
    """The pressure under rigid tracks: a trapezoid, its centre below the centre of mass.

    On a slope β that is height · tan β farther back.

    Args:
        slope: β, upwards [rad].
    """
    centre = vehicle.centre - vehicle.height * xp.tan(slope)
    if isinstance(centre, int | float) and centre == 0.0:
        return Pressure()
    return Pressure(Distribution.LINEAR, centre)


@dataclass(frozen=True)
class Traction:
    """A vehicle on a soil, driving straight.

    Attributes:
        pressure: how each track's load is spread; by default as :func:`pressure_of`.
        slope: β of the ground, upwards [rad]. The load is W cos β.
    """

    soil: Soil
    vehicle: TrackedVehicle
    pressure: Pressure | None = None
    slope: Real = 0.0

    def spread(self, xp: Any = np) -> Pressure:
        """The pressure that holds."""
        return self.pressure or pressure_of(self.vehicle, self.slope, xp)

    def load(self, xp: Any = np) -> Real:
        """Normal load on each track [N]."""
        return 0.5 * self.vehicle.weight * xp.cos(self.slope)

    def thrust(self, slip: Real, xp: Any = np) -> Real:
        """Thrust of both tracks at that slip [N]."""
        v = self.vehicle
        return 2.0 * thrust(
            self.soil, self.load(xp), slip, v.contact_length, v.track_width, self.spread(xp), xp
        )

    def rolling(self, xp: Any = np) -> Real:
        """Rolling resistance of both tracks, driving forward [N] (2.34)."""
        return 2.0 * self.load(xp) * self.soil.rolling

    def compaction(self, xp: Any = np) -> Real:
        """Resistance of the ground that both tracks press together [N]."""
        v = self.vehicle
        return 2.0 * compaction_resistance(
            self.soil, self.load(xp), v.contact_length, v.track_width, self.spread(xp), xp
        )

    def drawbar_pull(self, slip: Real, xp: Any = np) -> Real:
        """What is left to pull with, H = F − R − R_c [N], driving forward; on a slope W sin β goes
        off this."""
        return self.thrust(slip, xp) - self.rolling(xp) - self.compaction(xp)

    def efficiency(self, slip: Real, xp: Any = np) -> Real:
        """Tractive efficiency η = H v′/(F v) = (1 − i) H/F [1]; NaN without slip, where F is 0."""
        force = self.thrust(slip, xp)
        pull = force - self.rolling(xp) - self.compaction(xp)
        return xp.where(
            force == 0.0, xp.nan, (1.0 - slip) * pull / xp.where(force == 0.0, 1.0, force)
        )

    def largest_pull(self, xp: Any = np) -> tuple[Real, Real]:
        """Largest drawbar pull [N] and its slip [1], of slips from 0 to 1."""
        low, high = xp.asarray(0.0), xp.asarray(1.0)
        best = high
        shape = (-1,) + (1,) * np.ndim(self.drawbar_pull(high, xp))
        for _ in range(_ROUNDS):
            share = xp.linspace(0.0, 1.0, _TRIED).reshape(shape)
            at = xp.argmax(self.drawbar_pull(low + (high - low) * share, xp), axis=0)
            step = (high - low) / (_TRIED - 1)
            best = low + step * at
            low, high = xp.maximum(best - step, 0.0), xp.minimum(best + step, 1.0)
        return self.drawbar_pull(best, xp), best

    def slip_for(self, pull: Real, xp: Any = np) -> Real:
        """Least slip at which the vehicle pulls that much [1]; NaN where the soil cannot give it.

        Args:
            pull: H [N].
        """
        most, at = self.largest_pull(xp)
        ends = 0.0 * (at + pull), at + 0.0 * pull
        slip = bisected(xp, _HALVINGS, ends, lambda slip: self.drawbar_pull(slip, xp) >= pull)
        return xp.where(pull <= most, slip, xp.nan)

    def needed_slip(self, pull: float) -> float:
        """As :meth:`slip_for`, of one pull [N]."""
        slip = float(self.slip_for(pull))
        if math.isnan(slip):
            most, at = self.largest_pull()
            given = f"{float(most):.3g} N at a slip of {float(at):.2g}"
            if most <= 0.0:
                given = "none: its resistances are larger than its thrust"
            raise ModelError(
                f"the soil cannot give a pull of {pull:.3g} N, at most {given}; reduce load or "
                "slope, or use a larger track or firmer ground"
            )
        return slip

    @property
    def tipping_slope(self) -> float:
        """Slope at which the load reaches the end of the track and the vehicle tips [rad]."""
        v = self.vehicle
        return math.atan2(0.5 * v.contact_length + v.centre, v.height)

    def steepest_slope(self) -> float:
        """Steepest slope that the vehicle climbs, W sin β = largest pull under W cos β [rad].

        At most the one at which it tips, and 89°; NaN where it cannot even drive on the level.
        """

        def spare(slope: float) -> float:
            tilted = replace(self, slope=slope)
            return float(tilted.largest_pull()[0] - self.vehicle.weight * math.sin(slope))

        ends = 0.0, min(self.tipping_slope * (1.0 - 1e-9), _STEEPEST)
        if spare(0.0) < 0.0:
            return math.nan
        slope = bisected(floats, _HALVINGS_OF_SLOPE, ends, lambda slope: spare(slope) < 0.0)
        return float(slope)
