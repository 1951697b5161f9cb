"""Pages open with an example that runs as printed, after ``sysid demo`` in a fresh folder."""

from pathlib import Path

import page_examples
import pytest
from sysid_cli import render
from sysid_cli.app import main

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "README.md": "long",
    "docs/first-csv.md": "long",
    "docs/from-matlab.md": "",
    "docs/from-python-control.md": "",
    "docs/missions.md": "",
    "docs/look.md": "long",
    "docs/forecast.md": "long",
    "docs/monte-carlo.md": "long",
    "docs/terramechanics.md": "",
    "docs/vehicle.md": "",
}
"""Pages whose examples are run, and whether they take more than a second."""


@pytest.mark.parametrize(
    "page", [pytest.param(p, marks=[pytest.mark.slow] if long else []) for p, long in PAGES.items()]
)
def test_a_page_runs_as_printed(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "SPOKEN_EVERY", 1e6)  # no lines on progress between the others
    assert main(["demo", "."]) == 0
    page_examples.drive(tmp_path / "drive.csv")
    for example in page_examples.examples(ROOT / page):
        if example.line.startswith(page_examples.NOT_RUN):
            continue
        lines = page_examples.printed(example)
        part = page_examples.missing(example.shown, lines)
        assert not part, "\n".join([f"$ {example.line}", *lines, "--- lacks", *part])


def test_the_readme_is_short_and_the_tour_is_the_demo() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    lines = [e.line for e in page_examples.examples(ROOT / "README.md")]
    assert lines[:3] == ["pip install sysid-workbench", "sysid demo", "cd sysid-demo"]


def test_an_example_that_prints_something_else_is_found() -> None:
    lines = ["a 1.00 oe-123abc", "b", "c 2", "d"]
    for good in (
        ["…", "b", "…"],
        ["a 1.001 oe-fffff0", "…"],
        ["…", "d"],
        lines,
        [],
        ["…", "c 2", "d"],
    ):
        assert page_examples.missing(tuple(good), lines) == []
    for bad in (["b", "…"], ["…", "c 3", "…"], ["…", "c 2"], ["…", "d", "…", "b", "…"], ["…", "e"]):
        assert page_examples.missing(tuple(bad), lines)
