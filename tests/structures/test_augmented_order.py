"""A model that was stored with friction before loads runs as it did, in Python and in C."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler

from sysid.data.record import Array, Record
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import prepare
from sysid.effects.base import ORDER
from sysid.effects.catalogue import effect, in_chain
from sysid.errors import ModelError
from sysid.runners.native import compiler
from sysid.structures.augmented.batch import Stepped
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model
from sysid.structures.physics import identified_effects
from sysid.structures.registry import structure_from_json, structure_to_json

OLDER = Path(__file__).parents[1] / "data" / "chain-1"
"""A model with six effects on the torque, and its run, as written before files named an order."""


def stored() -> tuple[Model, Array, Array]:
    """The model, the commands of its run, and its outputs."""
    rows = np.loadtxt(OLDER / "run.csv", delimiter=",", skiprows=1)
    return Model.load(OLDER / "model.json"), rows[:, :2], rows[:, 2:]


def test_an_older_model_runs_as_it_did() -> None:
    model, u, y = stored()
    np.testing.assert_allclose(model.simulate(u), y, rtol=0, atol=1e-12)  # the same arithmetic
    assert isinstance(model.structure, Augmented)
    today = replace(model, structure=replace(model.structure, chain=ORDER))
    assert np.max(np.abs(today.simulate(u) - y)) > 0.1  # the order matters here


def test_its_order_is_kept_in_its_file_and_by_what_makes_up_for_it(tmp_path: Path) -> None:
    model, u, y = stored()
    model.save(tmp_path / "again.json")
    again = Model.load(tmp_path / "again.json")
    np.testing.assert_allclose(again.simulate(u), y, rtol=0, atol=1e-12)
    assert json.loads((tmp_path / "again.json").read_text())["settings"]["chain"] == 1
    assert identified_effects(again.structure, again.theta).order == 1


def test_an_order_of_a_later_version_is_refused() -> None:
    raw = structure_to_json(Augmented(1, 1, (1.0,), 0.05, ("load-bias",)))
    assert raw["settings"]["chain"] == ORDER
    raw["settings"]["chain"] = ORDER + 1
    with pytest.raises(ModelError, match=f"order {ORDER + 1}"):
        structure_from_json(raw)


@pytest.mark.slow
@needs_compiler
def test_its_c_code_runs_as_it_did(tmp_path: Path) -> None:
    model, u, y = stored()
    program = build(tmp_path, model, "driver")["driver"]
    # other orders of addition and another libm: see test_c_nonlinear
    np.testing.assert_allclose(driven(program, u), y, rtol=0, atol=1e-10 * float(np.ptp(y)))


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
def test_the_compiled_run_knows_what_the_drive_makes() -> None:
    """Friction by load, a weight and a warm winding in the search as in the model."""
    some = in_chain(effect(id) for id in ("coulomb-friction", "gravity-load", "thermal-fade"))
    model = FullModel(some, 1, 1, np.array([5.0]), 0.02)
    u = np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, (20, 1)), 20, axis=0)
    data = prepare([Record(u, np.zeros_like(u), 0.02)], np.ones(1), 1)
    q = model.null
    model.set_core(q, 0, 6.0, np.array([-0.92]))
    for name, value in {
        ("coulomb-friction", "level"): 0.4, ("coulomb-friction", "of_load"): 0.25,
        ("coulomb-friction", "by_load"): 1.0, ("gravity-load", "sine"): 1.2,
        ("thermal-fade", "loss"): 0.8, ("thermal-fade", "time"): 5.0,
    }.items():  # fmt: skip
        q[model.index[*name, 0]] = value
    stepped = Stepped(model.effects, 1, 1, 0.02)
    expected = stepped.run(q[None], model.null, model._entries, data.signals)
    np.testing.assert_allclose(model.run(q, data), expected, atol=1e-9)
    assert np.std(expected) > 0.5
