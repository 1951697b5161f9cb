"""Tables, sentences and progress on the terminal; nothing else in the workbench prints.

Results go to stdout, everything about them (warnings, progress, errors) to stderr, so that
``--json`` leaves exactly one document on stdout. rich is imported when something is drawn.
"""

import math
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, Literal

from sysid.data import documents
from sysid.outside_text import visible

from .field_options import running, with_options

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

    from sysid.data.finding import Finding
    from sysid.report.page import Page
    from sysid.structures.model import Model, ParameterEstimate

_PIPE_WIDTH = 120
"""Columns of a table that is piped into a file, where neither a terminal nor COLUMNS says how wide
it is; sentences are not wrapped there."""

_STYLES = {"ok": "green", "note": "cyan", "warning": "yellow", "fatal": "bold red"}


def document(value: Any) -> None:
    """Print one JSON document on stdout; numbers that are not finite are null."""
    encoding = (getattr(sys.stdout, "encoding", None) or "ascii").lower()
    shown = _with_options(documents.plain(value))
    sys.stdout.write(documents.text(shown, ascii_only="utf" not in encoding))


def quiet() -> bool:
    """Whether the line asks for results and warnings only (``-q``)."""
    context = running()
    return context is not None and context.obj is not None and bool(context.obj.quiet)


def columns(stream: Any) -> int | None:
    """The width that COLUMNS or the terminal of a stream says; None for a pipe."""
    with suppress(KeyError, ValueError):
        if (said := int(os.environ["COLUMNS"])) > 0:
            return said
    try:
        return os.get_terminal_size(stream.fileno()).columns or None if stream.isatty() else None
    except (OSError, ValueError):
        return None


def say(sentence: str, style: str = "") -> None:
    """Print a line of a result on stdout, wrapped between words."""
    _print(sentence, sys.stdout, style)


def command(line: str) -> None:
    """Print a command to paste on stdout, as one line however long it is."""
    _print(line, sys.stdout, "", wrapped=False)


def note(sentence: str) -> None:
    """Print what a quiet line leaves out, dim on stdout."""
    if not quiet():
        _print(sentence, sys.stdout, "dim")


def warn(sentence: str) -> None:
    """Print a warning on stderr."""
    _print(sentence, sys.stderr, "yellow")


def cautions(sentences: Iterable[str]) -> None:
    """Print warnings on a result on stderr."""
    for sentence in sentences:
        warn(f"! {sentence}")


def files(facts: Mapping[str, Any], **words: str) -> None:
    """Print where files were written: those that the facts name, each after its word."""
    for key, word in words.items():
        if facts.get(key) is not None:
            say(f"{word}: {facts[key]}")


def error(sentence: str) -> None:
    """Print the sentence of a failed command, in red on stderr."""
    _print(sentence, sys.stderr, "bold red")


def table(
    headings: Sequence[str], rows: Sequence[Sequence[object]], title: str = "", caption: str = ""
) -> None:
    """Print a table on stdout; columns of numbers are aligned on the right.

    Args:
        rows: cells; floats are shown by :func:`number`, None as a dash.
    """
    console = _console(sys.stdout)
    cells = [[_cell(c) for c in row] for row in rows]
    heads = [shown(h) for h in headings]
    words = [max(map(len, " ".join(c).split(" "))) for c in zip(heads, *cells, strict=True)]
    framed = sum(words) + 3 * len(heads) < console.width  # a frame takes the room of words
    drawn = grid(heads, cells, rows, console.width, framed)
    if title:  # as a line of its own: rich would break it at the width of the table
        say(title, "bold")
    console.print(drawn)
    if caption:
        say(caption, "dim")


def grid(
    heads: Sequence[str],
    cells: Sequence[Sequence[str]],
    values: Sequence[Sequence[object]],
    width: int,
    framed: bool = False,
) -> "Table":
    """A table of so many columns of the terminal.

    Args:
        values: what the cells show; columns of numbers are aligned on the right.
    """
    from rich.table import Table
    from rich.text import Text

    drawn = Table(header_style="bold")
    if not framed:
        drawn = Table(header_style="bold", box=None, padding=(0, 2, 0, 0), pad_edge=False)
    beside = 3 * len(heads) + 1 if framed else 2 * len(heads) - 2
    wide = column_widths([heads, *cells], width - beside)
    for k, heading in enumerate(heads):
        known = [row[k] for row in values if row[k] is not None]
        side: Literal["left", "right"] = (
            "right" if known and all(map(_is_number, known)) else "left"
        )
        drawn.add_column(Text(heading), justify=side, overflow="fold", width=wide[k])
    for line in cells:
        drawn.add_row(*map(Text, line))
    return drawn


