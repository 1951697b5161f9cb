"""A model that was stored with friction before loads runs as it did, in Python and in C."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_programs import build, driven, needs_compiler

from sysid.data.record import Array
from sysid.errors import ModelError
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
    today = replace(model, structure=replace(model.structure, chain=2))
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
    assert raw["settings"]["chain"] == 2
    raw["settings"]["chain"] = 3
    with pytest.raises(ModelError, match="order 3"):
        structure_from_json(raw)


@pytest.mark.slow
@needs_compiler
def test_its_c_code_runs_as_it_did(tmp_path: Path) -> None:
    model, u, y = stored()
    program = build(tmp_path, model, "driver")["driver"]
    # other orders of addition and another libm: see test_c_nonlinear
    np.testing.assert_allclose(driven(program, u), y, rtol=0, atol=1e-10 * float(np.ptp(y)))
