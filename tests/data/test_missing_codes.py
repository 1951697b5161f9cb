"""Codes for missing measurements: what is taken for one, what is not, which option decides."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.data.reading.missing_codes import without_codes

N = 600


def signals(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A stepping input from 20 to 80 and an output around 40 ± 12 that lags it, to 0.1."""
    rng = np.random.default_rng(seed)
    u = np.round(np.repeat(rng.uniform(20.0, 80.0, N // 20), 20), 1)
    y = lfilter([0.0, 0.02], [1.0, -0.9], u - 50.0) + 40.0 + 0.3 * rng.standard_normal(N)
    return u, np.round(y, 1)


def rows_of_codes(u: np.ndarray, y: np.ndarray, missing: tuple[str, ...] = ()) -> int:
    """Cells that are read as empty."""
    read, _ = without_codes(np.column_stack([u, y]), ("u", "y"), 1, missing, "log.csv")
    return int(np.count_nonzero(np.isnan(read)))


@pytest.mark.parametrize("code", [-999.0, -9999.0, 9999.0, 999.9, -99.99, 0.0, 85.0, -127.0])
@pytest.mark.parametrize("at", [(30, 31, 200), (77, 311, 312, 313, 500)])
def test_an_isolated_number_that_is_repeated_is_a_code(code: float, at: tuple[int, ...]) -> None:
    u, y = signals(len(at))
    y[list(at)] = code
    assert rows_of_codes(u, y) == len(at)
    assert rows_of_codes(u, y, ("none",)) == 0
    assert rows_of_codes(u, y, (str(code),)) == len(at)


def harmless(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Logs in which nothing is missing, though numbers repeat at an end or stand apart."""
    u, y = signals(seed)
    rng = np.random.default_rng(seed + 1)
    off = slice(int(rng.integers(50, 300)), int(rng.integers(310, 330)))
    kind = seed % 8
    if kind == 0:  # a sensor that clips
        y = np.minimum(y, np.quantile(y, 0.97))
    elif kind == 1:  # a command of 0 in a stretch, which the output of a fast plant follows
        u[off], y[off] = 0.0, 0.0
    elif kind == 2:  # a command of 0 and a slow answer
        u[off] = 0.0
        y = np.round(lfilter([0.0, 0.1], [1.0, -0.9], u), 1)
    elif kind == 3:  # short pulses, answered in the next sample
        u = np.where(np.arange(N) % 97 == 5, 90.0, u)
        y = np.where(np.roll(u, 1) == 90.0, 200.0, y)
    elif kind == 4:  # at rest before and after
        u[:40], u[-40:], y[:45], y[-35:] = 0.0, 0.0, 0.0, 0.0
    elif kind == 5:  # a counter of 12 bits
        y = np.cumsum(np.rint(y)) % 4096
    elif kind == 6:  # a switched output
        y = np.where(u > 50.0, 5.0, 0.0)
    else:  # one wild measurement
        y[100] = 999.9
    return u, y


def test_what_is_measured_is_no_code() -> None:
    """320 logs of eight kinds that have none."""
    assert [s for s in range(320) if rows_of_codes(*harmless(s))] == []


def test_a_code_is_said_with_the_option_that_keeps_it(tmp_path: Path, capsys: Capture) -> None:
    u, y = signals(3)
    y[[40, 41, 300]] = -999.0
    path = write_log(tmp_path / "log.csv", ["u", "y"], [u, y])
    said = " ".join(run(capsys, "inspect", path).out.split())
    assert "missing y is -999 in 3 rows (--missing)" in said
    assert "keep it with --missing none" in said
    kept = " ".join(run(capsys, "inspect", path, "--missing", "none").out.split())
    assert "stands for a missing" not in kept
    assert run(capsys, "inspect", path, "--missing", "-999").code == 0
    assert run(capsys, "inspect", path, "--missing", "maybe").code == 2
