"""Valid C names for the names of users, sensors and other packages."""

import re
import unicodedata
from collections.abc import Iterable
from itertools import chain, count

_WORDS = """
alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t
char32_t class compl concept const const_cast consteval constexpr constinit continue co_await
co_return co_yield decltype default delete do double dynamic_cast else enum explicit export extern
false float for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr
operator or or_eq private protected public register reinterpret_cast requires restrict return short
signed sizeof static static_assert static_cast struct switch template this thread_local throw true
try typedef typeid typename typeof union unsigned using virtual void volatile wchar_t while xor
xor_eq
"""
"""Words of C99, C11 and C++20."""

_MACROS = """
linux unix i386 arm near far I NAN INFINITY NULL EOF PI F abs min max round sq bit byte word boolean
radians degrees constrain interrupts isnan isinf isfinite signbit HIGH LOW INPUT OUTPUT DEFAULT
EXTERNAL INTERNAL SERIAL DISPLAY CHANGE FALLING RISING EULER
"""
"""Macros of compilers, of the headers of C and of the Arduino core."""

RESERVED = frozenset([*_WORDS.split(), *_MACROS.split()])
"""What no name of ours may be."""

_NUMBERED_MACRO = re.compile(r"[ABDE]\d+")
"""Pins and binary numbers of the Arduino core."""


def identifier(text: str) -> str:
    """A text as a name of C: letters without marks, digits and single underscores.

    Greek letters and others without a Latin form become ``_``; who writes several names keeps them
    apart by :func:`distinct`.
    """
    plain = unicodedata.normalize("NFKD", text)
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    joined = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9]", "_", plain)).strip("_") or "value"
    if joined[0].isdigit():
        return f"v_{joined}"
    reserved = joined in RESERVED or _NUMBERED_MACRO.fullmatch(joined)
    return f"{joined}_" if reserved else joined


def distinct(texts: Iterable[str]) -> list[str]:
    """Names of C for several texts, no two alike."""
    return apart(map(identifier, texts))


def apart(names: Iterable[str]) -> list[str]:
    """The names, no two alike: later ones get ``_2``, ``_3`` …"""
    found: dict[str, None] = {}
    for name in names:
        numbered = chain([name], (f"{name}_{k}" for k in count(2)))
        found[next(n for n in numbered if n not in found)] = None
    return [*found]
