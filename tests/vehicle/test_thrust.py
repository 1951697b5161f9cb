"""Thrust of a track against what its formula is the integral of."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from sysid.errors import ModelError
from sysid.vehicle.soil import Soil
from sysid.vehicle.thrust import uniform_thrust
from sysid.vehicle.tracked import TrackedVehicle

SAND = Soil(cohesion=1.0e3, friction_angle=0.5, shear_modulus=0.025)


@pytest.mark.parametrize("slip", [-0.6, -0.01, 1e-9, 0.02, 0.3, 1.0])
def test_the_closed_form_is_the_integral_of_shear_stress(slip: float) -> None:
    load, length, width = 8.0, 0.14, 0.04
    most = SAND.cohesion + load / (width * length) * SAND.friction

    def stress(x: float) -> float:
        return most * (1.0 - math.exp(-abs(slip) * x / SAND.shear_modulus))

    integral = math.copysign(width * quad(stress, 0.0, length)[0], slip)
    thrust = uniform_thrust(SAND, load, slip, length, width)
    assert thrust == pytest.approx(integral, rel=1e-6)  # below a reach of 1e-6 a series stands


def test_thrust_of_many_slips_at_once() -> None:
    slips = np.linspace(-1.0, 1.0, 11)
    together = uniform_thrust(SAND, 8.0, slips, 0.14, 0.04)
    assert together == pytest.approx([uniform_thrust(SAND, 8.0, s, 0.14, 0.04) for s in slips])
    assert np.all(np.diff(together) > 0.0)


def test_a_vehicle_whose_centre_of_mass_lies_beyond_its_tracks_is_refused() -> None:
    with pytest.raises(ModelError, match="tips"):
        TrackedVehicle(centre=0.08)
