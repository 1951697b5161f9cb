"""A reference in the file tells a loop from what only looks like one, at three hundred rows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.data.checks.feedback import feedback_tests
from sysid.data.facts import LogFacts
from sysid.data.io import read_log
from sysid.data.preprocess import decimate, low_pass
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record

DT = 0.1
ROWS = 300
A, B = (1.0, -1.5, 0.6), (0.1, 0.05)
"""The plant: poles at 0.75 ± 0.19j."""


def reference(kind: str, rng: np.random.Generator) -> np.ndarray:
    if kind == "white":
        return rng.standard_normal(ROWS)
    if kind == "prbs":
        return np.repeat(rng.choice([-1.0, 1.0], ROWS // 4 + 1), 4)[:ROWS]
    return lfilter([1.0], [1.0, -0.95], rng.standard_normal(ROWS))


def record(u: np.ndarray, y: np.ndarray, r: np.ndarray) -> Record:
    return Record(u[:, None], y[:, None], DT, references=r[:, None], reference_names=("ref",))


def loop(seed: int, kind: str, gain: float, late: int = 0) -> Record:
    """A PI controller that answers in the same row, or one later; process noise."""
    rng = np.random.default_rng([seed, 1])
    r, push = reference(kind, rng), 0.05 * rng.standard_normal(ROWS)
    u, y, total = np.zeros(ROWS), np.zeros(ROWS), 0.0
    for t in range(ROWS):
        y[t] = push[t] + sum(B[k - 1] * u[t - k] - A[k] * y[t - k] for k in (1, 2) if t >= k)
        if t >= late:
            error = r[t - late] - y[t - late]
            total += 0.05 * gain * error
            u[t] = gain * error + total
    return record(u, y, r)


def led(seed: int, kind: str, how: str) -> Record:
    """Open loop: the command is the reference, filtered, limited, or with something beside it."""
    rng = np.random.default_rng([seed, 2])
    r = reference(kind, rng)
    u = {
        "copied": 2.0 * r,
        "ahead": lfilter([1.0, -0.9], [1.0, -0.3], r),
        "limited": np.clip(2.0 * r, -1.0, 1.0),
        "dithered": r + lfilter([0.2], [1.0, -0.8], rng.standard_normal(ROWS)),
    }[how]
    within = (0.0, *B) if seed % 2 else (*B, 0.0)  # half of them answer within the sample
    noise = lfilter([0.05], A, rng.standard_normal(ROWS))
    return record(u, lfilter(within, A, u) + noise, r)


@pytest.mark.parametrize(
    ("kind", "gain", "late"),
    [
        *((kind, 0.8, late) for kind in ("white", "prbs", "slow") for late in (0, 1)),
        ("white", 0.3, 0),  # a slow reference drowns the answer of so slow an integral part
        ("prbs", 0.3, 0),
    ],
)
def test_a_loop_is_seen_by_its_reference(kind: str, gain: float, late: int) -> None:
    """Measured 59 or 60 of 60; without the reference 0 to 17."""
    logs = [loop(seed, kind, gain, late) for seed in range(10)]
    tests = [feedback_tests([log])[0] for log in logs]
    assert sum(t.seen for t in tests) >= 9
    assert {t.reference for t in tests if t.seen} == {"ref"}
    if kind == "white":
        assert LogFacts(tuple(logs[:3])).surely_closed_loop


def test_a_reference_alone_is_no_loop() -> None:
    """Nominal 1 % over 120 logs: five or more have a chance below 1 %."""
    alarms = [
        (how, kind, seed)
        for how in ("copied", "ahead", "limited", "dithered")
        for kind in ("white", "prbs", "slow")
        for seed in range(10)
        if feedback_tests([led(seed, kind, how)])[0].seen
    ]
    assert len(alarms) < 5, alarms


def cascade(seed: int, how: str) -> Record:
    """A height whose error moves the thrust; its rate is the output, with noise of its own.

    "open": the thrust is the set point, filtered, and the height drifts. "ahead": the thrust
    follows a column that no output moves.
    """
    rng = np.random.default_rng([seed, 3])
    rows = 5 * ROWS
    r = np.repeat(rng.standard_normal(rows // 60), 60)
    push, own, height_noise, rate_noise = rng.standard_normal((4, rows)) * 0.01
    lead = r + 0.2 * lfilter([1.0], [1.0, -0.9], rng.standard_normal(rows))
    u, v, h = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for t in range(1, rows):
        v[t] = 0.9 * v[t - 1] + 0.1 * u[t - 1] + push[t]
        h[t] = h[t - 1] + DT * v[t]
        error = {"loop": r[t] - h[t] - height_noise[t], "open": r[t], "ahead": lead[t]}[how]
        u[t] = 0.6 * u[t - 1] + 0.2 * error + own[t]
    log = record(u, v + rate_noise, r)
    column = lead if how == "ahead" else h + height_noise
    return replace(log, unused=column[:, None], unused_names=("height",))


def test_a_loop_over_a_column_that_is_not_used_is_seen() -> None:
    """Of 40 loops 36 over the column and 4 by their rate; none of 80 others."""
    assert LogFacts((cascade(0, "loop"),)).surely_closed_loop
    loops = [feedback_tests([cascade(seed, "loop")])[0] for seed in range(6)]
    assert all(t.seen for t in loops)
    over = {(t.reference, t.column) for t in loops if t.column}
    assert over == {("ref", "height")}
    for how in ("open", "ahead"):
        assert not any(feedback_tests([cascade(seed, how)])[0].seen for seed in range(6))


@pytest.mark.parametrize("name", ["speed_ref", "speed_setpoint", "target", "Sollwert", "sp"])
def test_the_reader_knows_a_reference_by_its_name(
    name: str, tmp_path: Path, capsys: Capture
) -> None:
    log = loop(3, "white", 0.8)
    assert log.references is not None
    columns = [log.u[:, 0], log.y[:, 0], log.references[:, 0]]
    path = write_log(tmp_path / "loop.csv", ["voltage", "speed_rpm", name], columns)
    said = " ".join(run(capsys, "inspect", path).out.split())
    assert f"The input voltage responds to {name} - speed_rpm" in said
    assert f"{name} serves to detect a controller" in said
    assert "not used" not in said


def test_a_reference_goes_the_way_of_its_record(tmp_path: Path) -> None:
    """Missing rows, resampling, filters and cuts leave as many samples of it as of the input."""
    rng = np.random.default_rng(4)
    r = np.repeat(rng.choice([-1.0, 1.0], 80), 5)
    kept = np.delete(np.arange(400), [50, 51, 200])
    columns = [kept * DT, r[kept], lfilter((0.0, *B), A, r)[kept], r[kept]]
    names = ["t", "u", "y", "ref"]
    path = write_log(tmp_path / "gaps.csv", names, columns, step=None)
    log = read_log(path, ReadOptions(resample="fill"))
    for part in (log, log.rows(10, 90), decimate(log, 3), low_pass(log, 1.0)):
        assert part.references is not None
        np.testing.assert_allclose(part.references, part.u, atol=1e-12)


def test_other_columns_do_not_pass_for_references(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    u = rng.standard_normal(ROWS)
    y = lfilter((0.0, *B), A, u)
    still, told = np.full(ROWS, 3.0), y + 0.01 * rng.standard_normal(ROWS)
    names = ["u", "y", "y_hat", "y_ref", "temperature"]
    log = read_log(write_log(tmp_path / "open.csv", names, [u, y, told, still, told]))
    assert log.references is None
