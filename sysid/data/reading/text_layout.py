"""Layout of a text log: encoding, header, delimiter, decimal sign, data lines."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from sysid.data.reading.data_lines import DataLines, cut_tail
from sysid.data.reading.dates import date_format
from sysid.data.reading.header import (
    MISSING,
    bare_unit,
    cells_of,
    find_header,
    is_numeric,
    measured,
)
from sysid.errors import DataError, UsageError

DELIMITERS = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";"}
"""Words a person may use for a delimiter."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_MAGIC = {
    b"PK\x03\x04": "a spreadsheet or zip archive; export the sheet as CSV",
    b"\x1f\x8b": "a gzip archive; unpack it first",
    b"\xd0\xcf\x11\xe0": "an Excel file; export the sheet as CSV",
    b"{": "JSON; export the numbers as CSV",
    b"[{": "JSON; export the numbers as CSV",
    b"<": "a web page or XML; download or export the log as CSV",
    b"%PDF": "a PDF; export the numbers as CSV",
    b"\x89PNG": "a picture; name the log itself",
    b"\x89HDF": "an HDF5 file; export it as CSV or Parquet",
    b"MATLAB 5.0": "a MATLAB file; export it as CSV or Parquet",
}


@dataclass(frozen=True)
class Layout:
    """A text log cut into header and data lines.

    Attributes:
        names: cells of the header row.
        delimiter: ``,`` ``;`` tab, or a space for runs of white space.
        decimal: the decimal sign, ``.`` or ``,``.
        rows: the data lines, blank ones left out.
        lines: line number of each data line in the file, counted from 1.
        notes: what a person should know about the reading.
        units: cells of a row of units below the header, as many as names; empty cells without.
        interval: time between two rows [s] that a title states, None without.
        in_cells: the unit behind every number of a column, as many as names; empty without.
    """

    names: tuple[str, ...]
    delimiter: str
    decimal: str
    rows: DataLines
    lines: Sequence[int]
    notes: tuple[str, ...]
    units: tuple[str, ...] = ()
    interval: float | None = None
    in_cells: tuple[str, ...] = ()


def lay_out(data: bytes, where: str, delimiter: str | None, decimal: str | None) -> Layout:
    """Find header, delimiter, decimal sign and data lines in the bytes of a text log.

    Of a log whose first lines say how all others are to be read only these are looked at.

    Raises:
        DataError: empty, binary, without a header, without rows, or with ragged rows.
        UsageError: the delimiter or decimal sign asked for does not exist.
    """
    cut = cut_tail(data)
    if cut is not None:
        head, tail = cut
        with suppress(DataError):  # where the first lines are no log, all of them may be one
            layout = _lay_out(head, where, delimiter, decimal)
            alike = (layout.delimiter, len(layout.names)) == (tail.separator, tail.cells)
            if alike and not any(layout.in_cells):
                rows = DataLines(layout.rows.head, tail)
                return replace(layout, rows=rows, lines=[*layout.lines, *tail.numbers])
    return _lay_out(data, where, delimiter, decimal)


