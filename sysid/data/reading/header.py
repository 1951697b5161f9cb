"""Find the header of a text log: below titles, above a row of units, behind a comment sign."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.data.decision import amount
from sysid.data.reading.dates import date_format
from sysid.data.reading.line_keys import Line, interval_of, without_keys
from sysid.data.reading.time_column import UNIT_WORDS, is_time
from sysid.data.unit_words import ENDINGS, SYNONYMS, looks_like_unit, word_set
from sysid.data.units import UNITS

COMMENTS = ("#", "%", "//", "!")
"""Signs with which a line of a text log is a comment."""
MISSING = (
    *("", "na", "nan", "n/a", "null", "none", "-nan", "#n/a", "<na>", "-", "--"),
    *("unavailable", "unknown"),
)
"""Cells, in lower case, that hold nothing."""
STATES: dict[str, float] = {
    **dict.fromkeys(("on", "true", "an", "ein", "yes", "ja", "high", "oui", "wahr", "open"), 1.0),
    **dict.fromkeys(("off", "false", "aus", "no", "nein", "low", "non", "falsch", "closed"), 0.0),
}
"""Words of a switch, in lower case -> its number."""

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.I)
_MEASURED = re.compile(
    r"(?P<number>[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*"
    r"(?P<unit>[a-zA-Zµμ°%Ω][\w°µμ/^·*²%-]*)"
)
_UNIT_NAMES = frozenset((*UNITS, *(u.lower() for u in UNITS), *SYNONYMS, *ENDINGS, *UNIT_WORDS))
_NO_UNITS = ("TS", "RN")
"""What Campbell loggers write for the unit of a time stamp and of a record number."""
_PROCESSING = word_set(
    "smp avg mean std min max tot med tmn tmx wvc cov sample average minimum maximum total "
    "mittelwert"
)
"""Words, in lower case, with which a row says how a logger made its numbers from measurements."""
_UNIT_LABELS = frozenset(
    ("vertical units", "y_unit_label", "units", "unit", "einheit", "einheiten")
)
"""First cells, in lower case, of a line with the units of the columns."""
_TITLES = 60
"""No logger writes more lines than this before its header."""
_LABEL = re.compile(r"[A-Za-z_][\w .()\[\]/%°-]*")
_MONITOR = re.compile(r"\d{1,2}:\d{2}:\d{2}[.,]\d+ -> ?")


@dataclass(frozen=True)
class Header:
    """The lines of a text log by what they are.

    Attributes:
        line: number and text of the header; an empty text where the first line is a row.
        units: the line of units below it, or None.
        body: the lines of data.
        notes: what was left out, as parts of sentences.
        interval: time between two rows [s] that a title states, None without.
    """

    line: Line
    units: str | None
    body: list[Line]
    notes: tuple[str, ...]
    interval: float | None = None


def find_header(numbered: Sequence[Line]) -> Header:
    """The header is the line of words above the table that has a name in each cell.

    What a title block says in numbers (``Samples  2400  2400``) is no row of the table below it,
    see ``_first_row``.

    Comments go; where nothing but comments stands above the data, the last one is the header
    (``numpy.savetxt`` and ROS put it behind a sign). Where no line looks like data, the first one
    is the header, so that what is wrong with the second can be said.
    """
    lines, notes = _without_monitor(numbered)
    lines, labelled = _without_labels(lines)
    lines, paired = without_keys(lines)
    notes += labelled + paired
    at = next((i for i, (_, text) in enumerate(lines) if not _comment(text)), len(lines))
    if at and (at == len(lines) or is_data(lines[at][1])):
        at -= 1
        head = (lines[at][0], _uncommented(lines[at][1]))
    else:
        head = lines[at]
    if _is_row(head[1]) and all(_is_row(text) for _, text in lines[at + 1 : at + 3]):
        return Header((head[0], ""), None, _body(lines[at:], "")[0], notes)
    rest, dropped = _body(lines[at + 1 :], head[1])
    notes += dropped
    block = [head, *rest[:_TITLES]]
    first = _first_row(block)
    units: str | None = None
    titles: list[Line] = []
    if first > 1 and not _has_number(block[first - 1][1]):
        above, rest = block[:first], rest[first - 1 :]
        summed = len(above) > 2 and _is_processing(above[-1][1])
        if summed:
            notes += (f"line {above.pop()[0]}, a row of processing labels, was left out",)
        place, with_units = _names_and_units(above, rest[0][1])
        if place is None:
            return Header(above[0], None, [*above[1:], *rest], notes)
        units = above.pop()[1] if with_units else None
        titles, head = above[:place], above[place]
        notes += (*_left_out(titles, "above"), *_left_out(above[place + 1 :], "below"))
        if units is None and rest:
            units = _stated_units([text for _, text in titles], head[1], rest[0][1])
    remarks = [text for _, text in numbered[:_TITLES] if _comment(text)]
    intervals = [interval_of(_uncommented(text)) for text in (*[t for _, t in titles], *remarks)]
    distinct = {seconds for seconds in intervals if seconds is not None}
    return Header(head, units, rest, notes, distinct.pop() if len(distinct) == 1 else None)


def _is_row(text: str) -> bool:
    """Whether every filled cell of a line holds a number or a date."""
    if is_data(text) and all(_is_value(c) for c in _tokens(text)):
        return True
    cells = [c.strip('"') for c in re.split(r"[;\t ]+|,(?=\s)|,", text.strip()) if c]
    return bool(cells) and all(_NUMBER.fullmatch(c) for c in cells)


def is_data(text: str) -> bool:
    """Whether more than half of a line's cells hold values, at least one a number or date.

    Half is not enough: ``Writer_Version 2`` or ``Run 3`` stand in many heads.
    """
    cells = _tokens(text)
    good = [c for c in cells if _NUMBER.fullmatch(c) or date_format(c) or measured(c)]
    states = [c for c in cells if c.lower() in STATES or c.lower() in MISSING]
    return bool(good) and len(cells) > 1 and 2 * (len(good) + len(states)) > len(cells)


_SHORT_UNIT = re.compile(r"[^\W\d_]{1,4}(/[^\W\d_]{1,4})?")
"""A unit that nobody knows here: ``t/h``, ``gpm``."""


def measured(cell: str) -> tuple[str, str] | None:
    """Number and unit of a cell such as ``0.01 sec`` or ``12 V``; None for any other."""
    match = _MEASURED.fullmatch(cell.strip())
    if match is None or not (is_unit(match["unit"]) or _SHORT_UNIT.fullmatch(match["unit"])):
        return None
    return match["number"], match["unit"]


def is_unit(text: str) -> bool:
    """Whether a text is a unit as people write them."""
    return looks_like_unit(text, _UNIT_NAMES)


def cells_of(line: str, sep: str) -> list[str]:
    """The cells of one line."""
    if sep == " ":
        return line.split()
    if '"' in line:
        return next(csv.reader([line], delimiter=sep, skipinitialspace=True), [])
    return line.split(sep)


def bare_unit(cell: str) -> str:
    """A unit of the row of units without brackets; empty where it says that there is none."""
    text = cell.strip().strip('"').strip("[](){}").strip()
    if text.lower() in _UNIT_LABELS:
        return ""  # the label of an instrument's line of units
    return "" if text in ("-", "–", "--", "1", *_NO_UNITS) else text


def _tokens(text: str) -> list[str]:
    """The filled cells of a line whose delimiter is not known yet."""
    if ";" in text or "\t" in text:
        cells = re.split(r"[;\t]", text)
    elif "," in text:
        # a date with a blank inside stays whole; a decimal comma falls into two numbers
        cells = text.split(",")
    else:
        cells = text.split()
    return [c.strip().strip('"') for c in cells if c.strip().strip('"')]


def _has_number(text: str) -> bool:
    """Whether a cell is a number: then the line is a row with empty cells, and no header."""
    return any(_NUMBER.fullmatch(c) for c in _tokens(text))


def _comment(text: str) -> bool:
    return text.lstrip().lstrip('"').startswith(COMMENTS)


def _uncommented(text: str) -> str:
    bare = text.lstrip()
    for sign in COMMENTS:
        if bare.startswith(sign):
            return bare[len(sign) :].lstrip()
    return bare


def _body(lines: Sequence[Line], header: str) -> tuple[list[Line], tuple[str, ...]]:
    """The lines below the header without comments and without the header said again."""
    again = header.strip()
    kept = [line for line in lines if not _comment(line[1]) and line[1].strip() != again]
    comments = sum(_comment(text) for _, text in lines)
    repeated = len(lines) - len(kept) - comments
    notes: tuple[str, ...] = ()
    if comments:
        notes += (f"{amount(comments, 'comment line')} between the data {_was(comments)} left out",)
    if repeated:
        notes += (
            f"the header, which is repeated {'once' if repeated == 1 else f'{repeated} times'} "
            "below (did the logger restart?), was left out there",
        )
    return kept, notes


def _without_monitor(numbered: Sequence[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """The lines without the clock that a serial monitor writes in front of each."""
    if not all(_MONITOR.match(text) for _, text in numbered):
        return list(numbered), ()
    return (
        [(i, _MONITOR.sub("", text, count=1)) for i, text in numbered],
        ("the serial monitor's own clock in front of each line was left out",),
    )


def _without_labels(lines: Sequence[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Lines of a serial plotter, such as ``pwm:80,rpm:12.5``, as a header and numbers."""
    rows: list[Line] = []
    names: list[str] = []
    for i, text in lines:
        cells = [
            c.strip().partition(":") for c in re.split(r"[,;\t]|(?<=\d)\s+", text.strip()) if c
        ]
        numbers = [value.strip() for _, sign, value in cells if sign]
        labels = [name.strip() for name, sign, _ in cells if sign]
        names = names or labels
        if len(labels) < 2 or labels != names or not all(_LABEL.fullmatch(n) for n in labels):
            return list(lines), ()
        if len(numbers) != len(cells) or not all(_NUMBER.fullmatch(n) for n in numbers):
            return list(lines), ()
        rows.append((i, ";".join(numbers)))
    if not rows:
        return list(lines), ()
    return [(0, ";".join(names)), *rows], ("the names in front of the numbers are the columns",)


