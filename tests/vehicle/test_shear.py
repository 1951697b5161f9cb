"""Laws of shear stress: limits, published points, closed means against integrals."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from sysid.vehicle.shear import largest_stress, mean_share, mobilised_share, shear_stress
from sysid.vehicle.soil import Shear, Soil

LAWS = [
    Soil(1.0e3, 0.5, 0.02),
    Soil(1.0e3, 0.5, 0.02, shear=Shear.HUMP),
    Soil(1.0e3, 0.5, 0.02, shear=Shear.RESIDUAL, residual=0.4),
    Soil(1.0e3, 0.5, 0.02, shear=Shear.RESIDUAL, residual=1.0),
]
each_law = pytest.mark.parametrize("soil", LAWS, ids=lambda s: f"{s.shear}-{s.residual:g}")
ROUNDING = 1e-12


def test_mohr_and_coulomb() -> None:
    assert largest_stress(Soil(2.0e3, math.atan(0.5), 0.02), 3.0e3) == pytest.approx(3.5e3)


@each_law
def test_stress_begins_at_nothing_and_is_odd(soil: Soil) -> None:
    j = np.linspace(-0.1, 0.1, 21)
    stress = shear_stress(soil, 1.0e3, j)
    assert stress[10] == 0.0
    assert stress == pytest.approx(-stress[::-1])


@pytest.mark.parametrize(
    ("soil", "at_k", "far"),
    [(LAWS[0], 1 - 1 / math.e, 1.0), (LAWS[1], 1.0, 0.0), (LAWS[2], 1.0, 0.4), (LAWS[3], 1.0, 1.0)],
)
def test_where_each_law_goes(soil: Soil, at_k: float, far: float) -> None:
    k = soil.shear_modulus
    assert mobilised_share(soil, k) == pytest.approx(at_k, rel=ROUNDING)
    assert mobilised_share(soil, 60.0 * k) == pytest.approx(far, abs=1e-20)  # 60 e^(−59) = 1e-24


def test_the_hump_with_residual_exceeds_its_point_by_what_is_said() -> None:
    t = np.linspace(0.0, 10.0, 10_001)
    flat = Soil(0.0, 0.5, 1.0, shear=Shear.RESIDUAL, residual=1e-9)
    assert 1.07 < mobilised_share(flat, t).max() < 1.076


@each_law
@pytest.mark.parametrize("reach", [1e-8, 1e-3, 0.00999, 0.01001, 0.3, 5.0, 80.0])
def test_the_closed_mean_is_the_mean(soil: Soil, reach: float) -> None:
    def share(t: float) -> float:
        return float(mobilised_share(soil, t * soil.shear_modulus))

    cuts = [0.0, *(c for c in (2.0, 10.0, 40.0) if c < reach), reach]
    areas = [quad(share, a, b, epsabs=0.0, epsrel=1e-12)[0] for a, b in pairwise(cuts)]
    assert mean_share(soil, reach) == pytest.approx(sum(areas) / reach, rel=1e-10)
