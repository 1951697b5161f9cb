"""Polynomial NARMAX: terms, selection, free runs, and the laws every structure obeys."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from narmax_cases import ORDERS, TRUTH, fitted, names, record, structure
from problem_cases import problems_of

from sysid.data.record import Channel, Record
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Initial, Problem
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.structures.difference_equations.chunks import ChunkedRuns
from sysid.structures.difference_equations.frols import best_sizes, bic_size, forward, term_gram
from sysid.structures.difference_equations.monomials import (
    columns,
    is_noise,
    parsed,
    pool,
    term,
    typed_name,
)
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.narmax.chunk_fits import CandidateRuns, ChunkFit, fit_together
from sysid.structures.narmax.runs import PolynomialRun
from sysid.structures.narmax.structure import NARMAX

COUPLED = (
    "constant, y1(t-1), y2(t-2)*u1(t), u2(t-1), y1(t-1)^2*y2(t-1), e(t-1), u1(t)*e(t-2);"
    "y2(t-1), y2(t-2)*u1(t-1), u2(t-2), y1(t-1), u2(t-2)^3, e(t-1)*y1(t-1)"
)

COUPLED_ORDERS = {"na": [[2, 2], [1, 2]], "nb": 3, "nk": 0}

COUPLED_TRUTH = np.array([0.1, 0.6, 0.3, 0.5, -0.1, 0.4, 0.1, 0.5, 0.2, 0.7, 0.1, 0.05, 0.2])


def coupled() -> NARMAX:
    found = NARMAX.from_orders(COUPLED_ORDERS, 2, 2, {"terms": COUPLED})
    return replace(
        found,
        output_range=((-3.0, 3.0),) * 2,
        input_range=((-1.0, 1.0),) * 2,
        input_step=(2.0,) * 2,
    )


CASES = {"one": (structure(), TRUTH), "coupled": (coupled(), COUPLED_TRUTH)}

every_case = pytest.mark.parametrize("case", list(CASES))

# ------------------ terms


def test_the_pool_holds_every_monomial_once() -> None:
    s = NARMAX.from_orders({"na": 2, "nb": 2}, 1, 1, {"degree": "3"})
    found = pool(s.orders, 0, 3)
    # 4 signals: 1 + 4 + 10 + 20 monomials
    assert len(found) == 35
    assert len(set(found)) == 35
    assert found[0] == ()


def test_columns_are_the_products_of_lagged_signals() -> None:
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((30, 2)), rng.standard_normal((30, 1))
    t = parsed("y(t-1)^2*u2(t-3)", 2, 1, 0)
    found = columns([t, ()], u, y)
    assert found[10, 0] == pytest.approx(y[9, 0] ** 2 * u[7, 1], rel=1e-15)
    assert found[2, 0] == 0.0
    np.testing.assert_array_equal(found[:, 1], 1.0)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(st.sampled_from("yu"), st.integers(0, 1), st.integers(1, 9)),
        min_size=1,
        max_size=6,
    )
)
def test_a_term_is_read_back_from_its_name(factors: list[tuple[str, int, int]]) -> None:
    t = term([Signal(*f) for f in factors])
    u, y = ([Channel(f"{k}{j}") for j in (1, 2)] for k in "uy")
    assert parsed(typed_name(t, u, y), 2, 2, 0) == t


# ------------------ forward regression


def test_error_reduction_ratios_add_up_to_what_least_squares_explains() -> None:
    r = record(400, process=0.1)
    candidates = pool(NARMAX.from_orders(ORDERS, 1, 1).orders, 0, 2)
    gram = term_gram(candidates, [(r.u, r.y)], 0, 2)
    path = forward(gram, range(len(candidates)), 8)
    assert np.all(path.err >= 0.0)
    Phi, y = columns(candidates, r.u, r.y)[2:], r.y[2:, 0]
    for n in (1, 4, 8):
        chosen = path.order[:n]
        rest = y - Phi[:, chosen] @ np.linalg.lstsq(Phi[:, chosen], y)[0]
        # the Gram matrix squares the condition number: nine digits are left
        assert path.unexplained()[n - 1] == pytest.approx(rest @ rest / (y @ y), rel=1e-8)
        np.testing.assert_allclose(
            gram.solve(chosen.tolist()), np.linalg.lstsq(Phi[:, chosen], y)[0], rtol=1e-8
        )


def test_the_first_term_is_the_most_correlated_one() -> None:
    r = record(400, process=0.1)
    candidates = pool(NARMAX.from_orders(ORDERS, 1, 1).orders, 0, 3)
    gram = term_gram(candidates, [(r.u, r.y)], 0, 2)
    first = forward(gram, range(len(candidates)), 1).order[0]
    assert first == np.argmax(np.abs(gram.right))


def test_a_copy_of_a_chosen_term_is_never_chosen() -> None:
    r = record(300, process=0.1)
    y1, u1 = term([Signal("y", 0, 1)]), term([Signal("u", 0, 1)])
    gram = term_gram([y1, u1, y1], [(r.u, r.y)], 0, 2)
    assert len(forward(gram, range(3), 3).order) == 2


@pytest.mark.parametrize("seed", range(5))
def test_frols_finds_the_true_terms(seed: int) -> None:
    # u(t-2) is correlated with u(t-2)^3 by 0.92 and comes first; it must be taken back
    found = fitted(record(3000, process=0.05, seed=seed), selection="err", degree="3", terms="5")
    assert names(found) == {p.name for p in structure().parameters([Channel("u")], [Channel("y")])}


def test_bic_stops_near_the_true_size() -> None:
    r = record(3000, process=0.05, seed=1)
    candidates = pool(NARMAX.from_orders(ORDERS, 1, 1).orders, 0, 3)
    gram = term_gram(candidates, [(r.u, r.y)], 0, 2)
    sets = best_sizes(gram, range(len(candidates)), 25)
    # each of 30 false terms enters with a chance of 0.5 % (F beyond ln N = 8)
    assert 5 <= bic_size([left for _, left in sets], gram.samples) <= 7
    true = {candidates.index(t) for t in structure().rows[0]}
    assert set(sets[4][0]) == true


# ------------------ the truth comes back


def test_recovers_its_own_truth_without_noise() -> None:
    model = fit(structure(wide=False), [record(400)])
    found = {p.name: v for p, v in zip(model.parameters, model.theta, strict=True)}
    truth = structure().parameters([Channel("u")], [Channel("y")])
    for p, value in zip(truth, TRUTH, strict=True):
        assert found[p.name] == pytest.approx(value, abs=1e-8)


def test_simulation_focus_recovers_the_truth_in_sensor_noise_where_least_squares_is_biased() -> (
    None
):
    r = record(3000, sensor=0.1, seed=4)
    truth = dict(zip([p.name for p in structure().parameters([Channel("u")], [Channel("y")])],
                     TRUTH, strict=True))  # fmt: skip
    errors = {}
    for focus, selection in ((Focus.PREDICTION, "err"), (Focus.SIMULATION, "auto")):
        model = fit(structure(wide=False, selection=selection), [r], FitOptions(focus=focus))
        table = model.parameter_table()
        errors[focus] = max(abs(p.value - truth[p.name]) for p in table)
        if focus is Focus.SIMULATION:
            for p in table:
                # chunks start from noisy states, hence 5 instead of 4 standard errors
                assert abs(p.value - truth[p.name]) < 5.0 * p.std_error
    assert errors[Focus.SIMULATION] < 0.5 * errors[Focus.PREDICTION]


def test_the_chosen_model_simulates_like_the_truth() -> None:
    model = fitted(record(2000, process=0.02, seed=5), degree="3")
    fresh = record(800, seed=6)
    run = outputs(model, fresh, None, Start.ESTIMATED)
    error = np.linalg.norm(fresh.y - run) / np.linalg.norm(fresh.y - fresh.y.mean())
    # coefficients are known to a per cent or so
    assert error < 0.02


def test_noise_terms_make_coloured_errors_white_and_the_process_unbiased() -> None:
    rng = np.random.default_rng(7)
    n = 4000
    u, e, y = rng.uniform(-1, 1, n), 0.2 * rng.standard_normal(n), np.zeros(n)
    for t in range(2, n):
        y[t] = 0.7 * y[t - 1] + 0.5 * u[t - 1] - 0.3 * u[t - 1] * y[t - 1] + e[t] + 0.8 * e[t - 1]
    r = Record(u[:, None], y[:, None], 0.1)
    terms = "y(t-1), u(t-1), u(t-1)*y(t-1)"
    plain = fit(structure(terms, wide=False, selection="err"), [r])
    noisy = fit(structure(terms, wide=False, selection="err", noise_lags="1"), [r])
    found = dict(zip([p.name for p in noisy.parameters], noisy.theta, strict=True))
    table = {p.name: p for p in noisy.parameter_table()}
    for name, value in (("y(t-1)", 0.7), ("u(t-1)", 0.5), ("u(t-1)*y(t-1)", -0.3), ("e(t-1)", 0.8)):
        name = "y(t-1)*u(t-1)" if "*" in name else name
        assert abs(found[name] - value) < 4.0 * table[name].std_error
    biased = dict(zip([p.name for p in plain.parameters], plain.theta, strict=True))
    assert abs(biased["y(t-1)"] - 0.7) > 6.0 * table["y(t-1)"].std_error
    assert noisy.noise_covariance[0, 0] == pytest.approx(0.04, rel=0.1)
    assert "e(t-1)" in noisy.structure.equations(noisy.theta, r.inputs, r.outputs)[0].replace(
        "−", "-"
    )


@pytest.mark.parametrize("seed", range(3))
def test_noise_terms_never_make_the_predictor_run_away(seed: int) -> None:
    # noise of the sensor alone: its best model lies at the edge of what can be inverted
    r = record(600, sensor=0.1, seed=seed)
    plain = fitted(r, selection="err", degree="3")
    noisy = fitted(r, selection="err", degree="3", noise_lags="2")
    errors = [m.structure.errors(m.theta, r.u, r.y, 0)[2:] for m in (plain, noisy)]
    assert any(name.endswith("e(t-1)") for name in names(noisy))
    assert noisy.termination.good
    # noise terms are added to the terms of the plain model
    assert np.sum(errors[1] ** 2) < np.sum(errors[0] ** 2)


def test_several_outputs_are_fitted_together() -> None:
    rng = np.random.default_rng(8)
    s = replace(coupled(), output_range=(), input_range=(), input_step=())
    u = rng.uniform(-1, 1, (3000, 2))
    y = s.simulate(COUPLED_TRUTH, u)
    process = [not is_noise(t) for row in s.rows for t in row]
    plain = ";".join(",".join(p for p in row.split(",") if "e(" not in p)
                     for row in COUPLED.split(";"))  # fmt: skip
    bare = NARMAX.from_orders(COUPLED_ORDERS, 2, 2, {"terms": plain})
    model = fit(bare, [Record(u, y, 0.1)])
    truth = dict(
        zip([p.name for p in s.parameters(model.inputs, model.outputs)], COUPLED_TRUTH, strict=True)
    )
    assert sum(process) == len(model.theta)
    for p, value in zip(model.parameters, model.theta, strict=True):
        assert value == pytest.approx(truth[p.name], abs=1e-7)


# ------------------ runs


@every_case
def test_stepping_is_simulating(case: str) -> None:
    s, theta = CASES[case]
    u = np.random.default_rng(9).uniform(-1, 1, (300, s.nu))
    x0 = 0.3 * np.random.default_rng(10).standard_normal(s.n_states(theta))
    whole, x, rows = s.simulate(theta, u, x0), x0, []
    step = s.step(theta)
    for now in u:
        x, y = step(x, now)
        rows.append(y)
    # the sums run in a different order
    np.testing.assert_allclose(np.array(rows), whole, rtol=0, atol=1e-12)


@every_case
def test_batched_runs_are_single_runs(case: str) -> None:
    s, theta = CASES[case]
    rng = np.random.default_rng(11)
    run = s.free_run()
    u = rng.uniform(-1, 1, (run.before + 50, s.nu, 4))
    past = 0.5 * rng.standard_normal((run.depth, s.ny, 4))
    found = run.driven(theta, u, past)
    for k in range(4):
        x0 = run.state(past[:, :, k], u[: run.before, :, k])
        alone = s.simulate(theta, u[run.before :, :, k], x0)
        np.testing.assert_allclose(found[:, :, k], alone, rtol=0, atol=1e-12)


def test_candidate_runs_are_free_runs_from_the_measured_past() -> None:
    r = record(200)
    s = structure()
    runs = CandidateRuns(s.rows[0], [(r.u, r.y)], s.limits[0])
    wrong = TRUTH * np.array([0.9, 1.0, 1.0, 0.0, 1.0])
    both = runs.errors(np.column_stack([TRUTH, wrong]))
    assert both[0] < 1e-25
    total = 0.0
    for a, b in ((2, 152), (152, 200)):
        x0 = s.free_run().state(r.y[:a], r.u[:a])
        total += float(np.sum((s.simulate(wrong, r.u[a:b], x0) - r.y[a:b]) ** 2))
    assert both[1] == pytest.approx(total / 198, rel=1e-10)


def test_fits_together_are_fits_alone() -> None:
    r, other = record(240, process=0.05), record(180, process=0.05, seed=1)
    s, limits = structure(), (-3.0, 3.0)
    cut = s.rows[0][:3]
    fits = [
        ChunkFit(s.rows[0], 0.5 * TRUTH, [(r.u, r.y)]),
        ChunkFit(cut, 0.5 * TRUTH[:3], [(r.u, r.y), (other.u, other.y)]),
        ChunkFit(cut[:2], TRUTH[:2], [(r.u[:3], r.y[:3])]),
    ]
    found = fit_together(fits, limits, 40, 60, tolerance=1e-10)
    for each, theta in zip(fits[:2], found[:2], strict=True):
        n, bound = len(theta), np.full(len(theta), np.inf)
        run = PolynomialRun((each.terms,), 1, (limits,))
        problem = ChunkedRuns(run, each.data, 40, np.ones(1))
        alone = levenberg_marquardt(
            problem, each.theta, Descent(free=np.ones(n, dtype=bool), lower=-bound, upper=bound)
        )
        # both stop within 1e-9 of the lowest cost: 3e-5 in the coefficients, times conditioning
        np.testing.assert_allclose(theta, alone.p, rtol=0, atol=1e-3)
        cost = float(np.sum(problem.residual(theta) ** 2))
        assert cost == pytest.approx(2.0 * alone.cost, rel=1e-6)
    # one sample for two coefficients teaches nothing
    np.testing.assert_array_equal(found[2], TRUTH[:2])


@pytest.mark.slow
def test_the_input_of_the_same_sample_enters_only_where_it_acts() -> None:
    rng = np.random.default_rng(20)
    u = rng.uniform(-1, 1, 600)
    for through in (0.0, 0.4):
        y = np.zeros(600)
        for t in range(1, 600):
            y[t] = 0.7 * y[t - 1] + 0.3 * u[t - 1] + through * u[t] + 0.01 * rng.standard_normal()
        s = NARMAX.from_orders({"na": 2, "nb": 3, "nk": 0}, 1, 1, {"degree": "2"})
        model = fit(s, [Record(u[:, None], y[:, None], 0.1)])
        assert ("u(t)" in names(model)) == (through > 0.0)
        assert model.structure.order_values()["nk"] == (0 if through else 1)


@every_case
@pytest.mark.parametrize("focus", list(Focus))
def test_gradients_are_those_of_central_differences(case: str, focus: Focus) -> None:
    s, theta = CASES[case]
    rng = np.random.default_rng(12)
    records = []
    for n in (90, 60):
        u = rng.uniform(-1, 1, (n, s.nu))
        y = s.simulate(theta, u) + 0.1 * rng.standard_normal((n, s.ny))
        records.append(Record(u, y, 0.1))
    found: list[Problem] = list(problems_of(s, records, focus, Initial.AUTO))
    if focus is Focus.SIMULATION:
        data = [(r.u, r.y) for r in records]
        found.append(ChunkedRuns(s.free_run(), data, 17, np.ones(s.ny)))
    for problem in found:
        p = theta[problem.index]
        J, numerical = problem.jacobian(p), np.empty((len(problem.residual(p)), len(p)))
        for k in range(len(p)):
            d = np.zeros(len(p))
            d[k] = 1e-6
            change = problem.residual(p + d) - problem.residual(p - d)
            numerical[:, k] = change / 2e-6
        # rounding 1e-16/1e-6 times the size of the run, curvature times 1e-12
        np.testing.assert_allclose(J, numerical, rtol=0, atol=1e-8)
        assert sum(problem.lengths) == len(J)


@every_case
def test_gradients_are_those_of_the_prediction(case: str) -> None:
    s, theta = CASES[case]
    rng = np.random.default_rng(13)
    u, y = rng.uniform(-1, 1, (60, s.nu)), rng.standard_normal((60, s.ny))
    for i in range(s.ny):
        found = s.gradients(theta, u, y)[i]
        for k in range(len(theta)):
            d = np.zeros(len(theta))
            d[k] = 1e-6
            one, two = (s.errors(theta + c * d, u, y, 0)[:, i] for c in (1.0, -1.0))
            numerical = np.nan_to_num((two - one) / 2e-6)
            np.testing.assert_allclose(found[:, k], numerical, rtol=0, atol=1e-7)


@every_case
def test_k_step_predictions_are_what_they_say(case: str) -> None:
    s, theta = CASES[case]
    rng = np.random.default_rng(14)
    u, y = rng.uniform(-1, 1, (60, s.nu)), 0.5 * rng.standard_normal((60, s.ny))
    e, first = np.nan_to_num(s.errors(theta, u, y, 0)), s.first_sample()
    horizon = 4
    found = s.predict(theta, u, y, horizon, 0)
    assert np.isnan(found[: first + horizon - 1]).all()
    for t in range(first + horizon - 1, 60):
        seen, surprises = y.copy(), e.copy()
        start = t - horizon + 1
        surprises[start:] = 0.0
        for now in range(start, t + 1):
            for i, row in enumerate(s.rows):
                values = columns(row, u[: now + 1], seen[: now + 1], surprises[: now + 1])[-1]
                seen[now, i] = values @ theta[s.row_index(i)]
        np.testing.assert_allclose(found[t], seen[t], rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        s.predict(theta, u, y, 1, 0)[first:], (y - s.errors(theta, u, y, 0))[first:]
    )


def test_the_fitted_state_continues_a_run() -> None:
    s = structure()
    r = record(400)
    x0 = s.fitted_state(TRUTH, r.u[200:], r.y[200:], 3 * s.n_states(TRUTH))
    run = s.simulate(TRUTH, r.u[200:], x0)
    # the weak pull towards steady state costs a thousandth of a usual change, and fades
    assert np.max(np.abs(run - r.y[200:])) < 5e-3
    assert np.max(np.abs((run - r.y[200:])[40:])) < 1e-6


def test_free_runs_stay_inside_the_widened_range_whatever_the_input() -> None:
    model = fitted(record(600, process=0.05), degree="3")
    u = np.random.default_rng(15).uniform(-30.0, 30.0, (20000, 1))
    run = model.simulate(u)
    ((low, high),) = model.structure.limits
    assert np.all((run >= low) & (run <= high))
    assert model.structure.at_limits(run)[0] > 0.0
    seen = model.ranges[1]
    assert high - seen[1] == pytest.approx(0.15 * (seen[1] - seen[0]))


def test_an_equation_that_runs_away_is_called_unstable() -> None:
    s = structure()
    assert s.stable(TRUTH)
    assert not s.stable(np.array([1.2, -0.1, 0.5, 0.0, 0.0]))
    assert not s.stable(np.array([0.9, -0.3, 0.5, 2.0, 0.1]))
    assert not s.stable(np.full(5, np.nan))
    assert np.all(np.isfinite(s.simulate(np.array([9.0, -0.1, 0.5, 9.0, 0.1]), np.ones((500, 1)))))


def test_long_runs_are_fast() -> None:
    s, theta = CASES["coupled"]
    u = np.random.default_rng(16).uniform(-1, 1, (10_000, 2))
    x, step = np.zeros(s.n_states(theta)), s.step(theta)
    spent = []
    for _ in range(3):
        started = perf_counter()
        s.simulate(theta, u)
        middle = perf_counter()
        for now in u[:1000]:
            x, _ = step(x, now)
        spent.append((middle - started, (perf_counter() - middle) / 1000))
    # 0.04 s and 5 µs on an idle machine
    assert min(a for a, _ in spent) < 0.5
    assert min(b for _, b in spent) < 30e-6