def _first_row(block: Sequence[Line]) -> int:
    """Where the table's first row stands; 0 where no line looks like data.

    Above it a title block may hold lines that look like data: values behind a word, as ``X0  0.0
    0.0``, or with another number of cells. Such a line is left behind where a line of words with
    the table's number of cells follows. A line of words below rows of the table is no header: it
    is a fault in the log, which the reader is to hear of.
    """
    data = [i for i, (_, text) in enumerate(block) if i and is_data(text)]
    if not data:
        return 0
    first, foreign = data[0], [0] if is_data(block[0][1]) else []
    for i in data:
        words = block[i - 1][1]
        heads = (
            i > 1 and not is_data(words) and not _has_number(words) and _fits(words, block[i][1])
        )
        if heads and _are_foreign([block[j][1] for j in foreign], block[i][1]):
            first = i
        foreign.append(i)
    return first


def _fits(words: str, data: str) -> bool:
    """Whether a line of words has the cells of a row; one may be more, or one a trailing sign."""
    sep = _sign_of(data)
    cells = [c.strip() for c in cells_of(words, sep)]
    most = len(cells_of(data, sep))
    return len([c for c in cells if c]) > 1 and abs(len(cells) - most) <= 1


def _are_foreign(lines: Sequence[str], data: str) -> bool:
    """Whether lines that look like data are no rows of the table in which another one stands.

    They stand behind a word, as no row of numbers does; one line alone, such as a date and a time
    of day, is also known by its number of cells. Several such lines may be a table of their own.
    """
    if not _is_value(_tokens(data)[0]):
        return not lines  # rows that begin with a word look like what stands in a title block
    known = (*MISSING, *STATES)
    firsts = [_tokens(line)[0] for line in lines]
    bare = [
        line
        for line, first in zip(lines, firsts, strict=True)
        if _is_value(first) or first.lower() in known
    ]
    sep = _sign_of(data)
    wanted = len(cells_of(data.rstrip(sep), sep))
    return len(bare) < 2 and all(len(cells_of(b.rstrip(sep), sep)) != wanted for b in bare)


