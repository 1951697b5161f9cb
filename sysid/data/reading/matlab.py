"""Arrays of a MATLAB file of level 4 or 5 (up to -v7).

MAT-File Format, The MathWorks 2019. Read here and not by scipy.io, whose compiled reader ends the
process on damaged files.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from sysid.errors import DataError

LARGEST = 1 << 31
"""Bytes that a compressed variable may unpack to."""
DEEPEST = 8
"""Structures inside structures that are looked into."""

_CELL, _STRUCT, _OBJECT, _OPAQUE = 1, 2, 3, 17
_NUMERIC = range(6, 16)
_MATRIX, _COMPRESSED = 14, 15
_STORED = {
    **{1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"},
    **{7: "f4", 9: "f8", 12: "i8", 13: "u8"},
}
_OF_LEVEL_4 = ("f8", "f4", "i4", "i2", "u2", "u1")

Variable = tuple[str, Any]


def matlab_arrays(data: bytes, where: str) -> list[Variable]:
    """Names and arrays (2-D) of all numeric variables; ``outer.inner`` of those in structures.

    Raises:
        DataError: the file is damaged, or holds objects alone.
    """
    try:
        if data[126:128] in (b"IM", b"MI"):
            arrays = list(_level_5(data[128:], "<" if data[126:128] == b"IM" else ">"))
        else:
            arrays = list(_level_4(data))
    except (ValueError, IndexError, KeyError, struct.error, zlib.error, MemoryError):
        raise DataError(f"{where} is a damaged MATLAB file; save it again") from None
    opaque = any(value is None for _, value in arrays)
    arrays = [(name, value) for name, value in arrays if value is not None]
    if opaque and not arrays:
        raise DataError(
            f"{where} holds MATLAB objects (a timetable or timeseries); write their numbers with "
            "writetimetable, or save the vectors"
        )
    return arrays


def _level_4(data: bytes) -> Iterator[Variable]:
    at = 0
    while at < len(data):
        kind, rows, columns, imaginary, length = struct.unpack_from("<5i", data, at)
        if not 0 <= kind < 60 or min(rows, columns, length) < 0 or kind % 10 > 1:
            raise ValueError("no header of level 4")
        name = data[at + 20 : at + 20 + length].rstrip(b"\0").decode("latin-1")
        stored = np.dtype("<" + _OF_LEVEL_4[kind // 10 % 10])
        at += 20 + length
        values = np.frombuffer(data, stored, rows * columns, at)
        at += stored.itemsize * rows * columns * (2 if imaginary else 1)
        if kind % 10 == 0:
            yield name, values.reshape(columns, rows).T


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and bytes of each element; small ones hold both in eight bytes."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        if kind >> 16:
            kind, size, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start, end = at + 8, at + 8 + size + (-size % 8 if kind != _COMPRESSED else 0)
        if start + size > len(data):
            raise ValueError("an element ends behind the file")
        yield kind, data[start : start + size]
        at = end


def _level_5(data: bytes, order: str) -> Iterator[Variable]:
    for kind, content in _elements(data, order):
        if kind == _COMPRESSED:
            content = zlib.decompressobj().decompress(content, LARGEST)
            kind, content = next(_elements(content, order), (0, b""))
        if kind == _MATRIX:
            yield from _matrix(content, order, "", 0)


def _matrix(content: bytes, order: str, called: str, depth: int) -> Iterator[Variable]:
    """The arrays of one variable; None for an object whose content is not stated."""
    parts = _elements(content, order)
    (_, flags), (_, dims) = next(parts, (0, b"")), next(parts, (0, b""))
    if len(flags) < 4:
        return  # an empty cell
    of_class = struct.unpack_from(order + "I", flags)[0] & 0xFF
    if of_class == _OPAQUE:
        yield called, None
        return
    shape = np.frombuffer(dims, order + "i4")
    name = called or next(parts, (0, b""))[1].rstrip(b"\0").decode("latin-1")
    if called:
        next(parts, None)  # members have an empty name of their own
    count = int(np.prod(shape, dtype=np.float64)) if len(shape) and shape.min() >= 0 else 0
    if of_class in _NUMERIC:
        stored, raw = next(parts, (9, b""))
        values = np.frombuffer(raw, order + _STORED[stored])
        if len(values) == count and len(shape) == 2:
            yield name, values.reshape(shape[::-1]).T
    elif of_class in (_CELL, _STRUCT, _OBJECT) and depth < DEEPEST:
        if of_class == _OBJECT:
            next(parts, None)
        fields = [""] if of_class == _CELL else _fields(parts, order)
        for k, (kind, member) in enumerate(parts):
            element = f"{name}_{k // len(fields) + 1}" if count > 1 else name
            field = fields[k % len(fields)]
            if kind == _MATRIX:
                inner = f"{element}.{field}" if field else element
                yield from _matrix(member, order, inner, depth + 1)


def _fields(parts: Iterator[tuple[int, bytes]], order: str) -> list[str]:
    """The names of a structure's fields."""
    width = int(np.frombuffer(next(parts, (0, b""))[1], order + "i4")[0])
    text = next(parts, (0, b""))[1]
    starts = range(0, len(text), width) if width > 0 else ()
    return [text[k : k + width].rstrip(b"\0").decode("latin-1") for k in starts] or [""]
