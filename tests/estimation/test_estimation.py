"""The estimator: against linear algebra, published figures, hard data and useless data."""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import studies
from hypothesis import given, settings
from hypothesis import strategies as st
from polynomial_cases import SYSTEMS, System
from scipy.signal import lfilter

from sysid.criteria.fit import fit_percent, rmse
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError, Termination, UsageError
from sysid.estimation.pem import fit
from sysid.fitting import normal_equations as ne
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Initial
from sysid.structures.head import head_window
from sysid.structures.linear.output_error import pole_grid, reflected
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

MEASURED = Path(os.environ.get("SYSID_DATA", "../shared/data"))
measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured records are not there (../shared/data, SYSID_DATA)"
)
FOUR = ("arx", "armax", "oe", "bj")
every_structure = pytest.mark.parametrize("name", FOUR)


def table(path: str) -> Array:
    """A measured file as an array."""
    return pd.read_csv(MEASURED / path).to_numpy(dtype=np.float64)


def estimated(
    name: str,
    orders: dict[str, object],
    records: Sequence[Record],
    *,
    detrend: str = "auto",
    **options: object,
) -> Model:
    structure = structure_class(name).from_orders(orders, records[0].nu, records[0].ny)
    found = FitOptions(**options)  # type: ignore[arg-type]
    return fit(structure, records, found, detrend=detrend)


def of(system: System, record: Record, **options: object) -> Model:
    return fit(system.model_structure, [record], FitOptions(**options))  # type: ignore[arg-type]


def free_run(model: Model, record: Record) -> Array:
    x0 = model.fitted_state(record, head_window(model.structure, model.theta))
    return model.simulate(record.u, x0)


# ------------------------------------------------------------------ linear algebra


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    nu=st.integers(1, 3),
    ny=st.integers(1, 3),
    na=st.integers(0, 4),
    nb=st.integers(1, 4),
    nk=st.integers(0, 3),
)
def test_arx_is_least_squares(seed: int, nu: int, ny: int, na: int, nb: int, nk: int) -> None:
    rng = np.random.default_rng(seed)
    record = Record(rng.standard_normal((120, nu)), rng.standard_normal((120, ny)), 1.0)
    orders = {"na": [[na] * ny] * ny, "nb": nb, "nk": nk}
    # an offset is seen in pure noise now and then; without one it is plain least squares
    model = estimated("arx", orders, [record], detrend="none")
    for i in range(ny):
        start = max(na, nb + nk - 1)
        columns = [-record.y[start - k : 120 - k, j] for j in range(ny) for k in range(1, na + 1)]
        columns += [record.u[start - k : 120 - k, j] for j in range(nu) for k in range(nk, nk + nb)]
        phi, target = np.column_stack(columns), record.y[start:, i]
        by_hand = np.linalg.lstsq(phi, target, rcond=None)[0]
        index = model.structure.row_index(i)  # type: ignore[attr-defined]
        assert model.theta[index] == pytest.approx(by_hand, abs=1e-10)


