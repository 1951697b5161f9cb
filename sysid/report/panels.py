"""Panels: lines with bands and dots over one axis, drawn alone, side by side, or as a table.

A panel holds numbers, not ink: the same one is drawn into a file, stands in a page, and is written
as CSV.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sysid.data.documents import by_field
from sysid.data.record import Array
from sysid.report import style
from sysid.report.envelope import envelope
from sysid.report.movement import Mover
from sysid.report.plots import write_picture
from sysid.structures.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Kind = Literal["line", "steps", "dots", "stems", "marks", "area", "words"]

BINS = 700
"""A line of more points is drawn by its envelope over so many stretches."""

DIGITS = 7
"""Of a stored point."""

ABOVE = 2
"""Names that stand beside the title; more stand within the panel."""

LONGEST = 36
"""Letters of a name at a panel's side."""

HEIGHT = 2.5
"""Of one panel [in]."""

PLACES = 9
"""At which a picture shows what moves on a page."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a panel.

    Attributes:
        label: in the legend; an empty one has no entry. ``words`` stand at their points instead.
        low, high: ends of a band, (n,), NaN or infinite where there is none.
        colour: index into the series; -1 for what was measured.
    """

    label: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None
    kind: Kind = "line"
    colour: int = 0

    def to_json(self) -> dict[str, Any]:
        """Its fields, as many points and digits as a page shows."""
        x, y = thinned(self) if self.low is None else (self.x, self.y)
        short = {k: _short(v) for k, v in (("x", x), ("y", y))}
        ends = {k: _short(v) for k in ("low", "high") if (v := getattr(self, k)) is not None}
        return by_field(self) | short | ends


def _short(values: Array) -> list[float]:
    return [float(f"{v:.{DIGITS}g}") for v in values]


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves over one axis.

    Attributes:
        name: letters of a file and an anchor, such as ``step-omega_l``.
        limits: of the vertical axis; None where the curves set them.
        rules: horizontal lines, such as 0 or a limit.
        names: of rows from 0: the curves then lie, x down and y across.
        equal: whether both axes have one scale (a plane).
        circle: whether the unit circle is drawn.
        note: a sentence below the panel.
        large: whether it has the room of four on a wide page.
        movers: what moves over a plane, all in the same time.
    """

    name: str
    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False
    limits: tuple[float, float] | None = None
    rules: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    equal: bool = False
    circle: bool = False
    note: str = ""
    large: bool = False
    movers: tuple[Mover, ...] = ()


@dataclass(frozen=True, eq=False)
class PanelPicture:
    """Panels side by side under a title; a large one by itself, twice as high."""

    title: str
    subtitle: str
    panels: tuple[Panel, ...]
    columns: int = 2

    def draw(self, figure: "Figure") -> None:
        """Draw all panels in rows."""
        columns = min(self.columns, len(self.panels))
        rows: list[list[Panel]] = []
        for panel in self.panels:
            if not rows or len(rows[-1]) == columns or panel.large or rows[-1][0].large:
                rows.append([])
            rows[-1].append(panel)
        heights = [HEIGHT * (1 + row[0].large) + 0.25 for row in rows]
        style.heading(figure, 0.7 + sum(heights), self.title, self.subtitle)
        grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
        for k, row in enumerate(rows):
            for j, panel in enumerate(row):
                place = grid[k, :] if panel.large else grid[k, j]
                draw_panel(figure.add_subplot(place), panel)


def draw_panels(path: Path, title: str, subtitle: str, panels: "Panels", columns: int = 2) -> None:
    """Draw panels into a file."""
    write_picture(path, PanelPicture(title, subtitle, panels, columns))


@dataclass(frozen=True, eq=False)
class Shown:
    """A model, what to call it, and the processor time of one of its steps [s] where known."""

    label: str
    model: Model
    cost: float | None = None


Panels = tuple[Panel, ...]


def panel(
    title: str,
    x: str,
    y: str,
    curves: Sequence[Curve],
    equal: bool = False,
    around: Sequence[Curve] = (),
) -> Panel:
    """A panel named by its title, whose curves take the colours in turn; references lie below.

    Args:
        curves: those of the colour -1 keep it.
        around: what lies below all of them and keeps its colours.
    """
    references = [c for c in curves if c.colour < 0]
    others = [c for c in curves if c.colour >= 0]
    turned = [replace(c, colour=k) for k, c in enumerate(others)]
    return Panel(title, title, x, y, (*around, *references, *turned), equal=equal)


RAD = "frequency [rad/s]"


def draw_panel(axes: "Axes", panel: Panel) -> None:
    """Draw the curves, their names and the axes."""
    for curve in panel.curves:
        _draw(axes, curve, lying=bool(panel.names))
    for m in panel.movers:
        for k in np.linspace(0, len(m.t) - 1, PLACES).astype(int):
            outline = m.at(k)
            axes.fill(*outline.T, color=_colour(m.colour), alpha=0.7, linewidth=0, zorder=3)
    _frame(axes, panel)
    axes.set_xlabel(_cut(panel.x))
    axes.set_ylabel(_cut(panel.y))
    shown = [c for c in reversed(panel.curves) if c.label and c.kind != "words"]
    named = {_cut(c.label): (_colour(c.colour), 2.0) for c in shown}
    named = dict(reversed(named.items()))
    wide = 4.2 * panel.large
    style.title(axes, panel.title, wide + (1.9 if len(named) == ABOVE else 3.6))
    if len(named) == ABOVE:
        style.legend_above(axes, named, room=2.1 + wide)
    elif len(named) > ABOVE:
        lines = [axes.plot([], [], color=c, linewidth=w)[0] for c, w in named.values()]
        legend = axes.legend(lines, list(named), loc="best", frameon=True)
        legend.get_frame().set(alpha=0.8, edgecolor="none")


def _frame(axes: "Axes", panel: Panel) -> None:
    """Scales, limits, rules and the names of rows."""
    for level in panel.rules:
        rule = axes.axvline if panel.names else axes.axhline
        rule(level, color=style.INK, linewidth=0.6, zorder=1.5)
    if panel.circle:
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.plot(np.cos(turn), np.sin(turn), color=style.MUTED, linewidth=0.7)
    if panel.limits is not None:
        axes.set_ylim(*panel.limits)
    for axis, log in ((axes.xaxis, panel.log_x), (axes.yaxis, panel.log_y)):
        if log:
            _logarithmic(axes, axis)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.names:
        axes.set_yticks(range(len(panel.names)), [_cut(n) for n in panel.names])
        axes.invert_yaxis()
    if any(c.kind in ("dots", "marks") for c in panel.curves):
        axes.margins(x=0.05)


def _logarithmic(axes: "Axes", axis: Any) -> None:
    """Ticks at decades; at 2 and 5 as well where there are few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    across = axis is axes.xaxis
    (axes.set_xscale if across else axes.set_yscale)("log")
    low, high = axes.get_xlim() if across else axes.get_ylim()
    few = low > 0.0 and high < 300.0 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.5g}"))
    axis.set_minor_formatter(NullFormatter())


