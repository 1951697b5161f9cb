"""Check stored files against a schema: a frozen dataclass whose fields describe the file.

pydantic does the checking. It is imported when the first file is read, and reads the dataclasses as
they are: what only writes files, or only asks for help, does not wait for it.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar, get_type_hints

from sysid.data.documents import name_in_file

STORED: Mapping[str, Any] = MappingProxyType({"extra": "forbid", "allow_inf_nan": False})
"""``__pydantic_config__`` of a schema: no key it does not know, no number that JSON cannot say."""

DAMAGED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)
"""What reading a document raises that is not what it should be, where no schema has caught it."""

Schema = TypeVar("Schema")


@dataclass(frozen=True)
class Null:
    """What null in a file stands for, in a number or in an array of them.

    ``Annotated[float, Null()]`` is NaN, a number that is not defined; infinity is one that is not
    known or not bounded. An array is stored as lists of numbers and is read as float64.
    """

    stands_for: float = math.nan

    def __get_pydantic_core_schema__(self, source: Any, _: Any) -> Any:
        from pydantic_core import core_schema as kinds

        if source is not float:
            return kinds.no_info_plain_validator_function(self._array)
        number = kinds.nullable_schema(kinds.float_schema(allow_inf_nan=False))
        return kinds.no_info_after_validator_function(
            lambda value: self.stands_for if value is None else value, number
        )

    def _array(self, raw: Any) -> Any:
        import numpy as np

        def cells(part: Any) -> Any:
            if isinstance(part, list):
                return [cells(p) for p in part]
            if part is None:
                return self.stands_for
            if type(part) not in (int, float) or not math.isfinite(part):
                raise ValueError
            return part

        try:
            if isinstance(raw, list):
                return np.array(cells(raw), dtype=np.float64)
        except (ValueError, OverflowError):
            pass
        raise ValueError("should be a list of numbers, or of rows that are as long")


def checked(schema: type[Schema], raw: object, *, others: bool = False) -> Schema:
    """What was read from a JSON file, as its schema says: no text for a number, nothing missing.

    Args:
        schema: a frozen dataclass, or a type such as ``tuple[str, ...]``.
        raw: as ``json.loads`` gives it.
        others: whether the outermost object may hold more than the schema knows.

    Raises:
        ValueError: what does not fit, and where in the file.
    """
    if others and isinstance(raw, Mapping):
        known = [name_in_file(f) for f in fields(schema)]  # type: ignore[arg-type]
        raw = {name: raw[name] for name in known if name in raw}
    value: Schema = _valid(schema, raw)
    return value


def completed(schema: type[Schema], raw: Mapping[str, Any], **given: Any) -> Schema:
    """A dataclass of which a file holds some fields, each of them needed; the others are given.

    Args:
        raw: as ``json.loads`` gives it; it may hold more.
        given: fields that the file describes in words of its own.

    Raises:
        ValueError: what does not fit, and where in the file.
    """
    hints = get_type_hints(schema, include_extras=True)
    names = {f.name: name_in_file(f) for f in fields(schema)}  # type: ignore[arg-type]
    read = {name: key for name, key in names.items() if name not in given}
    for key in read.values():
        if key not in raw:
            raise ValueError(f"{key!r} is missing")
    return schema(
        **{name: _valid(hints[name], raw[key], key) for name, key in read.items()}, **given
    )


def _valid(schema: Any, raw: object, *place: str) -> Any:
    from pydantic import ValidationError

    try:
        # as text: only there lists may stand for tuples and objects for dataclasses, no more
        return _adapter(schema).validate_json(json.dumps(raw), strict=True)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        raise ValueError(_words({**problem, "loc": (*place, *problem["loc"])})) from None
    except (TypeError, RecursionError):
        raise ValueError("it is not what JSON can hold") from None


@cache
def _adapter(schema: Any) -> Any:
    from pydantic import TypeAdapter
    from pydantic_core import SchemaValidator

    return SchemaValidator(_ending_at_the_first(TypeAdapter(schema).core_schema))


def _ending_at_the_first(part: Any) -> Any:
    """pydantic's own description of a schema, its lists given up at the first item that is wrong:
    a million of these take it seconds, and only the first is shown."""
    if isinstance(part, Mapping):
        kept = {key: _ending_at_the_first(value) for key, value in part.items()}
        return {**kept, "fail_fast": True} if kept.get("type") in ("list", "tuple") else kept
    if isinstance(part, list | tuple):
        return type(part)(map(_ending_at_the_first, part))
    return part


def _words(problem: Mapping[str, Any]) -> str:
    """The first problem: what it is, and where."""
    *above, last = problem["loc"] or ("",)
    kind, place = problem["type"], ".".join(map(str, above))
    within = f" in {place}" if place else ""
    if kind.startswith("missing"):
        return f"{str(last)!r} is missing{within}"
    if kind.startswith("unexpected"):
        return f"{str(last)!r} is not known{within}"
    where = f"{place}.{last}" if place else str(last)
    if kind in ("float_type", "int_type"):
        return f"{where}: a number is missing"
    if kind == "finite_number":
        return f"{where}: a number is not finite"
    message = str(problem["msg"]).removeprefix("Input ").removeprefix("Value error, ")
    return f"{where}: it {message}" if where else f"it {message}"
