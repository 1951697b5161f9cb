"""Options that several commands share: declared once, present and meaning the same everywhere."""

from inspect import signature
from pathlib import Path

import pytest
from command_line import robot_log, run
from sysid_cli import diagnose, fit, inspect, reading


@pytest.mark.parametrize("command", [fit.fit, inspect.inspect, diagnose.diagnose])
def test_every_command_with_a_log_has_every_option_of_reading_and_preparing(command) -> None:
    for build in (reading.read_options, reading.preparation):
        for name, declared in signature(build).parameters.items():
            own = signature(command).parameters[name]
            assert (own.default, own.annotation) == (declared.default, declared.annotation)


def test_a_log_is_inspected_as_it_will_be_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = robot_log(tmp_path / "log.csv", 300)
    halved = run(capsys, "inspect", log, "--decimate", "2", "--trim", "5:5", "--json").document
    (record,) = halved["records"]
    assert record["samples"] == 100  # 300 samples of 0.1 s less 5 s at both ends, every second
    assert record["sample_time_s"] == pytest.approx(0.2)