def _cut(words: str) -> str:
    """Words that leave room for what they name."""
    shown = style.printable(words)
    return shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 1]}…"


def _colour(index: int) -> str:
    return style.MEASURED if index < 0 else style.SERIES[index % len(style.SERIES)]


def _draw(axes: "Axes", c: Curve, lying: bool) -> None:
    colour = _colour(c.colour)
    x, y = (c.y, c.x) if lying else (c.x, c.y)
    if c.kind in ("dots", "marks"):
        if c.low is not None and c.high is not None:
            error = np.maximum(np.array([c.y - c.low, c.high - c.y]), 0.0)
            side = {"xerr" if lying else "yerr": error}
            axes.errorbar(x, y, fmt="o", markersize=3.5, color=colour, linewidth=1.0, **side)
            return
        mark, size = ("x", 5.0) if c.kind == "marks" else ("o", 2.2)
        axes.plot(x, y, mark, color=colour, markersize=size, markeredgewidth=1.2)
        return
    if c.kind == "words":
        for at in zip(x, y, strict=True):
            beside: dict[str, Any] = {
                "xytext": (5.0, 3.0),
                "textcoords": "offset points",
                "zorder": 7,
            }
            axes.annotate(style.printable(c.label), at, size=style.SMALL, **beside)
        return
    if c.kind == "area":
        axes.fill(c.x, c.y, color=colour, alpha=0.3, linewidth=0)
        return
    if c.kind == "stems" and lying:
        axes.barh(c.x, c.y, 0.4, color=colour)
        return
    if c.kind == "stems":
        x = np.repeat(c.x, 3)
        y = np.column_stack([0.0 * c.y, c.y, np.full(len(c.y), np.nan)]).ravel()
        axes.plot(x, y, color=colour, linewidth=1.3)
        return
    if c.low is not None and c.high is not None:
        low, high = (np.where(np.isfinite(e), e, np.nan) for e in (c.low, c.high))
        axes.fill_between(c.x, low, high, color=colour, alpha=0.2, linewidth=0)
    x, y = thinned(c)
    wide = 2.4 if c.colour < 0 else 1.3
    drawstyle = "steps-post" if c.kind == "steps" else "default"
    style.stroke(axes, x, y, colour, linewidth=wide, drawstyle=drawstyle)


def thinned(c: Curve) -> tuple[Array, Array]:
    """A curve's points, or those of its envelope where they are many."""
    return (c.x, c.y) if len(c.x) <= 2 * BINS else envelope(c.x, c.y, BINS)


def table(panels: Sequence[Panel]) -> str:
    """The numbers as CSV: panel, curve, x, y, and the ends of its 95 % band."""
    text = io.StringIO()
    text.write("panel,curve,x,y,low,high\n")
    for panel in panels:
        for c in panel.curves:
            none = np.full(len(c.x), np.nan)
            low, high = (none if e is None else e for e in (c.low, c.high))
            head = f"{_cell(panel.name)},{_cell(c.label)}"
            for row in zip(c.x, c.y, low, high, strict=True):
                cells = ("" if not np.isfinite(v) else f"{v:.9g}" for v in row)
                text.write(f"{head},{','.join(cells)}\n")
    return text.getvalue()


def _cell(words: str) -> str:
    shown = style.printable(words).replace('"', "'")
    return f'"{shown}"' if "," in shown else shown