def test_ill_conditioned_regressors_keep_their_digits() -> None:
    """A slow signal sampled fast: condition 1e9 of ΦᵀΦ; the triangular factor is used instead."""
    rng = np.random.default_rng(0)
    u = lfilter([1.0], np.poly([0.995] * 3), rng.standard_normal(4000))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
    y = y + 1e-6 * np.std(y) * rng.standard_normal(4000)
    record = Record(u, y, 0.01)
    gram = ne.lag_gram([record], 4)
    terms = [(0, k) for k in range(1, 5)] + [(1, k) for k in range(1, 5)]
    columns = [gram.column(s, k) for s, k in terms]
    assert ne.solve(gram, gram.column(0, 0), columns) is None, "the fallback must be needed"
    model = estimated("arx", {"na": 4, "nb": 4, "nk": 1}, [record])
    signals = (y, u)
    phi = np.column_stack([signals[s][4 - k : 4000 - k] for s, k in terms])
    by_hand = np.linalg.lstsq(phi, y[4:], rcond=None)[0]
    by_hand[:4] *= -1.0
    # condition 1e7 of Φ itself: 9 digits are left
    assert model.theta == pytest.approx(by_hand, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("start", [None, 9])
def test_the_gram_matrix_is_that_of_the_regressors(start: int | None) -> None:
    rng = np.random.default_rng(1)
    records = [
        Record(rng.standard_normal((n, 2)), rng.standard_normal((n, 2)), 1.0) for n in (50, 5, 31)
    ]
    lags, first = 6, start or 6
    gram = ne.lag_gram(records, lags, start)
    blocks = []
    for r in records:
        signals = (*r.y.T, *r.u.T)
        rows = [s[max(first - k, 0) : len(r) - k] for s in signals for k in range(lags + 1)]
        if len(r) > first:
            blocks.append(np.array(rows))
    stacked = np.hstack(blocks)
    assert gram.samples == stacked.shape[1]
    assert gram.matrix == pytest.approx(stacked @ stacked.T, abs=1e-10)


def test_arx_uses_little_memory() -> None:
    """The eight regressors would take eight copies of a channel, their matrix alone."""
    import tracemalloc

    rng = np.random.default_rng(2)
    u = rng.standard_normal(300_000)
    record = Record(u, lfilter([0.0, 1.0], [1.0, -0.8], u) + rng.standard_normal(300_000), 0.1)
    structure = structure_class("arx").from_orders({"na": 4, "nb": 4}, 1, 1)
    tracemalloc.start()
    try:
        fit(structure, [record])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # residuals, prediction errors and their finite rows are copies of one channel each
    assert peak < 6 * 8 * len(record) + 64 * 10 * ne.BLOCK


# ------------------------------------------------------------------ published figures


@measured
def test_dryer() -> None:
    """arx [2 2 3] on samples 1…300, means removed."""
    d = table("dryer/dryer.csv")
    record = Record(d[:300, 1], d[:300, 2], 0.08)
    structure = structure_class("arx").from_orders({"na": 2, "nb": 2, "nk": 3}, 1, 1)
    model = fit(structure, [record], detrend=Detrend.means([record]))
    assert np.round(model.theta, 4).tolist() == [-1.2737, 0.3935, 0.0666, 0.0445]
    e = model.errors(record, 0)
    assert fit_percent(record.y, record.y - e)[0] == pytest.approx(95.12, abs=0.005)


@measured
@pytest.mark.parametrize(("level", "published"), [("low", 0.2915), ("high", 0.3305)])
def test_coupled_electric_drives(level: str, published: float) -> None:
    d = table(f"ced/unif_{level}.csv")
    half, test = Record(d[:200, 1], d[:200, 2], 0.02), Record(d[400:, 1], d[400:, 2], 0.02)
    structure = structure_class("arx").from_orders({"na": 10, "nb": 10, "nk": 0}, 1, 1)
    model = fit(structure, [half], detrend=Detrend.means([half]))
    run = model.simulate(test.u, model.fitted_state(test, 10))
    assert rmse(test.y, run, skip=10)[0] == pytest.approx(published, abs=5e-5)


@measured
def test_silverbox() -> None:
    d = table("silverbox/snls80mv.csv")
    dt = 1.0 / 610.35
    multisine = Record(d[40650:127400, -2], d[40650:127400, -1], dt)
    arrow = Record(d[100:40575, -2], d[100:40575, -1], dt)
    train, test = multisine.split(0.75)
    half = train.rows(0, len(train) // 2)
    structure = structure_class("arx").from_orders({"na": 10, "nb": 10, "nk": 0}, 1, 1)
    model = fit(structure, [half], detrend=Detrend.means([half]))
    for record, published in ((test, 6.95), (arrow, 14.23)):
        run = model.simulate(record.u, model.fitted_state(record, 10))
        assert 1e3 * rmse(record.y, run, skip=50)[0] == pytest.approx(published, abs=0.005)


@measured
@pytest.mark.parametrize(
    ("name", "orders", "focus", "reach"),
    [
        ("arx", {"na": 4, "nb": 4}, Focus.SIMULATION, (70.0, 80.0)),
        ("oe", {"nb": 4, "nf": 4}, Focus.PREDICTION, (68.0, 80.0)),
        ("bj", {"nb": 4, "nf": 4, "nc": 2, "nd": 2}, Focus.SIMULATION, (68.0, 80.0)),
    ],
)
def test_a_lightly_damped_arm(
    name: str, orders: dict[str, object], focus: Focus, reach: tuple[float, float]
) -> None:
    """CD player arm: the second half is simulated from a model of the first."""
    d = table("cdplayer_arm/cdplayer.csv")
    train, test = Record(d[:, 1:3], d[:, 3:5], 1.0).split(0.5)
    structure = structure_class(name).from_orders(orders, 2, 2)
    model = fit(structure, [train], FitOptions(focus=focus), detrend=Detrend.means([train]))
    assert np.all(fit_percent(test.y, free_run(model, test)) > np.array(reach))


@measured
@pytest.mark.parametrize(
    ("name", "orders", "focus"),
    [
        ("arx", {"na": 2, "nb": 2}, Focus.PREDICTION),
        ("armax", {"na": 2, "nb": 2, "nc": 2}, Focus.PREDICTION),
        ("armax", {"na": 2, "nb": 2, "nc": 2}, Focus.SIMULATION),
        ("oe", {"nb": 1, "nf": 1}, Focus.PREDICTION),
        ("oe", {"nb": 2, "nf": 2}, Focus.PREDICTION),
        ("bj", {"nb": 1, "nf": 1, "nc": 1, "nd": 1}, Focus.PREDICTION),
    ],
)
def test_a_winding_process_of_five_inputs(
    name: str, orders: dict[str, object], focus: Focus
) -> None:
    d = table("winding/winding.csv")
    train, test = Record(d[:, 1:6], d[:, 6:8], 0.1).split(0.5)
    structure = structure_class(name).from_orders(orders, 5, 2)
    model = fit(structure, [train], FitOptions(focus=focus), detrend=Detrend.means([train]))
    assert model.stable
    # ten inputs' poles of order two are more than the log can tell: a flat valley, reported so
    flat = name == "oe" and orders["nf"] == 2
    assert model.termination.good or (flat and model.termination is Termination.MAX_ITERATIONS)
    if focus is Focus.SIMULATION or name == "oe":
        least = (60.0, 40.0) if orders.get("nf") == 1 else (70.0, 45.0)
        assert np.all(fit_percent(test.y, free_run(model, test)) > np.array(least))
    else:
        # one step ahead is what was asked; the free run of these need not follow
        e = model.errors(train, head_window(structure, model.theta))
        assert np.all(fit_percent(train.y, train.y - e) > np.array((85.0, 60.0)))


# ------------------------------------------------------------------ constraints


def test_fixed_parameters_keep_their_value_and_have_no_error() -> None:
    system = SYSTEMS["oe"]
    model = of(system, system.record(500, 0.3, seed=1), fixed={"f2": 0.7, "b1": 1.0})
    rows = {row.name: row for row in model.parameter_table()}
    assert (rows["f2"].value, rows["f2"].std_error, rows["f2"].fixed) == (0.7, 0.0, True)
    assert rows["b1"].value == 1.0
    assert model.n_estimated == 2
    free = of(system, system.record(500, 0.3, seed=1))
    assert rows["f1"].std_error < free.parameter_table()[2].std_error
    assert model.theta == pytest.approx(system.truth, abs=0.05)


def test_everything_fixed_is_an_evaluation() -> None:
    system = SYSTEMS["armax"]
    names = ["a1", "a2", "b1", "b2", "c1", "c2"]
    record = system.record(300, 0.3)
    model = of(system, record, fixed=dict(zip(names, system.theta, strict=True)))
    assert model.termination is Termination.NO_FREE_PARAMETERS
    assert model.theta.tolist() == list(system.theta)
    assert model.criteria["loss"] == pytest.approx(0.09, rel=0.2)


@every_structure
def test_bounds_hold_and_are_reported(name: str) -> None:
    system = SYSTEMS[name]
    model = of(system, system.record(400, 0.2), bounds={"b1": (0.0, 0.6)})
    value = model.theta[[p.name for p in model.parameters].index("b1")]
    assert 0.0 <= value <= 0.6
    assert value == pytest.approx(0.6, abs=1e-4)
    assert model.at_bound == ("b1",)
    assert model.termination is Termination.AT_BOUND


@every_structure
def test_bounds_that_do_not_bind_change_nothing(name: str) -> None:
    system = SYSTEMS[name]
    record = system.record(400, 0.2, seed=2)
    free, bounded = of(system, record), of(system, record, bounds={"b1": (-5.0, 5.0)})
    errors = np.sqrt(np.diag(free.covariance))
    assert np.max(np.abs(free.theta - bounded.theta) / errors) < 1e-2
    assert bounded.at_bound == ()


@pytest.mark.parametrize(
    "options",
    [
        {"fixed": {"q1": 0.0}},
        {"bounds": {"q1": (0.0, 1.0)}},
        {"bounds": {"a1": (1.0, 1.0)}},
        {"bounds": {"a1": (0.0, 1.0)}, "fixed": {"a1": 2.0}},
        {"bounds": {"a1": (float("nan"), 1.0)}},
    ],
)
def test_impossible_constraints_are_refused(options: dict[str, object]) -> None:
    system = SYSTEMS["arx"]
    with pytest.raises(UsageError) as caught:
        of(system, system.record(100, 0.1), **options)
    assert "\n" not in str(caught.value)


def test_a_fixed_unstable_pole_contradicts_stability() -> None:
    system = SYSTEMS["oe"]
    with pytest.raises(ModelError, match="Diverged"):
        of(system, system.record(200, 0.1), stable=True, fixed={"f2": 1.5})


def unstable_looking(samples: int = 300) -> Record:
    """Short steps into an integrator-like plant with drift: least squares puts a pole outside."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 30 + 1), 30)[:samples]
    y = lfilter([0.0, 0.02], [1.0, -0.999], u) + np.exp(np.arange(samples) / 60.0) / 20.0
    return Record(u, y + 0.02 * rng.standard_normal(samples), 0.1)


@pytest.mark.parametrize("name", ["arx", "armax", "oe", "bj"])
@pytest.mark.parametrize("focus", list(Focus))
def test_stability_is_enforced_where_asked(name: str, focus: Focus) -> None:
    system = SYSTEMS[name]
    record = unstable_looking()
    model = of(system, record, stable=True, focus=focus)
    assert model.stable
    if name in ("arx", "armax") and focus is Focus.PREDICTION:
        assert not of(system, record).stable, "the constraint must be needed"


# ------------------------------------------------------------------ losses and foci


@every_structure
@pytest.mark.parametrize("focus", list(Focus))
def test_five_per_cent_of_outliers_hurt_the_robust_loss_less(name: str, focus: Focus) -> None:
    system = SYSTEMS[name]
    errors = []
    for seed in range(3):
        clean = system.record(800, 0.1, seed=seed)
        rng = np.random.default_rng(100 + seed)
        y = clean.y.copy()
        hit = rng.random(800) < 0.05
        y[hit] += 8.0 * rng.standard_normal((int(hit.sum()), 1))
        struck = Record(clean.u, y, clean.dt)
        index = system.model_structure.deterministic_index()
        errors.append(
            [
                np.linalg.norm(
                    of(system, struck, robust=r, focus=focus).theta[index] - system.truth[index]
                )
                for r in (False, True)
            ]
        )
    quadratic, robust = np.mean(errors, axis=0)
    # an outlier in y stays in the regressors of ARX, which no loss on its errors repairs
    gain = 1.0 if name == "arx" and focus is Focus.PREDICTION else 0.6
    assert robust < gain * quadratic


@pytest.mark.parametrize("name", ["arx", "armax", "bj"])
def test_simulation_focus_lowers_the_free_run_error(name: str) -> None:
    """The plant is of higher order than the model, so the two foci must differ."""
    rng = np.random.default_rng(8)
    u = rng.standard_normal(1500)
    y = lfilter([0.0, 0.1, 0.05], np.poly([0.95, 0.7, 0.4]), u)
    y = y + lfilter([1.0, 0.5], [1.0, -0.7], 0.05 * rng.standard_normal(1500))
    record = Record(u, y, 0.1)
    orders = {
        "arx": {"na": 1, "nb": 2},
        "armax": {"na": 1, "nb": 2, "nc": 1},
        "bj": {"nb": 1, "nf": 1, "nc": 1, "nd": 1},
    }[name]
    error = {
        focus: rmse(record.y, free_run(estimated(name, orders, [record], focus=focus), record))[0]
        for focus in Focus
    }
    factor = 0.999 if name == "bj" else 0.9
    assert error[Focus.SIMULATION] < factor * error[Focus.PREDICTION]


# ------------------------------------------------------------------ initial states


@pytest.mark.parametrize("name", ["oe", "bj", "armax"])
@pytest.mark.parametrize("initial", list(Initial))
def test_records_cut_from_the_middle(name: str, initial: Initial) -> None:
    """A slow plant in full swing: zero states are wrong, the other three policies find out."""
    slow = {
        "oe": replace(SYSTEMS["oe"], theta=(0.1, 0.05, -1.9, 0.91)),
        "bj": replace(SYSTEMS["bj"], theta=(0.1, 0.05, 0.5, -0.5, -1.9, 0.91)),
        "armax": replace(SYSTEMS["armax"], theta=(-1.9, 0.91, 0.1, 0.05, -0.9, 0.3)),
    }[name]
    record = slow.record(250, 0.02, seed=3, skip=60)
    model = of(slow, record, initial=initial)
    index = slow.model_structure.deterministic_index()
    z = (model.theta - slow.truth)[index] / np.sqrt(np.diag(model.covariance))[index]
    if initial is Initial.ZERO and name != "armax":
        # the transient counts as noise
        assert model.noise_covariance[0, 0] > 1.5 * 0.02**2
        return
    assert np.max(np.abs(z)) < 4.5
    assert model.noise_covariance[0, 0] == pytest.approx(0.02**2, rel=0.3)
    states = model.provenance.options["initial_states_estimated"]
    assert (
        states
        == {
            Initial.ZERO: 0,
            Initial.BACKCAST: 0,
            Initial.ESTIMATED: {"oe": 2, "bj": 3, "armax": 2}[name],
            Initial.AUTO: {"oe": 2, "bj": 3, "armax": 0}[name],  # its wrong start dies with C
        }[initial]
    )


def test_auto_counts_no_states_at_rest() -> None:
    system = SYSTEMS["oe"]
    counted = [of(system, system.record(400, 0.3, seed=s)).n_estimated for s in range(10)]
    # the test of the states is run at 1 %, once at the start and once at the end
    assert counted.count(4) >= 9


@every_structure
def test_criteria_are_those_of_the_errors_that_were_minimised(name: str) -> None:
    system = SYSTEMS[name]
    model = of(system, system.record(300, 0.3, seed=3, skip=60), initial=Initial.ESTIMATED)
    costs = [s.cost for s in model.starts if s.cost is not None]
    assert bool(costs) is (name != "arx")  # which is solved in closed form
    if costs:
        samples = 300 - system.model_structure.first_sample()
        assert model.criteria["loss"] == pytest.approx(2.0 * min(costs) / samples, rel=1e-9)


def test_the_head_of_a_slow_run_is_long_enough_for_its_state() -> None:
    """Six samples say nothing about a mode that lasts hundreds."""
    slow = replace(SYSTEMS["oe"], theta=(0.01, 0.009, -1.985, 0.98505))
    record = slow.record(1500, 0.3, seed=3, skip=400)
    model = of(slow, record)
    assert head_window(model.structure, model.theta) > 150
    # as many skipped samples as states: the run starts from the measured outputs; else never less
    assert head_window(model.structure, model.theta, skip=2) == 2
    assert head_window(model.structure, model.theta, skip=20) > 150
    assert head_window(model.structure, model.theta, skip=900) == 900
    run = free_run(model, record)
    assert rmse(record.y, run)[0] < 1.1 * 0.3


# ------------------------------------------------------------------ data without information


@every_structure
@pytest.mark.parametrize("ratio", [1.0, -2.0, 1e6])
def test_inputs_that_move_alike_are_named(name: str, ratio: float) -> None:
    system = SYSTEMS[name]
    one = system.record(500, 0.1)
    both = Record(np.hstack([one.u, ratio * one.u]), one.y, one.dt)
    orders = dict(system.orders)
    model = estimated(name, orders, [both])
    alike = {f"b{k}[y,u{j}]" for k in (1, 2) for j in (1, 2)}
    if name in ("oe", "bj"):
        alike |= {f"f{k}[y,u{j}]" for k in (1, 2) for j in (1, 2)}
    unknown = {row.name for row in model.parameter_table() if np.isinf(row.std_error)}
    assert unknown == alike
    assert {n for direction in model.null_directions for n in direction} == alike
    # what can be known is known: the sum of both reaches y as the single input does
    assert rmse(one.y, free_run(model, both))[0] < 3 * np.std(
        one.y - free_run(of(system, one), one)
    )


def test_both_tracks_commanded_alike() -> None:
    """Two inputs, two outputs, equal commands: each wheel's response to the pair is found."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(800)
    y = np.column_stack([lfilter([0, 0.5], [1, -0.8], u), lfilter([0, 0.6], [1, -0.8], u)])
    record = Record(np.column_stack([u, u]), y + 0.05 * rng.standard_normal(y.shape), 0.1)
    for name, orders in (("arx", {"na": 1, "nb": 1}), ("oe", {"nb": 1, "nf": 1})):
        model = estimated(name, orders, [record])
        assert len(model.null_directions) == 2
        assert np.all(fit_percent(record.y, free_run(model, record)) > 90.0)


@every_structure
def test_an_input_without_effect_is_insignificant(name: str) -> None:
    rng = np.random.default_rng(4)
    noise = lfilter([1.0], [1.0, -0.5], rng.standard_normal(1000))
    record = Record(rng.standard_normal(1000), noise, 0.1)
    model = of(SYSTEMS[name], record)
    assert np.all(np.isfinite(model.theta))
    gains = [row for row in model.parameter_table() if row.name.startswith("b")]
    # poles of a transfer function that is not there are free to fit noise: wider than 2.6
    assert all(abs(row.value) < 5 * row.std_error + 0.2 for row in gains)


@every_structure
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda u, y: (0 * u + 3.0, y), "input u is constant"),
        (lambda u, y: (u, 0 * y), "output y is constant"),
        (lambda u, y: (u, np.where(np.arange(len(y))[:, None] == 7, np.nan, y)), "y holds numbers"),
        (lambda u, y: (np.where(np.arange(len(y))[:, None] == 7, np.inf, u), y), "u holds numbers"),
        (lambda u, y: (u[:5], y[:5]), "5 samples leave"),
        (lambda u, y: (u[:0], y[:0]), "is constant"),
        (lambda u, y: (u[:1], y[:1]), "is constant"),
        (lambda u, y: (np.hstack([u, u]), y), "but the structure has 1 and 1"),
    ],
)
def test_useless_data_are_refused_in_one_sentence(name: str, spoil: object, said: str) -> None:
    system = SYSTEMS[name]
    record = system.record(100, 0.1)
    u, y = spoil(record.u, record.y)  # type: ignore[operator]
    with pytest.raises(DataError) as caught:
        of(system, Record(u, y, 0.1))
    assert "\n" not in str(caught.value)
    assert said in str(caught.value)


