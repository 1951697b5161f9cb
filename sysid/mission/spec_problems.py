"""What is wrong with a mission file, in words: one sentence with its line from all findings."""

import difflib
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sysid.mission.registry import ROLES, axes, kinds, law_class, section_class
from sysid.mission.yaml_source import Place, YamlSource, shown


def first_problem(error: ValidationError, source: YamlSource, model: type[BaseModel]) -> str:
    """Word the problem that comes first in the file, and name the lines of the others.

    Args:
        error: what pydantic found.
        source: the file, for line numbers.
        model: the model of the whole file, for the keys there are.

    Returns:
        ``file:line: what is wrong: what to do``.
    """

    def line(details: ErrorDetails) -> int:
        return int(source.where(details["loc"]).rpartition(":")[2])

    # A misspelt key is also a missing one: the spelling is what the reader has to hear about.
    problems = sorted(error.errors(), key=lambda p: (line(p), p["type"] == "missing"))
    for problem in problems:
        place = problem["loc"]
        if place and isinstance(place[-1], int) and place not in source.lines:
            problem["loc"] = place[:-1]  # one number that stands for all of a list
    first, *others = dict.fromkeys(line(p) for p in problems)
    more = f" (more to correct in line {', '.join(map(str, others))})" if others else ""
    return f"{source.name}:{first}: {_sentence(problems[0], model, source.values)}{more}"


NAMED = "named"
"""Type of a custom error whose sentence begins behind the name of the key."""

_LIMITS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "of at least"),
    "less_than_equal": ("le", "of at most"),
    "less_than": ("lt", "below"),
}


def _sentence(details: ErrorDetails, model: type[BaseModel], values: Mapping[str, Any]) -> str:
    kind, place, value = details["type"], details["loc"], details["input"]
    name = _name(place)
    if kind == "extra_forbidden":
        return _unknown(place, model, values)
    if kind == "missing":
        example = "goal: [1, 0]" if name == "goal" else f"{name}: a number"
        return f"the key {name!r} is missing: add {example}"
    if kind == NAMED:
        return f"{name} {details['msg']}"
    if kind in _LIMITS:
        context, words = _LIMITS[kind]
        limit = details.get("ctx", {}).get(context, 0)
        if context == "ge" and 0 < limit < 1e-3 and value <= 0:
            words, limit = "above", 0  # the small bound guards the arithmetic, not the meaning
        return f"{name} is {value:g}: give a number {words} {limit:g}"
    if kind == "finite_number":
        return f"{name} is {value}: give a finite number"
    if kind.startswith("float"):
        return f"{name} is {shown(value)}: give a number"
    if kind == "model_type" or kind == "dict_type":
        return f"{name} is {shown(value)}: write a section {{key: value}} with its settings"
    return str(details["msg"]).removeprefix("Value error, ")


def _unknown(place: Place, model: type[BaseModel], values: Mapping[str, Any]) -> str:
    """Name an unknown key, the keys there are, and the one that was probably meant."""
    key = str(place[-1])
    known = _known_keys(place[:-1], model, values)
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.6) or [
        k for k in known if k.lower() == key.lower()
    ]
    advice = f"did you mean {close[0]!r}?" if close else f"the keys are {', '.join(known)}"
    section = f" in {_name(place[:-1])}" if place[:-1] else ""
    return f"unknown key {key!r}{section}: {advice}"


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
    for key in place:
        inner = model.model_fields[str(key)].annotation
        model = inner if isinstance(inner, type) and issubclass(inner, BaseModel) else model
    return list(model.model_fields)


def _name(place: Place) -> str:
    """Return ``obstacles[2].radius`` for the place (obstacles, 1, radius), counted from 1."""
    text = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{p}" for p in place)
    return text.lstrip(".") or "the mission"
