"""A command that is killed loses nothing and leaves nothing half.

The states in which SIGKILL can leave a folder are those before each operation on files: one run of
a command passes all of them, and a copy of the folder is kept of each.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from command_line import Capture, run
from plant_models import robot_model

import sysid
from sysid.data.files import PART, settle
from sysid.plant.package import load_plant
from sysid.workspace.store import Workspace

VEHICLES = Path(sysid.__file__).parents[1] / "datasets" / "vehicles"

Contents = dict[str, bytes]

CHANGING = {"os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.chmod", "os.link", "os.truncate"}
"""Events of Python's audit that change a folder, beside files opened for writing."""

COMMANDS = {
    "fit": "fit log.csv --structure arx --orders 'na=2 nb=2'",
    "compare": "compare --val log.csv",
    "remove": "models remove arx",
    "export over a plant": "export --format json,c",
    "export over a zip": "export --format json,c -o plant.zip",
    "simulate over a log": "simulate mission.yaml -o drive.csv",
    "excite over a schedule": "excite prbs --duration 20 -o drive.csv",
    "vehicle over its files": "vehicle car.yaml --urdf car.urdf --mjcf car.xml",
}


@dataclass
class Recorder:
    """Copies a folder before each operation that changes it.

    Attributes:
        states: what lay in it.
        in_place: files opened for writing where others look for them: a kill leaves half of one.
        on: whether it looks; an audit hook cannot be removed.
    """

    root: Path
    copies: Path
    states: list[Path] = field(default_factory=list)
    in_place: list[str] = field(default_factory=list)
    on: bool = False

    def hear(self, event: str, arguments: tuple[object, ...]) -> None:
        """One event of Python's audit."""
        if not self.on:
            return
        writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_ACCMODE
        if not (writes or event in CHANGING) or not self._ours(arguments[0]):
            return
        self.on = False
        if writes and PART not in str(arguments[0]) and Path(str(arguments[0])).name != ".lock":
            self.in_place.append(str(arguments[0]))
        self.states.append(self.copies / str(len(self.states)))
        shutil.copytree(self.root, self.states[-1], symlinks=True)
        self.on = True

    def _ours(self, path: object) -> bool:
        if not isinstance(path, str | os.PathLike):
            return True  # a descriptor: rmtree walks by them
        return Path(os.path.abspath(path)).is_relative_to(self.root)


def contents(root: Path) -> Contents:
    """Every file by its name."""
    files = (p for p in root.rglob("*") if p.is_file() and p.name != ".lock")
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in files}


@pytest.fixture
def prepared(here: Path, capsys: Capture) -> Path:
    """A workspace with models, a plant, and outputs of earlier commands."""
    Workspace(Path(".sysid")).save(robot_model("arx"), {})
    assert run(capsys, "export", "-o", "plant.zip", "--format", "json").code == 0
    for name in ("drive.csv", "car.urdf", "car.xml"):
        Path(name).write_text("old\n")
    shutil.copy(VEHICLES / "ackermann.yaml", "car.yaml")
    return here


def killed_states(root: Path, copies: Path, command: Callable[[], object]) -> list[Path]:
    """The folders that a kill of the command may leave, the whole command's last."""
    copies.mkdir()
    recorder = Recorder(root, copies)
    sys.addaudithook(recorder.hear)
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # modules are no output
    recorder.on = True
    try:
        command()
    finally:
        recorder.on, sys.dont_write_bytecode = False, before
    assert not recorder.in_place
    shutil.copytree(root, copies / "done", symlinks=True)
    return [*recorder.states, copies / "done"]


@pytest.mark.parametrize("command", COMMANDS)
def test_whenever_it_is_killed_the_next_command_finds_the_old_or_the_new(
    command: str,
    prepared: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old, copies = contents(prepared), tmp_path_factory.mktemp("killed") / "copies"

    def whole() -> None:
        done = run(capsys, *shlex.split(COMMANDS[command]))
        assert done.code == 0, done.err

    states = killed_states(prepared, copies, whole)
    new = contents(prepared)
    assert len(states) > 3
    assert new != old
    seen: list[Contents] = []
    for state in states:
        monkeypatch.chdir(state)
        Workspace(Path(".sysid"))  # as every command that follows
        settle(state)  # as every command that writes there
        assert not [*state.rglob(f"{PART}*")]
        left = contents(state)
        for name in {*old, *new, *left}:
            assert left.get(name) in (old.get(name), new.get(name)), name
        if left not in seen:
            seen.append(left)
            load_plant(".sysid/plant")
            load_plant("plant.zip")
            assert run(capsys, "models", "--json").document["models"]
    assert len(seen) > 1


@pytest.mark.slow
def test_an_export_waits_for_the_workspace(here: Path) -> None:
    with Workspace(Path(".sysid")).locked():
        export = subprocess.Popen(
            [sys.executable, "-c", "from sysid_cli.app import main; main(['export', '--json'])"],
            stdout=subprocess.PIPE,
        )
        with pytest.raises(subprocess.TimeoutExpired):
            export.wait(2.0)
    assert export.wait(60.0) == 0
    assert export.stdout is not None
    assert b"plant" in export.communicate()[0]
