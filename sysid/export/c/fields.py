"""Members of the C structs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.runners.trace.writing import comment


@dataclass(frozen=True)
class Field:
    """One member of a struct.

    Attributes:
        name: as C.
        unit: SI, empty for none.
        size: entries of an array; 0 for a single number.
        values: of a parameter, as it was exported, one for each entry.
    """

    name: str
    unit: str = ""
    words: str = ""
    size: int = 0
    values: tuple[float, ...] = ()


def members(fields: Sequence[Field]) -> Iterator[str]:
    """Lines that declare them."""
    if not fields:
        yield "    char none; /* nothing */"
    for f in fields:
        size = f"[{f.size}]" if f.size else ""
        unit = f"[{f.unit}] " if f.unit else ""
        words = f"{unit}{f.words}".strip()
        said = f" /* {comment(words)} */" if words else ""
        yield f"    double {f.name}{size};{said}"


def places(fields: Sequence[Field]) -> Iterator[tuple[str, float]]:
    """Every number of a struct of parameters by its place in C, and its value."""
    for f in fields:
        if not f.size:
            yield f.name, f.values[0]
        for k in range(f.size):
            yield f"{f.name}[{k}]", f.values[k]


def numbers(fields: Sequence[Field]) -> int:
    """How many numbers they hold."""
    return sum(max(f.size, 1) for f in fields)
