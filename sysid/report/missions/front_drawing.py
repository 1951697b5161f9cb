"""The picture of a front of gains: trade-offs, and the proposed set."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style
from sysid.report.panels import Panel, draw_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.figure import Figure

_ROOM = 0.35
"""Room around the front, in parts of its span: what lies farther away is no choice."""

_LEGEND = 0.62
"""Where the legend begins below the upper edge [in]: under title and subtitle."""

_SHADES = ("#cfe4f1", "#7fb8dc", "#0072b2", "#00304d")
"""From little to much, distinguishable in grey print."""


@dataclass(frozen=True)
class Mark:
    """A set with a name: the present gains, or those of a rule."""

    name: str
    x: float
    y: float


@dataclass(frozen=True, eq=False)
class Trade:
    """Two criteria against each other.

    Attributes:
        title, across, up: words.
        tried: both criteria of every set that was driven, (K, 2).
        front: of the sets to choose from, (F, 2).
        marks: sets with names.
    """

    title: str
    across: str
    up: str
    tried: Array
    front: Array
    marks: tuple[Mark, ...]


@dataclass(frozen=True, eq=False)
class FrontPicture:
    """What sets of gains trade, coloured by one criterion, and answers of two of them.

    Attributes:
        trades: up to three.
        shade: of every member of the front, (F,), and what it is.
        proposed: which member is proposed.
    """

    title: str
    subtitle: str
    trades: tuple[Trade, ...]
    shade: Array
    shade_name: str
    proposed: int
    answers: tuple[Panel, ...]

    def draw(self, figure: "Figure") -> None:
        """Draw the trades in the first row, the answers in the second."""
        height = 7.0 if self.answers else 3.8
        style.heading(figure, height, self.title, self.subtitle)
        rows = 2 if self.answers else 1
        grid = figure.add_gridspec(rows, 1, height_ratios=(1.15, 1.0)[:rows])
        engine = figure.get_layout_engine()
        if engine is not None:  # a strip for the legend of all panels
            top = (_LEGEND + 0.22) / height
            engine.set(rect=(0.0, 0.0, 1.0, 1.0 - top))  # type: ignore[call-arg]
        upper = grid[0].subgridspec(1, len(self.trades))
        panels = [figure.add_subplot(upper[0, k]) for k in range(len(self.trades))]
        dots = [_trade(axes, t, self) for axes, t in zip(panels, self.trades, strict=True)]
        bar = figure.colorbar(dots[-1], ax=panels, fraction=0.03, pad=0.01, aspect=25)
        bar.set_label(self.shade_name, size=style.SMALL)
        bar.outline.set_visible(False)
        handles, names = panels[0].get_legend_handles_labels()
        legend = figure.legend(
            handles, names, loc="upper left", ncols=len(names),
            bbox_to_anchor=(0.1 / style.WIDTH, 1.0 - _LEGEND / height),
        )  # fmt: skip
        legend.set_in_layout(False)
        if self.answers:
            lower = grid[1].subgridspec(1, len(self.answers))
            for k, panel in enumerate(self.answers):
                draw_panel(figure.add_subplot(lower[0, k]), panel)


def _trade(axes: "Axes", trade: Trade, picture: FrontPicture) -> "PathCollection":
    from matplotlib.colors import LinearSegmentedColormap

    shades = LinearSegmentedColormap.from_list("effort", _SHADES)
    low, high = _window(trade)
    inside = np.all((trade.tried >= low) & (trade.tried <= high), axis=1)
    x, y = trade.tried[inside].T
    axes.scatter(x, y, s=5, color=style.FAINT, label="tried", zorder=2)
    dots = axes.scatter(
        trade.front[:, 0], trade.front[:, 1], s=22, c=picture.shade, cmap=shades,
        edgecolors=style.INK,
        linewidths=0.4, label="to choose from", zorder=4,
    )  # fmt: skip
    best = trade.front[picture.proposed]
    axes.scatter(
        best[0], best[1], s=130, marker="*", color=style.VERMILION,
        edgecolors="white", linewidths=0.7,
        label="proposed", zorder=6,
    )  # fmt: skip
    rules = 0
    for mark in trade.marks:
        at = np.array([mark.x, mark.y])
        if not np.all((at >= low) & (at <= high)):
            continue
        is_present = mark.name == "present"
        rules += not is_present
        label = mark.name if is_present else "rules" if rules == 1 else None
        colour, shape = (style.INK, "D") if is_present else (style.GREEN, "s")
        axes.scatter(mark.x, mark.y, s=26, marker=shape, color=colour, label=label, zorder=5)
        if not is_present:
            size, place = style.SMALL - 1.0, (mark.x, mark.y)
            style.words(axes, mark.name, place, (5, 3), size=size, color=style.GREEN, zorder=7)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_title(trade.title)
    axes.set_xlabel(trade.across)
    axes.set_ylabel(trade.up)
    return dots


def _window(trade: Trade) -> tuple[Array, Array]:
    """Lowest and highest values that are shown: the front with room around it."""
    low, high = trade.front.min(axis=0), trade.front.max(axis=0)
    span = np.where(high > low, high - low, np.maximum(1e-3, 0.05 * np.abs(high)))
    lowest = np.where(low >= 0.0, -0.05 * high, -np.inf)  # none of the criteria is below 0
    return np.maximum(low - _ROOM * span, lowest), high + _ROOM * span
