"""A package that was changed after its export is noticed, whatever was changed and however."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import Capture, robot_log, run
from plant_models import bench_model, robot_model

from sysid.errors import ModelError
from sysid.export.package import write_package
from sysid.plant.package import KEY, load_model, load_plant, read_package
from sysid.structures.model import Model
from sysid.workspace.store import Workspace


def describe(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    """An edit of plant.json."""

    def edit(package: Path) -> None:
        raw = json.loads((package / "plant.json").read_text())
        change(raw)
        (package / "plant.json").write_text(json.dumps(raw, indent=4))

    return edit


def text(name: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    """An edit of another file."""

    def edit(package: Path) -> None:
        (package / name).write_bytes(change((package / name).read_text()).encode())

    return edit


CHANGES = {
    "a parameter": describe(lambda r: r["blocks"][1]["parameters"][0].update(value=-0.5)),
    "an operating point": describe(lambda r: r["blocks"][0]["offset"].__setitem__(0, 1.5)),
    "the sample time": describe(lambda r: r.update(sample_time=0.2)),
    "the domain": describe(lambda r: r["domain"]["inputs"]["pwm_l"].__setitem__(1, 9e4)),
    "a key of one's own": describe(lambda r: r.update(note="mine")),
    "the hash": describe(lambda r: r.update({KEY: "0" * 64})),
    "the hash is no text": describe(lambda r: r.update({KEY: None})),
    "the self-test": text("selftest.csv", lambda s: s.replace("0", "1", 1)),
    "the C code": text("c/plant.c", lambda s: s + "/* mine */\n"),
    "the C code is gone": lambda package: shutil.rmtree(package / "c"),
}
HARMLESS = {
    "nothing": lambda package: None,
    "the layout of JSON": describe(lambda r: None),
    "the ends of lines": text("c/plant.c", lambda s: s.replace("\n", "\r\n")),
    "the model card": text("README.md", lambda s: s + "What we found out about it.\n"),
    "a compiled self-test": lambda package: (package / "c" / "selftest").write_bytes(b"\x7fELF"),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_a_changed_package_is_refused_unless_that_is_accepted(tmp_path: Path, kind: str) -> None:
    package = write_package(robot_model("arx"), tmp_path / "p")
    CHANGES[kind](package)
    for use in (load_plant, load_model, read_package):
        with pytest.raises(ModelError, match="changed after it was exported") as caught:
            use(package)
        assert "\n" not in str(caught.value)
    accepted = read_package(package, accept_changes=True)
    assert len(accepted.notes) == 1
    assert "taken as it is" in accepted.notes[0]
    assert load_plant(package, accept_changes=True).dt == accepted.plant().dt


@pytest.mark.parametrize("kind", HARMLESS)
def test_what_changes_no_content_is_accepted_in_silence(tmp_path: Path, kind: str) -> None:
    package = write_package(robot_model("arx"), tmp_path / "p")
    HARMLESS[kind](package)
    assert read_package(package).notes == ()


@pytest.mark.parametrize("structure", ["arx", "bj"])
def test_a_zip_has_the_hash_of_the_folder(tmp_path: Path, structure: str) -> None:
    model = bench_model(structure, 1, 1, 1)
    folder, one = (
        read_package(write_package(model, tmp_path / name)) for name in ("plant", "plant.zip")
    )
    assert folder.description[KEY] == one.description[KEY]
    assert folder.notes == one.notes == ()


def test_a_package_without_a_hash_is_read_with_a_note(tmp_path: Path) -> None:
    package = write_package(robot_model("arx"), tmp_path / "p")
    described = read_package(package).description
    describe(lambda r: r.pop(KEY))(package)
    read = read_package(package)
    assert len(read.notes) == 1
    assert "no hash" in read.notes[0]
    # the hash is all that a new file has and an old one has not
    assert {k: v for k, v in described.items() if k != KEY} == read.description


def test_the_commands_notice_a_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    log = robot_log(tmp_path / "log.csv")
    Path("m.yaml").write_text("goal: [1, 0]\n")
    assert run(capsys, "fit", log, "--structure", "arx", "--orders", "na=1 nb=1").code == 0
    assert run(capsys, "export").code == 0
    intact = run(capsys, "simulate", log, "--json").document
    CHANGES["a parameter"](Path(".sysid/plant"))
    lines = [
        ["simulate", "m.yaml"],
        ["simulate", log],
        ["diagnose", log, "--mission", "m.yaml", "--plant", ".sysid/plant"],
    ]
    for line in lines:
        refused = run(capsys, *line)
        assert refused.code == 1
        assert refused.err.count("\n") == 1
        assert "changed after it was exported" in refused.err
        assert "--accept-changes" in refused.err
    taken = run(capsys, "simulate", log, "--accept-changes", "--json").document
    assert "taken as it is" in taken["warnings"][0]
    assert taken["fit_percent"] != intact["fit_percent"]
    describe(lambda r: r.pop(KEY))(Path(".sysid/plant"))
    assert "no hash" in run(capsys, "simulate", log).err


def test_model_load_reads_the_models_of_a_workspace(tmp_path: Path) -> None:
    model = bench_model("oe", 1, 1, 1)
    stored = Workspace(tmp_path).save(model, {"fit": 1.0})
    model.save(tmp_path / "saved.json")
    for path in (stored.path, tmp_path / "saved.json"):
        assert Model.load(path).to_json() == model.to_json()
    package = write_package(model, tmp_path / "p")
    for path, words in ((package / "plant.json", "schema"), (tmp_path / "index.json", "schema")):
        with pytest.raises(ModelError, match=words) as caught:
            Model.load(path)
        assert str(path) in str(caught.value)
