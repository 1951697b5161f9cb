"""Values as JSON text, for the documents of commands and the files of the workspace."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
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
    if value is None or (isinstance(value, bool | int) and not isinstance(value, Enum)):
        return value
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, str):
        return visible(str(value))
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {visible(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, PathLike):
        return visible(str(fspath(value)))
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if hasattr(value, "tolist"):  # NumPy, without importing it for commands that need none
        return plain(value.tolist())
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


class Document:
    """A dataclass that is its own document: its fields, as they are in JSON."""

    def to_json(self) -> dict[str, Any]:
        """{name of a field: its value}, documents within it as they write themselves."""
        return {f.name: _held(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]


def _held(value: Any) -> Any:
    if isinstance(value, Document):
        return value.to_json()
    if isinstance(value, Mapping):
        return {key: _held(item) for key, item in value.items()}
    return [_held(item) for item in value] if isinstance(value, list | tuple) else value


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
