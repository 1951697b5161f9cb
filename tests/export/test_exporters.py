"""Formats of a plant: those that come along, and those of other packages."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest
from command_line import Capture, run
from plant_models import robot_model

from sysid.errors import ModelError, UsageError
from sysid.export import registry
from sysid.export.base import Exporter, Source
from sysid.export.package import package_files, write_package
from sysid.plant.package import CARD, load_plant, read_package
from sysid.workspace.store import Workspace

THERE = "json, c, fmu, fmu3, ros, table, broken"
"""Every format, two of other packages among them."""


class Table(Exporter):
    """A format that is not ours: text and bytes."""

    name: ClassVar[str] = "table"
    title: ClassVar[str] = "table"
    most: ClassVar[int] = 2

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        if len(source.model.outputs) > self.most:
            raise ModelError(f"a table holds {self.most} output")
        return {
            "y.txt": f"{source.selftest.y[-1, 0]!r}\n",
            "raw/y.bin": source.selftest.y.tobytes(),
        }

    def usage(self) -> str:
        return "Read `table/y.txt`.\n"


class _Point:
    """An entry point, as importlib.metadata gives it."""

    dist = None

    def __init__(self, name: str, made: Any) -> None:
        self.name, self.value, self.made = name, f"theirs:{name}", made

    def load(self) -> Any:
        if isinstance(self.made, Exception):
            raise self.made
        return self.made


@pytest.fixture(autouse=True)
def others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two formats of other packages, one of them broken."""
    result = [_Point("table", Table), _Point("broken", ImportError("No module named 'fmu'"))]
    monkeypatch.setattr(registry, "points", lambda group: {p.name: p for p in result})


def test_every_format_of_the_package_loads_and_is_called_what_it_calls_itself() -> None:
    assert ", ".join(registry.names()) == THERE
    for name in (*registry.BUILT_IN, "table"):
        made = registry.exporter(name)
        assert made.name == name
        assert made.title
    assert set(registry.DEFAULT) <= set(registry.BUILT_IN)


@pytest.mark.parametrize(
    ("formats", "error", "words"),
    [
        (["fmi"], UsageError, f"there is no format 'fmi'; choose from {THERE}"),
        ([" "], UsageError, f"no format is named; choose from {THERE}"),
        (["json", "broken"], UsageError, "theirs:broken cannot be imported (No module"),
    ],
)
def test_formats_that_cannot_be_used(formats: list[str], error: type, words: str) -> None:
    with pytest.raises(error) as caught:
        package_files(robot_model("arx"), formats=formats)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_formats_say_what_stands_beside_the_package() -> None:
    model = robot_model("arx")
    package = {"plant.json", "selftest.csv", CARD}
    sources = ("plant.c", "plant.h", "selftest.c", "Makefile", "CMakeLists.txt")
    c = {f"c/{n}" for n in (*sources, "report.md", "simulink/plant_sfun.c")}
    table = {"table/y.txt", "table/raw/y.bin"}
    for formats, more in [
        (None, c),
        (["json"], set()),
        (["c"], c),
        (["JSON", "c", "c"], c),
        (["c", " table"], c | table),
    ]:
        files = package_files(model, formats=formats)
        assert set(files) == package | more
        assert json.loads(files["plant.json"])["files"] == sorted(set(files) - {"plant.json", CARD})
        card = files[CARD].decode()
        assert ("cc -std=c99" in card) == ("c/plant.c" in files)
        assert ("Read `table/y.txt`." in card) == ("table/y.txt" in files)


def test_a_format_that_cannot_write_a_plant_is_an_error_only_where_it_was_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = robot_model("arx")
    monkeypatch.setattr(Table, "most", 1)
    with pytest.raises(ModelError, match="a table holds 1 output"):
        package_files(model, formats=["table"])
    monkeypatch.setattr("sysid.export.package.DEFAULT", ("json", "table"))
    card = package_files(model)[CARD].decode()
    assert "There is no table: a table holds 1 output." in card
    assert "table/y.txt" not in card


def test_an_exporter_writes_inside_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Table, "files", lambda self, source: {"../../y.txt": ""})
    with pytest.raises(ModelError, match="is not a valid file name in a package"):
        package_files(robot_model("arx"), formats=["table"])


@pytest.mark.parametrize("name", ["plant", "plant.zip"])
def test_files_of_another_format_are_covered_by_the_hash_and_replaced(
    tmp_path: Path, name: str
) -> None:
    model = robot_model("arx")
    path = write_package(model, tmp_path / name, formats=["table"])
    assert read_package(path).notes == ()
    if path.is_dir():
        (path / "table" / "y.txt").write_text("0.0\n")
        with pytest.raises(ModelError, match="changed after it was exported"):
            load_plant(path)
    write_package(model, path)
    assert read_package(path).notes == ()
    assert not (tmp_path / name / "table").exists()


@pytest.mark.parametrize(
    "names", [["../../secret"], ["/etc/passwd"], ["c\\..\\x"], ["c:x"], [""], ["a//b"], 3, [3]]
)
def test_a_list_of_files_that_leads_out_of_the_package_is_refused(
    tmp_path: Path, names: object
) -> None:
    path = write_package(robot_model("arx"), tmp_path / "p")
    raw = json.loads((path / "plant.json").read_text())
    (path / "plant.json").write_text(json.dumps(raw | {"files": names}))
    with pytest.raises(ModelError, match="its list of files"):
        read_package(path, accept_changes=True)


def test_formats_are_chosen_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    Workspace(Path(".sysid")).save(robot_model("arx"), {})
    made = run(capsys, "export", "--format", "json,table", "-o", "p", "--json").document
    own = ["README.md", "plant.json", "selftest.csv"]
    assert made["files"] == [*own, "table/raw/y.bin", "table/y.txt"]
    assert made["selftest"]["max_error"] < 1e-9
    refused = run(capsys, "export", "--format", "fmi")
    assert refused.code == 2
    assert refused.err.count("\n") == 1
    assert f"choose from {THERE}" in refused.err
