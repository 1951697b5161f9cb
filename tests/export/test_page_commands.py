"""Exports and replays of the pages on C, FMU and ROS, as a reader types them in a fresh folder."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest
from c_programs import needs_compiler
from command_line import Capture, run
from plant_models import robot_model

from sysid.export.verification import verify as module
from sysid.export.verification.runtimes import Compiled
from sysid.workspace.store import Workspace

DOCS = Path(__file__).resolve().parents[2] / "docs"


def shown(page: str) -> list[list[str]]:
    """Lines of a page's console blocks that export or verify."""
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```console\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if re.match(r"sysid (export|verify) ", line)]


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(find_spec("fmpy") is None, reason="the extra fmu is not installed")
@pytest.mark.parametrize("page", ["c.md", "fmu.md", "ros.md"])
def test_shown_exports_run(
    page: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One compiler stands for all of them: what each gives is tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "COMPILED", (Compiled("cc", "cc"),))
    absent = Compiled("absent", "no-such-compiler")
    monkeypatch.setattr(module, "CORTEX_M4", absent)
    monkeypatch.setattr(module, "RosNodes", lambda: absent)
    Workspace(tmp_path / ".sysid").save(robot_model(), {})
    (tmp_path / "mission.yaml").write_text("goal: [1, 0]\n")
    commands = shown(page)
    assert {"export", "verify"} == {words[0] for words in commands}
    for words in commands:
        done = run(capsys, *words)
        assert done.code == 0, (words, done.err)
    assert "passed" in done.out
