"""Logs that are no text table: JSON (lines, objects, arrays) and MATLAB files, as named columns."""

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sysid.data.reading.matlab import matlab_arrays
from sysid.data.record import Array
from sysid.errors import DataError

MAX_DEPTH = 8
"""Objects inside objects that are looked into."""
HDF5_AT = 512
"""Byte at which HDF5 begins in a MATLAB file of version 7.3, behind MATLAB's own words."""

Columns = dict[str, list[Any] | Array]


def container(data: bytes, where: str) -> Columns | None:
    """The columns of a JSON or MATLAB file, of one length; None for any other file.

    Raises:
        DataError: it is damaged, or holds no columns.
    """
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
    """The object of each line; the last line may be cut off.

    Raises:
        DataError: another line is none.
    """
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
    for _ in range(MAX_DEPTH):
        if isinstance(content, list):
            rows = [dict(_flat(row)) for row in content if isinstance(row, Mapping)]
            names = dict.fromkeys(name for row in rows for name in row)
            return {n: [row.get(n) for row in rows] for n in names} if len(rows) > 1 else {}
        if not isinstance(content, Mapping):
            return {}
        vectors = {n: v for n, v in _flat(content) if isinstance(v, list) and len(v) > 1}
        if any(not isinstance(v[0], Mapping) for v in vectors.values()):
            return _of_one_length(vectors)
        if not vectors:
            return {}
        content = max(vectors.values(), key=len)  # {"meta": …, "samples": [{…}, {…}]}
    return {}


def _flat(row: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """The values of an object, those of objects inside it as ``outer.inner``."""
    for name, value in row.items():
        if isinstance(value, Mapping) and depth < MAX_DEPTH:
            yield from _flat(value, f"{prefix}{name}.", depth + 1)
        else:
            yield f"{prefix}{name}", value


def _of_one_length(vectors: Mapping[str, Sequence[Any]]) -> Columns:
    """The vectors of the length that most of them have."""
    lengths = [len(v) for v in vectors.values()]
    usual = max(lengths, key=lambda n: (lengths.count(n), n), default=0)
    return {
        n: v if isinstance(v, np.ndarray) else list(v)
        for n, v in vectors.items()
        if len(v) == usual
    }


def _matlab(data: bytes, where: str) -> Columns:
    return _of_arrays((name, np.squeeze(value)) for name, value in matlab_arrays(data, where))


def _of_arrays(arrays: Iterable[tuple[str, Any]]) -> Columns:
    """Vectors, and the columns of matrices whose longer side is as long as most vectors are."""
    numbers = {n: np.asarray(v) for n, v in arrays if isinstance(v, np.ndarray)}
    numbers = {n: v for n, v in numbers.items() if v.dtype.kind in "biuf" and 1 <= v.ndim <= 2}
    lengths = [max(v.shape) for v in numbers.values() if v.size]
    usual = max(lengths, key=lambda n: (lengths.count(n), n), default=0)
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


def _is_hdf5(data: bytes, where: str) -> bool:
    return b"\x89HDF" in (data[:4], data[HDF5_AT : HDF5_AT + 4])


def _is_matlab(data: bytes, where: str) -> bool:
    return data.startswith(b"MATLAB 5.0") or where.lower().endswith(".mat")


def _is_json(data: bytes, where: str) -> bool:
    return data[:64].lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"{", b"["))


_KINDS: tuple[tuple[Callable[[bytes, str], bool], Callable[[bytes, str], Columns]], ...] = (
    (_is_hdf5, _hdf5),
    (_is_matlab, _matlab),
    (_is_json, _json),
)
"""Whether a file is of a kind, by its first bytes or its name, and its reader."""
