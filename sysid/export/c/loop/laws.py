"""Parameters of a law, found and replaced one by one."""

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from pydantic import BaseModel

from sysid.export.c.loop.trees import Path

SCHEDULE = ("period",)
"""Numbers that say when a step is called: they are the caller's."""


def numbers(law: Any, path: Path = ()) -> Iterator[tuple[Path, float]]:
    """The floats of a law and of the laws inside it, by their places."""
    for name, value in _fields(law):
        if type(value) is float and name not in SCHEDULE:
            yield (*path, name), value
        elif isinstance(value, BaseModel) or is_dataclass(value):
            yield from numbers(value, (*path, name))


def with_numbers(law: Any, given: Mapping[Path, Any], path: Path = ()) -> Any:
    """The same law with other numbers at these places, taken as they are."""
    changed: dict[str, Any] = {}
    for name, value in _fields(law):
        place = (*path, name)
        if place in given:
            changed[name] = given[place]
        elif isinstance(value, BaseModel) or is_dataclass(value):
            inner = with_numbers(value, given, place)
            if inner is not value:
                changed[name] = inner
    if not changed:
        return law
    if isinstance(law, BaseModel):
        return law.model_copy(update=changed)
    return replace(law, **changed)


def _fields(law: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(law, BaseModel):
        yield from ((name, getattr(law, name)) for name in type(law).model_fields)
    elif is_dataclass(law) and not isinstance(law, type):
        yield from ((f.name, getattr(law, f.name)) for f in fields(law))


_ATTRIBUTE = re.compile(r"(\w+(?:, \w+)*): (.+)")
_UNITS = re.compile(r"\s*\[([^\]]*)\]")


def documented(law: Any, path: Path) -> tuple[str, str]:
    """(unit, words) of a number, as the docstring of its class has them; empty where it has none.

    A docstring lists ``name, other: words [unit of the one, unit of the other].``
    """
    for name in path[:-1]:
        law = getattr(law, name, None)
    section = (inspect.getdoc(type(law)) or "").partition("Attributes:")[2]
    joined = re.sub(r"\n {5,}", " ", section)  # a line that goes on is indented further
    for line in joined.splitlines():
        match = _ATTRIBUTE.match(line.strip())
        names = match[1].split(", ") if match else []
        if match and path[-1] in names:
            units = _UNITS.search(match[2])
            several = units[1].partition(" is ")[0].split(", ") if units else [""]
            at = names.index(path[-1])
            single = len(several) != len(names) or (units and " is " in units[1])
            unit = several[0] if single else several[at]
            words = _UNITS.sub("", match[2]).partition(";")[0].strip(" .`")
            return _plain(unit), _plain(words)
    return "", ""


def _plain(text: str) -> str:
    """Text without marks of reStructuredText."""
    return re.sub(r":\w+:`[^`]*`|`", "", text)
