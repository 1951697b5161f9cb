"""Polynomial NARMAX: the laws every structure obeys, and its words."""

from pathlib import Path

import numpy as np
import pytest
from narmax_cases import ORDERS, TRUTH, fitted, names, record, structure

from sysid.data.preprocess import Detrend
from sysid.data.record import Channel, Record
from sysid.errors import DataError, ModelError, Termination, UsageError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.model import Model
from sysid.structures.narmax.problems import OneStep
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.registry import structure_class, structure_from_json, structure_to_json

# ------------------ laws


def test_a_saved_model_is_the_same_model(tmp_path: Path) -> None:
    r = record(300, process=0.05)
    model = fit(
        NARMAX.from_orders(ORDERS, 1, 1, {"noise_lags": "2", "degree": "2"}),
        [r],
        detrend=Detrend.means([r]),
    )
    model.save(tmp_path / "a.json")
    again = Model.load(tmp_path / "a.json")
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert again.structure == model.structure
    x0 = model.fitted_state(r, 20)
    np.testing.assert_array_equal(again.simulate(r.u, x0), model.simulate(r.u, x0))
    np.testing.assert_array_equal(again.predict(r, 5, 10), model.predict(r, 5, 10))


def test_damaged_settings_are_refused() -> None:
    raw = structure_to_json(structure())
    raw["settings"] = {**raw["settings"], "terms": [[[["z", 0, 1]]]]}
    with pytest.raises(ModelError, match="cannot be read"):
        structure_from_json(raw)


@pytest.mark.slow
@pytest.mark.parametrize("selection", ["err", "auto"])
def test_invariant_to_the_channels_scale(selection: str) -> None:
    r = record(300, process=0.05, seed=3)
    a, b = 1024.0, 0.125  # powers of two: rounding is the same
    scaled = Record(a * r.u, b * r.y, r.dt)
    one, other = (fitted(x, selection=selection, degree="2") for x in (r, scaled))
    assert one.structure.rows == other.structure.rows
    # the solvers' tolerances are relative but their paths are not bit for bit alike
    np.testing.assert_allclose(other.simulate(scaled.u), b * one.simulate(r.u), atol=1e-5)


@pytest.mark.slow
def test_the_same_answer_on_every_run() -> None:
    r = record(300, process=0.05)
    one, other = (fitted(r, degree="2") for _ in range(2))
    np.testing.assert_array_equal(one.theta, other.theta)


def test_fixed_and_bounded_coefficients_are_kept() -> None:
    r = record(800, process=0.05)
    options = FitOptions(fixed={"y(t-1)": 0.9}, bounds={"u(t-1)": (0.0, 0.4)})
    model = fit(structure(wide=False), [r], options)
    table = {p.name: p for p in model.parameter_table()}
    assert table["y(t-1)"].value == 0.9
    assert table["y(t-1)"].std_error == 0.0
    assert table["u(t-1)"].value == pytest.approx(0.4, abs=1e-5)
    assert "u(t-1)" in model.at_bound
    assert model.termination is Termination.AT_BOUND


def test_a_direction_without_information_is_named() -> None:
    r = record(400, process=0.05)
    both = Record(np.hstack([r.u, r.u]), r.y, r.dt)
    s = NARMAX.from_orders(ORDERS, 2, 1, {"terms": "y(t-1), u1(t-1), u2(t-1)", "selection": "err"})
    model = fit(s, [both])
    assert any(set(d) == {"u1(t-1)", "u2(t-1)"} for d in model.null_directions)
    table = {p.name: p.std_error for p in model.parameter_table()}
    assert np.isinf(table["u1(t-1)"])
    assert np.isfinite(table["y(t-1)"])


@pytest.mark.slow
def test_a_two_level_input_gets_no_powers() -> None:
    rng = np.random.default_rng(17)
    u = np.repeat(rng.choice([-1.0, 1.0], 300), 4)[:, None]
    y = np.zeros(len(u))
    for t in range(1, len(u)):
        y[t] = 0.8 * y[t - 1] + 0.2 * u[t - 1, 0] + 0.01 * rng.standard_normal()
    model = fitted(Record(u, y, 0.1), degree="3")
    assert not any("u(t-1)^" in n or "u(t-2)^" in n for n in names(model))


