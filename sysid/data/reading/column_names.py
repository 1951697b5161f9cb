"""Names and units of the columns of a table, as a header writes them."""

import re
from collections.abc import Sequence

from sysid.data.reading.header import is_unit

_BRACKETS = re.compile(
    r"(?P<base>.*?\S)(?:\s*[\[(](?P<unit>[^\[\]()]*)[\])]|\s+in\s+(?P<word>[A-Za-zµμ°%Ω][^\s]*))"
)
"""A name with its unit: ``u [V]``, ``speed (rpm)``, ``Temperatur in °C``."""


def names_and_units(raw: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Take ``u [V]`` or ``speed (rpm)`` apart, unless two columns would then share a name."""
    split = [_BRACKETS.fullmatch(n) for n in raw]
    split = [m if m and (m["word"] is None or is_unit(m["word"])) else None for m in split]
    bases = [m["base"] if m else n for m, n in zip(split, raw, strict=True)]
    if len(set(bases)) != len(set(raw)):
        return tuple(raw), ("",) * len(raw)
    return tuple(bases), tuple((m["unit"] or m["word"] or "").strip() if m else "" for m in split)


def distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names, with ``(2)`` behind the second of one name and so on."""
    out: list[str] = []
    for name in names:
        numbered = (name, *(f"{name} ({k})" for k in range(2, len(names) + 2)))
        out.append(next(n for n in numbered if n not in out and (n == name or n not in names)))
    return tuple(out)
