"""What is stored is read by its schema: what is damaged is named, and taken for nothing else."""

import json
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

from sysid.data.schema import STORED, checked
from sysid.errors import ModelError
from sysid.plant.description import to_model
from sysid.structures.model import Model

OLDER = Path(__file__).parent / "0.1"
MODELS = {
    path.stem: json.loads(path.read_text())["model"]
    for path in sorted((OLDER / "workspace" / "models").glob("*.json"))
}
PLANT = json.loads((OLDER / "workspace" / "plant" / "plant.json").read_text())

READ_NOT = {"name", "properties", "fit", "termination", "data", "warnings", "options", "version"}
"""Keys of plant.json that tell a person of the plant; a runtime does without."""


def wrong(value: Any) -> list[Any]:
    """Values of other kinds than the one that stands there."""
    kind = int if isinstance(value, float) else type(value)  # 3 is as good a number as 3.0
    return [v for v in ("text", 3, None, [1], {"a": 1}, True) if type(v) is not kind]


@pytest.mark.parametrize("id", MODELS)
def test_each_key_of_a_model_is_needed_and_of_one_kind(id: str) -> None:
    whole = MODELS[id]
    Model.from_json(whole)
    for key, value in whole.items():
        for damage in ({}, *({key: v} for v in wrong(value))):
            if key in ("level", "settings") and damage.get(key) is None:
                continue  # a model may do without, or say so
            raw = {k: v for k, v in whole.items() if k != key} | damage
            with pytest.raises(ModelError) as caught:
                Model.from_json(deepcopy(raw))
            assert "\n" not in str(caught.value), (key, damage)


@pytest.mark.parametrize("key", sorted(PLANT.keys() - READ_NOT - {"schema", "content_sha256"}))
def test_each_key_of_a_plant_is_needed_and_of_one_kind(key: str) -> None:
    to_model(PLANT, "here").plant()
    for damage in ({}, *({key: v} for v in wrong(PLANT[key]))):
        with pytest.raises(ModelError, match="here") as caught:
            to_model({k: v for k, v in PLANT.items() if k != key} | damage, "here")
        assert "\n" not in str(caught.value), damage


@dataclass(frozen=True)
class _Inner:
    size: float
    unit: str = ""


@dataclass(frozen=True)
class _File:
    __pydantic_config__: ClassVar[Any] = STORED

    count: int
    parts: tuple[_Inner, ...] = ()


@pytest.mark.parametrize(
    ("raw", "says"),
    [
        ({}, "'count' is missing"),
        ({"count": "3"}, "count: a number is missing"),
        ({"count": True}, "count: a number is missing"),
        ({"count": 3, "more": 1}, "'more' is not known"),
        ({"count": 3, "parts": [{"size": 1}, {}]}, "'size' is missing in parts.1"),
        ({"count": 3, "parts": [{"size": "1"}]}, "parts.0.size: a number is missing"),
        ({"count": 3, "parts": [{"size": 1, "colour": 2}]}, "'colour' is not known in parts.0"),
        ({"count": 3, "parts": [{"size": float("nan")}]}, "parts.0.size: a number is not finite"),
        ({"count": 3, "parts": [{"size": 10**400}]}, "parts.0.size: a number is not finite"),
        ({"count": 3, "parts": [{"size": 1, "unit": 2}]}, "parts.0.unit: it should be"),
        ([], "it should be"),
    ],
)
def test_what_does_not_fit_is_said_with_its_place(raw: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        checked(_File, raw)


def test_what_fits_is_read_as_it_is() -> None:
    raw = {"count": 3, "parts": [{"size": 1, "unit": "m"}], "theirs": 2}
    assert checked(_File, raw, others=True) == _File(3, (_Inner(1.0, "m"),))
