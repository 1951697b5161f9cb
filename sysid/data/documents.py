"""Values as JSON text, for the documents of commands and the files of the workspace."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from os import PathLike, fspath
from typing import Any


def plain(value: Any) -> Any:
    """``value`` made of dict, list, str, int, float, bool and None only.

    Numbers that are not finite become None, because JSON has none; NumPy scalars and arrays
    become numbers and lists, paths become text.

    Raises:
        TypeError: there is something in it that JSON cannot say.
    """
    if value is None or (isinstance(value, bool | int) and not isinstance(value, Enum)):
        return value
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, str):
        return str(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, PathLike):
        return str(fspath(value))
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if hasattr(value, "tolist"):  # NumPy, without importing it for commands that need none
        return plain(value.tolist())
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def text(value: Any, *, ascii_only: bool = False) -> str:
    """``value`` as one indented JSON document that ends in a newline."""
    return json.dumps(plain(value), indent=1, allow_nan=False, ensure_ascii=ascii_only) + "\n"
