"""Sparse descriptions of errors: the right term, its size, its share, the same every time."""

import numpy as np
import pytest
from plain_tracks import FULL, SCALES, SIGMA, logged, simulate

from sysid.diagnosis.validation.explain import described, explain

FLOOR = np.array([SIGMA, SIGMA])


def test_a_product_of_both_commands_is_named_with_its_size() -> None:
    record, clean = logged("steps", 3, "white")
    d = record.u / FULL
    missing = simulate(d * np.abs(d[:, ::-1]) / 20.0) * -4.0
    found = explain([record], [record.y - clean + missing], [clean], FLOOR, SCALES)
    assert [f.output for f in found] == ["omega_l", "omega_r"]
    for f, own, other in zip(found, "lr", "rl", strict=True):
        assert f.terms[0] == f"F(d_{own}·|d_{other}|)"
        # gain 20 and 21.5 over 20; the noise leaves some percent
        assert f.coefficients[0] == pytest.approx(-4.0, rel=0.12)
        assert f.share > 0.85
        assert len(f.terms) <= 3
    assert "omega_l error ≈ −" in described(found)
    assert "% of the error above the noise" in described(found)
    again = explain([record], [record.y - clean + missing], [clean], FLOOR, SCALES)
    assert described(again) == described(found)


def test_noise_gets_no_description() -> None:
    record, clean = logged("driving", 4, "white")
    errors = record.y - clean
    assert explain([record], [errors], [clean], np.zeros(2), SCALES) == ()
    assert described(()) == ""


def test_samples_that_do_not_count_are_left_out() -> None:
    record, clean = logged("steps", 5, "white")
    errors = record.y - clean - 0.004 * clean * np.abs(clean)
    errors[100:160] = np.nan
    found = explain([record], [errors], [clean], FLOOR, SCALES)
    assert len(found) == 2
    assert all("omega" in f.sentence and f.share > 0.4 for f in found)
