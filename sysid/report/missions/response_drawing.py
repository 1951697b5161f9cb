"""Pictures of tuning: responses over time beside a reference, and paths in the plane."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sysid.data.record import Array
from sysid.report import style
from sysid.report.missions.outlines import circle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW = 2.9
"""Height of a row of panels [in]."""


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a panel: its name, x and y, whether it is a reference, or dots instead."""

    name: str
    x: Array
    y: Array
    reference: bool = False
    dots: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines in one system of axes.

    Attributes:
        title, across, up: words of the panel and its axes.
        lines: at most six that are no reference.
        plane: whether both axes are lengths with one scale.
        discs: obstacles and goals of a plane, (x, y, radius, colour) [m].
        outlines: closed lines drawn faintly, (x, y) each.
    """

    title: str
    across: str
    up: str
    lines: tuple[Line, ...]
    plane: bool = False
    discs: tuple[tuple[float, float, float, str], ...] = ()
    outlines: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True, eq=False)
class ResponsePicture:
    """Panels in rows of at most three.

    Attributes:
        panels: in reading order.
    """

    title: str
    subtitle: str
    panels: tuple[Panel, ...]
    columns: int = 3

    def draw(self, figure: "Figure") -> None:
        """Draw every panel."""
        rows = -(-len(self.panels) // self.columns)
        style.heading(figure, 0.9 + _ROW * rows, self.title, self.subtitle)
        grid = figure.add_gridspec(rows, self.columns)
        for k, panel in enumerate(self.panels):
            draw_panel(figure.add_subplot(grid[k // self.columns, k % self.columns]), panel)
        entries = [axes.get_legend_handles_labels() for axes in figure.axes]
        if len(entries) > 1 and all(names == entries[0][1] for _, names in entries):
            figure.legend(
                *entries[0], loc="outside lower left", ncols=len(entries[0][1]), borderaxespad=0.8
            )
            return
        for axes in figure.axes:
            axes.legend(loc="best", borderaxespad=0.6)


def draw_panel(axes: "Axes", panel: Panel) -> None:
    """Draw one panel, without a legend.

    A later path in a plane is narrower: one that runs under another is seen beside it.
    """
    for x, y, radius, colour in panel.discs:
        axes.fill(*circle(x, y, radius), color=colour, zorder=2)
    for x_out, y_out in panel.outlines:
        axes.fill(x_out, y_out, facecolor=style.BLUE, alpha=0.15, linewidth=0.8, edgecolor="none")
    colours = iter(style.SERIES)
    drawn = sum(not line.reference for line in panel.lines)
    widths = iter([1.1 + 0.4 * k for k in reversed(range(drawn))] if panel.plane else [1.5] * drawn)
    for line in panel.lines:
        if line.reference:
            dashed: dict[str, Any] = {
                "color": style.INK,
                "linewidth": 1.0,
                "linestyle": (0, (4, 3)),
                "zorder": 4,
            }
            axes.plot(line.x, line.y, label=line.name, **dashed)
        elif line.dots:
            dotted: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.0}
            axes.plot(line.x, line.y, label=line.name, color=next(colours), **dotted)
        else:
            axes.plot(line.x, line.y, label=line.name, color=next(colours), linewidth=next(widths))
    axes.set_title(panel.title)
    axes.set_xlabel(panel.across)
    axes.set_ylabel(panel.up)
    axes.margins(x=0.02, y=0.1)
    if panel.plane:
        axes.set_aspect("equal", adjustable="datalim")
