"""What docs/mujoco.md shows runs as it stands there; without the extra one sentence names it."""

import re
import shlex
import sys
from pathlib import Path

import pytest
from command_line import Capture, run
from plant_models import robot_model

from sysid.cosim.multibody.engine import MISSING
from sysid.export.package import write_package

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "mujoco.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```(yaml|console)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
COMMANDS = [c for c in BLOCKS["console"].splitlines() if c.startswith("sysid ")]


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a plant, the page's mission and the bundled files where the page has them."""
    write_package(robot_model(), tmp_path / ".sysid" / "plant", formats=["json"])
    (tmp_path / "mission.yaml").write_text(BLOCKS["yaml"], encoding="utf-8")
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def needs_mujoco(command: str) -> bool:
    return command.startswith("sysid simulate") and not command.endswith("--motion kinematic")


def test_its_commands_run(shown: Path, capsys: Capture) -> None:
    pytest.importorskip("mujoco", reason="the extra physics is not installed")
    for command in COMMANDS:
        done = run(capsys, *shlex.split(command)[1:])
        assert done.code == 0, (command, done.err)
    for name in re.findall(r"\S+\.(?:svg|csv|xml)\b", BLOCKS["console"]):
        assert (shown / name).is_file(), name


def test_without_mujoco_one_sentence_names_the_extra(
    shown: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    # an engine that another test has made would be found again without an import
    monkeypatch.setattr("sysid.cosim.multibody.motion.engine", _made_anew)
    assert any(map(needs_mujoco, COMMANDS))
    for command in COMMANDS:
        done = run(capsys, *shlex.split(command)[1:])
        if needs_mujoco(command):
            assert done.code == 1, command
            said = " ".join(done.err.split())
            assert said.endswith(MISSING), said
            assert "Traceback" not in said
        else:
            assert done.code == 0, (command, done.err)


def _made_anew(*numbers: object) -> object:
    from sysid.cosim.multibody.engine import engine

    return engine.__wrapped__(*numbers)
