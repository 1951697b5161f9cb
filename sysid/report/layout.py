"""The layout of a picture in a page: one column, as wide as a phone shows it with legible letters.

A wide window shows several such pictures beside one another, magnified.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 3.28
"""Of a picture [in]: a phone 360 px wide less the page's margins of 16 px, so that 7.5 pt text is
10.4 px high."""

Look = tuple[str, float]
"""Colour and width [pt] of a line."""

LINE = 0.17
"""Height of a line of text [in]."""
_HANDLE, _GAP = 0.23, 0.17
"""Room of a legend's line before its name, and between two entries [in]."""
_MEASURED = 0.95
"""Letters measured on a grid of pixels may be that much narrower than their outlines."""


@lru_cache(maxsize=4096)
def _room(words: str) -> float:
    """Width of small words [in]."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family=style.RC["font.family"], size=style.SMALL)
    width, _, _ = text_to_path.get_text_width_height_descent(style.printable(words), font, False)
    return float(width) / 72.0


def broken(words: str, inches: float) -> list[str]:
    """Words on as many lines as fit in a width; a per cent sign stays with its number."""
    lines = [""]
    for word in re.split(r" +(?!%)", words):
        longer = f"{lines[-1]} {word}".strip()
        if _room(longer) <= inches:
            lines[-1] = longer
            continue
        lines.append("")
        for letter in word:  # a name may be longer than a line
            if _room(lines[-1] + letter) > inches:
                lines.append("")
            lines[-1] += letter
    return [line for line in lines if line] or [""]


def legend_height(entries: Collection[str]) -> float:
    """Room at a picture's top that its legend needs [in]."""
    return LINE * len(_legend_rows(entries)) + 0.07 if entries else 0.0


def _legend_rows(entries: Iterable[str]) -> list[list[str]]:
    """Names of a legend by line, as many on each as fit."""
    rows: list[list[str]] = []
    used = 0.0
    for name in entries:
        wide = _HANDLE + _GAP + _room(name)
        if not rows or used + wide > WIDTH:
            rows.append([])
            used = 0.0
        rows[-1].append(name)
        used += wide
    return rows


def legend(axes: "Axes", entries: Mapping[str, Look]) -> None:
    """Name lines by colour and width above the panels, on as many lines as the names need."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    for row, names in enumerate(_legend_rows(entries)):
        left = 0.06
        for name in names:
            left = _entry(axes, name, entries[name], left, (row + 0.5) * LINE)
    reserve_top(figure, legend_height(entries))


def _entry(axes: "Axes", name: str, look: Look, left: float, down: float) -> float:
    """Draw a line and its name ``left`` from the edge and ``down`` from the top [in].

    Returns:
        where the next entry begins [in].
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    width, height = (float(v) for v in figure.get_size_inches())
    y = 1.0 - down / height
    ends = [left / width, (left + _HANDLE - 0.07) / width]
    (handle,) = axes.plot(
        ends,
        [y, y],
        color=look[0],
        linewidth=look[1],
        transform=figure.transFigure,
        clip_on=False,
    )
    handle.set_in_layout(False)
    at = left + _HANDLE
    text = figure.text(at / width, y, name, size=style.SMALL, va="center_baseline")
    text.set_in_layout(False)
    style.shorten(text, _MEASURED * (WIDTH - at))
    return at + style.width_inches(text) + _GAP


def reserve_top(figure: "Figure", inches: float) -> None:
    """Keep panels that find their own places out of the uppermost part of a picture."""
    engine = figure.get_layout_engine()
    if engine is not None and figure.get_constrained_layout():
        height = float(figure.get_size_inches()[1])
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - inches / height))  # type: ignore[call-arg]


@dataclass(frozen=True)
class Row:
    """A row of panels: room above and below them [in], and their share of the height that is left.

    What stands below is an axis with its name by default.
    """

    above: float
    share: float = 1.0
    below: float = 0.42


_RIGHT = 0.14
"""Room at a picture's right edge [in], into which the last number of an axis reaches half."""


def arrange(
    figure: "Figure", rows: Sequence[Row], panels: Sequence["Axes"], top: float = 0.0
) -> None:
    """Place panels below one another so that their numbers and names have room.

    Only the widths of vertical axes are measured; a layout that finds all places takes as long as
    the drawing.

    Args:
        rows: from the top, one a panel.
        panels: in the order of the rows.
        top: room kept free at the top [in].
    """
    figure.set_layout_engine("none")
    width, height = (float(v) for v in figure.get_size_inches())
    left = height - top - sum(r.above + r.below for r in rows)
    each = left / sum(r.share for r in rows)

    def place(margin: float) -> None:
        at = height - top
        for axes, r in zip(panels, rows, strict=True):
            at -= r.above + each * r.share
            box = (margin, at, width - margin - _RIGHT, each * r.share)
            axes.set_position((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
            at -= r.below

    place(0.6)  # how many ticks there are follows from the heights, final now
    place(max(_left_room(axes) for axes in panels))


def _left_room(axes: "Axes") -> float:
    """How far numbers and name of a panel's vertical axis reach to its left [in]."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    box = axes.yaxis.get_tightbbox(renderer)
    reach = 0.0 if box is None else float(axes.bbox.x0 - box.x0) / figure.dpi
    return max(reach, 0.0) + 0.06
