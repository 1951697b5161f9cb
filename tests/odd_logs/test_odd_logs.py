"""Logs of strangers, with the first command a person would type, against the truth.

A gain is right within 3 % or three standard errors, whichever is larger: an estimate misses three
standard errors in one log of 370, and 3 % is what a person with a robot cares for. All of them,
slow ones included, run under ``make study`` on other seeds, where the fit always chooses the
structure (``studies/odd_logs.py``).
"""

import re
from pathlib import Path

import pytest
from catalogue import CATALOGUE
from judged import judge
from odd_log import OddLog


@pytest.mark.slow
@pytest.mark.parametrize(
    "log", [o for o in CATALOGUE if not o.slow], ids=lambda o: re.sub(r"\W+", "-", o.name)
)
def test_a_stranger_s_log(
    log: OddLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    fitted = "--structure oe" if log.read_only else ""
    verdict = judge(log, 0, tmp_path, capsys.readouterr, fitted)
    assert not verdict.faults, "\n".join(verdict.faults)


def test_there_are_at_least_forty_of_them() -> None:
    assert len({o.name for o in CATALOGUE}) >= 40
