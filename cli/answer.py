"""An answer that fits a screen: at most 24 lines of the terminal's width, and where the rest is."""

import re
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from . import render

LINES = 24
"""Lines of an answer, warnings included: those of the smallest terminal in use."""

HANGING = ("! ", "Read as: ")
"""Beginnings of paragraphs whose other lines are indented."""

NARROWEST, WIDEST = 40, 100
"""Columns within which the width of the terminal is followed: longer lines are hard to read."""


def width() -> int:
    """Columns of an answer: those of the terminal or of ``COLUMNS``, 80 where neither says."""
    return min(max(shutil.get_terminal_size((80, LINES)).columns, NARROWEST), WIDEST)


@dataclass
class Answer:
    """Lines of an answer in their order, printed together at the end.

    Attributes:
        ending: lines that the end of the answer will take, kept free by :meth:`cautions`.
    """

    ending: int = 2
    _files: Mapping[str, Path] = field(default_factory=dict)
    _lines: list[tuple[Any, str]] = field(default_factory=list)

    @staticmethod
    def with_files(ending: int, files: Mapping[str, Path | None]) -> "Answer":
        """One that names files before its last line: word → path; none where it was not written."""
        written = {word: path for word, path in files.items() if path is not None}
        return Answer(ending + len(written), written)

    @property
    def room(self) -> int:
        """Lines that are left before the ending."""
        return LINES - self.ending - len(self._lines)

    def say(self, text: str, style: str = "", most: int = 3, stream: Any = None) -> None:
        """Add a paragraph, broken between words, of at most so many lines; an empty one is none."""
        from rich.text import Text

        if style == "dim" and render.quiet():
            return
        for line in _wrapped(render.shown(text), most):
            self._lines += [(stream or sys.stdout, s) for s in _drawn(Text(line, style=style))]

    def note(self, text: str, most: int) -> None:
        """Add a paragraph on how logs were read, which a quiet line leaves out."""
        if not render.quiet():
            self.say(text, "dim", most)

    def table(self, heads: Sequence[str], rows: Sequence[Sequence[object]], spare: int = 0) -> int:
        """Add columns without a frame; cells of what is a number stand on the right.

        Args:
            spare: lines to leave free behind it.

        Returns:
            How many rows there was room for.
        """
        shown = len(rows)
        lines = _columns(heads, rows)
        while shown > 1 and len(lines) > self.room - spare:
            shown -= 1
            lines = _columns(heads, rows[:shown])
        self._lines += [(sys.stdout, line) for line in lines]
        return shown

    def cautions(self, sentences: Sequence[str], rest: str) -> None:
        """Add warnings on stderr while there is room: whole, else their first sentences.

        Args:
            rest: the command that shows them all.
        """
        told = list(dict.fromkeys(sentences))
        parts = [_wrapped(f"! {render.shown(s)}", LINES) for s in told]
        if sum(map(len, parts)) > self.room:
            parts = [_wrapped(f"! {_first_sentence(render.shown(s))}", 2) for s in told]
        kept = len(parts)
        while kept and sum(map(len, parts[:kept])) + (kept < len(parts)) > self.room:
            kept -= 1
        left = len(parts) - kept
        more = [[f"! {left} more warning{'s' * (left > 1)}: {rest}"]] if left else []
        for part in (*parts[:kept], *more):
            self.say("\n".join(part), "yellow", LINES, sys.stderr)

    def print(self, last: str = "") -> None:
        """Write all lines, each to its stream, then the files and a last one."""
        for word, path in self._files.items():
            self.say(f"{word}: {path}", "", 1)
        self.say(last, "bold", 1)
        for stream, line in self._lines:
            (sys.stdout if stream is sys.stderr else sys.stderr).flush()
            stream.write(f"{line}\n")


def _columns(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """The lines of a table without a frame."""
    cells = [["–" if c is None else _joined(render.shown(str(c))) for c in row] for row in rows]
    drawn = render.grid([render.shown(h) for h in heads], cells, rows, width())
    return [line.replace(_JOIN, " ") for line in _drawn(drawn)]


_JOIN = "\ue000"
"""Stands for a space at which a cell is not broken; no text holds it."""


def _joined(cell: str) -> str:
    """A cell whose numbers stay on one line with their intervals."""
    return cell.replace(" ± ", f"{_JOIN}±{_JOIN}")


def _first_sentence(text: str) -> str:
    """Up to the first full stop or semicolon behind which something else begins."""
    ends = [at for mark in (". ", "; ") if (at := text.find(mark)) > 0]
    return f"{text[: min(ends)]}." if ends else text


def _wrapped(text: str, most: int) -> list[str]:
    """A text in lines of the answer's width; what is longer ends in dots, behind a sentence or a
    part of one where that is in its second half."""
    lines: list[str] = []
    for part in text.splitlines():
        indent = " " * (len(part) - len(part.lstrip()) + (2 if part.startswith(HANGING) else 0))

        def filled(words: str, indent: str = indent) -> list[str]:
            return textwrap.wrap(
                words,
                width(),
                subsequent_indent=indent,
                break_long_words=False,
                break_on_hyphens=False,
            )

        whole = filled(part) or [""]
        if len(whole) > most:
            ends = [m.end() for m in re.finditer(r"[.;](?= )", part) if not indent]
            cuts = [f"{part[:end]} …" for end in ends if end > most * width() // 2]
            fitting = [c for c in map(filled, cuts) if len(c) <= most]
            last = whole[most - 1]
            last = last if len(last) <= width() - 2 else last[: last.rindex(" ")]
            whole = fitting[-1] if fitting else [*whole[: most - 1], f"{last} …"]
        lines += whole
    return lines


def _drawn(what: Any) -> list[str]:
    """The lines of something that rich draws, coloured where stdout is a terminal."""
    from rich.console import Console

    console = Console(
        file=StringIO(),
        width=width(),
        highlight=False,
        markup=False,
        emoji=False,
        force_terminal=sys.stdout.isatty(),
    )
    with console.capture() as kept:
        console.print(what, soft_wrap=not hasattr(what, "columns"))
    return [line.rstrip() for line in kept.get().rstrip("\n").split("\n")]
