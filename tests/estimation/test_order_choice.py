"""How orders, delays and structures are chosen: what is held out, what ties, what leads."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid.data.checks.delay import estimate_delays
from sysid.data.facts import LogFacts
from sysid.data.preprocess import Detrend
from sysid.data.record import Record, shortened
from sysid.estimation.pem import fit
from sysid.estimation.selection.delays import chosen_delay
from sysid.estimation.selection.orders import Candidate, ranked, searching
from sysid.estimation.selection.select_structure import select_structure
from sysid.estimation.soundness import bounded_run
from sysid.fitting.holdout import error_margin, hold_out, independent_samples, tie_margin
from sysid.fitting.options import FitOptions
from sysid.methods.held_out_error import free_run_error
from sysid.structures.linear.families import ARX, OE


def steps(n: int, hold: int, seed: int) -> NDArray[np.float64]:
    """Random levels in ±1, each held for ``hold`` samples."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, n // hold + 1), hold)[:n]


def lagged(u: NDArray[np.float64], pole: float, delay: int = 1) -> NDArray[np.float64]:
    """y(t) = pole·y(t−1) + (1 − pole)·u(t−delay), from rest."""
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = pole * y[k - 1] + (1 - pole) * (u[k - delay] if k >= delay else 0.0)
    return y


def motor(n: int = 600, noise: float = 0.02, seed: int = 1, **facts: float) -> Record:
    u = steps(n, int(facts.get("hold", 4)), seed)
    y = lagged(u, facts.get("pole", 0.6), int(facts.get("delay", 1)))
    return Record(u, y + noise * np.random.default_rng(seed + 99).standard_normal(n), 0.1)


@pytest.mark.parametrize(
    ("lengths", "pieces", "words"),
    [
        ((100,), 1, "the last 30 %"),
        ((300,), 2, "the 30 %"),
        ((1000,), 4, "the 30 % of the estimation data that were held out"),
        ((100, 1000), 5, "the 30 %"),
        ((900,) * 5, 5, "the last 30 % of each piece"),
    ],
)
def test_every_sample_is_either_fitted_or_held_out(
    lengths: tuple[int, ...], pieces: int, words: str
) -> None:
    records = [motor(n, seed=n + k) for k, n in enumerate(lengths)]
    data = hold_out(records)
    assert len(data.train) == pieces
    assert data.words.startswith(words)
    assert data.whole == tuple(records)
    for held in data.counted:
        assert np.mean(held) == pytest.approx(0.3, abs=0.01)
    seen = np.concatenate([*(r.y for r in data.train), *(r.y for r in data.holdout)])
    assert sorted(seen[:, 0]) == sorted(np.concatenate([r.y for r in records])[:, 0])
    assert data.samples == sum(len(r) for r in data.train)


def test_long_logs_are_shortened_to_spread_pieces() -> None:
    (r,) = [motor(4000)]
    parts = shortened([r], 1000)
    assert [len(p) for p in parts] == [250] * 4
    assert [round(p.t0 / r.dt) for p in parts] == [0, 1000, 2000, 3000]
    assert shortened([r], 4000) == (r,)


def test_a_tie_is_one_standard_error_of_the_rms() -> None:
    """The spread of the RMS of N normal errors, measured over 4000 draws, is the margin."""
    n = 180
    draws = np.random.default_rng(0).standard_normal((4000, n))
    measured = np.std(np.sqrt(np.mean(draws**2, axis=1)))
    # 4000 draws show a standard deviation to 1.1 %
    assert tie_margin([motor(n)]) == pytest.approx(measured, rel=0.05)
    assert tie_margin([motor(60_000)]) == 0.01


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_errors_that_are_alike_tell_less(memory: float) -> None:
    """The RMS of errors e(t) = ρ e(t−1) + w(t) scatters so in two blocks of 120 of 400 samples."""
    draws = lfilter([1.0], [1.0, -memory], np.random.default_rng(1).standard_normal((600, 450)))
    counted = np.zeros(400)
    counted[140:200] = counted[340:400] = 1.0
    draws = draws[:, 50:] * counted
    sizes = np.sqrt(np.sum(draws**2, axis=1) / 120.0)
    measured = np.std(sizes) / np.mean(sizes)
    # ρ(k)² sum to (1 + ρ²)/(1 − ρ²), of which a single draw of 120 samples shows a third or so
    # too much or too little
    margins = [error_margin([e]) for e in draws]
    assert np.median(margins) == pytest.approx(measured, rel=0.2)
    assert min(margins) >= 1.0 / np.sqrt(240.0)