def _lay_out(data: bytes, where: str, delimiter: str | None, decimal: str | None) -> Layout:
    """``lay_out`` where every line is looked at."""
    text, notes = _decode(data, where)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    complete = not lines[-1]
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line and not line.isspace()]
    if not numbered:
        raise DataError(f"{where} is empty; a log needs a header row and rows of numbers")
    header_parts = find_header(numbered)
    first, header = header_parts.line[0], header_parts.line[1].strip("\ufeff").lstrip(" ")
    rows, numbers = [line for _, line in header_parts.body], [i for i, _ in header_parts.body]
    notes += tuple(f"{where}: {note}." for note in header_parts.notes)

    sep = cut = _delimiter(header, rows[:20], delimiter)
    if sep == "," and decimal != "." and _quoted_commas(rows[:200]):
        # a comma between cells and inside the numbers: only the quotes distinguish them
        header, *rows = ["\t".join(cells_of(line, ",")) for line in (header, *rows)]
        sep, decimal = "\t", ","
    names = tuple(c.strip() for c in cells_of(header, sep))
    if is_numeric(header):
        raise DataError(
            f"{where}, line {first} holds numbers where the column names belong; add a header row "
            "such as t,u,y"
        )
    if not rows:
        raise DataError(f"{where} has a header but no rows of numbers; record the log again")
    rows, units_in_cells = _without_units(rows, numbers, sep, names, where)
    point = decimal or _decimal(rows, sep)
    if point not in (".", ","):
        raise UsageError(f"the decimal sign must be '.' or ',', got {point!r}")
    if point == sep:
        raise UsageError(f"delimiter and decimal sign cannot both be {sep!r}; give another one")
    names, rows, numbers, more = _even_out(names, rows, numbers, sep, where, complete)
    units = (
        ()
        if header_parts.units is None
        else tuple(map(bare_unit, cells_of(header_parts.units, cut)))
    )
    units = (*units, *[""] * len(names))[: len(names)]
    in_cells = tuple(units_in_cells.get(i, "") for i in range(len(names)))
    notes = (*notes, *more)
    return Layout(
        names, sep, point, DataLines(rows), numbers, notes, units, header_parts.interval, in_cells
    )


