"""Drawbar pull: limits, efficiency, the inverse and the slope."""

import math

import numpy as np
import pytest

from sysid.errors import ModelError
from sysid.vehicle.ground.drawbar import Traction, pressure_of
from sysid.vehicle.ground.presets import soil_preset
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.soil import Shear, Soil
from sysid.vehicle.tracked import TrackedVehicle

ROBOT = TrackedVehicle()
FIRM = Soil(0.0, math.atan(0.6), 1e-9, rolling=0.1)
SOILS = [*(soil_preset(n) for n in ("dry-sand", "snow", "concrete")), FIRM]


@pytest.mark.parametrize("soil", SOILS, ids=lambda s: s.source[:20])
def test_efficiency_stays_below_what_slip_leaves(soil: Soil) -> None:
    slips = np.linspace(0.01, 1.0, 50)
    efficiency = Traction(soil, ROBOT).efficiency(slips)
    assert np.all(efficiency <= 1.0 - slips)
    assert efficiency[-1] <= 0.0


@pytest.mark.parametrize("soil", SOILS, ids=lambda s: s.source[:20])
def test_the_slip_for_a_pull_gives_that_pull(soil: Soil) -> None:
    traction = Traction(soil, ROBOT)
    most, _ = traction.largest_pull()
    pulls = np.linspace(0.05, 0.95, 7) * most
    assert traction.drawbar_pull(traction.slip_for(pulls)) == pytest.approx(pulls, rel=1e-6)


def test_what_the_soil_cannot_give_is_said() -> None:
    ice = Traction(soil_preset("ice"), ROBOT)
    assert np.isnan(ice.slip_for(np.array([0.1, 50.0]))).tolist() == [False, True]
    with pytest.raises(ModelError, match=r"cannot give a pull of 50 N, at most 0\.586 N at"):
        ice.needed_slip(50.0)
    stuck = Traction(Soil(0.0, 0.01, 0.01, rolling=0.2), ROBOT)
    with pytest.raises(ModelError, match="resistances are larger"):
        stuck.needed_slip(0.0)
    assert math.isnan(stuck.steepest_slope())


def test_the_largest_pull_of_a_hump_lies_at_its_slip() -> None:
    soil = Soil(1e3, 0.4, 0.005, shear=Shear.HUMP, rolling=0.0)
    pull, at = Traction(soil, ROBOT).largest_pull()
    slips = np.linspace(0.0, 1.0, 20_001)
    curve = Traction(soil, ROBOT).drawbar_pull(slips)
    assert 0.01 < at < 0.2
    assert pull == pytest.approx(curve.max(), rel=1e-7)
    assert at == pytest.approx(slips[curve.argmax()], abs=1e-4)


def test_on_firm_ground_the_steepest_slope_is_friction_less_rolling() -> None:
    """tan β = μ − μr, as of a body on an inclined plane."""
    assert math.tan(Traction(FIRM, ROBOT).steepest_slope()) == pytest.approx(0.5, rel=1e-6)


def test_at_the_steepest_slope_the_largest_pull_holds_the_weight() -> None:
    slope = Traction(soil_preset("dry-sand"), ROBOT).steepest_slope()
    there = Traction(soil_preset("dry-sand"), ROBOT, slope=slope)
    assert there.largest_pull()[0] == pytest.approx(ROBOT.weight * math.sin(slope), rel=1e-9)


def test_a_high_centre_of_mass_tips_before_the_soil_gives_way() -> None:
    tall = Traction(FIRM, TrackedVehicle(height=0.3, centre=-0.02))
    assert tall.tipping_slope == pytest.approx(math.atan(0.05 / 0.3))
    assert tall.steepest_slope() == pytest.approx(tall.tipping_slope, rel=1e-6)
    assert Traction(soil_preset("loam"), ROBOT).tipping_slope == pytest.approx(0.5 * math.pi)


def test_slopes_of_a_batch() -> None:
    slopes = np.array([0.0, 0.2, 0.5])
    together = Traction(soil_preset("dry-sand"), ROBOT, slope=slopes).largest_pull()[0]
    alone = [Traction(soil_preset("dry-sand"), ROBOT, slope=s).largest_pull()[0] for s in slopes]
    assert together == pytest.approx(alone)


def test_the_pressure_follows_the_centre_of_mass() -> None:
    assert pressure_of(ROBOT) == Pressure()
    assert pressure_of(TrackedVehicle(centre=0.02)) == Pressure(Distribution.LINEAR, 0.02)
    uphill = pressure_of(TrackedVehicle(height=0.05), math.atan(0.4))
    assert uphill.centre == pytest.approx(-0.02)