@pytest.mark.parametrize(("memory", "of_change"), [(0.9, 0.9), (0.9, 0.0), (0.0, 0.9)])
def test_a_change_unlike_the_errors_is_told_by_every_sample(
    memory: float, of_change: float
) -> None:
    """Products of errors and changes that have nothing to do with each other scatter by N²/M."""
    rng = np.random.default_rng(2)
    pair = [lfilter([1.0], [1.0, -p], rng.standard_normal((400, 700))) for p in (memory, of_change)]
    e, d = (x[:, 100:] for x in pair)
    scatter = np.var(np.sum(e * d, axis=1)) / (np.var(e) * np.var(d))
    told = [independent_samples([a], [b]) for a, b in zip(e, d, strict=True)]
    # 400 draws show a variance to 7 %; a single pair's autocorrelations scatter by a fifth
    assert np.median(told) == pytest.approx(600**2 / scatter, rel=0.2)
    assert independent_samples([e[0]], [0.0 * e[0]]) == 600


def test_the_smallest_of_those_that_tie_leads() -> None:
    large = Candidate({"na": 4}, 8, 0.100, 0.100)
    small = Candidate({"na": 1}, 2, 0.103, 0.103)
    poor = Candidate({"na": 0}, 1, 0.200, 0.200)
    unstable = Candidate({"na": 9}, 1, 0.001, 0.001, stable=False)
    found = [large, small, poor, unstable]
    assert ranked(found, "fit", 0.05, (100, 1)) == (small, large, poor, unstable)
    assert ranked(found, "fit", 0.01, (100, 1)) == (large, small, poor, unstable)
    assert ranked(found, "aic", 0.05, (100, 1)) == (large, small, poor, unstable)


@pytest.mark.parametrize("criterion", ["fit", "aic", "bic", "fpe"])
def test_a_settled_model_that_ties_goes_before_one_that_drifts(criterion: str) -> None:
    """An error 1 % larger is 2 N ln 1.01 in AIC and BIC, and 1.01² in FPE."""
    n = 500

    def scored(error: float) -> float:
        if criterion == "fit":
            return error
        return error**2 if criterion == "fpe" else 2.0 * n * np.log(error)

    drifts = Candidate({"na": 3}, 4, scored(0.100), 0.1, settled=False)
    close = Candidate({"na": 2}, 4, scored(0.101), 0.101)
    far = Candidate({"na": 1}, 4, scored(0.110), 0.110)
    assert ranked([drifts, close, far], criterion, 0.02, (n, 1)) == (close, drifts, far)
    assert ranked([drifts, far], criterion, 0.02, (n, 1)) == (drifts, far)


def test_the_free_run_goes_through_the_whole_record() -> None:
    """A state fitted to the head of each block would hide a drift; a run through all shows it."""
    r = motor(600, noise=0.0)
    data = hold_out([r])
    s = ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    assert free_run_error(s, np.array([-0.6, 0.4]), data.whole, data.counted) < 1e-9
    assert free_run_error(s, np.array([-0.99, 0.01]), data.whole, data.counted) > 0.5


def test_outliers_do_not_rule_a_robust_score() -> None:
    r = motor(400)
    y = r.y.copy()
    y[::40] += 50.0
    data = hold_out([Record(r.u, y, r.dt)])
    s = ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    true, wrong = np.array([-0.6, 0.4]), np.array([-0.6, 0.2])

    def ratio(robust: bool) -> float:
        bad, good = (
            free_run_error(s, theta, data.whole, data.counted, robust) for theta in (wrong, true)
        )
        return bad / good

    assert ratio(False) < 1.05
    assert ratio(True) > 3.0


def delay_of(records: Sequence[Record]) -> int | list[list[int]]:
    """The delay to search with."""
    return chosen_delay(LogFacts.of(records)).nk


@pytest.mark.parametrize("delay", [0, 1, 2, 7])
def test_the_delay_is_confirmed(delay: int) -> None:
    assert delay_of([motor(600, 0.05, seed=delay + 1, delay=delay)]) == delay


def test_a_fast_sampled_plant_has_no_dead_time() -> None:
    """Noise hides the first samples of an answer that takes 200, but a free run needs no delay."""
    r = motor(6000, 0.03, seed=4, pole=0.995, hold=400)
    assert estimate_delays([r])[0].delay != 1, "else there is nothing to confirm"
    assert delay_of([r]) == 1


def test_a_controller_that_answers_within_the_sample_is_no_feedthrough() -> None:
    rng = np.random.default_rng(3)
    n, y, v, integral = 1500, 0.0, 0.0, 0.0
    reference = 10.0 * steps(n, 15, 2)
    u, out = np.zeros(n), np.zeros(n)
    for k in range(n):
        v = 0.7 * v + 0.4 * rng.standard_normal()
        out[k] = y + v
        integral += 0.1 * (reference[k] - out[k])
        u[k] = np.clip(0.04 * (reference[k] - out[k]) + 0.2 * integral, -1.0, 1.0)
        y = 0.6 * y + 0.4 * 20.0 * u[k]
    assert delay_of([Record(u, out, 0.1)]) == 1


