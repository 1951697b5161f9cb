"""Pressure under a track: it carries the load where the load is, and never pulls."""

import numpy as np
import pytest

from sysid.errors import ModelError
from sysid.vehicle.pressure import Distribution, Pressure, integrate

L, B, LOAD = 0.14, 0.04, 7.8
CASES = [
    Pressure(),
    Pressure(Distribution.LINEAR, 0.01),
    Pressure.triangle(L, forward=True),
    Pressure.triangle(L, forward=False),
    Pressure(Distribution.LINEAR, 0.05),
    Pressure(Distribution.LINEAR, -0.06),
    Pressure(Distribution.WHEELS, 0.0, 1),
    Pressure(Distribution.WHEELS, 0.02, 4),
    Pressure(Distribution.WHEELS, -0.03, 3, 0.6),
]


@pytest.mark.parametrize("pressure", CASES, ids=str)
def test_the_integral_is_the_load_and_its_centre_the_loads(pressure: Pressure) -> None:
    pressure.check(L)

    def moments(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p = pressure.at(x, LOAD, L, B) * B
        return p, p * (0.5 * L - x)

    load, moment = integrate(moments, pressure.smooth_parts(L))
    assert load == pytest.approx(LOAD, rel=1e-12)  # rounding of some hundred terms
    assert moment == pytest.approx(LOAD * pressure.centre, abs=1e-12 * LOAD * L)


@pytest.mark.parametrize("pressure", CASES, ids=str)
def test_pressure_is_never_negative_and_its_peak_is_found(pressure: Pressure) -> None:
    x = np.linspace(0.0, L, 6001)  # the peaks of wheels lie at odd multiples of L/2n: on the grid
    p = pressure.at(x, LOAD, L, B)
    assert p.min() >= 0.0
    peak = float(pressure.peak(LOAD, L, B))
    assert p.max() <= peak * (1.0 + 1e-12)
    assert p.max() == pytest.approx(peak, rel=0.02)  # under tilted wheels it lies beside the middle


def test_the_triangle_is_nothing_at_its_light_end() -> None:
    front, rear = (Pressure.triangle(L, forward=f) for f in (True, False))
    assert front.at(L, LOAD, L, B) == pytest.approx(0.0, abs=1e-9)
    assert front.at(0.0, LOAD, L, B) == pytest.approx(2.0 * LOAD / (L * B))
    assert rear.at(0.3 * L, LOAD, L, B) == pytest.approx(front.at(0.7 * L, LOAD, L, B))
    assert front.mirrored == rear


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Pressure(wheels=0), "0 road wheels carries nothing"),
        (lambda: Pressure(depth=1.2), "share from 0 to 1"),
        (lambda: Pressure(centre=0.01), "choose linear or wheels"),
        (lambda: Pressure(Distribution.LINEAR, 0.08).check(L), "between its ends"),
        (lambda: Pressure(Distribution.WHEELS, 0.04, 4).check(L), "the last one would lift"),
        (lambda: Pressure(Distribution.WHEELS, 0.01, 1).check(L), "the last one would lift"),
    ],
)
def test_impossible_pressures_are_refused(make: object, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        make()  # type: ignore[operator]