def _is_value(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell)) or date_format(cell) is not None


def _sign_of(data: str) -> str:
    """The delimiter that a row of data shows."""
    return next((sign for sign in (";", "\t", ",") if sign in data), " ")


def _ending(lines: Sequence[Line]) -> list[int]:
    """The places of the last lines that follow each other without an empty line between them."""
    start = len(lines) - 1
    while start > 0 and lines[start][0] == lines[start - 1][0] + 1:
        start -= 1
    return list(range(start, len(lines)))


def _is_full(line: str, data: str) -> bool:
    """Whether a line above the data has a word for each of three or more cells, as a header has.

    Two such lines that are no names over units are not chosen between: the second is then said to
    hold no numbers.
    """
    sep = _sign_of(data)
    wanted = len([c for c in cells_of(data, sep) if c.strip()])
    return wanted > 2 and len([c for c in cells_of(line, sep) if c.strip()]) == wanted


def _is_title(line: str) -> bool:
    """Whether one word stands alone in front of delimiters, as at the end of a title block."""
    cells = _tokens(line)
    return len(cells) == 1 and line.lstrip().startswith(cells[0]) and not is_unit(cells[0])


def _names_and_units(above: Sequence[Line], data: str) -> tuple[int | None, bool]:
    """Which of the lines above the data has the names, and whether the last one has units.

    Tags, descriptions and units may stand above each other, with as many cells as the data: names
    fill each cell, and none returns; units are units, or return. Two lines that could both be
    names without units below them are not chosen between: None where the first line is one.
    """
    sep = _sign_of(data)
    wanted = len(cells_of(data, sep))
    near = _ending(above)
    odd = [i for i in near if abs(len(cells_of(above[i][1], sep)) - wanted) > 1]
    odd += [i for i in near if _is_title(above[i][1])]
    near = [i for i in near if i > max(odd, default=-1)]
    able = [i for i in near if _is_full(above[i][1], data) and _is_distinct(above[i][1])]
    able = [i for i in able if not _has_number(above[i][1])]
    last = len(above) - 1
    again = bool(able) and last not in able and not _is_distinct(above[last][1])
    if again or _is_units(above[last][1], above[last - 1][1], data):
        able = [i for i in able if i != last] or [last - 1]
        timed = (i for i in able if is_time(_tokens(above[i][1])[0]))
        return next(timed, able[0]), True
    if able and last not in able:
        return able[0], False
    full = [i for i in _ending(above) if _is_full(above[i][1], data)]
    return (None if full and full[0] == 0 and len(full) > 1 else last), False