def test_an_input_without_effect_takes_the_delay_of_the_main_one() -> None:
    r = motor(600, 0.2, seed=6, delay=3)
    idle = steps(600, 5, 77)
    assert delay_of([Record(np.column_stack([r.u[:, 0], idle]), r.y, 0.1)]) == 3


def test_sixty_rows_of_a_step_that_overshoots_are_of_second_order() -> None:
    """ζ = 0.5 at 4 rad/s: the last third, which is at rest, chooses between the orders tried."""
    n, y, v = 60, np.zeros(60), 0.0
    u = np.where(np.arange(n) < 8, 0.0, 2.0)
    for k in range(1, n):
        v += 0.1 * (16.0 * (1.5 * u[k - 1] - y[k - 1]) - 4.0 * v)
        y[k] = y[k - 1] + 0.1 * v
    noisy = y + 0.02 * np.random.default_rng(1).standard_normal(n)
    best = select_structure(["oe"], [Record(u, noisy, 0.1)], FitOptions()).entries[0]
    assert best.model.structure.order_values()["nf"] in (2, [[2]])


def test_an_integrator_is_not_called_unstable() -> None:
    s = ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    assert bounded_run(s, np.array([-1.0001, 1.0]))
    assert not s.stable(np.array([-1.0001, 1.0]))
    assert not bounded_run(s, np.array([-1.01, 1.0]))


def test_a_search_ranks_as_full_fits_would() -> None:
    """Coarse descents end within a tie's width of full ones, in a fraction of the evaluations."""
    r = hold_out([motor(600, 0.1)]).train
    for orders in OE.candidate_orders(1, 1, 420, 1):
        s = OE.from_orders(orders, 1, 1)
        full, coarse = fit(s, r), fit(s, r, searching(FitOptions()))
        assert coarse.criteria["loss"] < 1.01 * full.criteria["loss"]
        runs = [sum(x.evaluations for x in m.starts) for m in (coarse, full)]
        assert runs[0] <= runs[1]


@pytest.mark.parametrize("criterion", ["fit", "aic", "bic"])
def test_the_contest_says_by_what_it_was_decided(criterion: str) -> None:
    r = motor(400, 0.2)
    found = select_structure(
        ("arx", "oe"), [r], FitOptions(), Detrend.none(1, 1), criterion=criterion
    )
    first = found.entries[0].model
    assert first.structure.name == "oe"
    if criterion == "fit":  # AIC may take an order more
        error = np.sqrt(first.covariance[1, 1])
        assert abs(first.theta[1] + 0.6) < 4 * error  # a chance of 6e-5
    words = {"fit": "among models tied on held-out data", "aic": "its AIC", "bic": "its BIC"}
    assert words[criterion] in found.reason


@pytest.mark.parametrize("delay", [1, 3, 6])
def test_two_lags_sampled_fast_get_no_dead_time_they_have_not(delay: int) -> None:
    rng = np.random.default_rng(1 + 10 * delay)
    u = np.repeat(rng.uniform(-1.0, 1.0, 60), 50)
    # 130 and 12 samples, commands held: a discrete plant with a pole for each
    slow, fast = np.exp(-1.0 / np.array([130.0, 12.0]))
    first, y = np.zeros(3000), np.zeros(3000)
    for k in range(1, 3000):
        first[k] = slow * first[k - 1] + (1.0 - slow) * u[max(k - delay, 0)]
        y[k] = fast * y[k - 1] + (1.0 - fast) * first[k]
    log = Record((u - u.mean())[:, None], (y + 0.003 * rng.standard_normal(3000))[:, None], 2.0)
    found = delay_of([log])
    # in the first sample the answer is a thousandth of the step: a third of the noise
    assert isinstance(found, int)
    assert abs(found - delay) <= 1


def test_a_step_of_few_rows_is_not_judged_by_its_flat_end() -> None:
    """Of 60 rows the last 18 hold noise only; the truth is 3 rad/s, damping 0.6, 0.3 s late."""
    u = np.where(np.arange(60) >= 5, 2.0, 0.0)
    wn, zeta, dt = 3.0, 0.6, 0.1
    pole = np.exp((-zeta + 1j * np.sqrt(1.0 - zeta**2)) * wn * dt)
    den = np.poly([pole, pole.conj()]).real
    k = 1.3 * den.sum() / 1.9  # a sampled lag of second order has two samples of numerator
    y = lfilter([0.0, 0.0, 0.0, 0.0, k, 0.9 * k], den, u)
    noisy = y + 0.015 * np.random.default_rng(512).standard_normal(60)
    made = select_structure(["oe"], [Record(u, noisy, dt)], FitOptions())
    (entry,) = made.entries
    found = entry.model.poles()[0]
    assert "No input moves in the last 30 % of the estimation data" in made.reason
    assert abs(complex(found.real, abs(found.imag)) - pole) < 0.02  # 2.4 rad/s would be 0.05 away