def column_widths(rows: Sequence[Sequence[str]], room: int) -> list[int]:
    """Width of each column of cells, headings among them, that share some room.

    Where they do not fit, the widest column that still has words to wrap is narrowed. Words are
    broken last, and those without a digit before numbers are.
    """
    from rich.cells import cell_len

    columns = list(zip(*rows, strict=True))
    wide = [max(map(cell_len, "\n".join(c).split("\n"))) for c in columns]
    words = [max(" ".join(c).split(" "), key=cell_len) for c in columns]
    least = [cell_len(w) for w in words]
    plain = [not any(map(str.isdigit, w)) for w in words]
    limits = (least, [1 if p else n for p, n in zip(plain, least, strict=True)], [1] * len(wide))
    for limit in limits:
        while sum(wide) > room:
            spare = [k for k, w in enumerate(wide) if w > limit[k]]
            if not spare:
                break
            wide[max(spare, key=wide.__getitem__)] -= 1
    return wide


def facts(pairs: Sequence[tuple[str, object]]) -> None:
    """Print names and values below each other on stdout."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 2))
    grid.add_column(overflow="fold")
    grid.add_column(overflow="fold")
    for name, value in pairs:
        grid.add_row(Text(shown(name), style="bold"), Text(_cell(value)))
    _console(sys.stdout).print(grid)


def findings(verdicts: "Sequence[Finding]") -> None:
    """Print findings on stdout, the severity in front of each and the advice below it."""
    from rich.text import Text

    console = _console(sys.stdout)
    for finding in verdicts:
        word = finding.severity.word
        head = f"{word:>8}  "
        line = Text(_wrapped(head + shown(finding.sentence), sys.stdout, " " * len(head)))
        line.stylize(_STYLES[word], 0, len(head))
        console.print(line, soft_wrap=True)
        if finding.advice:
            _print(" " * len(head) + finding.advice, sys.stdout, "dim")


def page(content: "Page") -> None:
    """Print what stands on a page below its title, but for the pictures."""
    for sentence in (*(words for _, words in content.checks), *content.text):
        say(sentence)
    for figure, words in content.tiles:
        say(f"{figure} {words}")
    for section in content.sections:
        if not section.within or section.text or section.rows or section.code:
            say("")
            say(section.title, "bold" if section.within else "bold cyan")
            for line in section.text:
                say(line)
            if section.rows:
                table(section.heads, section.rows, caption=section.note)
            for block in section.code:
                command(block)
            for name in section.files:
                say(f"File: {name}")


READING_LINES = 8
"""Most lines on how logs were read: more would hide the result."""


def reading(lines: Sequence[str]) -> None:
    """Print notes on how logs were read, one dim line each; sysid inspect shows the rest."""
    for line in lines[:READING_LINES]:
        note(line)
    if len(lines) > READING_LINES:
        more = len(lines) - READING_LINES
        note(f"{more} more notes on how the logs were read: sysid inspect.")


def number(value: float | None, digits: int = 5) -> str:
    """A number with so many significant digits; a dash where there is none."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return f"{value:.{digits}g}"


def reach(std_error: float | None, digits: int = 2) -> str:
    """Half of the 95 % interval of an error that is normal."""
    from sysid.estimation.assessment.delta_method import NORMAL

    return number(None if std_error is None else NORMAL * std_error, digits)


def parameters(model: "Model") -> None:
    """Print the parameters of a model, with 95 % intervals or why there are none.

    A question mark stands where the interval holds zero.
    """
    from sysid.estimation.assessment.delta_method import NORMAL

    rows = []
    for p in model.parameter_table():
        sure = p.visited and not (p.fixed or p.at_bound) and p.value and math.isfinite(p.std_error)
        share = f"{100.0 * NORMAL * p.std_error / abs(p.value):.2g} %" if sure else ""
        value = number(p.value if p.visited else None, 6)
        rows.append([p.name, value, interval(p), share, p.unit])
    table(["parameter", "value", "± 95 %", "relative", "unit"], rows)


def interval(p: "ParameterEstimate") -> str:
    """Half of a parameter's 95 % interval, marked where it holds zero, or why there is none."""
    if not p.visited:
        return "not excited"
    if p.fixed:
        return "fixed"
    if p.at_bound:
        return "at its bound"
    if not math.isfinite(p.std_error):
        return "not determined"
    from sysid.estimation.assessment.delta_method import NORMAL

    reach = NORMAL * p.std_error
    return f"{number(reach, 3)}{'' if abs(p.value) > reach else ' ?'}"


