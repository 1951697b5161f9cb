"""Layout of a text log: header, delimiter, decimal sign, data lines."""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from sysid.data.decision import amount
from sysid.data.reading.bad_lines import NONE_SKIPPED, Skipped, ragged, without_words
from sysid.data.reading.data_lines import DataLines, cut_tail
from sysid.data.reading.decoding import decode
from sysid.data.reading.header import (
    MISSING,
    Header,
    bare_unit,
    cells_of,
    find_header,
    is_data,
    is_unit,
    measured,
)
from sysid.data.reading.line_keys import Line
from sysid.data.reading.number_signs import NumberSigns, number_signs, without_groups
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError

DELIMITERS = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";"}
"""Words a person may use for a delimiter."""
SHOWN = 1000
"""Rows of a file without a header that say how many columns it has."""


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
        skipped: lines that are no rows.
        encoding: that of the text where it is a guess, else empty.
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
    skipped: Skipped = NONE_SKIPPED
    encoding: str = ""


def lay_out(data: bytes, where: str, options: ReadOptions) -> Layout:
    """Find header, delimiter, decimal sign and data lines in the bytes of a text log.

    Of a log whose first lines say how all others are to be read only these are looked at.
    """
    cut = cut_tail(data)
    if cut is not None:
        head, tail = cut
        with suppress(DataError):  # where the first lines are no log, all of them may be one
            layout = _lay_out(head, where, options)
            alike = (layout.delimiter, len(layout.names)) == (tail.separator, tail.cells)
            if alike and not any(layout.in_cells):
                rows = DataLines(layout.rows.head, tail)
                return replace(layout, rows=rows, lines=[*layout.lines, *tail.numbers])
    return _lay_out(data, where, options)


def _lay_out(data: bytes, where: str, options: ReadOptions) -> Layout:
    """``lay_out`` where every line is looked at."""
    text, notes, guess = decode(data, where, options.encoding)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line and not line.isspace()]
    if not numbered:
        raise DataError(f"{where} is empty; a log needs a header row and rows of numbers")
    parts = find_header(numbered)
    if not parts.body:
        raise DataError(f"{where} has a header but no rows of numbers; record the log again")
    cut = _delimiter(parts, options.delimiter)
    header, rows, said = _named(parts, cut, options.decimal)
    sep = "\t" if "\t" in header and cut == "," else cut
    names = tuple(c.strip() for c in cells_of(header, sep))
    numbered_rows = list(zip((i for i, _ in parts.body), rows, strict=True))
    complete = not lines[-1]
    names, kept, skipped, more = _cleaned(
        names, numbered_rows, sep, where, options.strict, complete
    )
    bare, of_cells = _without_units(kept, sep, names, where)
    signs = _signs(bare, sep, options.decimal)
    said, n = (*parts.notes, *said, *more, *signs.note()), len(names)
    below = [] if parts.units is None else [bare_unit(c) for c in cells_of(parts.units, cut)]
    return Layout(
        names=names,
        delimiter=sep,
        decimal=signs.decimal,
        rows=DataLines(without_groups(bare, sep, signs.group) if signs.group else bare),
        lines=[i for i, _ in kept],
        notes=(*notes, *(f"{where}: {note}." for note in said)),
        units=tuple([*below, *[""] * n][:n]),
        interval=parts.interval,
        in_cells=tuple(of_cells.get(i, "") for i in range(n)),
        skipped=skipped,
        encoding=guess,
    )


