"""The bundled files in a folder, and the five commands on them."""

import subprocess
import sys
from pathlib import Path

import pytest
import sysid_datasets
from command_line import Capture, contents, run
from sysid_cli import demo

NUMERIC = ("numpy", "scipy", "pandas", "yaml", "rich.table")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "sysid-demo"


def test_everything_that_is_bundled_is_copied(folder: Path, capsys: Capture) -> None:
    document = run(capsys, "demo", "--json").document
    assert document["commands"] == [*demo.COMMANDS]
    for kind, place in demo.FOLDERS.items():
        for path in (sysid_datasets.folder() / kind).glob("*.*"):
            assert (folder / place / path.name).read_bytes() == path.read_bytes()
    assert len(document["files"]) == len(contents(folder)) >= 26
    named = {w for line in demo.COMMANDS for w in line.split() if w.endswith((".csv", ".yaml"))}
    assert named <= {*document["files"]}


def test_it_may_be_asked_again_and_overwrites_no_change(folder: Path, capsys: Capture) -> None:
    first = run(capsys, "demo")
    assert first.out == run(capsys, "demo").out
    assert all(f"\n  {line}\n" in first.out for line in demo.COMMANDS)
    changed = folder / "prbs.csv"
    changed.write_text("mine")
    refused = run(capsys, "demo")
    assert (refused.code, refused.out) == (2, "")
    assert refused.err == "sysid-demo/prbs.csv was changed; name another folder, or remove it\n"
    assert changed.read_text() == "mine"
    assert run(capsys, "demo", "else/where").code == 0
    assert run(capsys, "demo", "--run", "--json").code == 2


def test_it_imports_no_numeric_library(folder: Path) -> None:
    code = (
        "import sys; from sysid_cli import app; app.main(['demo']); "
        f"sys.exit(str([m for m in {NUMERIC!r} if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr == "[]\n"


def test_a_command_that_fails_ends_the_run(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "COMMANDS", ("sysid models", "sysid export", "sysid models"))
    result = run(capsys, "demo", "--run")
    assert result.code == 1
    assert result.out.count("$ sysid models") == 1
    assert "$ sysid export" in result.out
    assert Path.cwd() == folder.parent


def test_the_commands_run_one_after_the_other(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As they are they are those of README.md, whose examples run; here the fit is a quick one."""
    first, fit, export, *others = demo.COMMANDS
    page = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    assert all(f"$ {line}\n" in page for line in (fit, export, *others))
    monkeypatch.setattr(demo, "COMMANDS", (first, f"{fit} --structure arx", export))
    result = run(capsys, "demo", "--run")
    assert result.code == 0, result.err
    assert (folder / ".sysid/plant/plant.json").is_file()
