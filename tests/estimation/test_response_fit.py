"""Fits to frequency responses: exact without noise, true errors with it, what is refused."""

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from command_line import Capture, run

from sysid.data.frequency_response import Complex, FrequencyResponse
from sysid.data.record import Channel
from sysid.errors import DataError, UsageError
from sysid.estimation.response_fit import fit_response

F = np.geomspace(0.01, 5.0, 80)
S = 2j * np.pi * F
WIDE = np.geomspace(0.02, 9.5, 90)
CHANNELS = (Channel("a"), Channel("b"))


def measured(G: Complex, error: float, seed: int, **more: object) -> FrequencyResponse:
    rng = np.random.default_rng(seed)
    sigma = error * np.abs(G)
    noise = sigma / np.sqrt(2.0) * (rng.standard_normal(len(G)) + 1j * rng.standard_normal(len(G)))
    values, variance = (G + noise)[:, None, None], (sigma**2)[:, None, None]
    return FrequencyResponse(F[: len(G)], values, variance, **more)  # type: ignore[arg-type]


def plant() -> Complex:
    return np.asarray(2.0 * np.exp(-0.33 * S) / ((1.0 + 1.5 * S) * (1.0 + 0.4 * S)))


@pytest.mark.slow
def test_numbers_are_found_with_true_errors() -> None:
    inside: list[bool] = []
    for seed in range(25):
        fit = fit_response(measured(plant(), 0.03, seed), "process", {"np": 2})
        table = {p.name: p for p in fit.model.parameter_table()}
        for name, truth in {"K": 2.0, "T1": 1.5, "T2": 0.4, "Td": 0.33}.items():
            p = table[name]
            inside.append(abs(p.value - truth) < 1.96 * p.std_error)
        assert 0.7 < fit.error < 1.3
    # 100 intervals of 95 %: 88 or fewer would happen once in 500 times
    assert sum(inside) > 88


def test_a_variance_near_zero_by_chance_does_not_own_the_fit() -> None:
    response = measured(plant(), 0.03, 3)
    usual = fit_response(response, "process", {"np": 2}).model
    value, variance = response.value.copy(), np.asarray(response.variance).copy()
    value[40] *= 1.09  # three standard errors off
    variance[40] = 1e-30
    model = fit_response(
        replace(response, value=value, variance=variance), "process", {"np": 2}
    ).model
    # with four times its weight it moves T1 by three errors; with its own by 22
    errors = np.sqrt(np.diag(usual.covariance))
    assert np.all(np.abs(model.theta - usual.theta) < 5.0 * errors)


def test_a_sampled_response_is_found_exactly() -> None:
    discrete = control.c2d(control.tf([2.0], [0.6, 1.9, 1.0]), 0.1)
    f = F[F < 4.9]
    values = discrete(np.exp(2j * np.pi * f * 0.1))[:, None, None]
    response = FrequencyResponse(f, values, sample_time=0.1)
    oe = fit_response(response, "oe", {"nb": 2, "nf": 2, "nk": 1})
    wanted = [*discrete.num[0][0], *discrete.den[0][0][1:]]
    np.testing.assert_allclose(oe.model.theta, wanted, rtol=1e-8)
    process = fit_response(response, "process", {"np": 2})
    np.testing.assert_allclose(np.sort(process.model.theta), [0.0, 0.4, 1.5, 2.0], atol=1e-8)


def two_by_two() -> tuple[Complex, control.StateSpace]:
    """A resonance and two lags that share inputs and outputs, sampled every 0.05 s."""
    A = np.array([[0, 1, 0, 0], [-9, -0.3, 0, 0], [0, 0, -2, 1], [0, 0, 0, -0.5]])
    B = np.array([[0, 0], [1, 0.5], [0, 1], [0.7, 0]])
    C = np.array([[1, 0, 0.5, 0], [0.3, 0, 0, 1]])
    system = control.c2d(control.ss(A, B, C, np.zeros((2, 2))), 0.05)
    values = [system(z) for z in np.exp(2j * np.pi * WIDE * 0.05)]
    return np.array(values), system


def test_state_space_of_two_by_two() -> None:
    """Exact without noise; with it, as far from the truth as 16 numbers must be."""
    G, system = two_by_two()
    exact = FrequencyResponse(WIDE, G, None, CHANNELS, CHANNELS, 0.05)
    model = fit_response(exact, "ss", {"n": 4}).model
    np.testing.assert_allclose(
        np.sort_complex(model.poles()), np.sort_complex(system.poles()), atol=1e-8
    )
    rng, distances = np.random.default_rng(3), []
    sigma = 0.03 * np.abs(G) + 0.003 * np.abs(G).max()
    for _ in range(12):
        noise = rng.standard_normal((2, *G.shape)) / np.sqrt(2.0)
        values = G + sigma * (noise[0] + 1j * noise[1])
        response = replace(exact, value=values, variance=sigma**2)
        fit = fit_response(response, "ss", {"n": 4})
        assert 0.85 < fit.error < 1.15  # 720 numbers: a standard error of 0.026
        got = fit.model.bode(2.0 * np.pi * WIDE)[1]
        distances.append(2.0 * float(np.sum(np.abs((got - G) / sigma) ** 2)))
    # chi-square of 16: the mean of 12 has a standard error of 1.6
    assert 10.0 < np.mean(distances) < 22.0


def test_two_inputs_and_a_band() -> None:
    G = np.stack([plant(), 3.0 / (1.0 + 0.2 * S)], axis=1)[:, None, :]
    response = FrequencyResponse(F, G, inputs=(Channel("a"), Channel("b")))
    fit = fit_response(response, "tf", {"np": 2, "nz": 1}, band=(0.02, 2.0))
    w = np.array([1.0])
    got = fit.model.structure.continuous_response(fit.model.theta, w)  # type: ignore[attr-defined]
    wanted = [
        2.0 * np.exp(-0.33j) / ((1.0 + 1.5j) * (1.0 + 0.4j)),
        3.0 / (1.0 + 0.2j),
    ]
    np.testing.assert_allclose(got[0, 0], wanted, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "more", "error", "words"),
    [
        ("oe", {}, UsageError, "sample time"),
        ("ss", {}, UsageError, "sample time"),
        ("arx", {}, UsageError, "tf, process, oe and ss"),
        ("tf", {"band": (90.0, 99.0)}, UsageError, "no frequency"),
        ("tf", {"orders": {"np": 10, "nz": 9}, "band": (0.01, 0.012)}, DataError, "too few"),
    ],
)
def test_what_cannot_be_fitted_is_said(
    name: str, more: dict[str, object], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        fit_response(measured(plant(), 0.01, 0), name, **more)  # type: ignore[arg-type]


def test_on_the_line(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    measured(plant(), 0.02, 1).write(tmp_path / "g.frd.csv")
    done = run(capsys, "fit", "g.frd.csv", "--band", "0.01:4")
    assert "process" in done.out
    assert len(done.out.splitlines()) <= 24
    assert "Saved" in done.out
    discrete = control.c2d(control.tf([2.0], [0.6, 1.9, 1.0]), 0.1)
    values = discrete(np.exp(2j * np.pi * F[F < 4.9] * 0.1))[:, None, None]
    FrequencyResponse(F[F < 4.9], values, sample_time=0.1).write(tmp_path / "d.frd.csv")
    assert "n=2" in run(capsys, "fit", "d.frd.csv", "-s", "ss").out  # more are not shown
    refused = run(capsys, "fit", "g.frd.csv", "g.frd.csv")
    assert refused.code == 2
    assert "by itself" in refused.err