def test_robust_loss_shrugs_off_shocks() -> None:
    rng = np.random.default_rng(18)
    n = 1500
    shocks = np.where(rng.random(n) < 0.05, 4.0 * rng.standard_normal(n), 0.0)
    e, u, y = shocks + 0.05 * rng.standard_normal(n), rng.uniform(-1, 1, n), np.zeros(n)
    for t in range(2, n):
        y[t] = 0.5 * y[t - 1] + 0.5 * u[t - 1] + 0.2 * u[t - 1] * u[t - 2] + e[t]
    s = NARMAX.from_orders(
        ORDERS, 1, 1, {"terms": "y(t-1), u(t-1), u(t-1)*u(t-2)", "selection": "err"}
    )
    truth = {"y(t-1)": 0.5, "u(t-1)": 0.5, "u(t-1)*u(t-2)": 0.2}
    worst = []
    for robust in (False, True):
        model = fit(s, [Record(u[:, None], y[:, None], 0.1)], FitOptions(robust=robust))
        table = zip(model.parameters, model.theta, strict=True)
        worst.append(max(abs(v - truth[p.name]) for p, v in table))
    # Huber's loss bounds what one shock in twenty can do
    assert worst[1] < 0.3 * worst[0]


# ------------------ words


def test_the_equation_reads_like_one() -> None:
    (line,) = structure().equations(TRUTH, [Channel("u")], [Channel("y")])
    assert line == (
        "y(t) = 0.9·y(t−1) - 0.3·y(t−2) + 0.5·u(t−1) - 0.2·y(t−2)²·u(t−1) + 0.1·u(t−2)³ + e(t)"
    )


def test_properties_tell_the_terms_their_ratios_and_the_limits() -> None:
    model = fitted(record(800, process=0.05), selection="err")
    facts = model.structure.properties(model.theta, model.dt)
    ratios = [t["err_percent"] for t in facts["terms"]]
    assert sum(ratios) == pytest.approx(100.0, abs=10.0)
    assert max(ratios) == ratios[0]
    assert len(facts["free_run_limits"]) == 1
    assert "kept inside" in facts["note"]


def test_units_of_the_coefficients() -> None:
    s = NARMAX.from_orders({"na": 1, "nb": 1}, 1, 1, {"terms": "y(t-1),u(t-1)*y(t-1),u(t-1)^2"})
    found = s.parameters([Channel("pwm", "V")], [Channel("w", "rad/s")])
    assert [p.unit for p in found] == ["", "1/V", "(rad/s)/(V·V)"]


BAD = [
    ({"degree": "0"}, "degree"),
    ({"degree": "x"}, "degree"),
    ({"terms": "y(t)"}, "lag it"),
    ({"terms": "y(t-1"}, "cannot read"),
    ({"terms": "y(t-1),y(t-1)"}, "each once"),
    ({"terms": "e(t-1)"}, "without e"),
    ({"terms": "y(t-1),e(t-1)*e(t-2)"}, "at most one"),
    ({"terms": "y(t-3)"}, "outside na"),
    ({"terms": "u2(t-1)"}, "not there"),
    ({"terms": "y(t-1)^9"}, "at most"),
    ({"terms": "y(t-1);y(t-1)"}, "outputs"),
    ({"noise_lags": "-1"}, "noise_lags"),
    ({"selection": "best"}, "choose one of"),
    ({"margin": "nan"}, "share"),
    ({"units": "3"}, "no option"),
]


@pytest.mark.parametrize(("options", "says"), BAD)
def test_bad_options_get_one_clear_sentence(options: dict[str, str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        NARMAX.from_orders(ORDERS, 1, 1, options)


def test_bad_orders_and_pools_beyond_all_bounds_are_refused() -> None:
    cls = structure_class("narmax")
    with pytest.raises(UsageError, match="no order 'nc'"):
        cls.from_orders({**ORDERS, "nc": 1}, 1, 1)
    with pytest.raises(UsageError, match="candidate terms"):
        cls.from_orders({"na": 30, "nb": 30}, 1, 1, {"degree": "3"})


def test_what_cannot_be_fitted_is_said() -> None:
    with pytest.raises(UsageError, match="give the terms"):
        fit(NARMAX.from_orders(ORDERS, 1, 1), [record(300)], FitOptions(fixed={"y(t-1)": 0.5}))
    with pytest.raises(DataError, match="samples"):
        fit(NARMAX.from_orders(ORDERS, 1, 1), [record(40)])


def test_an_unnecessary_noise_model_is_reported() -> None:
    model = fit(
        structure(wide=False, selection="err", noise_lags="1"), [record(2000, process=0.1, seed=2)]
    )
    assert any("white already" in w for w in model.warnings)
    assert "e(t-1)" not in names(model)


def test_one_step_reports_divergence_of_its_recursion() -> None:
    u, y = np.ones((200, 1)), np.random.default_rng(1).standard_normal((200, 1))
    s = NARMAX.from_orders(ORDERS, 1, 1, {"terms": "y(t-1), e(t-1)"})
    problem = OneStep(s.rows[0], 0, 0, [(u, y)], 1)
    e = problem.residual(np.array([0.5, 5.0]))
    assert np.all(np.isfinite(e))
    assert np.min(np.abs(e)) > 1e50
