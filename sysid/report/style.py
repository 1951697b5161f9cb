"""The look of every picture: colours, type sizes and the few marks all of them share.

Colours are those of Okabe and Ito (2008), distinguishable by colour-blind readers and in grey
print. Pictures are 9 in wide, so that 9 pt text is 12 px high where the picture is shown 900 px
wide.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.report.envelope import isolated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

WIDTH = 9.0
"""Width of every picture [in]."""

INK = "#1f2933"
MUTED = "#616e7c"
FAINT = "#cbd2d9"
BLUE = "#0072b2"
VERMILION = "#d55e00"
GREEN = "#009e73"
SERIES = (BLUE, VERMILION, GREEN, "#cc79a7", "#e69f00", "#5b4fc4")
MEASURED = "#a3b1bf"

SMALL, NORMAL, LARGE = 7.5, 8.5, 12.5

RC: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],  # ships with matplotlib: the same letters on every machine
    "font.size": NORMAL,
    "text.color": INK,
    "text.parse_math": False,  # a "$" in a channel's name is a dollar, not a formula
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.8,
    "axes.labelcolor": MUTED,
    "axes.labelsize": SMALL,
    "axes.titlesize": NORMAL,
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.08,
    "grid.color": "#dfe4e9",
    "grid.linewidth": 0.5,
    "xtick.color": FAINT,
    "xtick.labelcolor": MUTED,
    "xtick.labelsize": SMALL,
    "xtick.major.size": 3.0,
    "ytick.color": FAINT,
    "ytick.labelcolor": MUTED,
    "ytick.labelsize": SMALL,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.2,
    "lines.solid_joinstyle": "round",
    "lines.solid_capstyle": "butt",
    "legend.frameon": False,
    "legend.fontsize": SMALL,
    "legend.handlelength": 1.4,
    "legend.handletextpad": 0.5,
    "legend.columnspacing": 1.2,
    "legend.borderaxespad": 0.0,
    "legend.borderpad": 0.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.06,
    "figure.constrained_layout.hspace": 0.0,
    "figure.constrained_layout.wspace": 0.02,
}


def labelled(name: str, unit: str) -> str:
    """The text of an axis: ``name [unit]``, or the name alone when the unit is unknown."""
    return f"{name} [{unit}]" if unit else name


def printable(words: str) -> str:
    """Replace what XML forbids or one line cannot show: control characters, lone surrogates."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in words)


def percent(value: float) -> str:
    """A fit in per cent with one decimal, or a dash where it is undefined."""
    return f"{value:.1f} %" if np.isfinite(value) else "–"


def heading(figure: "Figure", height: float, title: str, subtitle: str, colour: str = INK) -> None:
    """Give a picture its height [in]; write title and subtitle at the top left and keep their room
    free of panels.
    """
    figure.set_size_inches(width := WIDTH, height)
    top = 0.62 if subtitle else 0.42
    left = 0.10 / width
    lines = [figure.text(left, 1 - 0.10 / height, title, size=LARGE, weight="bold", color=colour)]
    if subtitle:
        lines.append(figure.text(left, 1 - 0.36 / height, subtitle, size=NORMAL, color=MUTED))
    for line in lines:
        line.set_verticalalignment("top")
        line.set_in_layout(False)
        shorten(line, width - 0.2)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - top / height))  # type: ignore[call-arg]


def width_inches(text: "Text") -> float:
    """Width of a text as it will be drawn [in]; what cannot be shown is replaced first."""
    text.set_text(printable(text.get_text()))
    figure = text.figure
    return float(text.get_window_extent().width / figure.dpi) if figure is not None else 0.0


def shorten(text: "Text", inches: float) -> None:
    """Cut a text that is wider than ``inches`` and end it with an ellipsis."""
    if width_inches(text) <= inches:
        return
    full = text.get_text()
    low, high = 0, len(full)
    while low < high:  # the longest beginning that fits
        middle = (low + high + 1) // 2
        text.set_text(full[:middle].rstrip() + "…")
        low, high = (middle, high) if width_inches(text) <= inches else (low, middle - 1)
    text.set_text(full[:low].rstrip() + "…")


def stroke(axes: "Axes", t: Array, y: Array, colour: str, **options: Any) -> None:
    """Draw a signal that may have gaps: a line where samples adjoin, a dot where one is alone."""
    axes.plot(t, y, color=colour, **options)
    alone = isolated(y)
    if alone.any():
        size = 2.0 + float(options.get("linewidth", 1.2))
        axes.plot(
            t[alone],
            y[alone],
            linestyle="none",
            marker="o",
            markersize=size,
            color=colour,
            markeredgewidth=0.0,
            zorder=options.get("zorder", 2.0),
        )


def title(axes: "Axes", words: str, inches: float) -> None:
    """Title a panel, cut to the room it has."""
    shorten(axes.set_title(words), inches)


def legend_above(axes: "Axes", entries: dict[str, tuple[str, float]], room: float) -> None:
    """Name lines by colour and width on the title's line, where the names hide no data.

    The names are cut to share the room [in]; with too many for that, none is shown.
    """
    each = room / len(entries) - 0.35
    if each < 0.3:
        return
    handles = [axes.plot([], [], color=c, linewidth=w)[0] for c, w in entries.values()]
    legend = axes.legend(
        handles,
        list(entries),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.5,
        ncols=len(handles),
    )
    legend.set_in_layout(False)
    for text in legend.get_texts():
        shorten(text, each)
