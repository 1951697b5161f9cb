"""Errors in a hand-written file, each as one sentence with its line."""

import difflib
from collections.abc import Callable, Sequence

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from sysid.data.yaml_files.source import Place, YamlSource, shown

MOST_LINES = 10
"""Lines with further problems that a sentence names."""

KnownKeys = Callable[[Place], Sequence[str]]
"""The keys that there are in the section at a place."""


def first_problem(
    error: ValidationError,
    source: YamlSource,
    known_keys: KnownKeys,
    whole: str,
    examples: dict[str, str] | None = None,
) -> str:
    """Word the problem that comes first in the file, and name the lines of the others.

    Args:
        source: the file, for line numbers.
        known_keys: the keys there are in a section.
        whole: what the file describes, such as ``the mission``.
        examples: of keys that may be missing, as they would be written.

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
    lines = ", ".join(map(str, others[:MOST_LINES])) + (" …" if len(others) > MOST_LINES else "")
    more = f" (more to correct in line {lines})" if others else ""
    sentence = _sentence(problems[0], known_keys, whole, examples or {})
    return f"{source.name}:{first}: {sentence}{more}"


NAMED = "named"
"""Type of a custom error whose sentence begins behind the name of the key."""

_LIMITS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "of at least"),
    "less_than_equal": ("le", "of at most"),
    "less_than": ("lt", "below"),
}


def _sentence(
    details: ErrorDetails, known_keys: KnownKeys, whole: str, examples: dict[str, str]
) -> str:
    kind, place, value = details["type"], details["loc"], details["input"]
    name = _name(place) or whole
    if kind == "extra_forbidden":
        return _unknown(place, known_keys(place[:-1]))
    if kind == "missing":
        key = str(place[-1])
        return f"the key {name!r} is missing: add {examples.get(key, f'{key}: a number')}"
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
    if kind == "string_type":
        return f"{name} is {shown(value)}: write a text in quotes"
    if kind == "model_type" or kind == "dict_type":
        return f"{name} is {shown(value)}: write a section {{key: value}} with its settings"
    return str(details["msg"]).removeprefix("Value error, ")


def _unknown(place: Place, known: Sequence[str]) -> str:
    """Name an unknown key, the keys there are, and the one that was probably meant."""
    key = str(place[-1])
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.6) or [
        k for k in known if k.lower() == key.lower()
    ]
    advice = f"did you mean {close[0]!r}?" if close else f"the keys are {', '.join(known)}"
    section = f" in {_name(place[:-1])}" if place[:-1] else ""
    return f"unknown key {key!r}{section}: {advice}"


def sentence_at(place: tuple[str | int, ...], sentence: str) -> ValidationError:
    """The sentence as an error of the key at a place of the section that is checked."""
    error = PydanticCustomError("sentence", "{sentence}", {"sentence": sentence})
    details: InitErrorDetails = {"type": error, "loc": place, "input": None}
    return ValidationError.from_exception_data("file", [details])


def keys_of(model: type[BaseModel], place: Place) -> list[str]:
    """The keys of the section at a place, as the model of the whole file declares them."""
    for key in place:
        inner = model.model_fields[str(key)].annotation
        model = inner if isinstance(inner, type) and issubclass(inner, BaseModel) else model
    return list(model.model_fields)


def _name(place: Place) -> str:
    """Return ``obstacles[2].radius`` for the place (obstacles, 1, radius), counted from 1."""
    text = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{p}" for p in place)
    return text.lstrip(".")
