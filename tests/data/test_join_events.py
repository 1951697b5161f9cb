"""A command that is logged only when it changes, joined to the log of what it drives."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.io import LogFile, read_file
from sysid.data.joining.between_rows import held_at, is_event_log
from sysid.data.reading.read_options import ReadOptions

STEP, ROWS = 0.2, 900


def commands(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A command that stands still for 8 to 40 s, and the rows at which it changes."""
    rng = np.random.default_rng(seed)
    u = np.empty(0)
    while len(u) < ROWS:
        u = np.concatenate([u, np.full(rng.integers(40, 200), round(rng.uniform(15, 35), 1))])
    u = u[:ROWS]
    return u, np.flatnonzero(np.diff(u, prepend=np.nan) != 0.0)


def stamp(seconds: float, dated: bool) -> str:
    if not dated:
        return f"{seconds:.3f}"
    return f"2026-02-03T06:{int(seconds) // 60:02d}:{seconds % 60:06.3f}Z"


def pair(tmp_path: Path, dated: bool, name: str, fill: str = "", late: float = 0.0) -> LogFile:
    u, at = commands()
    y = np.zeros(ROWS)
    for k in range(1, ROWS):
        y[k] = 0.94 * y[k - 1] + 0.06 * 2.15 * u[k - 1]
    log, other = tmp_path / "flow.csv", tmp_path / "events.csv"
    rows = [f"{stamp(0.25 + STEP * k, dated)},{v:.2f}" for k, v in enumerate(y)]
    log.write_text("\n".join(["timestamp,flow_m3h", *rows]) + "\n")
    rows = [f"{stamp(0.25 + late + STEP * k, dated)},{u[k]:.1f},{fill}" for k in at]
    other.write_text("\n".join([f"timestamp,{name},extra", *rows]) + "\n")
    options = ReadOptions(inputs=(name,), outputs=("flow_m3h",), join=(str(other),))
    return read_file(log, options)


@pytest.mark.parametrize("dated", [True, False])
@pytest.mark.parametrize("name", ["freq_hz", "opening"])
def test_a_command_logged_at_its_changes_is_held(tmp_path: Path, dated: bool, name: str) -> None:
    found = pair(tmp_path, dated, name, "1")
    (record,) = found.records
    # every row of the log, to its end: after the last event the command stays what it is
    np.testing.assert_allclose(record.u[:, 0], commands()[0])
    assert any("held between them" in note for note in found.notes)
    assert not any(word in note for note in found.notes for word in ("pose", "wheel", "robot"))


def test_rows_before_the_first_event_have_no_command(tmp_path: Path) -> None:
    found = pair(tmp_path, False, "freq_hz", "1", late=2.0)
    (record,) = found.records
    assert len(record) == ROWS - 10
    np.testing.assert_allclose(record.u[:, 0], commands()[0][:-10])


def test_an_empty_cell_leaves_the_value_before_it() -> None:
    t = np.arange(8.0)
    values, covered = held_at(t, np.array([1.0, 3.0, 5.001]), np.array([2.0, np.nan, 7.0]))
    assert covered.tolist() == [False] + [True] * 7
    assert values[1:].tolist() == [2.0, 2.0, 2.0, 2.0, 7.0, 7.0, 7.0]


def test_a_sampled_file_is_no_file_of_events() -> None:
    rng = np.random.default_rng(1)
    log = np.arange(0.0, 100.0, 0.1)
    slow = np.arange(0.0, 100.0, 1.0) + rng.uniform(-0.2, 0.2, 100)
    assert not is_event_log(log, slow)
    assert not is_event_log(log, np.delete(slow, [7, 31, 32, 60]))
    assert not is_event_log(log, np.arange(0.0, 100.0, 0.02))
    assert is_event_log(log, np.cumsum(rng.exponential(4.0, 25)))


def test_a_slow_sensor_is_read_by_lines_and_a_sampled_command_is_held(tmp_path: Path) -> None:
    t, slow = np.arange(0.0, 60.0, 0.1), np.arange(0.0, 61.0, 1.0)
    log, other = tmp_path / "log.csv", tmp_path / "slow.csv"
    log.write_text("t,level\n" + "".join(f"{a:.1f},{np.sin(a):.4f}\n" for a in t))
    rows = (f"{a:.1f},{np.sin(a / 9):.6f},{a % 7:g}\n" for a in slow)
    other.write_text("t,temperature,valve\n" + "".join(rows))
    options = ReadOptions(inputs=("valve",), outputs=("temperature",), join=(str(other),))
    (record,) = read_file(log, options).records
    n = len(record)
    np.testing.assert_allclose(record.u[:, 0], np.floor(t[:n] + 1e-6) % 7)
    # a line between two samples of a sine of this length errs by h²/8 · max|y''| = 0.0016
    assert np.max(np.abs(record.y[:, 0] - np.sin(t[:n] / 9))) < 0.002
