"""Files that the documentation names are there, or are what the commands write."""

import re
import shlex
import sys
import types
from pathlib import Path

import pytest
import quick_diagnosis
from command_line import Capture, run
from sysid_datasets import folder as bundled_folder

ROOT = Path(__file__).resolve().parents[2]
LISTED = re.compile(r"^ {4,6}([\w<>*./]+) {2,}\w", re.MULTILINE)
"""A line of an indented listing: the file, then what it is."""
SHOWN = re.compile(r"^\$ (sysid .*)$", re.MULTILINE)


def _page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_files_of_the_examples_are_bundled() -> None:
    """Commands that README shows with their output read logs that come with the package."""
    bundled = {p.name for p in bundled_folder().rglob("*.*")}
    named = re.findall(r"[\w-]+\.(?:csv|yaml)\b", " ".join(SHOWN.findall(_page("README.md"))))
    assert named
    assert {*named} - {"drive.csv"} <= bundled, sorted({*named} - bundled)  # that is the reader's


@pytest.mark.slow
def test_listed_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Each file that a page lists is there after the commands, under that very name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)
    engine = types.ModuleType("sysid.diagnosis.diagnose")
    engine.diagnose = quick_diagnosis.diagnose  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, engine.__name__, engine)
    quick_diagnosis.dead_zone_log(tmp_path / "log.csv")
    for line in (
        "fit log.csv --structure arx --orders 'na=1 nb=1'",
        "compare",
        "export",
        "simulate log.csv",
        "diagnose log.csv",
        "fit --follow log.csv --idle 0.2",
    ):
        done = run(capsys, *shlex.split(line))
        assert done.code == 0, (line, done.err)
    root = tmp_path / ".sysid"
    for page, folder in (("docs/files.md", root), ("docs/diagnose.md", root / "diagnosis")):
        listed = LISTED.findall(_page(page))
        assert len(listed) >= 3, page
        for name in listed:
            pattern = re.sub(r"<\w+>", "*", name).rstrip("/")
            assert list(folder.glob(pattern)), f"{page}: no command wrote {name}"
    table = re.findall(r"^\| ((?:`[\w./]+`(?:, )?)+) \|", _page("docs/plant-package.md"), re.M)
    files = [f for row in table for f in re.findall(r"`([\w./]+\.\w+)`", row)]
    assert len(files) >= 4
    for name in files:
        assert (root / "plant" / name).exists(), f"docs/plant-package.md: no export wrote {name}"
