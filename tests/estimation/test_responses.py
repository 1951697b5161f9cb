"""Curves of a model: those of an independent library; bands hold the truth as often as said."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import dbode, dstep, lfilter

from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError
from sysid.estimation.assessment.responses import (
    FrequencyCurve,
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


def within(true: Array, ends: tuple[Array, Array]) -> NDArray[np.bool_]:
    return np.asarray((ends[0] <= true) & (true <= ends[1]))


def turned_within(true: NDArray[np.complex128], ends: tuple[Array, Array]) -> NDArray[np.bool_]:
    """Whether a band of angles holds that of ``true``, up to whole turns."""
    middle = 0.5 * (ends[0] + ends[1])
    return np.asarray(np.abs(np.angle(true * np.exp(-1j * middle))) <= ends[1] - middle)


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0, 30.0])
@pytest.mark.parametrize("flat", [0.01, 0.5])
def test_bands_of_a_bode_diagram_hold_at_a_gain_near_zero(size: float, flat: float) -> None:
    """4000 normal draws of a G that is so many standard errors large: the share is known to 0.35 %.

    Far from zero, and where it lies beside a flat ellipse, as sharp as the delta method; where the
    ellipse holds zero they are wider than they need be.
    """
    rng = np.random.default_rng(4)
    root = np.array([[1.0, 0.0], [0.3, flat]])
    truth = np.full(4000, size * np.exp(1j * np.pi / 6.0))
    drawn = truth + (np.array([1.0, 1j]) @ root @ rng.standard_normal((2, 4000)))
    towards = np.stack([drawn.real, drawn.imag]) / np.abs(drawn)
    error = np.linalg.norm(root.T @ towards, axis=0) / np.abs(drawn)
    none = np.zeros(4000)
    curve = FrequencyCurve("u", "y", none, drawn, error, none, np.tile(root, (4000, 1, 1)))
    of_gain, (low, high) = curve.bands()
    assert np.mean(within(np.abs(truth), of_gain)) > 0.94
    assert np.mean(turned_within(truth, (low, high))) > 0.94
    if size > 10.0:  # as sharp as the delta method there
        assert np.mean(turned_within(truth, (low, high))) < 0.96
        assert np.mean(within(np.abs(truth), of_gain)) < 0.96
    assert np.all(low <= curve.phase + 1e-9)
    assert np.all(curve.phase <= high + 1e-9)


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
        of_gain, of_phase = b.bands()
        inside["gain"].append(within(np.abs(truth), of_gain))
        inside["phase"].append(turned_within(truth, of_phase))
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
