"""AR, MA and ARMA: signals without inputs, against processes known exactly."""

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.criteria.information import information_criteria
from sysid.data.inspection import inspect_records
from sysid.data.record import Channel, Record
from sysid.errors import SysidError, UsageError
from sysid.estimation.identify import Request, identify
from sysid.estimation.pem import fit
from sysid.export.package import write_package
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

CASES = {
    "ar": ({"na": 2}, [1.0], [1.0, -1.5, 0.8]),
    "ma": ({"nc": 2}, [1.0, 0.6, 0.3], [1.0]),
    "arma": ({"na": 2, "nc": 1}, [1.0, 0.5], [1.0, -1.5, 0.8]),
}


def series(top: list[float], bottom: list[float], samples: int = 1500, seed: int = 0) -> Record:
    """A filtered white noise of variance one, as a log of one output and no input."""
    e = np.random.default_rng(seed).standard_normal(samples + 200)
    y = lfilter(top, bottom, e)[200:]
    return Record(np.zeros((samples, 0)), y, 0.1, (), (Channel("tilt", "rad"),))


@pytest.mark.parametrize("name", CASES)
def test_a_process_is_found_with_errors_as_large_as_they_say(name: str) -> None:
    """Over 30 seeds: squared deviations in standard errors average one (χ²₃₀/30 in .46 … 1.99)."""
    orders, top, bottom = CASES[name]
    structure = structure_class(name).from_orders(orders, 0, 1)
    truth = np.array([*bottom[1:], *top[1:]])
    scores = []
    for seed in range(30):
        model = fit(structure, [series(top, bottom, seed=seed)])
        table = model.parameter_table()
        scores.append([(p.value - t) / p.std_error for p, t in zip(table, truth, strict=True)])
        assert model.noise_covariance[0, 0] == pytest.approx(1.0, rel=0.15)  # √(2/1500) × 4
    spread = np.mean(np.square(scores), axis=0)
    assert np.all((spread > 0.46) & (spread < 1.99))


def test_the_right_kind_leads_without_being_named() -> None:
    found = identify([series(*CASES["arma"][1:])], [], Request())
    first = found.assessments[0]
    assert {a.model.structure.name for a in found.assessments} == {"ar", "ma", "arma"}
    assert first.model.structure.name == "arma"
    assert "one step ahead" in found.reason or "one-step" in found.reason
    assert "free" not in found.reason
    assert first.residuals.as_dict()["whiteness"]["passed"]


def test_the_fit_reaches_what_the_process_leaves_to_predict() -> None:
    record = series(*CASES["arma"][1:], samples=4000)
    (first, *_) = identify([record], [], Request(structures=("arma",))).assessments
    best = 100.0 * (1.0 - 1.0 / float(np.std(record.y)))
    assert first.judged.one_step.fit_percent["tilt"] == pytest.approx(best, abs=1.0)
    assert first.judged.free_run.horizon == 1


def test_a_saved_one_is_read_again_and_says_the_same() -> None:
    model = fit(
        structure_class("arma").from_orders({"na": 2, "nc": 1}, 0, 1), [series(*CASES["arma"][1:])]
    )
    again = Model.from_json(model.to_json())
    record = series(*CASES["arma"][1:], seed=9)
    assert np.array_equal(again.errors(record, 0), model.errors(record, 0), equal_nan=True)
    assert again.stable
    assert "y(t)" not in model.structure.equations(model.theta, (), model.outputs)[0]


def test_inputs_and_structures_must_agree() -> None:
    alone = series(*CASES["ar"][1:])
    driven = Record(np.sign(alone.y), alone.y, 0.1)
    with pytest.raises(UsageError, match="oe needs an input but the log has none"):
        identify([alone], [], Request(structures=("oe",)))
    with pytest.raises(UsageError, match="ar is for a log without inputs"):
        identify([driven], [], Request(structures=("ar",)))


def test_a_log_without_inputs_is_inspected(tmp_path) -> None:
    codes = {f.code for f in inspect_records([series(*CASES["ar"][1:])])}
    assert {"length", "missing", "stuck", "outliers"} <= codes
    assert not {"feedback", "delay", "excitation", "nonlinearity"} & codes


