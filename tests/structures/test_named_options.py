"""A message names no option that the command it appears on does not have."""

import ast
import re
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
import typer
from sysid_cli.app import app

from sysid.data.excitation import DESIGNS

ROOT = Path(__file__).resolve().parents[2]
GROUP: Any = typer.main.get_command(app)
OPTIONS = {
    name: {word for p in command.params for word in p.opts}
    for name, command in GROUP.commands.items()
}
EVERYWHERE = {"--debug", "--workspace", "--version", "--help"}
"""Options of the root, which every line may hold."""

READS_LOGS = ("inspect", "fit", "compare", "simulate", "diagnose")
SHOWN_BY = {
    "sysid/data/preparation.py": ("inspect", "fit", "diagnose"),
    "sysid/data/": READS_LOGS,
    "sysid/estimation/selection/comparison.py": ("compare",),
    "sysid/estimation/assessment/figures.py": ("fit", "compare"),
    "sysid/estimation/": ("fit",),
    "sysid/structures/model.py": ("compare", "diagnose"),
    "sysid/structures/": ("fit",),
    "sysid/plant/": ("simulate", "export"),
    "sysid/mission/": ("simulate",),
    "sysid/discrepancy/": ("diagnose",),
    "cli/reading.py": READS_LOGS,
    "cli/mission_options.py": ("diagnose",),
    "cli/fit_options.py": ("fit",),
    "cli/packages.py": ("simulate", "diagnose"),
    "cli/targets.py": ("fit", "compare", "simulate"),
    "cli/structures.py": ("fit",),
    "cli/diagnose_report.py": ("compare",),
}
"""Module or folder → the commands whose messages it writes; the first that fits counts."""

WITH_COMMAND = re.compile(r"sysid (\w+)(?:(?!sysid)[^`\n])*?(--[a-z][a-z-]+)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


def messages(path: Path) -> Iterator[tuple[int, str]]:
    """Every text of a module but its docstrings, formatted ones with {} for their values."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    silent: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            silent.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            silent |= {id(part) for part in ast.walk(node) if part is not node}
    for node in ast.walk(tree):
        if id(node) in silent:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
        elif isinstance(node, ast.JoinedStr):
            parts = (p.value if isinstance(p, ast.Constant) else "{}" for p in node.values)
            yield node.lineno, "".join(map(str, parts))


def named() -> list[tuple[str, str, str]]:
    """(place, option, command) of every option a message of the source names."""
    found = []
    for path in sorted([*(ROOT / "sysid").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]):
        module = path.relative_to(ROOT).as_posix()
        shown = next((c for part, c in SHOWN_BY.items() if module.startswith(part)), None)
        if shown is None and path.stem in OPTIONS:
            shown = (path.stem,)
        for line, text in messages(path):
            if module == "cli/reading.py" and OPTION.fullmatch(text):
                continue  # declared there, for the commands that compose it
            said = {option: command for command, option in WITH_COMMAND.findall(text)}
            for option in set(OPTION.findall(text)) - EVERYWHERE:
                place = f"{module}:{line}"
                assert option in said or shown, f"{place} names {option}: which commands show it?"
                commands = (said[option],) if option in said else shown or ()
                found += [(place, option, command) for command in commands]
    return found


def test_every_option_a_message_names_is_one_of_the_command_that_shows_it() -> None:
    every = named()
    assert len(every) > 150
    wrong = [
        f"{place}: sysid {command} has no {option}"
        for place, option, command in every
        if option not in OPTIONS.get(command, set())
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("design", DESIGNS)
def test_every_argument_of_a_schedule_is_an_option(design: str) -> None:
    wanted = {f"--{p}" for p in signature(DESIGNS[design]).parameters} - {"--names"}
    assert wanted - OPTIONS["excite"] <= {"--rotate", "--tries"}  # --tracks opposite; not for users


def test_options_in_the_documentation_exist() -> None:
    """Inline code such as `--split`: an option of some command, of pytest, git or a script."""
    others = re.compile(r"^(python|\.venv|make|cc|pip|git|pytest|datasets)")
    known = set().union(*OPTIONS.values()) | EVERYWHERE
    wrong = []
    for page in (*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"):
        for code in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8")):
            if not others.match(code):
                wrong += [f"{page.name}: {o}" for o in OPTION.findall(code) if o not in known]
    assert not wrong, wrong