def test_no_record_and_unlike_records_are_refused() -> None:
    system = SYSTEMS["arx"]
    record = system.record(100, 0.1)
    with pytest.raises(DataError, match="at least one log"):
        fit(system.model_structure, [])
    with pytest.raises(DataError, match="share both"):
        fit(system.model_structure, [record, replace(record, dt=0.2)])
    with pytest.raises(DataError, match="leave it out"):
        fit(system.model_structure, [record, record.rows(0, 2)])


def test_one_output_with_more_unknowns_than_samples_is_refused() -> None:
    rng = np.random.default_rng(0)
    record = Record(rng.standard_normal((48, 1)), rng.standard_normal((48, 2)), 0.1)
    orders = {"nb": [[20], [1]], "nf": [[10], [1]]}
    with pytest.raises(DataError, match="unknowns"):
        estimated("oe", orders, [record])


@every_structure
@pytest.mark.parametrize("initial", list(Initial))
def test_barely_enough_samples_raise_nothing_unexpected(name: str, initial: Initial) -> None:
    system = SYSTEMS[name]
    whole = system.record(40, 0.1)
    for n in (*range(1, 25), 30, 39):
        try:
            model = of(system, whole.rows(0, n), initial=initial)
        except DataError:
            assert n < 25
        else:
            assert np.all(np.isfinite(model.theta))