def _left_out(lines: Sequence[Line], where: str) -> tuple[str, ...]:
    """What is said of lines above or below the header."""
    if not lines:
        return ()
    many = len(lines) > 1
    which = f"lines {lines[0][0]} to {lines[-1][0]}" if many else f"line {lines[0][0]}"
    return (f"{which} {where} the header {_was(len(lines))} left out",)


def _is_distinct(line: str) -> bool:
    """Whether no filled cell of a line returns."""
    cells = _tokens(line)
    return len({*cells}) == len(cells)


def _is_units(line: str, header: str, data: str) -> bool:
    """Whether a line below a header holds units: as many cells, none a number, most a unit."""
    sep = _sign_of(data)
    names = [c.strip() for c in cells_of(header.rstrip(sep), sep)]
    cells = [c.strip().strip('"') for c in cells_of(line, sep)]
    stated = [c for c in cells if c and c not in ("1", *_NO_UNITS)]
    if not len(names) - 1 <= len(cells) <= len(names) + 1 or len(names) < 2 or not stated:
        return False
    if any(_NUMBER.fullmatch(c) for c in stated):
        return False
    hits = sum(looks_like_unit(c, _UNIT_NAMES) for c in stated)
    return 2 * hits > len(stated)


def _stated_units(titles: Sequence[str], header: str, data: str) -> str | None:
    """The line of a title block with units, as a row of units below the header would be.

    Its label stands where the header has the time, or before all columns: ``Vertical Units,V,A``.
    """
    sep = _sign_of(data)
    names = [c for c in cells_of(header.rstrip(sep), sep) if c.strip()]
    if names[-1].strip().lower() == "comment":
        names.pop()  # LabVIEW's own column of words
    for title in titles:
        label, *cells = (c.strip() for c in cells_of(title.rstrip(sep), sep))
        if label.strip('"').rstrip(":").lower() not in _UNIT_LABELS or not cells:
            continue
        if 0 <= len(names) - len(cells) <= 1:
            return sep.join([""] * (len(names) - len(cells)) + cells)
    return None


