"""``sysid forecast``: table, numbers and picture of a small log."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_log, run


def test_a_forecast_is_shown_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    log = str(robot_log(tmp_path / "log.csv"))
    fitted = run(capsys, "fit", log, "--structure", "ss", "--orders", "n=2")
    assert fitted.code == 0, fitted.err
    assert run(capsys, "plot", "singular", "-o", "s.svg").code == 0
    told = run(capsys, "forecast", log, "--steps", "5", "--save", "f.csv")
    assert told.code == 0, told.err
    assert "keep their last values" in told.out
    rows = np.genfromtxt("f.csv", delimiter=",", names=True)
    assert len(rows) == 5
    assert np.all(rows["omega_l_low"] < rows["omega_l"])
    assert Path(".sysid/forecast.svg").exists()
    instant = "5"
    told = run(capsys, "forecast", log, "--steps", "5", "--at", instant, "--json")
    document = json.loads(told.out)
    assert document["t"][0] > float(instant)
    assert set(document["inside"]) == {"omega_l", "omega_r"}
    assert all(v is not None for v in document["measured"]["omega_l"])
    refused = run(capsys, "forecast", log, "--at", "1e6")
    assert refused.code == 2
    assert "outside the log" in refused.err