# ------------------------------------------------------------------ unusual but legitimate data


@every_structure
def test_noise_free_data_converge(name: str) -> None:
    system = SYSTEMS[name]
    model = of(system, system.record(300))
    index = system.model_structure.deterministic_index()
    assert model.theta[index] == pytest.approx(system.truth[index], abs=1e-8)
    assert model.termination.good
    assert np.all(np.isfinite(model.covariance[np.ix_(index, index)]))


@every_structure
def test_offsets_are_removed_and_put_back(name: str) -> None:
    system = SYSTEMS[name]
    plain = system.record(600, 0.1, seed=6)
    shifted = Record(plain.u + 40.0, plain.y - 300.0, plain.dt)
    zero = fit(system.model_structure, [plain], detrend=Detrend.means([plain]))
    moved = fit(system.model_structure, [shifted], detrend=Detrend.means([shifted]))
    errors = np.sqrt(np.diag(zero.covariance))
    assert np.max(np.abs(zero.theta - moved.theta) / errors) < 1e-3
    assert moved.simulate(shifted.u) == pytest.approx(zero.simulate(plain.u) - 300.0, abs=1e-4)
    assert moved.predict(shifted, 1, 10)[20:] == pytest.approx(
        zero.predict(plain, 1, 10)[20:] - 300.0, abs=1e-4
    )
    without = fit(system.model_structure, [shifted], detrend="none")
    assert np.max(np.abs(without.theta - system.truth)) > 3 * np.max(
        np.abs(moved.theta - system.truth)
    )


