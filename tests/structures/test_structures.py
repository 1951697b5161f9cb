"""Every polynomial structure crossed with every law that all of them obey."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polynomial_cases import SYSTEMS
from problem_cases import problems_of
from scipy.signal import lfilter
from structure_cases import every_system, fitted

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError, UsageError
from sysid.estimation.pem import fit
from sysid.fitting.problem import Focus, Initial, Problem
from sysid.structures.linear.families import ARX
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.predictor import HUGE
from sysid.structures.model import Model
from sysid.structures.orders import MAX_ORDER, parse_orders, spread
from sysid.structures.registry import (
    require_readable,
    structure_class,
    structure_classes,
    structure_from_json,
    structure_to_json,
)

every_focus = pytest.mark.parametrize("focus", list(Focus))

# ------------------ gradients


@every_system
@every_focus
@pytest.mark.parametrize("stable", [False, True])
def test_gradients_are_those_of_central_differences(name: str, focus: Focus, stable: bool) -> None:
    system = SYSTEMS[name]
    first, second = system.record(70, 0.5, seed=1, skip=20), system.record(45, 0.5, seed=2)
    rng = np.random.default_rng(3)
    theta = 0.9 * system.truth + 0.02 * rng.standard_normal(len(system.theta))
    found = problems_of(system.model_structure, [first, second], focus, Initial.ESTIMATED, stable)
    for unsolved in found:
        problem = unsolved.given(theta)
        p = problem.initial_guess(theta)
        p[len(problem.index) :] += 0.3 * rng.standard_normal(problem.n_initial)
        assert np.max(np.abs(problem.residual(p))) < 1e3, "the point must be admissible"
        numerical = central_differences(problem, p)
        # second differences of a filter's output are below 1e2, the step is 1e-5: error 1e-8
        assert problem.jacobian(p) == pytest.approx(numerical, rel=1e-6, abs=1e-6)


def central_differences(problem: Problem, p: Array, step: float = 1e-5) -> Array:
    columns = []
    for k in range(len(p)):
        d = np.zeros(len(p))
        d[k] = step
        columns.append((problem.residual(p + d) - problem.residual(p - d)) / (2 * step))
    return np.array(columns).T


@every_system
def test_gradient_of_the_prediction_is_that_of_the_errors(name: str) -> None:
    system = SYSTEMS[name]
    record, structure = system.record(60, 0.5), system.model_structure
    for i in range(system.ny):
        columns = structure.gradients(system.truth, record.u, record.y)[i]
        for k in range(len(system.theta)):
            d = np.zeros(len(system.theta))
            d[k] = 1e-5
            change = [
                structure.errors(system.truth + s * d, record.u, record.y, 0)[:, i]
                for s in (1.0, -1.0)
            ]
            numerical = np.nan_to_num((change[1] - change[0]) / 2e-5)
            assert columns[:, k] == pytest.approx(numerical, rel=1e-6, abs=1e-6)


# ------------------ the truth comes back


@every_system
def test_recovers_its_own_truth_without_noise(name: str) -> None:
    system = SYSTEMS[name]
    structure = system.model_structure
    model = fitted(system, system.record(400))
    # C and D say nothing where there is no noise; an ARX model obeys the data exactly
    known = structure.deterministic_index()
    assert model.theta[known] == pytest.approx(system.truth[known], abs=1e-6)


@every_system
def test_recovers_its_own_truth_in_noise(name: str) -> None:
    system = SYSTEMS[name]
    model = fitted(system, system.record(3000, 0.2, seed=7, skip=50))
    z = (model.theta - system.truth) / np.sqrt(np.diag(model.covariance))
    # 4.5 standard errors: 1e-5 a parameter, 1e-3 for all parameters of all systems together
    assert np.max(np.abs(z)) < 4.5
    assert model.termination.good


@pytest.mark.parametrize("name", [n for n in SYSTEMS if not n.startswith("oe")])
def test_simulation_focus_recovers_the_truth_too(name: str) -> None:
    system = SYSTEMS[name]
    structure = system.model_structure
    model = fitted(system, system.record(600, 1e-4, seed=7), focus=Focus.SIMULATION)
    known = structure.deterministic_index()
    # noise of 1e-4 leaves standard errors of some 1e-5
    assert model.theta[known] == pytest.approx(system.truth[known], abs=1e-3)


# ------------------ save and load


@every_system
def test_a_saved_model_is_the_same_model(name: str, tmp_path: Path) -> None:
    system = SYSTEMS[name]
    record = system.record(200, 0.3, seed=5, skip=30)
    model = fit(system.model_structure, [record], detrend=Detrend.means([record]))
    model.save(tmp_path / "a.json")
    again = Model.load(tmp_path / "a.json")
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    x0 = model.fitted_state(record, 20)
    np.testing.assert_array_equal(again.fitted_state(record, 20), x0)
    np.testing.assert_array_equal(again.simulate(record.u, x0), model.simulate(record.u, x0))
    np.testing.assert_array_equal(again.predict(record, 5, 10), model.predict(record, 5, 10))
    np.testing.assert_array_equal(again.covariance, model.covariance)
    assert again.parameter_table() == model.parameter_table()
    assert again.criteria == model.criteria
    assert again.termination is model.termination
    assert structure_from_json(structure_to_json(model.structure)) == model.structure


def test_infinite_variance_and_unsearched_starts_survive_saving(tmp_path: Path) -> None:
    one = SYSTEMS["arx"].record(200, 0.1)
    both = Record(np.hstack([one.u, one.u]), one.y, one.dt)
    model = fit(structure_class("arx").from_orders({"na": 2, "nb": 2}, 2, 1), [both])
    model.save(tmp_path / "m.json")
    again = Model.load(tmp_path / "m.json")
    np.testing.assert_array_equal(np.isinf(again.covariance), np.isinf(model.covariance))
    assert again.null_directions == model.null_directions
    assert again.starts == model.starts


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[: len(text) // 2],
        lambda text: "[1, 2]",
        lambda text: text.replace("sysid-model/1", "sysid-model/0"),
        lambda text: text.replace('"b1"', '"b7"'),
        lambda text: text.replace('"structure": "arx"', '"structure": "mystery"'),
        lambda text: text.replace('"covariance"', '"variance"'),
        lambda text: text.replace("closed-form", "by-magic"),
    ],
)
def test_a_damaged_model_file_is_refused_in_one_sentence(damage: object, tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    fitted(SYSTEMS["arx"], SYSTEMS["arx"].record(100, 0.1)).save(path)
    path.write_text(damage(path.read_text()))  # type: ignore[operator]
    with pytest.raises(ModelError) as caught:
        Model.load(path)
    assert "\n" not in str(caught.value)


# ------------------ units


@every_system
@pytest.mark.parametrize(("s", "t"), [(1e-9, 1e9), (1e9, 1e-9), (1e9, 1e9)])
def test_units_of_the_channels_do_not_matter(name: str, s: float, t: float) -> None:
    """y·s and u·t scale b by s/t and leave poles, noise model, fit and standard errors alone."""
    system = SYSTEMS[name]
    record = system.record(300, 0.3, seed=11, skip=40)
    plain = fitted(system, record)
    scaled = fitted(system, Record(record.u * t, record.y * s, record.dt))
    gain = np.array([s / t if p.name.startswith("b") else 1.0 for p in plain.parameters])
    # the search ends within 1e-9 of the cost, that is some 1e-5 standard errors of the minimum
    errors = np.sqrt(np.diag(plain.covariance))
    assert np.max(np.abs(scaled.theta / gain - plain.theta) / errors) < 1e-3
    assert np.sqrt(np.diag(scaled.covariance)) / gain == pytest.approx(errors, rel=1e-3)
    assert scaled.criteria["fpe"] == pytest.approx(
        plain.criteria["fpe"] * s ** (2 * system.ny), rel=1e-6
    )
    assert scaled.criteria["aic"] - plain.criteria["aic"] == pytest.approx(
        2 * system.ny * np.log(s) * predicted(plain, record), rel=1e-6
    )
    x0, x1 = plain.fitted_state(record, 30), scaled.fitted_state(record_times(record, t, s), 30)
    run = scaled.simulate(record.u * t, x1) / s
    assert run == pytest.approx(plain.simulate(record.u, x0), rel=1e-4, abs=1e-4)


def record_times(record: Record, t: float, s: float) -> Record:
    return Record(record.u * t, record.y * s, record.dt)


def predicted(model: Model, record: Record) -> int:
    return int(np.sum(np.all(np.isfinite(model.errors(record, 0)), axis=1)))


# ------------------ inadmissible parameters


def test_a_search_admits_only_stable_predictors() -> None:
    system = SYSTEMS["bj"]
    record, structure = system.record(100, 0.2), system.model_structure
    (problem,) = problems_of(structure, [record], Focus.PREDICTION)
    names = [p.name for p in structure.parameters(record.inputs, record.outputs)]
    mirrored = system.truth
    mirrored[names.index("c1")] = 1.0 / 0.5
    assert np.all(problem.residual(mirrored) == HUGE)
    growing = system.truth
    growing[names.index("f1")], growing[names.index("f2")] = -1.03, 0.0
    assert np.all(problem.residual(growing) == HUGE)
    # an integrator is a plant one meets
    integrating = system.truth
    integrating[names.index("f1")], integrating[names.index("f2")] = -1.0, 0.0
    assert np.all(np.abs(problem.residual(integrating)) < 1e3)
    # and a given model is evaluated as it is
    assert np.nanmax(np.abs(structure.errors(mirrored, record.u, record.y, 0))) > 10.0


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.floats(-0.98, 0.98), min_size=0, max_size=6))
def test_admissible_noise_filters_are_those_with_roots_inside(roots: list[float]) -> None:
    from sysid.structures.linear.predictor import roots_inside

    tail = np.poly(roots)[1:] if roots else np.zeros(0)
    assert roots_inside(np.asarray(tail))
    outside = np.poly([*roots, 1.05])[1:]
    assert not roots_inside(np.asarray(outside))
    assert roots_inside(np.asarray(outside), radius=1.06)


# ------------------ orders and names


@pytest.mark.parametrize(
    ("text", "orders"),
    [
        ("na=2 nb=2 nk=1", {"na": 2, "nb": 2, "nk": 1}),
        ("na=1,0;0,1 nb=2", {"na": [[1, 0], [0, 1]], "nb": 2}),
        ("  nb=3,1 \t nk=0 ", {"nb": [[3, 1]], "nk": 0}),
    ],
)
def test_orders_are_read(text: str, orders: object) -> None:
    assert parse_orders(text) == orders


@pytest.mark.parametrize(
    "text",
    [
        "",
        "2 2 1",
        "na",
        "na=",
        "=2",
        "na=two",
        "na=1.5",
        "na=-1",
        f"na={MAX_ORDER + 1}",
        "na=1,2;3",
        "na=1 na=2",
        "na=1,,2",
        "na=1;",
        "na=99999999999999999999",
    ],
)
def test_malformed_orders_are_refused_in_one_sentence(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_orders(text)
    assert "`orders`" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("structure", "raw", "word"),
    [
        ("arx", {"na": 2}, "needs nb"),
        ("arx", {"na": 2, "nb": 2, "nc": 1}, "no order 'nc'"),
        ("oe", {"na": 2, "nb": 2, "nf": 1}, "no order 'na'"),
        ("arx", {"na": 2, "nb": 0}, "no input"),
        ("arx", {"na": [[1, 0]], "nb": 2}, "2x2"),
        ("arx", {"na": 1, "nb": [[1], [1]]}, "2x3"),
        ("armax", {"na": 1, "nb": 1, "nc": [[1, 2, 3]]}, "2 numbers"),
        ("bj", {"nb": 1, "nc": 1, "nd": 1, "nf": 1, "nk": [[1, 2], [1, 2]]}, "2x3"),
        ("arx", {"na": True, "nb": 1}, "whole numbers"),
        ("arx", {"na": -1, "nb": 1}, "from 0"),
        ("arx", {"na": 1, "nb": MAX_ORDER + 1}, "from 0"),
        ("arx", {"na": 1.0, "nb": 1}, "whole numbers"),
        ("arx", {"na": "2", "nb": 1}, "whole numbers"),
        ("arx", {"na": None, "nb": 1}, "whole numbers"),
    ],
)
def test_orders_that_do_not_fit_are_refused(structure: str, raw: dict, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        structure_class(structure).from_orders(raw, 3, 2)


def test_scalar_orders_spread_over_the_channels() -> None:
    orders = spread({"na": 2, "nb": 3, "nc": 1}, "abc", nu=2, ny=2, structure="armax")
    assert orders.na == ((2, 0), (0, 2))
    assert orders.nb == ((3, 3), (3, 3))
    assert orders.nc == (1, 1)
    assert orders.nk == ((1, 1), (1, 1))


@every_system
def test_orders_come_back_as_they_were_given(name: str) -> None:
    structure = SYSTEMS[name].model_structure
    again = type(structure).from_orders(structure.order_values(), structure.nu, structure.ny)
    assert again == structure


@every_system
def test_every_parameter_has_a_name_and_a_place(name: str) -> None:
    system = SYSTEMS[name]
    record = system.record(20)
    names = [p.name for p in system.model_structure.parameters(record.inputs, record.outputs)]
    assert len(names) == len(set(names)) == len(system.theta)
    assert set(names) == set(NAMES[name].split())
    rows = [system.model_structure.row_index(i) for i in range(system.ny)]
    assert np.concatenate(rows).tolist() == list(range(len(names)))


NAMES = {
    "arx": "a1 a2 b1 b2",
    "arx nk=0": "a1 a2 b0 b1",
    "arx MISO, mixed orders": "a1[y,y] a2[y,y] b0[y,u1] b1[y,u1] b3[y,u2]",
    "arx MIMO, coupled": "a1[y1,y1] a1[y1,y2] b1[y1,u1] b0[y1,u2] b1[y1,u2] "
    "a1[y2,y2] a2[y2,y2] b2[y2,u1] b3[y2,u1]",
    "armax": "a1 a2 b1 b2 c1 c2",
    "armax nk=0": "a1 b0 c1",
    "armax MISO, mixed orders": "a1[y,y] a2[y,y] b2[y,u1] b0[y,u2] b1[y,u2] c1[y]",
    "armax MIMO, coupled": "a1[y1,y1] a1[y1,y2] b1[y1,u1] b1[y1,u2] c1[y1] "
    "a1[y2,y1] a1[y2,y2] b1[y2,u1] b1[y2,u2] c1[y2] c2[y2]",
    "oe": "b1 b2 f1 f2",
    "oe nk=0": "b0 f1",
    "oe MISO, mixed orders": "b1[y,u1] b2[y,u1] b3[y,u2] b4[y,u2] f1[y,u1] f2[y,u1]",
    "oe MIMO": "b1[y1,u1] b0[y1,u2] b1[y1,u2] f1[y1,u1] f2[y1,u1] f1[y1,u2] "
    "b2[y2,u1] b1[y2,u2] f1[y2,u1] f1[y2,u2] f2[y2,u2]",
    "bj": "b1 b2 c1 d1 f1 f2",
    "bj nk=0": "b0 d1 d2 f1",
    "bj MISO, mixed orders": "b1[y,u1] b2[y,u1] b2[y,u2] c1[y] c2[y] f1[y,u1] f1[y,u2] f2[y,u2]",
    "bj MIMO": "b1[y1,u1] b1[y1,u2] c1[y1] d1[y1] f1[y1,u1] "
    "b1[y2,u1] b1[y2,u2] d1[y2] d2[y2] f1[y2,u1] f1[y2,u2]",
}


def test_units_of_the_parameters_follow_from_the_channels() -> None:
    structure = structure_class("arx").from_orders({"na": 1, "nb": 1}, 1, 1)
    a, b = structure.parameters([Channel("pwm", "us")], [Channel("omega", "rad/s")])
    assert (a.unit, b.unit) == ("", "(rad/s)/us")


def test_the_equation_is_written_as_a_person_would() -> None:
    system = SYSTEMS["bj"]
    record = system.record(10)
    assert system.model_structure.equations(system.truth, record.inputs, record.outputs) == (
        "y = (1 q^-1 + 0.5 q^-2)/(1 - 1.5 q^-1 + 0.7 q^-2)·u + (1 + 0.5 q^-1)/(1 - 0.9 q^-1)·e",
    )


def test_every_structure_says_what_it_is_and_when_to_use_it() -> None:
    for name, found in structure_classes().items():
        assert found.name == name
        assert found.traits.title
        assert found.traits.when
        assert found.traits.equation
    with pytest.raises(UsageError, match="choose one of"):
        structure_class("arxx")
    assert structure_class("ARMAX").name == "armax"
    assert issubclass(structure_class("bj"), PolynomialStructure)


class Forgetful(ARX):
    """A structure of another package whose settings are not read back."""

    def settings(self) -> dict[str, object]:
        return {"pole": 0.7}


def test_a_structure_that_is_not_read_back_as_written_is_not_saved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else a saved model would be another one, without a word."""
    structure = Forgetful.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    monkeypatch.setattr(Forgetful, "__module__", "laboratory")
    with pytest.raises(ModelError, match="arx is not read back as it is written"):
        require_readable(structure)
    require_readable(ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1))


def test_a_model_takes_a_log_that_states_no_unit_and_none_of_another_unit() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((60, 1))
    y = lfilter([0.0, 0.2], [1.0, -0.8], u, axis=0) + 0.01 * rng.standard_normal((60, 1))
    log = Record(u, y, 0.1, (Channel("u", "V"),), (Channel("y"),))
    model = fit(ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1), [log])
    model.check(replace(log, inputs=(Channel("u"),)))
    with pytest.raises(ModelError, match="u is in m in record, in V in the model"):
        model.check(replace(log, inputs=(Channel("u", "m"),)))
