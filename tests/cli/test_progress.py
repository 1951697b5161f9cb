"""Progress where nobody sees a bar: a line now and then on stderr, and nothing on stdout."""

import re
import time

import pytest
from sysid_cli import render


def test_piped_progress_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(render, "SPOKEN_EVERY", 0.05)
    with render.progress("Fitting", total=4) as tick:
        tick(1)
        time.sleep(0.3)
    with render.stages("Diagnosing") as stage:
        stage("the proof", 0.5)
        time.sleep(0.3)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert re.search(r"^Fitting: \d+ s, 25 % done$", shown.err, re.MULTILINE)
    assert re.search(r"^the proof: \d+ s, 50 % done$", shown.err, re.MULTILINE)


def test_a_short_command_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with render.progress("Fitting", total=4) as tick:
        tick(4)
    assert capsys.readouterr().err == ""
