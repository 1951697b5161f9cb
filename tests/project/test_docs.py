"""The documentation is tested like code: commands parse, links resolve, nothing is left out."""

import importlib
import inspect
import pkgutil
import re
import runpy
import shlex
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import scripts
import typer
from pydantic import BaseModel
from sysid_cli.app import app, main

import sysid
from sysid.criteria.table import BUILT_IN
from sysid.data.excitation import DESIGNS
from sysid.robot.mission.registry import ROLES, kinds, law_class
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.sensors.imperfect import ImperfectSensor
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import FrictionSpread, StartSpread, Variation
from sysid.structures.base import Structure
from sysid.structures.registry import structure_classes

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
        *DOCS.rglob("*.md"),
        *(ROOT / "reports").glob("*.md"),
        *(ROOT / "examples").rglob("*.md"),
        ROOT / "datasets" / "README.md",
    ]
)
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
WHOLE: Any = typer.main.get_command(app)
LINK = re.compile(r"(?<!`)!?\[[^\]\n]*\]\(([^)\s]+)\)")


def label(path: Path) -> str:
    return str(path.relative_to(ROOT))


def fenced(language: str) -> list[tuple[Path, str]]:
    """(page, text) of every fenced block in a language."""
    return [
        (page, block)
        for page in PAGES
        for kind, block in FENCE.findall(page.read_text(encoding="utf-8"))
        if kind == language
    ]


def shown_commands() -> list[tuple[str, str]]:
    """(page, command) of every line of a console block that runs sysid."""
    found = []
    for page, block in fenced("console"):
        lines = [line.removeprefix("$ ") for line in block.splitlines()]
        # an output line never begins with the program's name and a blank
        found += [(label(page), line) for line in lines if line.startswith("sysid ")]
    return sorted(set(found))


