"""An output that is an encoder's running count is said, with the options that make it a speed."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run

ROWS = 600


def drive(path: Path, name: str, values: np.ndarray, u: np.ndarray) -> Path:
    rows = [f"{10 * k},{u[k]:g},{v:g}" for k, v in enumerate(values)]
    path.write_text("\n".join([f"millis,pwm,{name}", *rows]) + "\n")
    return path


def counts(seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """A first-order speed under steps of the command, and the counts that it has turned."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(-200, 255, ROWS // 30), 30).astype(float)
    speed = np.zeros(ROWS)
    for k in range(1, ROWS):
        speed[k] = 0.92 * speed[k - 1] + 0.08 * 0.42 * u[k - 1]
    return u, np.floor(np.cumsum(speed))


@pytest.mark.parametrize(
    "command", [("inspect",), ("fit", "--structure", "arx", "--orders", "na=2 nb=2 nk=1")]
)
def test_a_running_count_is_said_with_the_options_that_work(
    command: tuple[str, ...], tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    u, y = counts()
    log = drive(tmp_path / "run.csv", "enc", y, u)
    full = ("--full",) if command[0] == "fit" else ()
    shown = run(capsys, *command[:1], log, *command[1:], *full)
    said = " ".join((shown.out + shown.err).split())
    assert "--speed-of enc --unit enc=counts=N/rev" in said
    done = run(capsys, "inspect", log, "--speed-of", "enc", "--unit", "enc=counts=1320/rev")
    assert done.code == 0
    assert "counts=N/rev" not in done.out


def test_a_register_that_wraps_needs_no_telling_name(tmp_path: Path, capsys: Capture) -> None:
    u, y = counts()
    log = drive(tmp_path / "run.csv", "a", np.mod(3 * y + 2000, 4096), u)
    assert "--speed-of a --unit" in " ".join(
        run(capsys, "inspect", log, "--output", "a").out.split()
    )


def test_ticks_of_one_sample_are_no_running_count(tmp_path: Path, capsys: Capture) -> None:
    u, y = counts()
    log = drive(tmp_path / "run.csv", "enc", np.diff(y, prepend=0.0), u)
    assert "counts=N/rev" not in run(capsys, "inspect", log).out


@pytest.mark.parametrize("name", ["level", "rpm_raw"])
def test_a_slow_reading_in_whole_numbers_is_no_count(
    name: str, tmp_path: Path, capsys: Capture
) -> None:
    u, _ = counts()
    y = np.zeros(ROWS)
    for k in range(1, ROWS):
        y[k] = 0.995 * y[k - 1] + 0.005 * 10 * u[k - 1]
    log = drive(tmp_path / "run.csv", name, np.rint(y), u)
    assert "counts=N/rev" not in run(capsys, "inspect", log).out