@pytest.mark.parametrize("name", ["arx", "armax", "oe", "bj"])
def test_an_integrating_plant(name: str) -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal(800)
    y = lfilter([0.0, 0.1], np.poly([1.0, 0.5]), u)
    disturbance = 0.02 * rng.standard_normal(800)
    if name in ("arx", "armax"):
        disturbance = lfilter([1.0], np.poly([1.0, 0.5]), disturbance)
    record = Record(u, y + disturbance, 0.1)
    orders = {
        "arx": {"na": 2, "nb": 1},
        "armax": {"na": 2, "nb": 1, "nc": 1},
        "oe": {"nb": 1, "nf": 2},
        "bj": {"nb": 1, "nf": 2, "nc": 1, "nd": 1},
    }[name]
    model = estimated(name, orders, [record])
    poles = np.sort([p["abs"] for p in model.structure.properties(model.theta, 0.1)["poles"]])
    assert poles == pytest.approx([0.5, 1.0], abs=0.03)
    assert fit_percent(record.y, free_run(model, record))[0] > 80.0


def test_a_direct_term_is_found_and_its_absence_too() -> None:
    for name in ("arx nk=0", "armax nk=0", "oe nk=0", "bj nk=0"):
        system = SYSTEMS[name]
        model = of(system, system.record(800, 0.1, seed=1))
        b0 = next(row for row in model.parameter_table() if row.name == "b0")
        assert abs(b0.value - 1.0) < 4.5 * b0.std_error
    delayed = SYSTEMS["arx"].record(800, 0.1, seed=1)
    b0 = estimated("arx", {"na": 2, "nb": 3, "nk": 0}, [delayed]).parameter_table()[2]
    assert abs(b0.value) < 4.5 * b0.std_error