@contextmanager
def progress(label: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """Show a bar on stderr while the block runs; a line every ten seconds where it is piped.

    Nothing is shown of what takes less than a second.

    Args:
        total: number of steps; None when unknown.

    Yields:
        A function that takes how many more steps are done.
    """
    done = 0
    with stages(label, known=total is not None) as show:

        def count(steps: int) -> None:
            nonlocal done
            done += steps
            show(label, done / total if total else None)

        yield count


@contextmanager
def stages(label: str, *, known: bool = True) -> Iterator[Callable[[str, float | None], None]]:
    """Show a bar on stderr that also says what is being done; lines where it is piped.

    Args:
        label: what stands there before the first stage.
        known: whether the share that is over can be known.

    Yields:
        A function that takes what is being done and which share is over, 0 to 1.
    """
    if quiet():
        yield lambda what, share: None
        return
    with _bar(label, known) if sys.stderr.isatty() else _spoken(label) as show:
        furthest = 0.0

        def forward(what: str, share: float | None) -> None:
            nonlocal furthest
            furthest = max(furthest, share or 0.0)
            show(what, None if share is None else furthest)

        yield forward


DRAWN_AFTER = 1.0
"""Seconds after which a bar appears: what is quicker than that needs none."""


@contextmanager
def _bar(label: str, known: bool) -> Iterator[Callable[[str, float | None], None]]:
    """A bar on the terminal, with the share and the time left where the share is known."""
    from rich import progress as bars

    shown = (
        (bars.TaskProgressColumn(), bars.TimeRemainingColumn(compact=True), bars.TextColumn("left"))
        if known
        else (bars.TimeElapsedColumn(),)
    )
    what = bars.TextColumn("{task.description}", markup=False)
    bar = bars.Progress(
        bars.BarColumn(20), *shown, what, console=_console(sys.stderr), transient=True
    )
    task = bar.add_task(label, total=1.0 if known else None)
    over = Event()

    def appear() -> None:
        if not over.wait(DRAWN_AFTER):
            bar.start()

    thread = Thread(target=appear, daemon=True)
    thread.start()
    try:
        yield lambda what, share: bar.update(task, completed=share, description=what)
    finally:
        over.set()
        thread.join()
        bar.stop()


@contextmanager
def screen(wanted: bool) -> "Iterator[Callable[[RenderableType], None] | None]":
    """A part of the terminal that changes while the block runs.

    Args:
        wanted: whether anything is to be drawn.

    Yields:
        A function that draws something in the place of what was there; None without a terminal.
    """
    if not (wanted and sys.stdout.isatty()):
        yield None
        return
    from rich.live import Live

    with Live(console=_console(sys.stdout), auto_refresh=False) as live:
        yield lambda drawn: live.update(drawn, refresh=True)


SPOKEN_EVERY = 10.0
"""Seconds between two lines on progress where no terminal shows a bar."""


@contextmanager
def _spoken(label: str) -> Iterator[Callable[[str, float | None], None]]:
    """A line on stderr now and then while the block runs: what is done, how far, how long yet.

    A share that has not grown is not said again.
    """
    now: tuple[str, float | None] = (label, None)
    over = Event()

    def update(what: str, share: float | None) -> None:
        nonlocal now
        now = (what, share)

    def write_lines() -> None:
        started, said = monotonic(), (label, 0)
        while not over.wait(SPOKEN_EVERY):
            what, share = now
            seconds, percent = monotonic() - started, round(100.0 * (share or 0.0))
            far = ""
            if percent and (what, percent) != said:
                left = seconds * (1.0 / (share or 1.0) - 1.0)
                far = f", {percent} % done, about {left:.0f} s left"
                said = what, percent
            with suppress(OSError, ValueError):  # whoever reads may have gone
                sys.stderr.write(f"{what}: {seconds:.0f} s{far}\n")
                sys.stderr.flush()

    thread = Thread(target=write_lines, daemon=True)
    thread.start()
    try:
        yield update
    finally:
        over.set()
        thread.join()


def _with_options(value: Any) -> Any:
    """A JSON value whose texts name options instead of fields."""
    if isinstance(value, dict):
        return {key: _with_options(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_options(item) for item in value]
    return with_options(value) if isinstance(value, str) else value


def shown(text: str) -> str:
    """A text as the terminal gets it: options named, nothing that would steer it."""
    return visible(with_options(text))


def _print(sentence: str, stream: Any, style: str, wrapped: bool = True) -> None:
    from rich.text import Text

    text = shown(sentence)
    if wrapped:
        indent = text[: len(text) - len(text.lstrip(" "))]
        text = _wrapped(text, stream, indent + "  " * text.startswith("! "))
    # Text, not markup: a sentence may hold [x, y] or a file called [red].csv
    _console(stream).print(Text(text, style=style), soft_wrap=True)


def _wrapped(text: str, stream: Any, indent: str) -> str:
    """Lines of the width of a stream, broken between words only."""
    width = columns(stream)
    if width is None or len(text) <= width:
        return text
    return textwrap.fill(
        text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def _console(stream: Any) -> "Console":
    from rich.console import Console

    width = columns(stream) or _PIPE_WIDTH
    return Console(file=stream, width=width, highlight=False, markup=False, emoji=False)


def _is_number(cell: object) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value)
    return shown(str(value))
