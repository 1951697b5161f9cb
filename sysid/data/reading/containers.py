"""Logs that are no text table: JSON (lines, objects, arrays) and MATLAB files, as named columns.

Arrays of a MATLAB file of level 4 or 5 (up to -v7).

MAT-File Format, The MathWorks 2019. Read here and not by scipy.io, whose compiled reader ends the
process on damaged files.
"""

import io
import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError

LARGEST = 1 << 31
"""Bytes that a compressed variable may unpack to."""
DEEPEST = 8
"""Structures inside structures, and objects inside objects, that are looked into."""

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
    """Names and arrays (2-D) of all numeric variables; ``outer.inner`` of those in structures."""
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


HDF5_AT = 512
"""Byte at which HDF5 begins in a MATLAB file of version 7.3, behind MATLAB's own words."""

Columns = dict[str, list[Any] | Array]


def container(data: bytes, where: str) -> Columns | None:
    """The columns of a JSON or MATLAB file, of one length; None for any other file."""
    for recognised, read in _KINDS:
        if recognised(data, where):
            columns = read(data, where)
            if not columns:
                raise DataError(
                    f"{where} holds no columns of equal length; write the signals and their time "
                    "as vectors of one length"
                )
            first = next(iter(columns)).partition(".")[0]
            shared = all(name.startswith(f"{first}.") for name in columns)
            return {n.removeprefix(f"{first}.") if shared else n: c for n, c in columns.items()}
    return None


def _json(data: bytes, where: str) -> Columns:
    try:
        text = data.decode("utf-8-sig")
        try:
            content = json.loads(text)
        except json.JSONDecodeError:
            content = list(_json_lines(text, where))
    except (UnicodeDecodeError, RecursionError):
        raise DataError(f"{where} is damaged JSON; write it again") from None
    return _of_content(content)


def _json_lines(text: str, where: str) -> Iterator[Any]:
    """The object of each line; the last line may be cut off."""
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    for i, line in lines:
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            if i == lines[-1][0] and i > 1:
                return
            raise DataError(f"{where}, line {i} is no JSON; correct or delete that line") from None


def _of_content(content: Any) -> Columns:
    """Columns of a list of objects, or of an object of lists, which may stand in another one."""
    for _ in range(DEEPEST):
        if isinstance(content, list):
            rows = [dict(_flat(row)) for row in content if isinstance(row, Mapping)]
            names = dict.fromkeys(name for row in rows for name in row)
            return {n: [row.get(n) for row in rows] for n in names} if len(rows) > 1 else {}
        if not isinstance(content, Mapping):
            return {}
        vectors = {n: v for n, v in _flat(content) if isinstance(v, list) and len(v) > 1}
        if any(not isinstance(v[0], Mapping) for v in vectors.values()):
            usual = _usual([len(v) for v in vectors.values()])
            return {n: v for n, v in vectors.items() if len(v) == usual}
        if not vectors:
            return {}
        content = max(vectors.values(), key=len)  # {"meta": …, "samples": [{…}, {…}]}
    return {}


def _flat(row: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """The values of an object, those of objects inside it as ``outer.inner``."""
    for name, value in row.items():
        if isinstance(value, Mapping) and depth < DEEPEST:
            yield from _flat(value, f"{prefix}{name}.", depth + 1)
        else:
            yield f"{prefix}{name}", value


def _usual(lengths: Sequence[int]) -> int:
    """The length that most have, of several the largest."""
    return max(lengths, key=lambda n: (lengths.count(n), n), default=0)


def _of_arrays(arrays: Iterable[tuple[str, Any]]) -> Columns:
    """Vectors, and the columns of matrices whose longer side is as long as most vectors are."""
    numbers = {n: np.asarray(v) for n, v in arrays if isinstance(v, np.ndarray)}
    numbers = {n: v for n, v in numbers.items() if v.dtype.kind in "biuf" and 1 <= v.ndim <= 2}
    usual = _usual([max(v.shape) for v in numbers.values() if v.size])
    columns: Columns = {}
    for name, value in numbers.items():
        if not value.size or max(value.shape) != usual or usual < 2:
            continue
        if value.ndim == 1:
            columns[name] = value.astype(np.float64)
            continue
        along_time = value if value.shape[0] == usual else value.T
        for k, column in enumerate(along_time.T, 1):
            columns[f"{name}_{k}" if along_time.shape[1] > 1 else name] = column.astype(np.float64)
    return columns


def _hdf5(data: bytes, where: str) -> Columns:
    try:
        import h5py
    except ImportError:
        raise DataError(
            f"{where} is an HDF5 or MATLAB 7.3 file, which needs h5py: pip install "
            "'sysid-workbench[hdf5]', or save it with -v7"
        ) from None
    arrays: dict[str, Any] = {}

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#") and item.ndim <= 2:
            arrays[name.replace("/", ".")] = np.squeeze(item[()])

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            file.visititems(add)
    except Exception:  # h5py raises whatever a damaged byte leads it to
        raise DataError(f"{where} is a damaged HDF5 file; save it again") from None
    return _of_arrays(arrays.items())


_KINDS: tuple[tuple[Callable[[bytes, str], bool], Callable[[bytes, str], Columns]], ...] = (
    (lambda data, _: b"\x89HDF" in (data[:4], data[HDF5_AT : HDF5_AT + 4]), _hdf5),
    (
        lambda data, where: data.startswith(b"MATLAB 5.0") or where.lower().endswith(".mat"),
        lambda data, where: _of_arrays((n, np.squeeze(v)) for n, v in matlab_arrays(data, where)),
    ),
    (lambda data, _: data[:64].lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"{", b"[")), _json),
)
"""Whether a file is of a kind, by its first bytes or its name, and its reader."""
