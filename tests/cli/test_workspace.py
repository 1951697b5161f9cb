"""The workspace keeps models in order, survives damage and commands that run at once."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plant_models import bench_model, robot_model

from sysid.errors import DataError, ModelError, UsageError
from sysid.structures.model import Model
from sysid.workspace.store import Workspace


@pytest.fixture
def place(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "w")


def variant(k: int) -> Model:
    """A model that differs from the others in one number."""
    return replace(bench_model("arx"), n_estimated=100 + k)


def test_a_model_comes_back_as_it_was_saved(place: Workspace) -> None:
    model = robot_model("oe")
    report = {"estimation": {"fit_percent": {"omega_l": np.float64(97.5), "x": float("nan")}}}
    stored = place.save(model, report)
    assert stored.id.startswith("oe-")
    assert len(stored.id) == len("oe-") + 6
    assert stored.path == place.root / "models" / f"{stored.id}.json"
    again = place.load(stored.id)
    assert again.model.to_json() == model.to_json()
    assert again.report == {"estimation": {"fit_percent": {"omega_l": 97.5, "x": None}}}
    assert set(json.loads(stored.path.read_text())) == {"id", "model", "report"}


def test_ids_depend_on_the_model_only(tmp_path: Path) -> None:
    first = Workspace(tmp_path / "a").save(variant(1), {})
    assert Workspace(tmp_path / "b").save(variant(1), {"note": "other"}).id == first.id
    assert Workspace(tmp_path / "b").save(variant(2), {}).id != first.id


def test_models_are_listed_in_the_order_of_saving(place: Workspace) -> None:
    ids = [place.save(variant(k), {}).id for k in range(6)]
    assert [s.id for s in place.all()] == ids
    assert len(set(ids)) == 6
    place.save(variant(2), {"again": True})  # the same model once more: now the newest
    assert [s.id for s in place.all()] == [*ids[:2], *ids[3:], ids[2]]
    assert place.load(ids[2]).report == {"again": True}
    assert place.remove(ids[0]) == ids[0]
    assert [s.id for s in place.all()] == [ids[1], *ids[3:], ids[2]]


def test_a_file_the_index_does_not_know_is_listed_too(place: Workspace) -> None:
    ids = {place.save(variant(k), {}).id for k in range(3)}
    (place.root / "index.json").unlink()
    assert {s.id for s in place.all()} == ids


def test_ids_may_be_shortened(place: Workspace) -> None:
    arx, oe = place.save(variant(1), {}).id, place.save(robot_model("oe"), {}).id
    assert place.load("oe").id == oe
    assert place.load(arx[:7]).id == arx
    assert place.remove("oe") == oe
    place.save(variant(2), {})
    with pytest.raises(UsageError, match="could be arx-"):
        place.load("arx-")
    for unknown in ("bj", "", "../models/x", "arx-zzzzzz"):
        with pytest.raises(UsageError, match=arx):
            place.load(unknown)


def test_colliding_ids_get_more_digits(place: Workspace) -> None:
    stored = place.save(variant(1), {})
    content = json.loads(stored.path.read_text())
    content["model"]["n_estimated"] = 7  # another model under this very id
    stored.path.write_text(json.dumps(content))
    second = place.save(variant(1), {})
    assert second.id.startswith(stored.id)
    assert len(second.id) == len(stored.id) + 1
    assert place.load(stored.id).id == stored.id  # the exact id wins over the longer one


def test_the_model_of_a_command_follows_the_latest_of_fit_and_compare(place: Workspace) -> None:
    with pytest.raises(ModelError, match="run `sysid fit` first"):
        place.chosen(None)
    ids = [place.save(variant(k), {}).id for k in range(4)]
    assert place.chosen(None).id == ids[3]  # nothing remembered: the newest
    place.remember("latest", [ids[1], ids[0]])
    assert place.chosen(None).id == ids[1]
    place.remember("best", ids[2])
    assert place.chosen(None).id == ids[2]
    assert place.chosen(ids[0][:9]).id == ids[0]
    place.remember("latest", [ids[0]])
    assert place.chosen(None).id == ids[0]
    place.remove(ids[0])
    assert place.chosen(None).id == ids[2]  # passed over what is gone
    with pytest.raises(UsageError, match="no model 'bj'"):
        place.chosen("bj")


DAMAGE = {
    "half a file": lambda text: text[: len(text) // 2],
    "not JSON": lambda text: "hello",
    "a list": lambda text: "[]",
    "another id": lambda text: text.replace('"id": "arx', '"id": "bj', 1),
    "no report": lambda text: text.replace('"report"', '"story"', 1),
    "another schema": lambda text: text.replace("sysid-model/1", "sysid-model/9"),
    "a package is gone": lambda text: text.replace('"structure": "arx"', '"structure": "own"'),
    "a channel too few": lambda text: text.replace('"inputs"', '"inputs": [], "old"', 1),
    "nested without end": lambda text: "[" * 100_000,
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_model_is_named_and_can_be_removed(place: Workspace, kind: str) -> None:
    place.save(variant(1), {})
    stored = place.save(variant(2), {})
    stored.path.write_text(DAMAGE[kind](stored.path.read_text()))
    models, unreadable = place.readable()
    assert len(models) == 1
    assert str(stored.path) in unreadable[stored.id]
    for use in (lambda: place.load(stored.id), lambda: place.chosen(None)):
        with pytest.raises(ModelError) as caught:
            use()
        assert str(stored.path) in str(caught.value)
        assert "\n" not in str(caught.value)
    place.remove(stored.id)
    assert len(place.all()) == 1


def test_saving_again_mends_a_damaged_model(place: Workspace) -> None:
    stored = place.save(variant(1), {})
    stored.path.write_text("{")
    assert place.save(variant(1), {}).id == stored.id
    assert place.load(stored.id).model.n_estimated == 101


@pytest.mark.parametrize("name", ["index.json", "state.json"])
@pytest.mark.parametrize("content", ["{", "3", '{"latest": 5}', "[1]"])
def test_damaged_bookkeeping_is_named(place: Workspace, name: str, content: str) -> None:
    place.save(variant(1), {})
    (place.root / name).write_text(content)
    with pytest.raises(ModelError, match=name.replace(".", r"\.")):
        place.chosen(None)


def test_a_workspace_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w").write_text("mine")
    for root in (tmp_path / "w", tmp_path / "w" / "below"):
        place = Workspace(root)
        with pytest.raises((UsageError, DataError)) as caught:
            place.save(variant(1), {})
        assert "w" in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match="is a file"):
        Workspace(tmp_path / "w").all()
    assert (tmp_path / "w").read_text() == "mine"


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_a_workspace_that_may_not_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w").mkdir(mode=0o500)
    with pytest.raises(DataError, match="choose another folder"):
        Workspace(tmp_path / "w").save(variant(1), {})


def test_reading_makes_nothing(tmp_path: Path) -> None:
    place = Workspace(tmp_path / "w")
    assert place.all() == []
    assert not place.root.exists()


SAVER = """
import sys, json
from dataclasses import replace
from pathlib import Path
from sysid.structures.model import Model
from sysid.workspace.store import Workspace
place = Workspace(Path(sys.argv[1]))
model = Model.load(Path(sys.argv[2]))
for k in range(15):
    stored = place.save(replace(model, n_estimated=1000 * int(sys.argv[3]) + k), {})
    place.remember(f"key{sys.argv[3]}-{k}", stored.id)
    place.all()
"""


def test_commands_that_run_at_once_lose_nothing(place: Workspace, tmp_path: Path) -> None:
    variant(0).save(tmp_path / "model.json")
    command = [sys.executable, "-c", SAVER, str(place.root), str(tmp_path / "model.json")]
    running = [subprocess.Popen([*command, str(k)]) for k in (1, 2, 3)]
    assert [p.wait(60) for p in running] == [0, 0, 0]
    assert len(place.all()) == 45
    order = [s.id for s in place.all()]
    state = json.loads((place.root / "state.json").read_text())
    for k in (1, 2, 3):  # each one's own models in the order it saved them
        own = [state[f"key{k}-{i}"]["value"] for i in range(15)]
        assert own == sorted(own, key=order.index)
    names = {p.name for p in place.root.iterdir()}
    assert names == {"models", "index.json", "state.json", ".lock"}