def anchor(heading: str) -> str:
    """The anchor GitHub gives a heading."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower().replace("`", ""))
    return kept.replace(" ", "-")


def anchors(page: Path) -> set[str]:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return {anchor(h) for h in re.findall(r"^#+ (.+)$", text, re.MULTILINE)}


def public(module: ModuleType) -> list[tuple[str, Any]]:
    """Public classes and functions that a module defines itself."""
    return [
        (f"{module.__name__}.{name}", value)
        for name, value in vars(module).items()
        if not name.startswith("_")
        and (inspect.isclass(value) or inspect.isfunction(value))
        and value.__module__ == module.__name__
    ]


def modules() -> list[str]:
    """Names of all modules of the package; imported by the tests, so that each fails alone."""
    return ["sysid", *(m.name for m in pkgutil.walk_packages(sysid.__path__, "sysid."))]


def test_there_are_commands_to_check() -> None:
    assert len(shown_commands()) > 15


@pytest.mark.parametrize(("page", "command"), shown_commands())
def test_shown_commands_parse(page: str, command: str) -> None:
    words = shlex.split(command)[1:]
    whole = WHOLE
    assert words[0] in whole.commands, f"{page}: there is no command {words[0]}"
    if hasattr(whole.commands[words[0]], "commands"):  # a group: the command is its second word
        whole, words = whole.commands[words[0]], words[1:]
        assert words[0] in whole.commands, f"{page}: there is no command {words[0]} of the group"
    # parses every option and argument, and runs nothing
    whole.commands[words[0]].make_context(f"sysid {words[0]}", words[1:])


@pytest.mark.parametrize("page", PAGES, ids=label)
def test_links_resolve(page: Path) -> None:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for target in LINK.findall(text):
        if re.match(r"https?://|mailto:", target):
            continue
        file, _, fragment = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        assert there.exists(), f"{label(page)} links to {target}, which is not there"
        if fragment and there.suffix == ".md":
            assert fragment in anchors(there), f"{label(page)}: no heading for {target}"


def test_every_page_is_linked_from_the_index() -> None:
    linked = {
        (page.parent / target.partition("#")[0]).resolve()
        for page in (DOCS / "index.md", DOCS / "decisions" / "README.md")
        for target in LINK.findall(page.read_text(encoding="utf-8"))
    }
    pages = {p for p in DOCS.rglob("*.md") if p.name != "index.md"}
    assert pages <= linked, f"not linked: {sorted(label(p) for p in pages - linked)}"


def test_command_page_is_up_to_date() -> None:
    fresh = scripts.load("docs/generate_commands.py").page()
    stored = (DOCS / "commands.md").read_text(encoding="utf-8")
    assert stored == fresh, "run python docs/generate_commands.py"


def test_effects_page_is_up_to_date() -> None:
    fresh = scripts.load("docs/generate_effects.py").page()
    stored = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert stored == fresh, "run python docs/generate_effects.py"


def test_every_command_and_option_has_help() -> None:
    silent = []
    for command in scripts.load("docs/generate_commands.py").commands():
        if not command.help:
            silent.append(command.name)
        silent += [f"{command.name} {p.names}" for p in command.parameters if not p.help]
    assert not silent, f"without help: {silent}"


@pytest.mark.parametrize("name", modules())
def test_public_names_have_docstrings(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__doc__, f"{module.__name__} has no docstring"
    for member, value in public(module):
        # a dataclass without one gets its signature for a docstring
        text = value.__doc__ or ""
        assert text.strip(), f"{member} has no docstring"
        assert not text.startswith(f"{value.__name__}("), f"{member} has no docstring of its own"


STRUCTURES = (DOCS / "structures.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("cls", structure_classes().values(), ids=lambda c: c.name)
def test_every_structure_and_order_is_described(cls: type[Structure]) -> None:
    assert f"| `{cls.name}` |" in STRUCTURES
    missing = [o for o in cls.traits.order_names if f"`{o}`" not in STRUCTURES]
    assert not missing, f"{cls.name}: orders {missing} are not in docs/structures.md"


def mission_keys(model: type[BaseModel] = Mission, prefix: str = "") -> list[str]:
    """Keys of a mission file, those of a section as section.key."""
    found = []
    for name, field in model.model_fields.items():
        if name in ("sensors", "vary"):
            found.append(name)  # its keys have a page of their own
            continue
        kind = law_class(name, kinds(name)[0]) if name in ROLES else field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found += mission_keys(kind, f"{name}.")
        else:
            found.append(f"{prefix}{name}")
    return found


def vary_keys() -> list[str]:
    """Keys of what varies from run to run, those of a part as part.key."""
    parts = {"start": StartSpread, "friction": FrictionSpread}
    inner = [f"{part}.{key}" for part, model in parts.items() for key in model.model_fields]
    return [*(k for k in Variation.model_fields if k not in parts), *inner]


def sensor_keys() -> list[str]:
    """Kinds of sensors, the keys that all of them have, and those of a kind as kind.key."""
    shared = ImperfectSensor.model_fields.keys()
    of_kinds = {k: law_class("sensors", k).model_fields.keys() - shared for k in kinds("sensors")}
    return [*shared, *of_kinds, *(f"{k}.{key}" for k, keys in of_kinds.items() for key in keys)]


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("criteria.md", list(BUILT_IN)),
        ("missions.md", [*mission_keys(), *(o.value for o in Outcome)]),
        ("sensors.md", sensor_keys()),
        ("monte-carlo.md", vary_keys()),
        ("data.md", list(DESIGNS)),
    ],
)
def test_reference_pages_are_complete(page: str, words: list[str]) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    missing = [w for w in words if f"`{w}`" not in text]
    assert not missing, f"docs/{page} does not say what {missing} are"


def test_every_finding_is_described() -> None:
    text = (DOCS / "data.md").read_text(encoding="utf-8")
    source = "".join(p.read_text(encoding="utf-8") for p in (ROOT / "sysid" / "data").rglob("*.py"))
    codes = set(re.findall(r"Finding\(\s*\"([a-z-]+)\"", source))
    assert len(codes) > 15
    missing = sorted(c for c in codes if f"| `{c}` |" not in text)
    assert not missing, f"docs/data.md does not say what to do about {missing}"


def test_json_keys_of_a_fit_are_described() -> None:
    from sysid_datasets import path

    from sysid.data.io import read_logs
    from sysid.estimation.identify import Request, identify

    text = (DOCS / "files.md").read_text(encoding="utf-8")
    found = identify(
        read_logs([path("rotation")]), [], Request(structures=("arx",), orders="na=1 nb=1")
    )
    keys = set(found.assessments[0].to_json())
    missing = sorted(k for k in keys if f"`{k}`" not in text)
    assert not missing, f"docs/files.md does not describe {missing}"


@pytest.mark.parametrize("block", [b for p, b in fenced("python") if p.name == "api.md"])
def test_python_examples_run(
    block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = tmp_path / "example.py"
    example.write_text(block, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "."]) == 0  # the examples read bundled logs
    capsys.readouterr()
    runpy.run_path(str(example))
    assert capsys.readouterr().err == ""
