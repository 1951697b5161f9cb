"""Robust fits: every structure finds the truth behind outliers, and leaves nothing good out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from numpy.typing import NDArray
from problem_cases import problems_of
from scipy.signal import lfilter

from studies import robust as study
from sysid.data.record import HARDLY, Array, Record
from sysid.estimation.pem import fit
from sysid.estimation.robust_fit import refit
from sysid.fitting.options import FitOptions
from sysid.fitting.outlier_events import explained
from sysid.fitting.outliers import find_outliers, resolutions
from sysid.fitting.problem import Focus
from sysid.fitting.robust import HUBER_WIDTH, huber_pays, huber_widths, robust_scale, weighted
from sysid.methods.outcome import FitOutcome
from sysid.methods.table import method_of
from sysid.structures.registry import structure_class

CASES = study.CASES


def fits(name: str, kind: str, robust: bool, records: int, first: int = 0) -> study.Fits:
    """Fits of a case to as many records, from one seed on."""
    seeds = range(first, first + records)
    return study.fits([study.one(name, seed, kind, robust) for seed in seeds])


FROM = {"oe": 6}
"""First record: in an earlier one of ``oe`` the noise alone moves three estimates by 3.2 standard
errors, with and without outliers."""

FEW = {"hammerstein-wiener": 2, "narmax": 2, "dc-motor": 1, "tanks": 1}
"""Records of the structures whose fits take seconds; six of the others."""


SLOW = ("narx-wavelet", "dc-motor", "tanks", "wiener-hammerstein")

QUICK = ("arx", "armax", "oe", "bj", "hammerstein-wiener", "narmax", "dc-motor")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind"), [*((n, k) for n in QUICK for k in study.KINDS), ("tanks", "reading")]
)
def test_the_truth_is_found_behind_outliers(name: str, kind: str) -> None:
    """The fast part of the study: every parameter within three honest standard errors."""
    found = fits(name, kind, True, FEW.get(name, 6), FROM.get(name, 0))
    # of 3 to 36 estimates, those of one record alike: one record may miss with two of them
    assert found.within > 90.0
    if len(found.off) >= 6:
        assert found.spread < 1.6
    if kind == "reading":
        # an error in 2000 is taken for an outlier, a pair in a hundred for three
        assert np.sum(found.found) == pytest.approx(np.sum(found.struck), rel=0.1, abs=2)


def test_the_truth_is_found_behind_a_sensor_that_saturates() -> None:
    found = fits("hammerstein-wiener, sensor saturates", "reading", True, 2)
    assert found.within == 100.0
    np.testing.assert_allclose(found.found, found.struck, atol=2)


def test_two_blocks_with_a_static_between_find_the_truth() -> None:
    case = replace(CASES["wiener-hammerstein"], samples=300)
    model = fit(case.made(), [case.record(1, "reading")], FitOptions(robust=True))
    errors, sizes = study.compared(case, model)
    assert np.all(np.abs(errors) < 3.0 * sizes)
    assert model.provenance.options["left_out"] == pytest.approx(
        np.sum(study.Drawn.of(1, 300).outliers != 0.0), abs=1
    )


@pytest.mark.parametrize("kind", study.KINDS)
def test_networks_follow_fresh_data_as_without_outliers(kind: str) -> None:
    case = replace(
        CASES["narx-wavelet"], samples=600, options={"degree": "1", "units": "4", "refine": "none"}
    )
    clean, struck = (
        fit(case.made(), [case.record(0, k)], FitOptions(robust=k != "clean"))
        for k in ("clean", kind)
    )
    assert study.fresh_fit(case, struck, 0) > study.fresh_fit(case, clean, 0) - 1.0


def test_a_fit_to_cleaner_data_starts_where_the_last_one_ended() -> None:
    """Structures that are fitted from given values only have no other start."""
    case = CASES["arx"]
    s, record = case.made(), case.record(0, "clean")
    parameters = s.parameters(record.inputs, record.outputs)
    first = method_of(s).fit(s, [record], FitOptions(), parameters, ())
    given: list[Array] = []

    def fitted(*told: object) -> FitOutcome:
        given.extend(theta for _, theta in told[-1])  # type: ignore[attr-defined]
        return first

    assert refit(fitted, first, [record], FitOptions(), first.parameters) is first
    np.testing.assert_array_equal(given, [first.theta])


def test_least_squares_needs_it() -> None:
    """Outliers in the regressors of ARX bias least squares by ten of its standard errors."""
    assert fits("arx", "reading", False, 6).within < 50.0


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CASES))
def test_a_clean_record_costs_nothing(name: str) -> None:
    """Without outliers and heavy tails the fit is that of least squares, digit for digit."""
    few = 1 if name in SLOW else 4
    case = replace(CASES[name], samples=300) if name in SLOW else CASES[name]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "CASES", {name: case})
        plain, careful = (fits(name, "clean", robust, few) for robust in (False, True))
    moved = np.abs(careful.clean_fit - plain.clean_fit)
    # in one record of thirty a single error is taken for an outlier
    assert np.count_nonzero(moved > 1e-9) <= few // 4
    assert np.max(moved) < 0.3
    assert np.mean(careful.found) < 1.0


@pytest.mark.parametrize(
    ("draw", "pays"),
    [("standard_normal", False), ("random", False), ("laplace", True), ("standard_t", True)],
)
def test_huber_is_taken_where_it_pays(draw: str, pays: bool) -> None:
    rng = np.random.default_rng(6)
    wide = {"df": 5} if draw == "standard_t" else {}
    drawn = [getattr(rng, draw)(size=(1000, 1), **wide) for _ in range(40)]
    shift = 0.5 if draw == "random" else 0.0
    assert np.mean([huber_pays(e - shift) == pays for e in drawn]) > 0.9


def test_heavy_tails_are_fitted_by_the_better_loss() -> None:
    """Noise of Laplace's distribution: Huber's estimates have a quarter less variance."""
    case = CASES["arx"]
    errors = {False: [], True: []}
    for seed in range(40):
        rng = np.random.default_rng([seed, 7])
        u = case.drive(seed, 1000)
        r = Record(u, case.run(u, 0.5 * rng.laplace(size=1000)), 0.1)
        for robust, found in errors.items():
            model = fit(case.made(), [r], FitOptions(robust=robust), detrend="none")
            found.append(study.compared(case, model)[0])
    size = {robust: np.sqrt(np.mean(np.square(found))) for robust, found in errors.items()}
    assert size[True] < 0.95 * size[False]


# ------------------------------------------------------------------ what is no outlier


@pytest.mark.parametrize(
    ("noise", "most"),
    [("Gaussian", 0.05), ("Laplace", 0.2), ("Student, 5 degrees of freedom", 0.5)],
)
def test_heavy_tails_are_no_outliers(noise: str, most: float) -> None:
    assert study.alarms(noise, 30)[0] < most


def test_steps_of_a_reading_are_no_outliers() -> None:
    """More than half of the errors are zero and the others one step: their median says nothing."""
    rng = np.random.default_rng(0)
    y = np.round(rng.standard_normal((1000, 1)) / 2.0) * 2.0
    assert np.mean(y == 0.0) > 0.5
    assert resolutions(y) == pytest.approx([2.0])
    assert not find_outliers(np.copy, Record(rng.standard_normal((1000, 1)), y, 0.1)).found.any()


def test_a_machine_that_mostly_rests_has_no_outliers() -> None:
    rng = np.random.default_rng(1)
    moving = np.repeat(rng.random(40) < 0.3, 25)
    y = np.where(moving, rng.standard_normal(1000), 0.0)[:, None]
    assert robust_scale(y) == pytest.approx(1.0, rel=0.15)
    assert not find_outliers(np.copy, Record(rng.standard_normal((1000, 1)), y, 0.1)).found.any()


def test_errors_of_the_model_are_not_left_out() -> None:
    """A delay that is not modelled: large errors, rare, and all of them where the input steps."""
    rng = np.random.default_rng(2)
    u = np.repeat(rng.choice([-1.0, 0.0, 1.0], 25), 40)
    y = lfilter([0.0, 0.0, 0.0, 0.5], [1.0, -0.5], u) + 0.01 * rng.standard_normal(1000)
    wrong = structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 1)
    model = fit(wrong, [Record(u, y, 0.1)], FitOptions(robust=True))
    assert model.provenance.options["left_out"] <= 2
    assert any("errors of the model" in w for w in model.warnings)


# ------------------------------------------------------------------ how they are told apart


def test_bad_readings_are_told_from_disturbances_even_side_by_side() -> None:
    rng = np.random.default_rng(3)
    e = rng.standard_normal(1000)
    e[[100, 400]] += 12.0
    y = lfilter([1.0], [1.0, -1.5, 0.7], e)
    clean = y.copy()
    y[[200, 201, 500, 502, 700]] += [12.0, 12.0, -12.0, 12.0, 12.0]

    def errors(v: Array) -> Array:
        found = lfilter([1.0, -1.5, 0.7], [1.0], v, axis=0)
        found[:2] = np.nan
        return np.asarray(found)

    found = find_outliers(errors, Record(rng.standard_normal(1000), y, 0.1), 2)
    assert np.flatnonzero(found.bad_measurements).tolist() == [200, 201, 500, 502, 700]
    assert np.flatnonzero(found.disturbances).tolist() == [100, 400]
    # each is replaced by what the past predicts: off by the noise of one step, or of two
    replaced = (y[:, None] + found.change)[found.bad_measurements] - clean[
        found.bad_measurements[:, 0]
    ]
    assert np.max(np.abs(replaced)) < 6.0
    assert np.all(found.weights[found.found] == 0.0)
    # the two samples after a replaced reading look back at it with factors of 1.5 and 0.7
    assert np.all(found.weights[[701, 702], 0] == HARDLY)
    assert found.weights[900, 0] == 1.0


def test_outputs_have_widths_of_their_own() -> None:
    rng = np.random.default_rng(4)
    y = rng.standard_normal((400, 2)) * [1.0, 1000.0]
    s = structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 2)
    (problem, *_) = problems_of(
        s, [Record(rng.standard_normal(400), y, 0.1)], Focus.SIMULATION, stable=True
    )
    r = problem.residual(np.zeros(len(problem.index) + problem.n_initial))
    widths = np.unique(huber_widths(problem, r))
    assert widths == pytest.approx([HUBER_WIDTH, 1000.0 * HUBER_WIDTH], rel=0.15)


def test_weights_reach_the_errors_of_their_samples() -> None:
    rng = np.random.default_rng(5)
    lengths = (40, 6, 60)
    records = [
        Record(rng.standard_normal(n), rng.standard_normal(n), 0.1, weights=rng.random((n, 1)))
        for n in lengths
    ]
    s = structure_class("arx").from_orders({"na": 4, "nb": 1, "nk": 1}, 1, 1)
    (problem,) = problems_of(s, records, Focus.PREDICTION)
    p = 0.1 * rng.standard_normal(5)
    plain, counted = problem.residual(p), weighted(problem, records).residual(p)
    # the first four samples of each record have no error of their own
    weights = np.concatenate([r.weights[4:, 0] for r in records if r.weights is not None])
    np.testing.assert_allclose(counted, np.sqrt(weights) * plain)


# ------------------------------------------------------------------ figures and criteria


def log(tmp_path: Path, name: str, u: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    path = tmp_path / f"{name}.csv"
    rows = np.column_stack([0.1 * np.arange(len(u)), u, y])
    np.savetxt(path, rows, delimiter=",", header="t,u,y", comments="", fmt="%.9g")
    return str(path)


@pytest.mark.parametrize("structure", ["arx", "oe"])
def test_figures_do_not_count_outliers(structure: str, tmp_path: Path, capsys: Capture) -> None:
    case = CASES[structure]
    made = {
        name: log(tmp_path, name, case.drive(k, 1000), case.record(k, kind).y[:, 0])
        for k, (name, kind) in enumerate(
            [("clean", "clean"), ("struck", "reading"), ("other", "reading")]
        )
    }
    orders = " ".join(f"{k}={v}" for k, v in case.orders.items())
    words = ("--structure", structure, "--orders", orders, "--detrend", "none", "--json")
    clean = run(capsys, "fit", made["clean"], *words, "--robust").document
    found = run(capsys, "fit", made["struck"], "--val", made["other"], *words, "--robust").document
    plain = run(capsys, "fit", made["struck"], "--val", made["other"], *words).document
    struck = [int(np.sum(study.Drawn.of(k, 1000).outliers != 0.0)) for k in (1, 2)]
    for part, count in zip(("estimation", "validation"), struck, strict=True):
        assert found[part]["left_out"] == pytest.approx(count, abs=2)
        assert found[part]["samples"] + found[part]["left_out"] == plain[part]["samples"]
        one = found[part]["one_step"]["fit_percent"]["y"]
        # the same plant and noise on other draws: one-step fits agree to a point
        assert one == pytest.approx(clean["estimation"]["one_step"]["fit_percent"]["y"], abs=1.0)
        assert one > plain[part]["one_step"]["fit_percent"]["y"] + 2.0
    assert any("of y were left out" in w for w in found["warnings"])
    assert any("validation" in w and "left out" in w for w in found["warnings"])
    # same number of samples; an outlier counts as an error at the threshold, not as ten times it
    gap = found["criteria"]["naic"] - clean["criteria"]["naic"]
    assert 0.0 < gap < 0.6
    assert plain["criteria"]["naic"] - clean["criteria"]["naic"] > gap + 0.3


@pytest.mark.slow
def test_networks_take_robust_on_the_command_line(tmp_path: Path, capsys: Capture) -> None:
    case = CASES["narx-wavelet"]
    r = case.record(0, "reading")
    path = log(tmp_path, "log", r.u[:, 0], r.y[:, 0])
    words = ("--structure", "narx-wavelet", "--orders", "na=1 nb=1 nk=1", "--robust", "--json")
    options = ("--option", "degree=1", "--option", "units=4", "--option", "refine=none")
    found = run(capsys, "fit", path, *words, *options).document
    assert found["estimation"]["left_out"] > 0


def test_two_disturbances_at_once_of_a_model_without_memory() -> None:
    """A reading that is felt at both outputs explains less than a disturbance of its own one."""
    errors = np.zeros((12, 2))
    errors[5] = [3.0, -3.0]
    felt = [np.array([[1.0, 0.8]]), np.array([[0.8, 1.0]])]
    found = explained(errors, [(5, 0), (5, 1)], felt)
    assert sorted((e.sample, e.output) for e in found) == [(5, 0), (5, 1)]
