"""Upper bounds of the operations in a step of C."""

import re
from collections.abc import Sequence
from dataclasses import astuple, dataclass

_HEAD = re.compile(r"for \(int \w+ = 0; \w+ < (\d+);")
_INDEX = re.compile(r"\[[^\[\]]*\]")
_CALL = re.compile(r"\b([a-z][a-z0-9_]*)\(")
_OPERATOR = re.compile(r"(?<=[\w)\]]) ([-+*/]|[<>!=]=?|&&|\|\||\?) ")
_CHEAP = frozenset(["fabs", "floor", "ceil", "isnan", "isfinite"])
"""Functions of math.h that are an instruction or a few, not a series."""


@dataclass(frozen=True)
class Count:
    """How many operations.

    Attributes:
        compared: comparisons, choices between two values, absolute values, roundings to a whole.
        calls: of other functions of math.h: exponentials, sines, powers …
    """

    added: int = 0
    multiplied: int = 0
    divided: int = 0
    roots: int = 0
    compared: int = 0
    calls: int = 0

    def __add__(self, other: "Count") -> "Count":
        pairs = zip(astuple(self), astuple(other), strict=True)
        return Count(*(a + b for a, b in pairs))

    def __mul__(self, times: int) -> "Count":
        return Count(*(times * n for n in astuple(self)))


def counted(lines: Sequence[str]) -> Count:
    """What lines of a recorded step make at most, loops counted as often as they go round.

    Both sides of a choice are computed always, so that this is what every step takes. Places in
    arrays are not counted.
    """
    total, times = Count(), [1]
    for line in lines:
        text = line.strip()
        head = _HEAD.match(text)
        if head:
            times.append(times[-1] * int(head[1]))
        elif text == "}":
            times.pop()
        else:
            total += _of_line(text) * times[-1]
    return total


def _of_line(text: str) -> Count:
    """What one statement makes."""
    _, equals, value = text.partition(" = ")
    if not equals:
        value = text.partition(" += ")[2]
    plain = value
    while _INDEX.search(plain):
        plain = _INDEX.sub("", plain)
    signs = _OPERATOR.findall(plain)
    functions = [f for f in _CALL.findall(plain) if f not in ("double", "float", "int")]
    cheap = sum(f in _CHEAP for f in functions)
    roots = functions.count("sqrt")
    added = signs.count("+") + signs.count("-")
    multiplied, divided = signs.count("*"), signs.count("/")
    return Count(
        added + (" += " in text),
        multiplied,
        divided,
        roots,
        len(signs) - added - multiplied - divided + cheap,
        len(functions) - cheap - roots,
    )


def operations(lines: Sequence[str]) -> tuple[int, int]:
    """(arithmetic and comparisons, calls of functions) that lines make at most."""
    n = counted(lines)
    return n.added + n.multiplied + n.divided + n.compared, n.calls + n.roots