def _named(parts: Header, sep: str, decimal: str | None) -> tuple[str, list[str], tuple[str, ...]]:
    """The header, the rows, and what is said where the columns are named by position."""
    header, rows = parts.line[1].strip("\ufeff").lstrip(" "), [line for _, line in parts.body]
    notes: tuple[str, ...] = ()
    usual = Counter(_counts(parts.body[:SHOWN], sep)).most_common(1)[0][0]
    if not header or (len(cells_of(header, sep)) == 1 < usual and is_data(rows[0])):
        names = [f"column_{k}" for k in range(1, usual + 1)]
        notes = (f"it has no header; its columns are named by position: {', '.join(names)}",)
        header = sep.join(names)
    if sep == "," and decimal != "." and _quoted_commas(rows):
        # a comma between cells and inside the numbers: only the quotes distinguish them
        header, *rows = ["\t".join(cells_of(line, ",")) for line in (header, *rows)]
    return header, rows, notes


def _cleaned(
    names: tuple[str, ...],
    rows: list[Line],
    sep: str,
    where: str,
    strict: bool,
    complete: bool,
) -> tuple[tuple[str, ...], list[Line], Skipped, tuple[str, ...]]:
    """Names and rows alone: lines with other cells are left out, words for numbers empty cells.

    Args:
        complete: whether the last line has an end.

    Returns:
        the names, the rows, the lines that were left out, and what is said of it.
    """
    skipped = footer = NONE_SKIPPED
    if not strict:
        wanted = len(names)
        comment = {wanted - 1, wanted} if names[-1].lower() == "comment" else set()
        bad = ragged(_counts(rows, sep), comment)
        if bad and bad[-1] == len(rows) - 1 and not complete:
            bad = bad[:-1]  # the last line is cut off, which is said on its own
        rows, skipped = _left_out(rows, bad)
    names, rows, notes = _even_out(names, rows, sep, where, complete)
    if not strict:
        without, first = without_words([text for _, text in rows], sep)
        end = len(rows)
        while end - 1 in without and cells_of(without[end - 1], sep)[0] == "nan":
            end -= 1  # a footer: its rows begin with words, such as ``Mean;3.2``
        rows, footer = _left_out(rows, range(end, len(rows)))
        first = {i: k for i, k in first.items() if k < end}
        said = ", ".join(
            f"{names[i]} ({split_line(rows[k][1], sep)[i]!r} in line {rows[k][0]})"
            for i, k in first.items()
        )
        notes += (f"words in columns of numbers are empty cells: {said}",) * bool(said)
        rows = [(number, without.get(k, text)) for k, (number, text) in enumerate(rows)]
    return names, rows, skipped + footer, notes


def _signs(rows: Sequence[str], sep: str, decimal: str | None) -> NumberSigns:
    """Decimal sign and thousands separator."""
    if decimal == sep:
        raise UsageError(f"delimiter and decimal sign cannot both be {sep!r}; give another one")
    return number_signs(rows, sep, "." if sep == "," else decimal)


def _left_out(rows: list[Line], bad: Sequence[int]) -> tuple[list[Line], Skipped]:
    """The rows without those that are none, and these."""
    gone = set(bad)
    kept = [row for k, row in enumerate(rows) if k not in gone]
    return kept, Skipped(tuple(rows[k] for k in bad))


def _counts(rows: Sequence[Line], sep: str) -> list[int]:
    plain = _is_plain(rows, sep)
    return [r.count(sep) + 1 if plain else len(cells_of(r, sep)) for _, r in rows]


def _is_plain(rows: Sequence[Line], sep: str) -> bool:
    """Whether each sign between cells is one."""
    return sep != " " and not any('"' in r for _, r in rows)


