"""Logs of people who know their robot, not this tool: whole files as loggers write them."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from written_logs import LOGGERS, STEP, lines, motor, point, put, whole

from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.io import read_file
from sysid.data.reading.read_options import ReadOptions

# ------------------------------------------------------------------------------------ whole files


@pytest.mark.parametrize("logger", LOGGERS)
def test_every_logger_is_read_alike(tmp_path: Path, logger: str) -> None:
    written = LOGGERS[logger]()
    log = read_file(put(tmp_path, written.text), ReadOptions(**written.options))
    record = log.records[0]
    # Stamps of an epoch in seconds and of spreadsheet days resolve 0.2 and 1 µs of 20 ms.
    assert record.dt == pytest.approx(written.dt, rel=1e-4)
    assert len(record) == len(written.u)
    np.testing.assert_allclose(record.u[:, 0], written.u, atol=1e-9)
    np.testing.assert_allclose(record.y[:, 0], written.y, atol=1e-9)
    for part in written.said:
        assert part in " ".join((*log.notes, *(d.value for d in record.read_as)))
    assert not [f for f in log.findings if f.code == "sample-time"]


@pytest.mark.parametrize("logger", LOGGERS)
def test_missing_lines_are_counted_behind_every_clock(tmp_path: Path, logger: str) -> None:
    """Two lines away: two samples are interpolated, whatever the clock, and none denies it."""
    written = LOGGERS[logger]()
    text = written.text.splitlines()
    body = len(text) - 60  # behind the header, and not where another line is doubled
    log = read_file(
        put(tmp_path, "\n".join([*text[:body], *text[body + 2 :]]) + "\n"),
        ReadOptions(**written.options),
    )
    assert len(log.records[0]) == len(written.u)
    findings = inspect_records(LogFacts(log.records, log.findings))
    said = " ".join(f.text for f in findings)
    assert "2 missing samples were interpolated" in said
    assert "No sample is missing" not in said


# ------------------------------------------------------------------------------ what commands say


def test_inspect_and_fit_never_deny_what_reading_found(tmp_path: Path, capsys: Capture) -> None:
    k, u, y = motor(900)
    keep = np.setdiff1d(k, np.arange(40, 880, 20))
    text = "time,u,y\n" + lines([point(STEP * keep), whole(u[keep]), point(y[keep])])
    path = put(tmp_path, text)
    out = run(capsys, "inspect", path).out
    assert "42 missing samples were interpolated" in out
    assert "No sample is missing" not in out
    found = json.loads(run(capsys, "inspect", path, "--json").out)["findings"]
    assert not [f for f in found if f["code"] == "missing" and f["severity"] == "ok"]
