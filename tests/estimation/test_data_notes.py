"""What inspect has proven is said again by a fit, to the models that it matters to."""

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.data.checks.dynamics_checks import check_delay
from sysid.data.checks.signal_checks import check_levels, visited_levels
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity
from sysid.data.record import Record
from sysid.estimation.assessment.advice import notes_for
from sysid.structures.registry import structure_class


def heater(levels: np.ndarray, samples: int = 1200, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A first-order plant behind a dead zone of 0.2, under random levels held for 8 samples."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(levels, samples // 8 + 1), 8)[:samples]
    v = np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)
    return u, lfilter([0.0, 0.3], [1.0, -0.8], v) + 0.002 * rng.standard_normal(samples)


@pytest.mark.parametrize(
    ("levels", "seen"),
    [
        ([0.0, 1.0], [0.0, 1.0]),
        ([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]),
        (np.linspace(-1.0, 1.0, 9), None),
    ],
)
def test_levels_are_counted(levels: list[float], seen: list[float] | None) -> None:
    u, y = heater(np.array(levels))
    (finding,) = check_levels(LogFacts((Record(u, y, 0.1),)))
    if seen is None:
        assert finding.severity is Severity.OK
    else:
        assert visited_levels(u) == pytest.approx(seen, abs=1e-5)
        assert f"{len(seen)} levels" in finding.sentence


def test_a_signal_that_is_no_grid_has_no_levels() -> None:
    assert not len(visited_levels(np.random.default_rng(0).standard_normal(500)))
    assert not len(visited_levels(np.ones(10)))


def test_each_kind_of_model_is_told_what_matters_to_it() -> None:
    findings = (
        Finding("missing", Severity.WARNING, "Lines are missing."),
        Finding("nonlinearity", Severity.NOTE, "It bends."),
        Finding("levels", Severity.NOTE, "Two levels."),
        Finding("levels", Severity.OK, "Enough levels."),
        Finding("length", Severity.NOTE, "Short."),
    )
    linear = structure_class("oe").from_orders({"nb": 1, "nf": 1}, 1, 1)
    bent = structure_class("hammerstein-wiener").from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 1)
    assert notes_for(linear, findings) == ("Lines are missing.", "It bends.")
    assert notes_for(bent, findings) == ("Lines are missing.", "Two levels.")


def test_a_linear_fit_to_a_bent_plant_says_that_it_is_bent(tmp_path, capsys: Capture) -> None:
    u, y = heater(np.linspace(-1.0, 1.0, 21))
    log = write_log(tmp_path / "oven.csv", ["u", "y"], [u, y])
    options = ("--structure", "arx", "--workspace", tmp_path / "ws")
    warnings = run(capsys, "fit", log, *options, "--json").document["warnings"]
    assert any("Nonlinear response" in w for w in warnings)


def test_a_state_is_never_said_to_come_from_more_samples_than_there_are(
    tmp_path, capsys: Capture
) -> None:
    """A slow mode asks for a long head; a log of 610 samples has 610."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.standard_normal(61), 10)
    y = lfilter([0.0, 1.0], [1.0, -0.99999], u)
    log = write_log(tmp_path / "slow.csv", ["u", "y"], [u, y])
    options = ("--structure", "oe", "--orders", "nb=1 nf=1 nk=1", "--workspace", tmp_path / "ws")
    figures = run(capsys, "fit", log, *options, "--json").document["estimation"]
    assert figures["initial_state"] == "estimated from all 610 samples"


@pytest.mark.parametrize("kind", ["white", "drifting"])
def test_an_input_without_effect_is_named_by_inspect_and_by_fit(
    kind: str, tmp_path, capsys: Capture
) -> None:
    rng = np.random.default_rng(2)
    u = np.repeat(rng.choice([-1.0, 0.0, 0.4, 1.0], 60), 10)
    e = rng.standard_normal(600)
    y = e if kind == "white" else lfilter([1.0], [1.0, -0.95], e)
    log = write_log(tmp_path / "noise.csv", ["u", "y"], [u, y])
    finding = "The input u explains no more of y than chance would."
    assert finding in run(capsys, "inspect", log).out
    place = ("--workspace", tmp_path / "ws")
    warnings = run(capsys, "fit", log, "--structure", "arx", *place, "--json").document["warnings"]
    assert finding in warnings[0]


def test_a_weak_effect_is_not_called_none() -> None:
    """One tenth of the output's power from the input, 600 samples: an effect, if a poor model."""
    called = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.choice([-1.0, 1.0], 60), 10)
        y = lfilter([0.0, 0.06], [1.0, -0.8], u) + rng.standard_normal(600) * 0.9
        called += any(f.code == "no-effect" for f in check_delay(LogFacts((Record(u, y, 0.1),))))
    assert called <= 2
