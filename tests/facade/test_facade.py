"""``import sysid``: quick, complete, and the same answers as the modules below it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import dlsim
from sysid_datasets import path

import sysid

A, B = -0.8, 0.5


def first_order(samples: int = 400, noise: float = 0.01) -> sysid.Record:
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((samples, 1)), np.zeros((samples, 1))
    for t in range(1, samples):
        y[t] = -A * y[t - 1] + B * u[t - 1]
    y += noise * rng.standard_normal(y.shape)
    return sysid.Record(
        u, y, dt=0.1, inputs=(sysid.Channel("u", "V"),), outputs=(sysid.Channel("y", "rad/s"),)
    )


def oe(record: sysid.Record) -> sysid.Model:
    return sysid.fit(record, "oe", orders="nb=1 nf=1 nk=1", detrend="none")


def test_importing_it_imports_no_library() -> None:
    script = (
        "import sys, sysid; sysid.__version__; dir(sysid)\n"
        "print([m for m in ('numpy', 'scipy', 'pandas', 'jax') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("name", sysid.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(sysid, name) is not None


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'ftt'"):
        sysid.ftt  # noqa: B018


def test_a_fit_by_name_is_the_fit_of_the_structure() -> None:
    record = first_order()
    structure = sysid.structure(record, "oe", {"nb": 1, "nf": 1, "nk": 1})
    by_structure = sysid.fit([record], structure, detrend="none")
    np.testing.assert_array_equal(oe(record).theta, by_structure.theta)
    # five standard errors of an output error model with noise .01 on 400 samples
    np.testing.assert_allclose(oe(record).theta, [B, A], atol=5e-3)


def test_orders_are_searched_where_none_are_given() -> None:
    record = first_order()
    assert sysid.fit(record, "arx").structure.name == "arx"


def test_what_a_linear_model_says_of_itself() -> None:
    model = oe(first_order())
    b, f = model.theta
    np.testing.assert_allclose(model.poles(), [-f])
    w, response = model.bode(np.array([0.0, 3.0]))
    z = np.exp(1j * w * model.dt)
    np.testing.assert_allclose(response[:, 0, 0], b / (z + f), rtol=1e-12)
    t, y = model.step_response(50, size=2.0)
    np.testing.assert_allclose(y[:, 0], 2.0 * b * (1 - (-f) ** np.arange(50)) / (1 + f), atol=1e-12)
    assert t[1] == model.dt


@pytest.mark.parametrize("name", ["oe", "ss"])
def test_zeros_are_those_of_python_control(name: str) -> None:
    control = pytest.importorskip("control")
    model = sysid.fit(first_order(), name, "nb=2 nf=2 nk=1" if name == "oe" else "n=2")
    zeros = model.zeros()
    assert len(zeros) == 1
    np.testing.assert_allclose(control.zeros(model.to_control()), zeros, rtol=1e-6, atol=1e-9)


def test_one_input_is_simulated_as_a_series() -> None:
    record = first_order()
    model = oe(record)
    np.testing.assert_array_equal(model.simulate(record.u[:, 0]), model.simulate(record.u))
    np.testing.assert_array_equal(model.simulate([0, 1]), model.simulate(np.array([[0.0], [1.0]])))  # type: ignore[arg-type]


def test_the_state_space_of_others_runs_alike() -> None:
    control = pytest.importorskip("control")
    record = first_order()
    model = oe(record)
    ours = model.simulate(record.u)[:, 0]
    np.testing.assert_allclose(dlsim(model.to_scipy(), record.u)[1][:, 0], ours, atol=1e-12)
    theirs = control.forced_response(model.to_control(), inputs=record.u[:, 0]).outputs
    np.testing.assert_allclose(np.squeeze(theirs), ours, atol=1e-12)


def test_residuals_and_predictions_belong_together() -> None:
    record = first_order()
    model = oe(record)
    errors, predicted = model.residuals(record), model.predict(record)
    # how either begins is its own affair; after 100 samples 0.8^100 = 2e-10 of it is left
    np.testing.assert_allclose((record.y - predicted)[100:], errors[100:], atol=1e-9)


def test_a_nonlinear_model_has_no_poles() -> None:
    record = first_order(200)
    model = sysid.fit(
        record,
        "narmax",
        options=sysid.FitOptions(structure_options={"terms": "y1(t-1), u1(t-1)"}),
        orders="na=1 nb=1 nk=1",
    )
    with pytest.raises(sysid.ModelError, match="narmax is not linear and has no poles"):
        model.poles()


def test_from_a_log_to_a_mission(tmp_path: Path) -> None:
    record = sysid.read_log(path("prbs.csv"))
    assert all(finding.text for finding in sysid.inspect(record))
    found = sysid.identify(record, structures=["arx"], orders="na=1 nb=1 nk=1")
    model = found.assessments[0].model
    model.save(tmp_path / "m.json")
    assert sysid.load_model(tmp_path / "m.json").to_json() == model.to_json()
    package = sysid.write_package(model, tmp_path / "plant")
    np.testing.assert_array_equal(sysid.load_model(package).theta, model.theta)
    other = sysid.read_log(path("prbs_val.csv"))
    ranking = sysid.compare(other, {"arx": model, "again": model})
    assert ranking.best.contender.id in ("arx", "again")
    result = sysid.simulate(sysid.Mission(goal=(1.0, 0.0)), sysid.load_plant(package))
    assert result.summary() == sysid.simulate(sysid.Mission(goal=(1.0, 0.0)), model).summary()


def test_a_mission_is_planned_and_a_log_of_its_sensors_estimated(tmp_path: Path) -> None:
    mission = sysid.Mission(goal=(1.0, 0.0))
    assert sysid.plan(mission).arrives
    file = tmp_path / "m.yaml"
    file.write_text("goal: [1, 0]\n")
    assert sysid.plan(file).length_m == sysid.plan(mission).length_m
    log = tmp_path / "log.csv"
    log.write_text("t,omega_l,omega_r\n" + "".join(f"{0.1 * k:g},1,1\n" for k in range(11)))
    found = sysid.localize(log, mission)
    # 1 rad/s at r = 0.0215 m for 1 s, on the straight.
    assert found.columns["x_est"][-1] == pytest.approx(0.0215, rel=1e-6)
    assert found.columns["y_est"][-1] == pytest.approx(0.0, abs=1e-12)


def test_a_mission_is_driven_many_times() -> None:
    from mission_cases import Robot

    mission = sysid.Mission.model_validate({"goal": (0.5, 0.0), "vary": {"start": {"x": 0.02}}})
    found = sysid.simulate_runs(mission, Robot(), 20, seed=1)  # type: ignore[arg-type]
    assert sum(o.count for o in found.outcomes.values()) == 20
    again = sysid.simulate_runs(mission, Robot(), 20, seed=1)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.time_s, again.time_s)


def test_a_log_is_given_as_it_comes(tmp_path: Path) -> None:
    """A record, its table, or the file of it: the same samples, the same model."""
    record = first_order(200)
    frame = record.to_frame()
    assert list(frame.columns) == ["u", "y"]
    assert frame.index.name == "t"
    file = tmp_path / "log.csv"
    frame.to_csv(file)
    read = sysid.from_dataframe(frame, inputs="u", outputs="y")
    np.testing.assert_allclose(read.y, record.y, atol=1e-12)
    by_keyword = sysid.read_log(file, inputs="u", outputs="y")
    np.testing.assert_array_equal(by_keyword.u, read.u)
    models = [
        sysid.fit(log, "arx", "na=1 nb=1 nk=1", detrend="none") for log in (record, frame, file)
    ]
    for model in models[1:]:
        np.testing.assert_allclose(model.theta, models[0].theta, rtol=1e-9)
    with pytest.raises(sysid.UsageError, match="not both"):
        sysid.read_log(file, sysid.ReadOptions(), inputs="u")


def test_a_model_shows_itself() -> None:
    record = first_order()
    model = oe(record)
    assert repr(model) == "<Model oe nb=1 nf=1 nk=1: u → y, 0.1 s, 2 parameters>"
    text = model.summary()
    b = next(line for line in text.splitlines() if line.startswith("b1 "))
    low, high = (model.theta[0] + k * 1.96 * np.sqrt(model.covariance[0, 0]) for k in (-1, 1))
    assert f"{low:.6g} to {high:.6g}" in b
    assert model._repr_html_().count("<table>") == 2
    (fit,) = model.fit_percent(record).values()
    # the noise of .01 beside the spread of y
    assert fit == pytest.approx(100.0 * (1.0 - 0.01 / np.std(record.y)), abs=0.1)
    np.testing.assert_array_equal(model.simulate(record), model.simulate(record.u))


def test_responses_have_standard_errors_and_pictures() -> None:
    record = first_order()
    model = oe(record)
    (step,) = sysid.step_response(model, seconds=2.0)
    _, y = model.step_response(21)
    np.testing.assert_allclose(step.y, y[:, 0], atol=1e-12)
    assert (step.error[1:] > 0.0).all()
    (bode,) = sysid.frequency_response(model, np.array([1.0, 3.0]))
    assert bode.gain_error.shape == (2,)
    figure = model.plot.bode(record)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["u → y: gain", "u → y: phase"]
    assert "step" in dir(model.plot)
    with pytest.raises(AttributeError, match="no plot 'sky'"):
        model.plot.sky()
    assert set(dir(sysid)) == set(sysid.__all__)


def test_channels_without_units_are_given_by_their_names() -> None:
    u = np.linspace(0.0, 1.0, 50)
    record = sysid.Record(u, 2.0 * u, 0.1, ["heater"], ["oven"])  # type: ignore[arg-type]
    assert record.input_names == ("heater",)
    assert record.outputs == (sysid.Channel("oven"),)


def test_a_type_of_process_that_was_asked_for_is_said_to_be_given() -> None:
    u = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 60), 5)
    y = np.convolve(u, 0.2 * 0.8 ** np.arange(60))[: len(u)]
    record = sysid.Record(u, np.roll(y, 1), 0.1)
    asked = sysid.FitOptions(structure_options={"type": "P1"})
    found = sysid.identify(record, structures=["process"], options=asked)
    assert "with the orders given" in found.reason
