"""Every estimated number has a standard error that says something."""

import numpy as np
import pytest
from scipy.signal import lfilter
from sysid_cli import render
from sysid_datasets import path

from sysid.criteria.coloured import coloured_gram
from sysid.data.io import read_logs
from sysid.data.reading.read_options import ReadOptions
from sysid.estimation.pem import fit
from sysid.fitting.uncertainty import AR_ORDER, half_of, uncertainty
from sysid.structures.model import Model, ParameterEstimate
from sysid.structures.registry import structure_class


def _factors(condition: float, samples: int = 600, n: int = 6) -> tuple[np.ndarray, ...]:
    """Q, s, Vᵀ with singular values from 1 down to 1/condition."""
    rng = np.random.default_rng(5)
    Q = np.linalg.qr(rng.standard_normal((samples, n)))[0]
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return Q, np.geomspace(1.0, 1.0 / condition, n), V.T


@pytest.mark.parametrize("condition", [1e2, 1e5, 1e7, 1e9])
def test_the_sandwich_is_right_on_ill_conditioned_problems(condition: float) -> None:
    """J = Q S Vᵀ with coloured residuals: V S⁻¹ QᵀΣQ S⁻¹ Vᵀ, whose variances are positive."""
    Q, s, Vt = _factors(condition)
    J, m = (Q * s) @ Vt, len(Q)
    e = lfilter([1.0], [1.0, -0.9], np.random.default_rng(6).standard_normal(m))
    found = uncertainty(J, e, ((0, m),), np.ones(m))
    assert found.coloured
    half = Vt.T / s
    known = np.diag(half @ coloured_gram([Q], [e], AR_ORDER) @ half.T) * m / (m - len(s))
    # J is stored with a relative error ε: its smallest direction with ε × condition, 2e-7 at most
    assert np.allclose(np.diag(found.covariance), known, rtol=1e-5, atol=0.0)


def test_the_root_of_a_covariance_gives_it_back() -> None:
    """H Hᵀ is the matrix, with columns of very unlike units too."""
    _, s, Vt = _factors(1e3)
    half = (Vt.T / s) * np.ones(6) / np.geomspace(1e-6, 1e6, 6)[:, None]
    inverse = half @ half.T
    H = half_of(inverse)
    size = np.sqrt(np.diag(inverse))
    # a condition of 1e6 of the scaled inverse leaves 1e-10
    assert np.allclose((H @ H.T) / np.outer(size, size), inverse / np.outer(size, size), atol=1e-9)


def says_what_it_is_worth(model: Model) -> list[str]:
    """Free parameters whose standard error says nothing: neither a number, nor open, nor bound."""
    open_names = {name for direction in model.null_directions for name in direction}
    return [
        p.name
        for p in model.parameter_table()
        if not p.fixed
        and not p.at_bound
        and not (0.0 < p.std_error < np.inf)
        and not (np.isinf(p.std_error) and p.name in open_names)
    ]


@pytest.mark.parametrize(
    "log",
    [
        "multisine",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("prbs", "forward_back", "multilevel")),
    ],
)
@pytest.mark.parametrize(
    ("name", "orders"),
    [
        ("arx", {"na": 5, "nb": 5, "nk": 1}),
        ("oe", {"nb": 3, "nf": 2, "nk": 1}),
        pytest.param("oe", {"nb": 4, "nf": 4, "nk": 1}, marks=pytest.mark.slow),
    ],
)
def test_every_free_parameter_has_a_standard_error(
    log: str, name: str, orders: dict[str, int]
) -> None:
    """Too many orders on logs of every kind: where nothing is known, that is said by name."""
    records = read_logs([path(log)], ReadOptions())
    structure = structure_class(name).from_orders(orders, 2, 2, {})
    model = fit(structure, records)
    assert says_what_it_is_worth(model) == []


def test_the_table_says_in_words_what_is_no_number() -> None:
    """An infinite error is "not determined", a bound is named; ± 0 is only a fixed value's."""
    assert render.interval(ParameterEstimate("a", 1.0, 0.25, "", False, False)) == "0.49"
    assert render.interval(ParameterEstimate("a", 1.0, 0.75, "", False, False)) == "1.47 ?"
    unknown = ParameterEstimate("a", 1.0, np.inf, "", False, False)
    assert render.interval(unknown) == "not determined"
    assert render.interval(ParameterEstimate("a", 1.0, 0.25, "", False, True)) == "at its bound"
    assert render.interval(ParameterEstimate("a", 1.0, 0.0, "", True, False)) == "fixed"
