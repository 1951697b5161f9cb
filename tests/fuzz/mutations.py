"""Valid documents and texts made wrong: a value replaced, a key gone, a list too long."""

import math
import re
from copy import deepcopy
from random import Random
from typing import Any

DEEP = "(nested)"
"""Stands for a thousand brackets in brackets, which no encoder would write."""
NESTED = ("[" * 1000 + "]" * 1000).encode()

ODD: tuple[Any, ...] = (
    None, True, False, "", "x", " ", "nan", "-", "1e400", "9" * 400, "a" * 300, "\x1b[31m",
    "\u202eab", "\x00", "=cmd|'/c calc'!A1", "é", "a.b", "a/b", "../x", "0", "1", "y", "u", -1, 0,
    1, 2, 3, 0.5, -0.5, 10**9, 10**18, -(10**18), 10**400, 1e300, -1e300, 1e-300, 5e-324,
    math.inf, -math.inf, math.nan, [], {}, [[]], [None], [1], [1.0, 2.0], [0, 0, 0], {"a": 1},
    {"": {}}, ["a", "b"], DEEP, list(range(40)),
)  # fmt: skip
"""What stands nowhere, or not there."""

TOKENS = (
    *(v for v in ODD if isinstance(v, str) and v != DEEP), "1e-300", "-1", "99999999",
    "1:99999999999", "0x1", "1,5", '"', "'", "\n", "\r", "\t", ";", ",", ":", "=", "#", "%", "{",
    "}", "[", "]", "<", ">", "&", "\ufeff", "9999-12-31", "12:99:99", "31.12.9999 23:59:59",
    "0001-01-01T00:00:00Z", "-9223372036854775808", "18446744073709551616", "inf", "NaN", "--",
    "-0", "\ud800", "\u2028", "\x85", "١٢", "1_000", "1.2.3", "1e5", "+-3",
)  # fmt: skip

Place = tuple[Any, Any]
"""A list or object, and the key of something in it."""


def mutated(seed: Any, rng: Random) -> Any:
    """A copy of a document, a text or bytes with one to four faults."""
    faults = rng.choice((1, 1, 1, 2, 2, 4))
    if isinstance(seed, str | bytes):
        for _ in range(faults):
            seed = _text(seed, rng) if isinstance(seed, str) else _bytes(seed, rng)
        return seed
    document = {"top": deepcopy(seed)}
    for _ in range(faults):
        places = _places(document["top"], document, "top")
        _damage(*rng.choice(places), places, rng)
    return document["top"]


def _places(value: Any, parent: Any, key: Any) -> list[Place]:
    inner = value.items() if isinstance(value, dict) else ()
    inner = enumerate(value) if isinstance(value, list) else inner
    return [(parent, key), *(p for k, v in inner for p in _places(v, value, k))]


def _damage(parent: Any, key: Any, places: list[Place], rng: Random) -> None:
    value = parent[key]
    kind = rng.randrange(10)
    top = parent is places[0][0]
    if kind == 0 and not top:
        del parent[key]
    elif kind == 1 and isinstance(parent, dict) and not top:
        parent[rng.choice(("extra", "", "a" * 300, "\x1b[2J", str(key).upper()))] = parent.pop(key)
    elif kind == 2 and isinstance(value, list):
        value *= rng.choice((2, 50))
    elif kind == 3 and type(value) in (int, float) and abs(value) < 1e300:
        parent[key] = value * rng.choice((-1, 10, 1e-6, 1e9, 0, 0.5, 1e150))
    elif kind == 4:
        other, name = rng.choice(places)
        parent[key] = deepcopy(other[name])
    elif kind == 5:
        parent[key] = rng.choice(([value], {"value": value}, str(value)[:400]))
    elif kind == 6 and isinstance(value, list | dict) and value:
        for name in list(value)[1:] if isinstance(value, dict) else ():
            del value[name]
        if isinstance(value, list):
            del value[rng.randrange(len(value)) :]
    else:
        parent[key] = deepcopy(rng.choice(ODD))


_TOKEN = re.compile(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?|\w+|\s+|[^\w\s]")


def _text(text: str, rng: Random) -> str:
    """One token, line or stretch of a text made wrong."""
    kind = rng.randrange(8)
    if kind < 3:
        tokens = list(_TOKEN.finditer(text)) or [re.match("", text)]
        token = rng.choice(tokens[: rng.choice((12, 60, 10**9))])
        assert token is not None
        new = rng.choice(TOKENS) if kind else rng.choice(tokens)[0]  # type: ignore[index]
        return text[: token.start()] + new + text[token.end() :]
    lines = text.splitlines(keepends=True)
    k = rng.randrange(min(len(lines), rng.choice((3, 10**9))) or 1)
    if kind == 3:
        del lines[k : k + 1]
    elif kind == 4:
        lines[k:k] = lines[k : k + 1] * rng.choice((1, 3))
    elif kind == 5:
        return text[: rng.randrange(len(text) + 1)]
    elif kind == 6:
        old, new = rng.choice(",;\t. =:\n"), rng.choice(",;\t. =:\n")
        return text.replace(old, new)
    else:
        at = rng.randrange(len(text) + 1)
        return text[:at] + rng.choice(TOKENS) + text[at:]
    return "".join(lines)


def _bytes(content: bytes, rng: Random) -> bytes:
    """Some bytes of a binary file made wrong."""
    if not content:
        return b"\x00"
    at, kind = rng.randrange(len(content)), rng.randrange(4)
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + content[at + rng.choice((1, 2, 8)) :]
    new = bytes(rng.choice((0, 255, 127, rng.randrange(256))) for _ in range(rng.choice((1, 4, 8))))
    return content[:at] + new + content[at + (len(new) if kind == 2 else 0) :]
