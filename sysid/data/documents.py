"""Values as JSON text, for the documents of commands and the files of the workspace.

A dataclass is an object of its fields. A field that a file calls otherwise says so:
``field(metadata={"alias": "sample_time"})``, and ``{"exclude": True}`` one that is not written;
pydantic, with which :mod:`sysid.data.schema` reads the file, knows these words too. A class whose
document is not that of its fields alone has ``to_json``.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from enum import Enum
from os import PathLike, fspath
from typing import Any

from sysid.outside_text import visible


def plain(value: Any) -> Any:
    """``value`` made of dict, list, str, int, float, bool and None only.

    Texts have no control characters (see ``outside_text``). Numbers that are not finite become
    None, because JSON has none; NumPy scalars and arrays become numbers and lists, paths text.

    Raises:
        TypeError: there is something in it that JSON cannot say.
    """
    if isinstance(value, Enum) or hasattr(value, "to_json"):
        return plain(_inside(value))
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, str):
        return visible(str(value))
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return plain_object(value)
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    return plain(_inside(value))


def plain_object(pairs: Mapping[Any, Any]) -> dict[str, Any]:
    """A mapping whose values are made plain; see :func:`plain`."""
    return {visible(str(key)): plain(item) for key, item in pairs.items()}


def _inside(value: Any) -> Any:
    """What is written of an object."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, PathLike):
        return str(fspath(value))
    if is_dataclass(value) and not isinstance(value, type):
        return by_field(value)
    if hasattr(value, "tolist"):  # NumPy, without importing it for commands that need none
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def name_in_file(field: "Field[Any]") -> str:
    """What a file calls a field of a dataclass."""
    return str(field.metadata.get("alias", field.name))


def by_field(value: Any, *, defaults: bool = True) -> dict[str, Any]:
    """The fields of a dataclass as a file calls them; their values as they are.

    Args:
        defaults: whether fields are among them that have the value of ``type(value)()``.
    """
    shown = [f for f in fields(value) if not f.metadata.get("exclude")]
    kept = {name_in_file(f): getattr(value, f.name) for f in shown}
    if defaults:
        return kept
    usual = by_field(type(value)())
    return {k: v for k, v in kept.items() if v != usual[k]}


MAX_BYTES = 64 * 1024**2
"""Stored documents beyond this size are refused before they are read."""

MAX_DEPTH = 40
"""Lists and objects within each other; ours have less than ten."""

MAX_DIGITS = 18
"""Digits of a whole number that is kept as one; a longer one is read as a float."""


def parsed(content: str | bytes) -> Any:
    """What a JSON document holds.

    Raises:
        ValueError: it is no JSON, too large or too deep, or a number in it is not finite; a few
            words that fit into brackets.
    """
    if len(content) > MAX_BYTES:
        raise ValueError(f"larger than {MAX_BYTES // 1024**2} MB")
    try:
        value = json.loads(
            content.decode("utf-8") if isinstance(content, bytes) else content,
            parse_int=lambda digits: (
                int(digits) if len(digits) <= MAX_DIGITS else _finite(float(digits))
            ),
            parse_float=lambda digits: _finite(float(digits)),
            parse_constant=lambda name: _finite(float(name)),
        )
    except RecursionError:
        raise ValueError("nested too deep") from None
    except ValueError as error:
        raise ValueError("not JSON" if "finite" not in str(error) else str(error)) from None
    level, depth = [value], 0
    while level:  # level by level, without recursion
        if (depth := depth + 1) > MAX_DEPTH:
            raise ValueError("nested too deep")
        nested = [v for v in level if isinstance(v, dict | list)]
        level = [i for v in nested for i in (v.values() if isinstance(v, dict) else v)]
    return value


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("a number is not finite")
    return value


def text(value: Any, *, ascii_only: bool = False) -> str:
    """``value`` as one indented JSON document that ends in a newline."""
    return json.dumps(plain(value), indent=1, allow_nan=False, ensure_ascii=ascii_only) + "\n"
