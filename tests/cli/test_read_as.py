"""What was assumed about a log stands in one place, and what a log leaves open is asked for."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_signals, run, write_log
from scipy.signal import lfilter


class Terminal:
    """A stream that says that it is a terminal."""

    def __init__(self, stream: object) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)

    def isatty(self) -> bool:
        return True


def stand(folder: Path) -> Path:
    """A test stand with two columns that can be the input, and two that can be the output."""
    rng = np.random.default_rng(6)
    signal = np.repeat(rng.uniform(1000.0, 2000.0, 40), 10)
    rpm = lfilter([0.0, 2.0], [1.0, -0.8], signal - 1000.0) + rng.normal(0.0, 5.0, 400)
    names = ["ESC signal", "servo", "Motor speed", "Thrust"]
    columns = [signal, 10.0 * rng.standard_normal(400), rpm, 1e-7 * rpm**2]
    return write_log(folder / "stand.csv", names, columns, step=0.02)


FIT = ("--structure", "arx", "--orders", "na=1 nb=1 nk=1")


@pytest.mark.parametrize(
    "line",
    [
        ("inspect", "log.csv"),
        ("fit", "log.csv", *FIT),
        ("compare", "--val", "log.csv"),
        ("simulate", "log.csv"),
        pytest.param(
            ("simulate", "mission.yaml", "--measured", "log.csv", "--runs", "40"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_every_command_says_what_it_assumed(
    here: Path, capsys: Capture, line: tuple[str, ...]
) -> None:
    if "--measured" in line:
        signals = robot_signals(200)
        way = {"x": 0.01 * np.arange(200), "y": np.zeros(200), "psi": np.zeros(200)}
        write_log(here / "log.csv", [*signals, *way], [*signals.values(), *way.values()])
    shown = run(capsys, *line)
    assert shown.code == 0, shown.err
    block = shown.out[shown.out.index("Read as:") :].splitlines()
    lines = [block[0], *(b for b in block[1:4] if b.startswith("  "))]
    assert max(map(len, lines)) <= 80
    text = " ".join(" ".join(lines).split())
    assert "time t [s] (--time, --unit); dt 0.1 s (--ts)" in text
    assert "in pwm_l, pwm_r [µs] (--input, --unit); out omega_l, omega_r [rad/s]" in text
    document = run(capsys, *line, "--json").document
    said = document.get("read_as") or document["measured"]["read_as"]
    assert {"log", "what", "value", "change"} == set(said[0])
    assert {d["what"] for d in said} >= {"time", "dt", "in", "out"}


def test_an_open_choice_is_refused_with_a_line_to_paste(tmp_path: Path, capsys: Capture) -> None:
    refused = run(capsys, "inspect", stand(tmp_path), "--trim", "0.2:0", "--input=servo,esc")
    assert refused.code == 1
    assert "output can be Motor speed or Thrust; name" in refused.err
    line = " ".join(refused.err.split()).split("for example sysid ")[1]
    assert "--trim 0.2:0" in line
    again = run(capsys, *shlex.split(line))
    assert again.code == 0, again.err


def test_an_open_choice_is_asked_for_on_a_terminal(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["1", "speed"])
    asked: list[str] = []

    def prompt(text: str, **_: object) -> str:
        asked.append(text)
        return next(answers)

    monkeypatch.setattr("typer.prompt", prompt)
    monkeypatch.setattr(sys, "stdin", Terminal(sys.stdin))
    monkeypatch.setattr(sys, "stderr", Terminal(sys.stderr))
    shown = run(capsys, "inspect", stand(tmp_path))
    assert shown.code == 0, shown.err
    assert [re.findall(r"\d (\w+)", a.replace("ESC ", "ESC_")) for a in asked] == [
        ["ESC_signal", "servo"],
        ["Motor", "Thrust"],
    ]
    assert "in ESC signal [no unit]" in shown.out


def test_a_set_point_as_the_input_is_said_to_be_the_loop_s(tmp_path: Path, capsys: Capture) -> None:
    target = np.repeat(np.random.default_rng(2).uniform(-40.0, 40.0, 30), 10)
    actual = lfilter([0.0, 0.3], [1.0, -0.7], target)
    log = write_log(tmp_path / "servo.csv", ["target_deg", "actual_deg"], [target, actual])
    shown = " ".join(run(capsys, "fit", log, *FIT, "--workspace", tmp_path / "w").out.split())
    assert "in target_deg [deg → rad], a set point: the model is the closed loop's" in shown
    assert "the model is of the closed loop that follows it, not of the plant alone" in shown


@pytest.mark.parametrize(
    "names", [["Torque ref [Nm]", "Load speed [rad/s]"], ["freq_setpoint", "shaft speed"]]
)
def test_a_set_point_of_another_quantity_is_a_drive_s(
    names: list[str], tmp_path: Path, capsys: Capture
) -> None:
    """No controller of the speed writes the torque here: a drive makes it."""
    u = np.repeat(np.random.default_rng(2).uniform(-40.0, 40.0, 30), 10)
    log = write_log(tmp_path / "belt.csv", names, [u, lfilter([0.0, 0.3], [1.0, -0.7], u)])
    shown = " ".join(run(capsys, "inspect", log).out.split())
    assert "a set point: the model includes the drive" in shown
    assert "the plant with the drive that follows it, not of the plant alone" in shown
    assert "closed loop" not in shown


def test_part_of_a_name_selects_a_column(tmp_path: Path, capsys: Capture) -> None:
    log = stand(tmp_path)
    for name in ("esc", "ESC signal (µs)"):
        said = run(capsys, "inspect", log, "--input", name, "--output", "motor", "--json").document
        assert [c["name"] for c in said["records"][0]["channels"]] == ["ESC signal", "Motor speed"]
    refused = run(capsys, "inspect", log, "--input", "esc", "--output", "not")
    assert refused.code == 2
    assert "not a column" in refused.err
    two = write_log(tmp_path / "two.csv", ["u", "motor speed", "fan speed"], [[1.0, 2.0] * 30] * 3)
    refused = run(capsys, "inspect", two, "--output", "speed")
    assert refused.code == 2
    assert "--output names 'speed', which can be motor speed or fan speed" in refused.err


def test_what_can_be_either_way_round_is_asked(tmp_path: Path, capsys: Capture) -> None:
    """A roller's speed drives a web; a supply that is called an input drives nothing."""
    held = np.repeat(np.random.default_rng(3).uniform(1.0, 9.0, 30), 10)
    left = lfilter([0.0, 0.3], [1.0, -0.7], held)
    log = write_log(tmp_path / "web.csv", ["Roller speed", "Web tension"], [held, left])
    refused = run(capsys, "inspect", log)
    assert refused.code == 1
    assert "the input and the output can be" in refused.err
    names = ["input_voltage", "duty_cycle", "erpm"]
    log = write_log(tmp_path / "vesc.csv", names, [50.0 - 0.01 * held, held, left])
    said = run(capsys, "inspect", log, "--output", "erpm", "--json").document
    assert [c["name"] for c in said["records"][0]["channels"]] == ["duty_cycle", "erpm"]