def _is_processing(line: str) -> bool:
    """Whether a line says of each column how it was summed up; ``min`` alone is a unit."""
    stated = {c.lower() for c in _tokens(line)}
    return bool(stated) and stated <= _PROCESSING and stated != {"min"}


def _was(n: int) -> str:
    return "was" if n == 1 else "were"


_BEHIND = re.compile(
    r"(?P<base>.*?[^\s/_,])(?:\s*[\[(](?P<unit>[^\[\]()]*)[\])]|\s+in\s+(?P<word>[A-Za-zµμ°%Ω]\S*)"
    r"|\s*[/_,]?\s*(?P<sign>[°º%]\S*)|(?:[\s,]\s*|\s*/\s+)(?P<bare>\S+))"
)
"""A name with its unit: ``u [V]``, ``speed (rpm)``, ``Temperatur in °C``, ``T / °C``, ``flap %``,
``Druck bar``."""
_BRACKET = re.compile(r".*[\[(](?P<unit>[^\[\]()]*)[\])]")
"""What ends in a bracket has its unit there: ``Leak valve[%]``."""
_BARE = frozenset(u for u in UNITS if len(u) > 1 and u not in (*UNIT_WORDS, "rev", "drive"))
"""Units that are no word of a name (as ``left drive`` and ``motor A``), where no sign says so."""


def names_and_units(raw: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Take ``u [V]`` or ``flap %`` apart; columns that would then share a name keep it whole."""
    split = [_name_and_unit(n) for n in raw]
    pairs = {(name, base) for name, (base, _) in zip(raw, split, strict=True)}
    shared = Counter(base for _, base in pairs)
    names = (n if shared[base] > 1 else base for n, (base, _) in zip(raw, split, strict=True))
    return tuple(names), tuple(unit for _, unit in split)


def _name_and_unit(raw: str) -> tuple[str, str]:
    """A name without the unit behind it, and that unit; empty for none."""
    match = _BEHIND.fullmatch(raw)
    if match is None:
        return raw, ""
    bracket = _BRACKET.fullmatch(raw) if match["bare"] else None
    if bracket is not None and (
        "[" in raw or (is_unit(bracket["unit"]) and len(bracket["unit"]) != 1)
    ):
        return raw[: bracket.start("unit") - 1].rstrip(" /_,"), bracket["unit"].strip()
    word, bare = match["word"], match["bare"]
    known = is_unit(word or "%") and (not bare or bare in _BARE or ("/" in bare and is_unit(bare)))
    unit = match["unit"] or word or match["sign"] or bare or ""
    return (match["base"], unit.strip()) if known else (raw, "")


def distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names, with ``(2)`` behind the second of one name and so on."""
    out: list[str] = []
    for name in names:
        numbered = (name, *(f"{name} ({k})" for k in range(2, len(names) + 2)))
        out.append(next(n for n in numbered if n not in out and (n == name or n not in names)))
    return tuple(out)
