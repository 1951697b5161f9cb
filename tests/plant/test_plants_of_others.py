"""What the commands say of logs that are no robot's: an oven, a motor, a tank, two heated zones."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, run, write_log

from sysid.data.record import Array

ROBOTS_OWN = re.compile(
    r"\b(tracks?|wheels?|robots?|pwm|left and right|turns? on the spot|lower eta|obstacles?|"
    r"chassis|drives? (in|along|a|an)|pose|rad/s)\b",
    re.IGNORECASE,
)
"""Words that only a vehicle's log may call up; rad/s where the file knows no angle."""
UNREADABLE = re.compile(
    r"\)/\(1\)|\(1\)/\(|\(s\)/|y/s\)|εu|linear trace|independent of u|depend on u|is ahead|\btie\b|"
    r"interleaved|structured|\bnan\b|None|  +\.|\d e-?\d"
)
"""Words and units that readers did not understand, and numbers that are none."""
SAMPLES = 260


def _steps(rng: np.random.Generator, low: float, high: float, hold: int) -> Array:
    """A command that is held for a while, anywhere between two limits."""
    return np.repeat(np.round(rng.uniform(low, high, SAMPLES // hold + 1), 1), hold)[:SAMPLES]


def oven(rng: np.random.Generator) -> dict[str, Array]:
    """A heater of 0 to 100 %, 1.8 °C for every percent, 120 s."""
    u = _steps(rng, 0.0, 100.0, 20)
    y = np.zeros(SAMPLES)
    for k in range(1, SAMPLES):
        y[k] = 0.96 * y[k - 1] + 0.04 * 1.8 * u[k - 1]
    return {"power_percent": u, "temp_degC": y + 21.0 + 0.3 * rng.standard_normal(SAMPLES)}


def motor(rng: np.random.Generator) -> dict[str, Array]:
    """A motor behind 1.2 V of dry friction, 150 rpm for every volt above it."""
    u = _steps(rng, -12.0, 12.0, 8)
    y = np.zeros(SAMPLES)
    for k in range(1, SAMPLES):
        drive = np.sign(u[k - 1]) * max(abs(u[k - 1]) - 1.2, 0.0)
        y[k] = 0.8 * y[k - 1] + 0.2 * 150.0 * drive
    return {"voltage_V": u, "speed_rpm": y + 6.0 * rng.standard_normal(SAMPLES)}


def tank(rng: np.random.Generator) -> dict[str, Array]:
    """A pump into a tank that drains as the root of its level."""
    u = _steps(rng, 1.0, 4.0, 15)
    y = np.full(SAMPLES, 1.0)
    for k in range(1, SAMPLES):
        y[k] = max(y[k - 1] + 0.05 * (u[k - 1] - 2.2 * np.sqrt(y[k - 1])), 0.0)
    return {"pump_V": u, "level_m": y + 0.004 * rng.standard_normal(SAMPLES)}


def zones(rng: np.random.Generator) -> dict[str, Array]:
    """Two heaters, two temperatures, heat that passes between them."""
    u = np.column_stack([_steps(rng, 0.0, 100.0, 13), _steps(rng, 0.0, 100.0, 17)])
    y = np.zeros((SAMPLES, 2))
    for k in range(1, SAMPLES):
        between = 0.3 * (y[k - 1, ::-1] - y[k - 1])
        y[k] = y[k - 1] + 0.05 * (np.array([0.6, 0.5]) * u[k - 1] - y[k - 1] + between)
    y += 20.0 + 0.2 * rng.standard_normal(y.shape)
    return {"heater_1": u[:, 0], "heater_2": u[:, 1], "temp_1": y[:, 0], "temp_2": y[:, 1]}


PLANTS: dict[str, tuple[Callable[[np.random.Generator], dict[str, Array]], float]] = {
    "oven": (oven, 5.0),
    "motor": (motor, 0.02),
    "tank": (tank, 0.5),
    "zones": (zones, 2.0),
}
"""What makes the log, and its sample time [s]."""


@pytest.fixture(params=list(PLANTS))
def log(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[str, list[str]]:
    """The name of a plant's log in the current folder, and its columns."""
    monkeypatch.chdir(tmp_path)
    make, step = PLANTS[request.param]
    signals = make(np.random.default_rng(3))
    write_log(tmp_path / f"{request.param}.csv", list(signals), list(signals.values()), step)
    return request.param, list(signals)


@pytest.mark.slow
def test_every_command_speaks_of_the_log_it_reads(
    log: tuple[str, list[str]], capsys: Capture
) -> None:
    plant, columns = log
    file = f"{plant}.csv"
    orders = ("--orders", "na=1 nb=1 nc=1 nd=1 nf=1")
    lines: list[tuple[str, ...]] = [("inspect", file), ("fit", file, *orders, "--full")]
    if plant == "motor":
        lines.append(
            ("fit", file, "--structure", "hammerstein-wiener", "--orders", "nb=1 nf=1 nk=1")
        )
    if plant == "zones":
        lines.append(("fit", file, "--structure", "arx", "--orders", "na=1 nb=1:2 nk=1"))
    lines += [("compare",), ("compare", "--val", file), ("export",), ("simulate", file)]
    said = {}
    for line in lines:
        result = run(capsys, *line)
        assert result.code == 0, (line, result.err)
        said[line] = result.out + result.err
        own = said[line].replace("rad/s", "") if plant == "motor" else said[line]
        # a mode that swings has a frequency in rad/s, whatever swings
        own = re.sub(r"swings at [^ ]+( ± [^ ]+)? rad/s", "", own)
        assert not ROBOTS_OWN.search(own), (line, ROBOTS_OWN.findall(own), own)
        assert not UNREADABLE.search(own), (line, UNREADABLE.findall(own), own)
    fitted = said[lines[1]]
    assert f"no linear effect of {columns[0]}" in fitted
    assert ("speed_rpm [rpm → rad/s]" in " ".join(fitted.split())) == (plant == "motor")
    assert ("(rad/s)/V" in fitted) == (plant == "motor")
    assert f"fitted to data of {file}" in said["compare", "--val", file]


@pytest.mark.slow
@pytest.mark.parametrize("log", ["oven"], indirect=True)
def test_a_diagnosis_speaks_of_the_oven(
    log: tuple[str, list[str]], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)
    run(capsys, "fit", "oven.csv", "--structure", "oe", "--orders", "nb=1 nf=1 nk=1")
    result = run(capsys, "diagnose", "oven.csv")
    assert result.code == 0, result.err
    assert not ROBOTS_OWN.search(result.out), result.out
    assert not UNREADABLE.search(result.out), result.out
    assert "The errors look like noise." in result.out
    assert "temp_degC" in result.out


def test_what_was_read_stands_once_above_the_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    signals = motor(np.random.default_rng(3))
    write_log(tmp_path / "motor.csv", list(signals), list(signals.values()), 0.02)
    common = ("fit", "motor.csv", "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    assert " ".join(run(capsys, *common).out.split()).count("speed_rpm [rpm → rad/s]") == 1
    document = run(capsys, *common, "--json").document
    assert "→" not in " ".join(document["warnings"])
    said = {d["what"]: (d["value"], d["change"]) for d in document["read_as"]}
    assert said["out"] == ("speed_rpm [rpm → rad/s]", "--output, --unit")
    assert {"time", "dt", "in", "offsets"} <= said.keys()


def test_a_switch_and_an_unnamed_output_are_said_by_the_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    on = np.repeat(rng.integers(0, 2, 40), 10)
    y = np.zeros(len(on))
    for k in range(1, len(on)):
        y[k] = 0.9 * y[k - 1] + 6.0 * on[k - 1]
    y += 20.0 + 0.1 * rng.standard_normal(len(on))
    rows = [
        f"{k},{'ON' if u else 'OFF'},{v:.4f}" for k, (u, v) in enumerate(zip(on, y, strict=True))
    ]
    (tmp_path / "fan.csv").write_text("\n".join(["t,heater,box", *rows]) + "\n")
    result = run(capsys, "fit", "fan.csv", "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    assert result.code == 0, result.err
    assert "heater was read as a switch" in result.out
    assert "box was taken as the output" in result.out


@pytest.mark.parametrize("log", ["tank"], indirect=True)
def test_orders_with_commas_are_told_apart(log: tuple[str, list[str]], capsys: Capture) -> None:
    result = run(capsys, "fit", f"{log[0]}.csv", "--orders", "na=1:2,nb=1:2")
    assert result.code == 2
    assert "put spaces between orders" in result.err
