"""Spectra of logs: the frequency response of a known plant, and coherence where noise is known."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import coherence, csd, lfilter, welch

from sysid.data.record import Record
from sysid.errors import DataError
from sysid.estimation.assessment.spectra import spectra

DT = 0.1


def test_two_inputs_are_told_apart_and_noise_lowers_the_coherence() -> None:
    """y = G₁u₁ + G₂u₂ + e of white u and e of variance 1: γ² = S/(S + 1), S = |G₁|² + |G₂|²."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal((40_000, 2))
    plants = (((0.0, 1.0), (1.0, -0.8)), ((0.5,), (1.0, 0.3)))
    y = sum(lfilter(b, a, u[:, j]) for j, (b, a) in enumerate(plants))
    record = Record(u, y + rng.standard_normal(40_000), DT)
    found = spectra([*(record.rows(k, k + 400) for k in range(0, 40_000, 400))])
    z = np.exp(-1j * found.w * DT)
    truth = np.column_stack([np.polyval(b[::-1], z) / np.polyval(a[::-1], z) for b, a in plants])
    # 100 records of some 9 windows: errors of some 1/√900; leakage at the lowest frequencies
    assert np.abs(found.response[2:, 0, :] - truth[2:]).max() < 0.15
    power = np.sum(np.abs(truth) ** 2, axis=1)
    np.testing.assert_allclose(found.coherence[:, 0], power / (power + 1.0), atol=0.08)
    # white noise of variance 1 has the one-sided density 2 Ts
    assert np.mean(found.inputs) == pytest.approx(2.0 * DT, rel=0.03)


def test_a_short_log_has_no_spectrum() -> None:
    with pytest.raises(DataError, match="too few for a spectrum"):
        spectra([Record(np.zeros(40), np.zeros(40), DT)])


def test_they_are_those_of_scipy() -> None:
    rng = np.random.default_rng(2)
    u = rng.standard_normal(2000)
    y = lfilter([0.0, 0.2, 0.1], [1.0, -1.3, 0.5], u) + 0.3 * rng.standard_normal(2000)
    found = spectra([Record(u[:, None], y[:, None], DT)])
    how: dict[str, Any] = {"fs": 1.0 / DT, "nperseg": 400, "window": "hann"}
    power, cross = welch(u, **how)[1], csd(u, y, **how)[1]
    inner = slice(0, 199)  # ours counts the Nyquist frequency twice, theirs once
    np.testing.assert_allclose(found.inputs[inner, 0], power[1:200], rtol=1e-9)
    np.testing.assert_allclose(found.response[inner, 0, 0], (cross / power)[1:200], rtol=1e-9)
    np.testing.assert_allclose(
        found.coherence[inner, 0], coherence(u, y, **how)[1][1:200], rtol=1e-9
    )