def split_line(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped."""
    return [c.strip() for c in cells_of(line, delimiter)]


def _without_units(
    rows: Sequence[Line], sep: str, names: tuple[str, ...], where: str
) -> tuple[list[str], dict[int, str]]:
    """The rows without the unit behind each number of a column (``0.01 sec``), and these units."""
    first = [measured(c) for c in cells_of(rows[0][1], sep)] if sep != " " else []
    units = {i: m[1] for i, m in enumerate(first) if m is not None and i < len(names)}
    if not units:
        return [text for _, text in rows], {}
    cells = [cells_of(text, sep) for _, text in rows]
    for i, unit in tuple(units.items()):
        for (line, _), row in zip(rows, cells, strict=True):
            text = row[i].strip() if i < len(row) else ""
            number = measured(text)
            if number is None and text.lower() not in MISSING:
                del units[i]  # text that only begins as a measurement does
                break
            if number is not None and number[1] != unit and not is_unit(unit):
                del units[i]  # words that follow a number
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


def _quoted_commas(rows: Sequence[str]) -> bool:
    """Whether a number in quotes holds a comma."""
    cells = (c for row in rows if '"' in row for c in cells_of(row, ","))
    return any("," in c and c.strip()[:1].lstrip("+-").isdigit() for c in cells)


def _delimiter(parts: Header, given: str | None) -> str:
    if given is not None:
        sep = DELIMITERS.get(given.lower(), given)
        if len(sep) != 1 or sep.isalnum() or sep in "\"'.+-\n\r":
            raise UsageError(
                f"the delimiter must be one of , ; tab space or another single sign, got {given!r}"
            )
        return sep
    rows = [line for _, line in parts.body[:20]]
    header = parts.line[1] or rows[0]
    for sep in (";", "\t", ","):
        if sep in header:
            return sep
    if len(header.split()) > 1 and all(len(r.split()) > 1 for r in rows):
        return " "
    return ","


def _even_out(
    names: tuple[str, ...], rows: list[Line], sep: str, where: str, complete: bool
) -> tuple[tuple[str, ...], list[Line], tuple[str, ...]]:
    """Check that every row has as many cells as the header; forgive a cut-off last line."""
    counts = _counts(rows, sep)
    wanted, spare = len(names), names[-1].lower() in ("", "comment")
    comment = names[-1].lower() == "comment"
    shown = rows if comment else rows[:1]
    if wanted > 1 and comment and _is_plain(rows, sep) and set(counts) == {wanted - 1, wanted}:
        # LabVIEW writes its comment behind the row that it was given for, and nothing elsewhere
        pairs = zip(rows, counts, strict=True)
        rows = [(i, r.rsplit(sep, 1)[0] if n == wanted else r) for (i, r), n in pairs]
        names, wanted = names[:-1], wanted - 1
        counts = [wanted] * len(rows)
    elif (
        wanted > 1
        and spare
        and set(counts) == {wanted}
        and all(not cells_of(r, sep)[-1].strip() for _, r in shown)
    ):
        names = names[:-1]  # every line, the header too, ends in a delimiter or an empty comment
    elif wanted > 1 and spare and set(counts) == {wanted - 1}:
        names, wanted = names[:-1], wanted - 1  # only the header ends in a delimiter or "Comment"
    elif set(counts) == {wanted + 1} and all(r.rstrip(" ").endswith(sep) for _, r in rows):
        wanted += 1  # every line but the header ends in a delimiter
    notes: tuple[str, ...] = ()
    if counts[-1] < wanted and not complete and len(rows) > 1:
        notes = (
            f"line {rows[-1][0]}: the last line is cut off "
            f"({counts[-1]} of {wanted} cells) and was left out",
        )
        rows, counts = rows[:-1], counts[:-1]
    for (line, _), count in zip(rows, counts, strict=True):
        if count != wanted:
            if not any(is_data(text) for _, text in rows):
                raise no_table(where)
            comma = sep == "," and count > wanted
            hint = " (a decimal comma? then use ; as delimiter)" if comma else ""
            raise DataError(
                f"{where}, line {line} has {amount(count, 'cell')} where the header has {wanted}"
                f"{hint}; correct or delete that line"
            )
    return names, rows, notes


def no_table(where: str) -> DataError:
    """What is said of a text whose lines are no rows of numbers."""
    return DataError(
        f"{where} is no table: its lines hold no columns of numbers. Write its measurements as "
        "CSV, one column each, below a header such as time,u,y."
    )
