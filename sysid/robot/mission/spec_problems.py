"""Errors of a mission file in words: one sentence with its line."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.data.yaml_files import problems
from sysid.data.yaml_files.source import Place, YamlSource
from sysid.robot.mission.registry import ROLES, axes, kinds, law_class, section_class


def first_problem(error: ValidationError, source: YamlSource, model: type[BaseModel]) -> str:
    """Word the problem that comes first in the file, and name the lines of the others.

    Args:
        source: the file, for line numbers.
        model: the model of the whole file, for the keys there are.

    Returns:
        ``file:line: what is wrong: what to do``.
    """
    known = partial(_known_keys, model=model, values=source.values)
    return problems.first_problem(error, source, known, "the mission", {"goal": "goal: [1, 0]"})


def _known_keys(place: Place, model: type[BaseModel], values: Mapping[str, Any]) -> list[str]:
    section = str(place[0]) if place else ""
    if section == "obstacles":
        return ["at", "radius", "velocity"]
    if section == "sensors":
        chosen = place[1:2]
        return (
            list(law_class(section, str(chosen[0])).model_fields) if chosen else [*kinds(section)]
        )
    if section in ROLES:
        keys = values[section]
        for axis in axes(section):  # of a law put together from the laws of its axes
            if place[1:2] == (axis,):
                section, keys = f"{section}.{axis}", keys[axis]
        return ["kind", *section_class(section, keys)[0].model_fields]
    return problems.keys_of(model, place)
