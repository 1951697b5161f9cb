"""The two layouts of a picture in a page: side by side, or one column for a phone."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Layout:
    """How a picture shares out its room.

    Attributes:
        width: of the picture [in]; a hundred pixels of the page each.
        stacked: panels in one column, names above their marks and legends on lines of their own.
    """

    width: float
    stacked: bool

    def columns(self, most: int) -> int:
        """Panels beside one another where there is room for ``most``."""
        return 1 if self.stacked else most


WIDE = Layout(style.WIDTH, stacked=False)
NARROW = Layout(3.28, stacked=True)
"""A phone 360 px wide less the page's margins of 16 px, so that 7.5 pt text is 10.4 px high."""

NARROWEST_WIDE = 944
"""Width of a window [px] in which a wide picture's 7.5 pt text is 10 px high, margins of 40 px
included: 80 + 900 · 10 / 10.4, rounded up; narrower windows show the narrow picture."""

LINE = 0.17
"""Height of a line of text [in]."""
_HANDLE, _GAP = 0.23, 0.17
"""Room of a legend's line before its name, and between two entries [in]."""
_MEASURED = 0.95
"""Letters measured on a grid of pixels may be that much narrower than their outlines."""
_WIDTHS = (
    ("ijl .,:;!'|·", 0.34),
    ("ftr()[]-/", 0.46),
    ("abcdeghknopqsuvxyz_0123456789", 0.64),
    ("ABCDEFGHIJKLNOPQRSTUVXYZ", 0.79),
)
"""Letters of DejaVu Sans and the widest among them, over the size; any other is at most 1 wide."""


def _room(words: str) -> float:
    """Width that small words do not exceed [in]."""
    widths = {letter: wide for letters, wide in _WIDTHS for letter in letters}
    return sum(widths.get(letter, 1.0) for letter in words) * style.SMALL / 72.0


def broken(words: str, inches: float) -> list[str]:
    """Words on as many lines as surely fit in a width; a per cent sign stays with its number."""
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


def legend_height(entries: Sequence[str], layout: Layout) -> float:
    """Room at a picture's top that its legend needs [in]; a wide one stands on a title's line."""
    return LINE * len(_legend_rows(entries, layout)) + 0.07 if layout.stacked and entries else 0.0


def _legend_rows(entries: Sequence[str], layout: Layout) -> list[list[str]]:
    """Names of a legend by line, as many on each as surely fit."""
    rows: list[list[str]] = []
    used = 0.0
    for name in entries:
        wide = _HANDLE + _GAP + _room(name)
        if not rows or used + wide > layout.width:
            rows.append([])
            used = 0.0
        rows[-1].append(name)
        used += wide
    return rows


def legend(axes: "Axes", entries: Mapping[str, tuple[str, float]], layout: Layout) -> None:
    """Name lines by colour and width above the panels, on as many lines as the names need."""
    if not layout.stacked:
        style.legend_above(axes, dict(entries))
        return
    figure = axes.get_figure(root=True)
    assert figure is not None
    for row, names in enumerate(_legend_rows(list(entries), layout)):
        left = 0.06
        for name in names:
            left = _entry(axes, name, entries[name], left, (row + 0.5) * LINE, layout)
    reserve_top(figure, legend_height(list(entries), layout))


def _entry(
    axes: "Axes", name: str, look: tuple[str, float], left: float, down: float, layout: Layout
) -> float:
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
    style.shorten(text, _MEASURED * (layout.width - at))
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


_BESIDE = 0.14
"""Room between panels beside one another and at a picture's right edge [in], into which the last
number of an axis reaches half."""


def arrange(
    figure: "Figure",
    rows: Sequence[Row],
    columns: Sequence[Sequence[tuple[int, "Axes"]]],
    top: float = 0.0,
) -> None:
    """Place panels so that their numbers and names have room.

    Only the widths of vertical axes are measured; a layout that finds all places takes as long as
    the drawing.

    Args:
        figure: that holds them.
        rows: from the top.
        columns: the panels of each column with their rows; all columns are of one width.
        top: room kept free at the top [in].
    """
    figure.set_layout_engine("none")
    width, height = (float(v) for v in figure.get_size_inches())
    left = height - top - sum(r.above + r.below for r in rows)
    each = left / sum(r.share for r in rows)
    tall = [each * r.share for r in rows]
    ends, at = [], height - top  # bottoms of the panels
    for r, panel in zip(rows, tall, strict=True):
        ends.append(at - r.above - panel)
        at = ends[-1] - r.below

    def place(margins: Sequence[float]) -> None:
        wide = (width - sum(margins) - _BESIDE * len(columns)) / len(columns)
        begin = 0.0
        for margin, panels in zip(margins, columns, strict=True):
            begin += margin
            for row, axes in panels:
                box = (begin / width, ends[row] / height, wide / width, tall[row] / height)
                axes.set_position(box)
            begin += wide + _BESIDE

    place([0.6] * len(columns))  # how many ticks there are follows from the heights, final now
    place([max(_left_room(axes) for _, axes in panels) for panels in columns])


def _left_room(axes: "Axes") -> float:
    """How far numbers and name of a panel's vertical axis reach to its left [in]."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    box = axes.yaxis.get_tightbbox(renderer)
    reach = 0.0 if box is None else float(axes.bbox.x0 - box.x0) / figure.dpi
    return max(reach, 0.0) + 0.06
