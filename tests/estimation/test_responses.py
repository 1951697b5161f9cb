"""Curves of a model: those of an independent library; bands hold the truth as often as said."""

import numpy as np
import pytest
from scipy.signal import dbode, dstep, lfilter

from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError
from sysid.estimation.assessment.responses import (
    frequency_curves,
    root_clouds,
    static_curves,
    step_curves,
)
from sysid.estimation.pem import fit
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

DT = 0.05
NUM, DEN = (0.0, 0.02, 0.03), (1.0, -1.6, 0.65)
"""Gain 1, a pair of poles at 0.8 ± 0.1i."""


def log(seed: int, samples: int = 600, noise: float = 0.1) -> Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 6), 6)
    y = lfilter(NUM, DEN, u) + noise * rng.standard_normal(samples)
    return Record(u, y, DT, (Channel("u", "V"),), (Channel("y", "rad/s"),))


def fitted(record: Record, structure: str = "oe", **orders: int) -> Model:
    raw = orders or {"nb": 2, "nf": 2, "nk": 1}
    return fit(structure_class(structure).from_orders(dict(raw), 1, 1), [record], detrend="none")


def test_curves_are_those_of_scipy() -> None:
    model = fitted(log(1))
    (g,) = model.structure.transfer(model.theta).groups  # type: ignore[attr-defined]
    (step,) = step_curves(model, seconds=4.0)
    _, (expected,) = dstep((np.trim_zeros(g.num[0], "f"), g.den, DT), n=99)
    np.testing.assert_allclose(step.y, expected[: len(step.y), 0], atol=1e-12)
    (pulse,) = step_curves(model, pulse=True, seconds=4.0)
    np.testing.assert_allclose(np.cumsum(pulse.y), step.y, atol=1e-12)
    (bode,) = frequency_curves(model, np.array([0.5, 2.0, 10.0]))
    _, decibels, degrees = dbode((np.trim_zeros(g.num[0], "f"), g.den, DT), w=bode.w * DT)
    np.testing.assert_allclose(20.0 * np.log10(np.abs(bode.response)), decibels, rtol=1e-9)
    turns = (np.degrees(bode.phase) - degrees) / 360.0
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    (cloud,) = root_clouds(model)
    np.testing.assert_allclose(np.sort_complex(cloud.poles), np.sort_complex(np.roots(g.den)))


@pytest.mark.slow
def test_bands_hold_the_truth_in_95_of_100_cases() -> None:
    """100 records, 20 points of each curve: points of a record go together, so that the share is
    known to some 1.5 %."""
    w = np.geomspace(0.3, 40.0, 20)
    _, (step,) = dstep((NUM[1:], DEN, DT), n=61)
    z = np.exp(-1j * w * DT)
    truth = np.polyval(NUM[::-1], z) / np.polyval(DEN[::-1], z)
    inside: dict[str, list[Array]] = {"step": [], "gain": [], "phase": []}
    for seed in range(100):
        model = fitted(log(seed))
        (s,) = step_curves(model, seconds=3.0)
        at = np.arange(3, 61, 3)[:20]
        inside["step"].append(np.abs(s.y[at] - step[at, 0]) < 1.96 * s.error[at])
        (b,) = frequency_curves(model, w)
        apart = np.log(truth / b.response)
        inside["gain"].append(np.abs(apart.real) < 1.96 * b.gain_error)
        inside["phase"].append(np.abs(apart.imag) < 1.96 * b.phase_error)
    shares = {name: float(np.mean(each)) for name, each in inside.items()}
    assert all(0.93 <= share <= 0.97 for share in shares.values()), shares


def test_a_static_curve_is_that_of_the_dead_zone() -> None:
    rng = np.random.default_rng(6)
    u = np.repeat(rng.uniform(-1.0, 1.0, 300), 5)
    v = np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)
    y = lfilter([0.0, 0.5], [1.0, -0.5], v) + 0.002 * rng.standard_normal(len(u))
    model = fitted(Record(u, y, DT), "hammerstein-wiener", nb=1, nf=1, nk=1)
    (curve,) = static_curves(model)
    true = np.sign(curve.x) * np.maximum(np.abs(curve.x) - 0.2, 0.0)
    assert np.abs(curve.y - true).max() < 0.03  # straight pieces between breakpoints


def test_what_a_model_has_not_is_refused() -> None:
    model = fitted(log(3), "hammerstein-wiener", nb=1, nf=1, nk=1)
    for curves in (frequency_curves, root_clouds):
        with pytest.raises(ModelError, match="hammerstein-wiener"):
            curves(model)
