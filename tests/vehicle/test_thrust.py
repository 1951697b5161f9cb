"""Thrust of a track against what its formula is the integral of."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from sysid.errors import ModelError
from sysid.runners import floats
from sysid.runners.compiled import jax_module
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.shear import shear_stress, thrust, uniform_thrust
from sysid.vehicle.soil import Shear, Soil
from sysid.vehicle.tracked import TrackedVehicle

SAND = Soil(cohesion=1.0e3, friction_angle=0.5, shear_modulus=0.025)
LAWS = [
    SAND,
    Soil(1.0e3, 0.5, 0.025, shear=Shear.HUMP),
    Soil(1.0e3, 0.5, 0.025, shear=Shear.RESIDUAL, residual=0.4),
]
each_law = pytest.mark.parametrize("soil", LAWS, ids=lambda s: s.shear)
PRESSURES = [
    Pressure(Distribution.WHEELS, 0.0, 5),
    Pressure(Distribution.WHEELS, -0.02, 3, 0.5),
    Pressure(Distribution.LINEAR, 0.01),
    Pressure(Distribution.LINEAR, 0.05),
    Pressure(Distribution.LINEAR, -0.05),
]
LOAD, L, B = 8.0, 0.14, 0.04


@pytest.mark.parametrize("slip", [-0.6, -0.01, 1e-9, 0.02, 0.3, 1.0])
def test_the_closed_form_is_the_integral_of_shear_stress(slip: float) -> None:
    load, length, width = 8.0, 0.14, 0.04
    most = SAND.cohesion + load / (width * length) * SAND.friction

    def stress(x: float) -> float:
        return -most * math.expm1(-abs(slip) * x / SAND.shear_modulus)

    integral = math.copysign(width * quad(stress, 0.0, length)[0], slip)
    thrust = uniform_thrust(SAND, load, slip, length, width)
    assert thrust == pytest.approx(integral, rel=1e-10)


@each_law
@pytest.mark.parametrize("slip", [-1.0, -1e-6, 0.0, 1e-3, 0.2, 1.0, 30.0])
def test_quadrature_is_the_closed_form_under_uniform_pressure(soil: Soil, slip: float) -> None:
    """A trapezoid that is none is uniform, but takes the way of the quadrature."""
    integrated = thrust(soil, LOAD, slip, L, B, Pressure(Distribution.LINEAR, 0.0))
    assert integrated == pytest.approx(uniform_thrust(soil, LOAD, slip, L, B), rel=1e-10, abs=1e-15)


@each_law
@pytest.mark.parametrize("pressure", PRESSURES, ids=str)
@pytest.mark.parametrize("stiffness", [1e-4, 1.0])
def test_quadrature_is_the_integral_under_any_pressure(
    soil: Soil, pressure: Pressure, stiffness: float
) -> None:
    soil = Soil(
        soil.cohesion,
        soil.friction_angle,
        soil.shear_modulus * stiffness,
        shear=soil.shear,
        residual=soil.residual,
    )
    begin, end = (float(v) for v in pressure.contact(L))
    slip, k = 0.4, soil.shear_modulus

    def stress(x: float) -> float:
        return float(shear_stress(soil, pressure.at(x, LOAD, L, B), slip * (x - begin)))

    layers = [begin + m * k / slip for m in (1.0, 4.0, 12.0, 40.0)]
    edges = [float(e) for part in pressure.smooth_parts(L) for e in part]
    cuts = sorted({begin, end, *(c for c in layers + edges if begin < c < end)})
    whole = sum(quad(stress, a, b, epsrel=1e-11)[0] for a, b in pairwise(cuts))
    assert thrust(soil, LOAD, slip, L, B, pressure) == pytest.approx(B * whole, rel=1e-9)


@each_law
@pytest.mark.parametrize("pressure", [None, *PRESSURES], ids=str)
def test_thrust_is_odd_and_linear_where_slip_is_small(
    soil: Soil, pressure: Pressure | None
) -> None:
    small = thrust(soil, LOAD, np.array([-2e-7, 1e-7, 2e-7]), L, B, pressure)
    assert small[0] == -small[2]
    # the next term is the slip times L/K, of 1e-6
    assert small[2] == pytest.approx(2.0 * small[1], rel=1e-5)


@each_law
def test_of_a_stiff_soil_coulombs_law_is_left(soil: Soil) -> None:
    stiff = Soil(1e3, 0.5, 1e-9, shear=soil.shear, residual=soil.residual)
    left = {Shear.JANOSI: 1.0, Shear.HUMP: 0.0, Shear.RESIDUAL: 0.4}[soil.shear]
    # the front, where shear has not settled, is K/(iL) = 7e-8 of the contact
    for pressure in (Pressure(), PRESSURES[0], PRESSURES[3]):
        begin, end = pressure.contact(L)
        most = (end - begin) * B * 1e3 + LOAD * math.tan(0.5)
        assert thrust(stiff, LOAD, 0.1, L, B, pressure) == pytest.approx(left * most, abs=1e-5)


def test_a_load_towards_the_rear_shears_more() -> None:
    """There the ground has been displaced farther (Wills 1963)."""
    front, rear = (thrust(SAND, LOAD, 0.1, L, B, Pressure.triangle(L, forward=f)) for f in (1, 0))
    assert front < uniform_thrust(SAND, LOAD, 0.1, L, B) < rear


def test_one_text_serves_floats_arrays_and_compiled_batches() -> None:
    jax = jax_module()
    jnp = jax.numpy
    slips = np.linspace(-0.9, 0.9, 7)
    friction = np.linspace(0.2, 0.7, 7)
    soil = Soil(1e3, friction, 0.02)
    for pressure in (None, PRESSURES[0], PRESSURES[4]):
        many = thrust(soil, LOAD, slips, L, B, pressure)
        single = [
            thrust(Soil(1e3, float(f), 0.02), LOAD, float(s), L, B, pressure, xp=floats)
            for f, s in zip(friction, slips, strict=True)
        ]
        assert many == pytest.approx(np.array(single), rel=1e-12)
        compiled = jax.jit(
            lambda f, s, p=pressure: thrust(Soil(1e3, f, 0.02), LOAD, s, L, B, p, xp=jnp)
        )
        assert np.asarray(compiled(friction, slips)) == pytest.approx(many, rel=1e-12)


def test_thrust_of_many_slips_at_once() -> None:
    slips = np.linspace(-1.0, 1.0, 11)
    together = uniform_thrust(SAND, 8.0, slips, 0.14, 0.04)
    assert together == pytest.approx([uniform_thrust(SAND, 8.0, s, 0.14, 0.04) for s in slips])
    assert np.all(np.diff(together) > 0.0)


def test_a_vehicle_whose_centre_of_mass_lies_beyond_its_tracks_is_refused() -> None:
    with pytest.raises(ModelError, match="tips"):
        TrackedVehicle(centre=0.08)