@every_structure
def test_the_same_data_give_the_same_bytes(name: str, tmp_path: Path) -> None:
    system = SYSTEMS[name]
    files = []
    for k in range(2):
        record = system.record(400, 0.3, seed=2, skip=20)
        of(system, record).save(tmp_path / f"{k}.json")
        files.append((tmp_path / f"{k}.json").read_bytes())
    assert files[0] == files[1]
    json.loads(files[0])


def test_the_callers_arrays_are_left_alone() -> None:
    system = SYSTEMS["bj"]
    record = system.record(200, 0.1)
    u, y = record.u.copy(), record.y.copy()
    fit(system.model_structure, [record], detrend=Detrend.means([record]))
    np.testing.assert_array_equal(record.u, u)
    np.testing.assert_array_equal(record.y, y)


# ------------------------------------------------------------------ starts


def noisy_motor(seed: int, ratio: float, hold: int, samples: int = 500) -> tuple[Record, Array]:
    """A motor sampled fast (poles 0.98, 0.9) under a random telegraph, at a low noise ratio."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples]
    theta = np.array([0.01, 0.009, -1.88, 0.882])
    y = lfilter([0.0, *theta[:2]], [1.0, *theta[2:]], u)
    y = y + np.std(y) / ratio * rng.standard_normal(samples)
    return Record(u, y, 0.01), theta


@pytest.mark.parametrize(("ratio", "hold"), [(3.0, 1), (1.0, 10), (0.3, 1)])
def test_output_error_ends_in_the_global_minimum(ratio: float, hold: int) -> None:
    """No worse than a search started at the truth."""
    structure = structure_class("oe").from_orders({"nb": 2, "nf": 2}, 1, 1)
    worse = 0
    for seed in range(25):
        record, theta = noisy_motor(seed, ratio, hold)
        options = FitOptions(initial=Initial.ZERO)
        found = fit(structure, [record], options).criteria["loss"]
        helped = fit(structure, [record], options, warm=[("truth", theta)]).criteria["loss"]
        worse += found > helped * (1.0 + 1e-6)
    # 98 % of runs is the aim; more than two misses in 25 have probability 1.4 % then
    assert worse <= 2


def test_every_start_is_recorded() -> None:
    record, _ = noisy_motor(0, 0.3, 10)
    model = estimated("oe", {"nb": 2, "nf": 2}, [record])
    assert {s.start for s in model.starts} == {
        "SRIV",
        "SRIV on a long ARX",
        "ARX",
        "pole grid",
    }
    assert any(s.cost is not None for s in model.starts)


def test_a_warm_start_is_tried() -> None:
    system = SYSTEMS["oe"]
    record = system.record(300, 0.2)
    model = fit(system.model_structure, [record], warm=[("neighbour", system.truth)])
    assert "neighbour" in {s.start for s in model.starts}


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=5))
def test_reflection_leaves_no_pole_outside_and_the_shape_alike(tail: list[float]) -> None:
    p = np.array([1.0, *tail])
    inside = reflected(p)
    assert len(inside) == len(p)
    roots = np.abs(np.roots(p))
    # a root of multiplicity five moves by 1e-16^(1/5) = 1e-3 when it is computed back
    assert np.all(np.abs(np.roots(inside)) < 1.0 + 2e-3)
    if np.all(np.abs(roots - 1.0) > 0.01):
        z = np.exp(1j * np.linspace(0.1, 3.0, 7))
        ratio = np.abs(np.polyval(p, z)) / np.abs(np.polyval(inside, z))
        assert ratio == pytest.approx(np.full(7, ratio[0]), rel=1e-4)


def test_the_pole_grid_finds_poles_of_any_kind() -> None:
    for poles in ([0.9], [0.98, 0.6], [0.95 * np.exp(0.4j), 0.95 * np.exp(-0.4j)]):
        den = np.real(np.poly(poles))
        rng = np.random.default_rng(0)
        u = rng.standard_normal(600)
        record = Record(u, lfilter([0.0, 1.0], den, u) + rng.standard_normal(600), 0.1)
        structure = structure_class("arx").from_orders({"na": len(poles), "nb": 1}, 1, 1)
        theta = pole_grid([record], structure.layout(0))  # type: ignore[attr-defined]
        assert theta[: len(poles)] == pytest.approx(den[1:], abs=0.05)


# ------------------------------------------------------------------ uncertainty


@pytest.mark.parametrize("name", ["ARX", "ARMAX", "OE, white noise", "OE, AR(1) noise 0.9", "BJ"])
def test_intervals_cover_the_truth(name: str) -> None:
    """The fast part of the coverage study: 60 records, intervals over all parameters pooled."""
    study = studies.load("benchmarks/study_coverage.py")
    case = next(c for c in study.CASES if c.name == name)
    found = study.outcome(replace(case, samples=500), records=60)
    # 240 intervals and more, those of one record alike: 95 % with a standard deviation of 2
    assert 89.0 <= found.pooled <= 99.5
    assert found.beyond <= 0.5


def test_more_data_mean_smaller_errors() -> None:
    system = SYSTEMS["oe"]
    few, many = (of(system, system.record(n, 0.3, seed=3)) for n in (400, 6400))
    ratio = np.sqrt(np.diag(few.covariance) / np.diag(many.covariance))
    # the input's sample spectrum varies by some 10 % at 400 samples
    assert ratio == pytest.approx(np.full(4, 4.0), rel=0.25)