def test_no_plant_is_made_of_a_signal_without_inputs(tmp_path) -> None:
    model = fit(structure_class("ar").from_orders({"na": 2}, 0, 1), [series(*CASES["ar"][1:])])
    with pytest.raises(SysidError, match="has no input"):
        write_package(model, tmp_path / "plant")


def test_criteria_count_as_they_do_with_inputs() -> None:
    model = fit(structure_class("ar").from_orders({"na": 2}, 0, 1), [series(*CASES["ar"][1:])])
    errors = model.errors(series(*CASES["ar"][1:]), 0)
    assert model.criteria["aic"] == pytest.approx(information_criteria([errors], 2)["aic"])


@pytest.mark.parametrize(
    ("names", "options"),
    [
        (["tilt"], []),
        (["y"], []),
        (["y", "other"], ["--input", "none", "--output", "y"]),
        (["u", "y"], ["--input", "none", "--output", "y"]),
    ],
)
def test_a_file_without_inputs_is_fitted(
    names: list[str], options: list[str], tmp_path, capsys: Capture
) -> None:
    signal = series(*CASES["arma"][1:], samples=600).y[:, 0]
    log = write_log(tmp_path / "drift.csv", names, [signal] * len(names))
    place = ["--workspace", tmp_path / "ws"]
    assert run(capsys, "inspect", log, *options).code == 0
    out = run(capsys, "fit", log, *options, *place)
    assert out.code == 0, out.err
    assert "arma" in out.out
    assert run(capsys, "compare", "--criterion", "aic", *place).code == 0
    refused = run(capsys, "export", *place)
    assert refused.code == 1
    assert "has no input" in refused.err
    assert refused.err.count("\n") <= 2


def test_columns_that_nobody_can_tell_are_still_asked_for(tmp_path, capsys: Capture) -> None:
    signal = series(*CASES["arma"][1:], samples=300).y[:, 0]
    log = write_log(tmp_path / "two.csv", ["foo", "bar"], [signal, signal[::-1]])
    refused = run(capsys, "fit", log)
    assert refused.code == 1
    assert "can be foo or bar" in refused.err


def test_the_oscillation_of_a_signal_is_said(tmp_path, capsys: Capture) -> None:
    """Poles 0.75 ± 0.487i at 0.1 s: 5.909 rad/s = 0.940 Hz with damping 0.189."""
    record = series(*CASES["ar"][1:], samples=4000)
    log = write_log(tmp_path / "vibration.csv", ["tilt"], [record.y[:, 0]])
    place = ("--workspace", tmp_path / "ws")
    found = run(capsys, "fit", log, "--structure", "ar", "--orders", "na=2", *place)
    assert "oscillates at 0.9" in found.out
    assert "trace of u" not in found.out
    assert "sysid export" not in found.out
    assert " and  " not in found.out
    document = run(capsys, "fit", log, "--structure", "ar", *place, "--json").document
    (mode,) = [m for m in document["own_modes"] if m["frequency"]]
    for name, truth in (("frequency", 5.909), ("damping", 0.1888)):
        assert abs(mode[name]["value"] - truth) < 4.0 * mode[name]["std_error"] + 0.03 * truth


@pytest.mark.parametrize(
    ("unit", "word"),
    [
        ("±255", "count"),
        ("counts=2048/rev", "counts"),
        ("counts/2048", "counts"),
        ("counts/1024/s", "counts/s"),
        ("counts/s/2048", "counts/s"),
        ("ticks/360", "ticks"),
        ("counts/s", "counts/s"),
        ("rpm", "rpm"),
        ("", ""),
    ],
)
def test_a_unit_of_the_file_is_spoken_of_by_what_it_counts(unit: str, word: str) -> None:
    assert Channel("c", "rad", 0.1, unit).file_words == word


@pytest.mark.parametrize("name", ["ar", "ma", "arma"])
def test_a_signal_without_inputs_has_no_free_run_to_fit(name: str) -> None:
    y = np.random.default_rng(2).standard_normal((200, 1))
    structure = structure_class(name).from_orders(
        dict.fromkeys(structure_class(name).traits.order_names, 1), 0, 1
    )
    with pytest.raises(UsageError, match=r"no input.*prediction"):
        fit(structure, [Record(np.zeros((200, 0)), y, 0.1)], FitOptions(focus=Focus.SIMULATION))