def split_line(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped."""
    return [c.strip() for c in cells_of(line, delimiter)]


def _without_units(
    rows: list[str], numbers: list[int], sep: str, names: tuple[str, ...], where: str
) -> tuple[list[str], dict[int, str]]:
    """The rows without the unit behind each number of a column (``0.01 sec``), and these units.

    Raises:
        DataError: a column has numbers in more than one unit.
    """
    first = [measured(c) for c in cells_of(rows[0], sep)] if sep != " " else []
    units = {i: m[1] for i, m in enumerate(first) if m is not None and i < len(names)}
    if not units:
        return rows, {}
    cells = [cells_of(row, sep) for row in rows]
    for i, unit in tuple(units.items()):
        for line, row in zip(numbers, cells, strict=True):
            text = row[i].strip() if i < len(row) else ""
            number = measured(text)
            if number is None and text.lower() not in MISSING:
                del units[i]  # text that only begins as a measurement does
                break
            if number is not None and number[1] != unit:
                raise DataError(
                    f"{where}, line {line}, column {names[i]}: {text!r} is not in {unit} as the "
                    "first row is; write the column in one unit"
                )
    out = []
    for row in cells:
        bare = [(measured(c) or (c,))[0] if i in units else c for i, c in enumerate(row)]
        out.append(sep.join(f'"{c}"' if sep in c else c for c in bare))
    return out, units


def _decode(data: bytes, where: str) -> tuple[str, tuple[str, ...]]:
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise DataError(f"{where} is {what}")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16"), ()
        except UnicodeDecodeError:
            raise DataError(f"{where} is damaged UTF-16 text; save it again as UTF-8") from None
    if b"\0" in data:
        if _looks_wide(data):
            raise DataError(f"{where} looks like UTF-16 text without its mark; save it as UTF-8")
        raise DataError(f"{where} is not text (it holds zero bytes); give a CSV or Parquet log")
    try:
        return data.decode("utf-8-sig"), ()
    except UnicodeDecodeError as error:
        head = data[:4096]
        odd = sum(b < 9 or 13 < b < 32 for b in head)
        if odd > 0.02 * len(head):
            raise DataError(f"{where} is binary; give a CSV or Parquet log") from None
        line = data[: error.start].count(b"\n") + 1
        note = f"{where} is not UTF-8 (line {line}); read as Latin-1."
        return data.decode("latin-1"), (note,)


def _looks_wide(data: bytes) -> bool:
    head = data[:400]
    return max(head[0::2].count(0), head[1::2].count(0)) > len(head) // 4


def _quoted_commas(rows: list[str]) -> bool:
    """Whether cells in quotes hold decimal commas, and none a decimal point."""
    cells = [c.strip() for row in rows if '"' in row for c in cells_of(row, ",")]
    return any(_DECIMAL_COMMA.fullmatch(c) for c in cells) and not any("." in c for c in cells)


def _delimiter(header: str, rows: list[str], given: str | None) -> str:
    if given is not None:
        sep = DELIMITERS.get(given.lower(), given)
        if len(sep) != 1 or sep.isalnum() or sep in "\"'.+-\n\r":
            raise UsageError(
                f"the delimiter must be one of , ; tab space or another single sign, got {given!r}"
            )
        return sep
    for sep in (";", "\t", ","):
        if sep in header:
            return sep
    if len(header.split()) > 1 and all(len(r.split()) > 1 for r in rows):
        return " "
    return ","


def _decimal(rows: list[str], sep: str) -> str:
    """A comma if some cell reads as ``1,5`` and none as ``1.5``; a comma delimiter forbids it."""
    if sep == ",":
        return "."
    # a log that starts at rest may have no fraction in its first rows
    shown = rows[:200] + [r for r in rows[200:] if "," in r][:200]
    cells = [c.strip().strip('"') for row in shown for c in cells_of(row, sep)]
    comma = any(_DECIMAL_COMMA.fullmatch(c) for c in cells)
    points = (c for c in cells if "." in c)
    return "," if comma and all(date_format(c) for c in points) else "."


def _even_out(
    names: tuple[str, ...],
    rows: list[str],
    numbers: list[int],
    sep: str,
    where: str,
    complete: bool,
) -> tuple[tuple[str, ...], list[str], list[int], tuple[str, ...]]:
    """Check that every row has as many cells as the header; forgive a cut-off last line."""
    plain = sep != " " and not any('"' in r for r in rows)
    counts = [r.count(sep) + 1 if plain else len(cells_of(r, sep)) for r in rows]
    wanted = len(names)
    comment = names[-1].lower() == "comment"
    shown = rows if comment else rows[:1]
    if wanted > 1 and comment and plain and set(counts) == {wanted - 1, wanted}:
        # LabVIEW writes its comment behind the row that it was given for, and nothing elsewhere
        pairs = zip(rows, counts, strict=True)
        rows = [r.rsplit(sep, 1)[0] if n == wanted else r for r, n in pairs]
        names, wanted = names[:-1], wanted - 1
        counts = [wanted] * len(rows)
    elif (
        wanted > 1
        and (comment or not names[-1])
        and set(counts) == {wanted}
        and all(not cells_of(r, sep)[-1].strip() for r in shown)
    ):
        names = names[:-1]  # every line, the header too, ends in a delimiter or an empty comment
    elif wanted > 1 and set(counts) == {wanted - 1} and names[-1].lower() in ("", "comment"):
        names, wanted = names[:-1], wanted - 1  # only the header ends in a delimiter or "Comment"
    elif set(counts) == {wanted + 1} and all(r.rstrip(" ").endswith(sep) for r in rows):
        wanted += 1  # every line but the header ends in a delimiter
    notes: tuple[str, ...] = ()
    if counts[-1] < wanted and not complete and len(rows) > 1:
        notes = (
            f"{where}, line {numbers[-1]}: the last line is cut off "
            f"({counts[-1]} of {wanted} cells) and was left out.",
        )
        rows, numbers, counts = rows[:-1], numbers[:-1], counts[:-1]
    for line, count in zip(numbers, counts, strict=True):
        if count != wanted:
            hint = (
                " (a decimal comma? then use ; as delimiter)"
                if sep == "," and count > wanted
                else ""
            )
            raise DataError(
                f"{where}, line {line} has {_n(count, 'cell')} where the header has {wanted}"
                f"{hint}; correct or delete that line"
            )
    return names, rows, numbers, notes


def _n(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")
