"""Pages open with an example that runs as printed, after ``sysid demo`` in a fresh folder."""

import re
from pathlib import Path

import page_examples
import pytest
from sysid_cli import render
from sysid_cli.answer import LINES
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

OPENINGS = {
    "bench": "long",
    "c": "long",
    "choosing": "",
    "continuous-time": "long",
    "control": "long",
    "criteria": "long",
    "data": "long",
    "diagnose": "long",
    "diagnosis-algorithm": "long",
    "estimation": "long",
    "exporters": "long",
    "files": "long",
    "fit-vehicle": "long",
    "grey-box-file": "long",
    "guidance": "",
    "live": "long",
    "motion": "long",
    "navigation": "long",
    "plant-package": "long",
    "sensors": "long",
    "state-space": "long",
    "structures": "",
    "structures/dc-motor": "",
    "structures/hammerstein-wiener": "",
    "structures/narmax": "",
    "structures/narx-wavelet": "",
    "structures/tanks": "",
    "structures/wiener-hammerstein": "",
}
"""Pages of which the example that they open with is run."""

WITHOUT = {
    "api": "Python, which is run, below a paragraph",
    "architecture": "for developers of the workbench",
    "bags": "needs the extra ros and a recording",
    "commands": "generated",
    "effects": "generated",
    "extending": "for developers; tests/plugin runs its package",
    "fmu": "needs the extra fmu",
    "gate": "for developers of the workbench",
    "index": "an index",
    "mujoco": "needs the extra physics",
    "ros": "needs ROS",
}
"""Pages that open with no example, and why."""


def test_every_page_opens_with_an_example_or_says_why_not() -> None:
    docs = ROOT / "docs"
    pages = {str(p.relative_to(docs).with_suffix("")) for p in docs.rglob("*.md")}
    pages = {p for p in pages if not p.startswith("decisions/")}
    whole = {p.removeprefix("docs/").removesuffix(".md") for p in PAGES if p.startswith("docs/")}
    assert pages == whole | set(OPENINGS) | set(WITHOUT)
    for page in OPENINGS:
        assert any(page_examples.examples(docs / f"{page}.md", opening=True)), page


ANSWERED = re.compile(r"sysid (fit|diagnose|compare) (?!.*--(follow|full|json))")
"""Commands whose answers fit a screen; one that follows a log says more and more."""

SHOWN = [
    *((page, False, long) for page, long in PAGES.items()),
    *((f"docs/{page}.md", True, long) for page, long in OPENINGS.items()),
]
"""Page, whether only its opening is run, and whether that takes long."""


@pytest.mark.parametrize(
    ("page", "opening"),
    [pytest.param(p, o, marks=[pytest.mark.slow] if long else []) for p, o, long in SHOWN],
)
def test_a_page_runs_as_printed(
    page: str, opening: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(render, "SPOKEN_EVERY", 1e6)  # no lines on progress between the others
    assert main(["demo", "."]) == 0
    page_examples.drive(tmp_path / "drive.csv")
    for example in page_examples.examples(ROOT / page, opening=opening):
        if example.line.startswith(page_examples.NOT_RUN):
            continue
        lines = page_examples.printed(example)
        part = page_examples.missing(example.shown, lines)
        assert not part, "\n".join([f"$ {example.line}", *lines, "--- lacks", *part])
        if ANSWERED.match(example.line):
            assert len(lines) <= LINES, "\n".join(lines)
            assert max(map(len, lines)) <= 80, max(lines, key=len)


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
