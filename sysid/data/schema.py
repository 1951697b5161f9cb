"""Check stored files against a schema: a frozen dataclass whose fields describe the file.

pydantic does the checking. It is imported when the first file is read, and reads the dataclasses as
they are: what only writes files, or only asks for help, does not wait for it.
"""

import json
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

STORED: Mapping[str, Any] = MappingProxyType({"extra": "forbid", "allow_inf_nan": False})
"""``__pydantic_config__`` of a schema: no key it does not know, no number that JSON cannot say."""

DAMAGED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)
"""What reading a document raises that is not what it should be, where no schema has caught it."""

Schema = TypeVar("Schema")


def checked(schema: type[Schema], raw: object, *, others: bool = False) -> Schema:
    """What was read from a JSON file, as its schema says: no text for a number, nothing missing.

    Args:
        schema: a frozen dataclass, or a type such as ``tuple[str, ...]``.
        raw: as ``json.loads`` gives it.
        others: whether the outermost object may hold more than the schema knows.

    Raises:
        ValueError: what does not fit, and where in the file.
    """
    from pydantic import ValidationError

    if others and isinstance(raw, Mapping):
        raw = {f.name: raw[f.name] for f in fields(schema) if f.name in raw}  # type: ignore[arg-type]
    kind: Any = schema
    try:
        # as text: only there lists may stand for tuples and objects for dataclasses, no more
        value: Schema = _adapter(kind).validate_json(json.dumps(raw), strict=True)
    except ValidationError as error:
        raise ValueError(_words(error.errors(include_url=False)[0])) from None
    except (TypeError, RecursionError):
        raise ValueError("it is not what JSON can hold") from None
    return value


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
    message = str(problem["msg"]).removeprefix("Input ")
    return f"{where}: it {message}" if where else f"it {message}"
