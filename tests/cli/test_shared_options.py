"""Options that several commands share: declared once, present and meaning the same everywhere."""

from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import get_args

import pytest
from command_line import Capture, robot_log, run
from sysid_cli import diagnose, fit, inspect, reading

from sysid.errors import UsageError


@pytest.mark.parametrize("command", [fit.fit, inspect.inspect, diagnose.diagnose])
def test_every_command_with_a_log_has_every_option_of_reading_and_preparing(command) -> None:
    for shared in (reading.Reading, reading.Preparing):
        for field in fields(shared):
            own = signature(command).parameters[field.name]
            words = get_args(own.annotation)[1]
            assert (own.default, words.help) == (
                field.default,
                field.metadata["declared"].words["help"],
            )


def test_a_log_is_inspected_as_it_will_be_fitted(tmp_path: Path, capsys: Capture) -> None:
    log = robot_log(tmp_path / "log.csv", 300)
    halved = run(capsys, "inspect", log, "--decimate", "2", "--trim", "5:5", "--json").document
    (record,) = halved["records"]
    assert record["samples"] == 100  # 300 samples of 0.1 s less 5 s at both ends, every second
    assert record["sample_time_s"] == pytest.approx(0.2)


@pytest.mark.parametrize("workspace", [("-w", "elsewhere"), ("--workspace=elsewhere",)])
def test_a_command_that_keeps_nothing_takes_a_workspace_too(
    tmp_path: Path, capsys: Capture, workspace: tuple[str, ...]
) -> None:
    log = robot_log(tmp_path / "log.csv", 200)
    plain = run(capsys, "inspect", log, "--json").document
    assert run(capsys, "inspect", *workspace, log, "--json").document == plain
    assert run(capsys, "inspect", log, "-w").code == 2


def test_texts_of_trimming_and_unwrapping() -> None:
    assert reading.seconds_to_trim("2:1.5") == (2.0, 1.5)
    assert reading.seconds_to_trim("2") == (2.0, 0.0)
    assert reading.seconds_to_trim(":3") == (0.0, 3.0)
    with pytest.raises(UsageError, match="HEAD:TAIL"):
        reading.seconds_to_trim("a:b")
    assert reading.periods(["65536", "a=4096,b=none"]) == {"": 65536.0, "a": 4096.0, "b": 0.0}
    for text in ("enc", "=256", "enc=-5", "enc=nan", "enc=inf"):
        with pytest.raises(UsageError, match="--unwrap cannot read"):
            reading.periods([text])
