"""Members of the C structs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

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

    @property
    def value(self) -> float:
        """Of a parameter that is a single number."""
        return self.values[0]


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


def listed(fields: Sequence[Field]) -> Iterator[Field]:
    """Every number of a struct of parameters as one of its own, by its place in C."""
    for f in fields:
        for k, value in enumerate(f.values):
            place = f"{f.name}[{k}]" if f.size else f.name
            yield replace(f, name=place, size=0, values=(value,))


def places(fields: Sequence[Field]) -> Iterator[tuple[str, float]]:
    """Every number of a struct of parameters by its place in C, and its value."""
    return ((f.name, f.value) for f in listed(fields))


def numbers(fields: Sequence[Field]) -> int:
    """How many numbers they hold."""
    return sum(max(f.size, 1) for f in fields)
