"""Mapping of a bag's fields to columns: ``omega_l = /joint_states.velocity[wheel_left]``."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.data.bags.fields import Step, steps_of
from sysid.data.yaml_files.source import read_yaml
from sysid.errors import UsageError

POSE = "pose"
"""A column of this name stands for three: x, y, psi of the pose at its path."""

EXAMPLE = "omega_l=/joint_states.velocity[wheel_left]"
FILES = (".yaml", ".yml")

_NAME = re.compile(r"(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
_SOURCE = re.compile(r"(?P<factor>-|[-+]?[0-9.]+(?:[eE][-+]?\d+)?\s*\*)?\s*(?P<path>/?[A-Za-z_].*)")


@dataclass(frozen=True)
class Source:
    """Where a column comes from.

    Attributes:
        unit: of the numbers in the bag where it is stated, else empty.
        factor: the column is so many times the field.
        topic: where its messages are.
        steps: of the path in a message; none for a message of a single number.
    """

    name: str
    unit: str
    factor: float
    topic: str
    steps: tuple[Step, ...]


def sources(mapping: Mapping[str, str]) -> tuple[Source, ...]:
    """The columns of a mapping, in its order.

    Args:
        mapping: column, with a unit in brackets or without, to ``/topic.field``; a minus before
            the path turns the sign, ``0.5*`` scales.
    """
    columns = tuple(_source(name, path) for name, path in mapping.items())
    names = [s.name for s in columns]
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise UsageError(f"`map` names {twice[0]} twice; give each column one field")
    return columns


def _source(name: str, path: str) -> Source:
    named, where = _NAME.fullmatch(name.strip()), _SOURCE.fullmatch(path.strip())
    topic, _, field = where["path"].partition(".") if where else ("", "", "")
    if named is None or where is None or not topic:
        raise UsageError(
            f"`map` cannot read {name}={path}; write a column, the topic and the field in it, "
            f"such as {EXAMPLE}"
        )
    if "[" in topic:
        topic, sign, rest = topic.partition("[")
        field = f"{sign}{rest}" + (f".{field}" if field else "")
    text = (where["factor"] or "1").rstrip("* ")
    try:
        factor = -1.0 if text == "-" else float(text)
    except ValueError:
        raise UsageError(f"`map` cannot read the factor {text!r} of {name}") from None
    if factor == 0.0:
        raise UsageError(f"`map` scales {name} by 0; give another factor")
    topic = topic if topic.startswith("/") else f"/{topic}"
    return Source(named["name"].strip(), named["unit"] or "", factor, topic, steps_of(field))


def mapping_of(given: Sequence[str]) -> dict[str, str]:
    """Column → field, from texts ``NAME=/topic.field`` and names of YAML files that hold such."""
    mapping: dict[str, str] = {}
    for text in given:
        name, sign, path = text.partition("=")
        if not sign and Path(text).suffix.lower() in FILES:
            added = _of_file(Path(text))
        elif name.strip() and path.strip():
            added = {name.strip(): path.strip()}
        else:
            raise UsageError(
                f"`map` cannot read {text!r}; write NAME=/topic.field such as {EXAMPLE}, or name "
                "a YAML file of such lines"
            )
        for column in added.keys() & mapping.keys():
            raise UsageError(f"`map` names {column} twice; give each column one field")
        mapping |= added
    sources(mapping)
    return mapping


def _of_file(path: Path) -> dict[str, str]:
    read = read_yaml(path)
    for name, value in read.values.items():
        if not isinstance(value, str):
            raise UsageError(
                f"{read.where((name,))}: {name} needs the path of a field, such as "
                f"{EXAMPLE.partition('=')[2]}"
            )
    return {str(n): str(v) for n, v in read.values.items()}
