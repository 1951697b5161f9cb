"""What the ground takes: published closed forms, integrals, Bekker's sinkage."""

import math

import numpy as np
import pytest

from sysid.vehicle.ground.presets import soil_preset
from sysid.vehicle.ground.resistance import (
    compaction_resistance,
    lateral_at_radius,
    lateral_force,
    lateral_reaction,
    rolling_resistance,
    sinkage,
    turning_moment,
)
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.soil import Soil

FLOOR = Soil(0.0, 0.5, 0.01, rolling=0.04, lateral=0.6)
W, L = 15.6, 0.14


def test_wongs_moment_stands_in_the_middle() -> None:
    assert turning_moment(FLOOR, W, 0.0, 0.3, L) == pytest.approx(0.6 * W * L / 4.0)
    assert lateral_force(FLOOR, W, 0.0, 0.3, L) == 0.0


def test_resistances_oppose_and_are_odd() -> None:
    assert rolling_resistance(FLOOR, W, np.array([-0.2, 0.0, 0.3])) == pytest.approx(
        np.array([-1, 0, 1]) * 0.04 * W
    )
    assert turning_moment(FLOOR, W, 0.02, -1.0, L) == -turning_moment(FLOOR, W, 0.02, 1.0, L) < 0.0
    # turning left about a point ahead, the body slides to the right: V_y = −ψ̇ x_ICR < 0
    assert lateral_force(FLOOR, W, 0.02, 1.0, L) > 0.0


@pytest.mark.parametrize("icr", [-0.2, -0.05, 0.0, 0.03, 0.07, 0.5])
def test_closed_forms_are_the_integrals_of_lateral_friction(icr: float) -> None:
    """Beyond the ends of the tracks all of them slides one way: μl W, and no moment."""
    force, moment = lateral_reaction(FLOOR, W, icr, -0.4, L, Pressure())
    assert force == pytest.approx(lateral_force(FLOOR, W, icr, -0.4, L), abs=1e-12)
    assert moment == pytest.approx(turning_moment(FLOOR, W, icr, -0.4, L), abs=1e-12)
    if abs(icr) > 0.5 * L:
        assert abs(force) == pytest.approx(0.6 * W)
        assert moment == pytest.approx(0.0, abs=1e-12)


def test_weight_in_the_middle_turns_more_easily() -> None:
    _, even = lateral_reaction(FLOOR, W, 0.0, 1.0, L, Pressure())
    _, one = lateral_reaction(FLOOR, W, 0.0, 1.0, L, Pressure(Distribution.WHEELS, wheels=1))
    # ∫ |s| (1 + cos(2πs/L)) ds over the track = L²/4 − L²/π² (one peak, in the middle)
    assert one == pytest.approx(even * (1.0 - 4.0 / math.pi**2), rel=1e-10)


def test_tight_turns_resist_most() -> None:
    radius = np.array([0.0, 0.093, 0.186, 1.86])
    coefficient = lateral_at_radius(0.6, radius, 0.186)
    assert coefficient == pytest.approx(0.6 / np.array([1.0, 1.0, 1.075, 2.425]))


def test_bekkers_sinkage_by_hand() -> None:
    """On dry sand, 10 kPa under a track 0.2 m wide: k = 990/0.2 + 1528430 = 1533380, and
    z = (10000/1533380)^(1/1.1) = 0.010305 m."""
    assert sinkage(soil_preset("dry-sand"), 1e4, 0.2) == pytest.approx(0.010305, rel=1e-5)


def test_compaction_is_the_work_of_pressing_a_metre_of_rut() -> None:
    soil, load, length, width = soil_preset("snow"), 50.0, 0.5, 0.1
    depth = sinkage(soil, load / (length * width), width)
    z = np.linspace(0.0, depth, 20_001)
    pressing = (soil.k_c / width + soil.k_phi) * z**soil.n
    work = width * np.trapezoid(pressing, z)  # z^1.6 by trapezoids: an error of 1e-9
    assert compaction_resistance(soil, load, length, width) == pytest.approx(work, rel=1e-7)


def test_heavier_sinks_deeper_and_firm_ground_not_at_all() -> None:
    loads = np.linspace(1.0, 100.0, 20)
    for name in ("dry-sand", "loam", "clay", "snow"):
        soil = soil_preset(name)
        assert np.all(np.diff(sinkage(soil, loads, 0.04)) > 0.0)
        peaks = compaction_resistance(soil, loads, L, 0.04, Pressure(Distribution.WHEELS))
        assert np.all(peaks > compaction_resistance(soil, loads, L, 0.04))
    assert compaction_resistance(soil_preset("concrete"), 10.0, L, 0.04) == 0.0
