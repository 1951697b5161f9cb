"""What a comparison says of the cost of a step, and of what can be read off a model."""

from pathlib import Path

import pytest
from command_line import Capture, robot_log, run
from plant_models import ORDERS, robot_record

import sysid
from sysid.structures.registry import structure_classes


def test_a_comparison_tells_cost_and_meaning_of_each_model() -> None:
    log = robot_record()
    models = {name: sysid.fit(log, name, ORDERS[name]) for name in ("arx", "oe")}
    lines = sysid.compare(log, models).lines
    for line in lines:
        shown = line.to_json()
        assert 1e-7 < shown["step_time_s"] < 1e-2  # a handful of operations in Python
        assert "time constants" in shown["tells"]
        assert shown["n"] == line.contender.model.n_estimated


def test_every_family_says_what_it_tells() -> None:
    told = {name: cls.traits.tells for name, cls in structure_classes().items()}
    assert "physical constants" in told["dc-motor"]
    assert told["narx-wavelet"] == "the response only, no physical parameters"
    assert len(set(told.values())) >= 4


@pytest.mark.parametrize("name", ["dc-motor", "oe"])
def test_the_words_are_no_sentence(name: str) -> None:
    assert not structure_classes()[name].traits.tells.endswith(".")


def test_the_table_shows_cost_where_models_tell_different_things(
    tmp_path: Path, capsys: Capture
) -> None:
    log, place = robot_log(tmp_path / "a.csv"), ["--workspace", tmp_path / "ws"]
    one = ["--structure", "arx", "--orders", "na=1 nb=1 nk=1"]
    assert run(capsys, "fit", log, *one, *place).code == 0
    assert "µs a step" not in run(capsys, "compare", *place).out
    other = ["--structure", "hammerstein-wiener", "--orders", "nb=1 nf=1 nk=1"]
    assert run(capsys, "fit", log, *other, *place).code == 0
    shown = run(capsys, "compare", *place).out
    assert "µs a step" in shown
    assert "What the models reveal: " in shown
    assert "static curves" in shown
