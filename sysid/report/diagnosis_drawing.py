"""Drawing a diagnosis: regimes, residual profiles, the worst places and the paths of a mission."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.discrepancy.localise import Region
from sysid.report import style
from sysid.report.diagnosis_picture import Profile, RegimeLine, Window, reach

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = style.VERMILION, style.BLUE
_ROW = 0.27
_LEFT = 3.75
"""Room for the names of regimes [in]."""


def regions_size(regions: Sequence[Region]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.75 + 0.36 * len(regions)


def draw_regions(figure: "Figure", regions: Sequence[Region]) -> None:
    """Bars: the share of the excess error in a regime over the share of the samples."""
    axes = _named_rows(figure, [r.region for r in regions], 0.36)
    k = np.arange(len(regions)) + 0.5
    excess = 100.0 * np.array([r.share_of_excess for r in regions])
    samples = 100.0 * np.array([r.share_of_samples for r in regions])
    axes.barh(k - 0.14, excess, 0.3, color=BEFORE, alpha=0.9)
    axes.barh(k + 0.2, samples, 0.2, color=style.MEASURED)
    for y, r in zip(k, regions, strict=True):
        low, high = (100.0 * float(np.clip(v, 0.0, 1.2)) for v in r.interval)
        axes.plot([low, high], [y - 0.14] * 2, color=style.INK, linewidth=1.0)
    axes.set_xlim(0.0, max(100.0, float(excess.max()) * 1.05) if len(regions) else 100.0)
    axes.set_xlabel("%")
    style.legend_above(
        axes,
        {
            "of the excess error, 90 % interval": (BEFORE, 5.0),
            "of the samples": (style.MEASURED, 4.0),
        },
    )


def regimes_size(lines: Sequence[RegimeLine]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.75 + _ROW * len(lines)


def draw_regimes(
    figure: "Figure",
    lines: Sequence[RegimeLine],
    unit: str,
    floor: float,
    *,
    changed: bool,
) -> None:
    """Dumbbells: the RMS error in each regime before and after, over the noise floor."""
    names = [f"{line.regime}  ·  {100 * line.share:.0f} %" for line in lines]
    axes = _named_rows(figure, names, _ROW)
    for row, line in enumerate(lines):
        axes.plot([line.before, line.after], [row + 0.5] * 2, color=style.FAINT, linewidth=2.2)
    k = np.arange(len(lines)) + 0.5
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5.5}
    axes.plot([line.before for line in lines], k, color=BEFORE, zorder=3, **dots)
    if changed:
        axes.plot([line.after for line in lines], k, color=AFTER, zorder=4, **dots)
    axes.axvline(floor, color=style.MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_xlim(0.0, 1.06 * max([floor, *(max(x.before, x.after) for x in lines)]))
    axes.set_xlabel(style.labelled("RMS error", unit))
    style.legend_above(axes, {**_models(4.0, changed), "noise floor": (style.MUTED, 1.0)})


def _named_rows(figure: "Figure", names: Sequence[str], row: float) -> "Axes":
    """A panel with a row a name, the names at its left."""
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (_LEFT / width, 0.42 / height, (width - _LEFT - 0.2) / width, row * len(names) / height)
    )
    axes.set_ylim(max(len(names), 1), 0)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    for k, name in enumerate(names):
        text = axes.annotate(
            name,
            (0.0, k + 0.5),
            xycoords=("axes fraction", "data"),
            xytext=(-7.0, 0.0),
            textcoords="offset points",
            ha="right",
            va="center",
        )
        text.set_in_layout(False)
        style.shorten(text, _LEFT - 0.2)
    return axes


def profiles_size(profiles: Sequence[Profile]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.4 + 1.75 * -(-len(profiles) // 3)


def draw_profiles(
    figure: "Figure", profiles: Sequence[Profile], unit: str, floor: float, *, changed: bool
) -> None:
    """Residuals against each regime variable: mean and the middle 80 %, before and after."""
    rows = -(-len(profiles) // 3)
    grid = figure.add_gridspec(rows, 3)
    low, high = reach([p.before for p in profiles] + [p.after for p in profiles])
    pad = 0.06 * (high - low)
    for k, p in enumerate(profiles):
        axes = figure.add_subplot(grid[k // 3, k % 3])
        axes.axhspan(-1.28 * floor, 1.28 * floor, color=style.BAND, linewidth=0, zorder=0.5)
        for values, colour in ((p.before, BEFORE), (p.after, AFTER))[: 1 + changed]:
            axes.fill_between(p.x, values[0], values[2], color=colour, alpha=0.16, linewidth=0)
            axes.plot(p.x, values[1], color=colour, linewidth=1.4)
        axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
        axes.set_ylim(low - pad, high + pad)
        axes.locator_params(nbins=5)
        axes.set_xlabel(p.variable)
        axes.tick_params(labelleft=k % 3 == 0)
        if k % 3 == 0:
            axes.set_ylabel(style.labelled("residual", unit))
        if k < 3:
            axes.set_title(" ")
        if k == min(2, len(profiles) - 1):
            style.legend_above(axes, _models(2.0, changed))


def worst_size(windows: Sequence[Window]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.2 + 2.75 * -(-len(windows) // 2)


def draw_worst(figure: "Figure", windows: Sequence[Window], *, changed: bool) -> None:
    """Measured and simulated traces where the model before errs most, the command below."""
    rows = -(-len(windows) // 2)
    grid = figure.add_gridspec(2 * rows, 2, height_ratios=(2.3, 1.0) * rows)
    for k, w in enumerate(windows):
        axes = figure.add_subplot(grid[2 * (k // 2), k % 2])
        for values, colour, width in (
            (w.measured, style.MEASURED, 3.0),
            (w.before, BEFORE, 1.2),
            (w.after, AFTER, 1.3),
        )[: 2 + changed]:
            style.stroke(axes, w.t, values, colour, linewidth=width)
        axes.tick_params(labelbottom=False)
        title = style.title(axes, style.labelled(w.output, w.unit), 1.6)
        title.set_fontweight("bold")
        if k == 0:
            entries = {"measured": (style.MEASURED, 3.0), **_models(1.4, changed)}
            style.legend_above(axes, entries)
        below = figure.add_subplot(grid[2 * (k // 2) + 1, k % 2], sharex=axes)
        below.plot(w.t, w.command, color=style.INK, linewidth=0.9, drawstyle="steps-post")
        below.locator_params(axis="y", nbins=3)
        style.title(below, w.command_name, 3.0, color=style.MUTED, pad=2.0)
        below.set_xlabel(f"time in {w.record} [s]")


def _models(width: float, changed: bool) -> dict[str, tuple[str, float]]:
    """Entries of a legend for the models that differ."""
    both = {"before": (BEFORE, width), "after": (AFTER, width)}
    return both if changed else {"simulated": (BEFORE, width)}


PATH_SIZE = (style.WIDTH, 4.6)


def draw_path(figure: "Figure", paths: Sequence[tuple[str, Array]]) -> None:
    """Paths over the plane: measured, before and after; others in further colours."""
    axes = figure.add_subplot()
    known = {"measured": (style.MEASURED, 3.4), "before": (BEFORE, 1.6), "after": (AFTER, 1.6)}
    entries: dict[str, tuple[str, float]] = {}
    for k, (name, xy) in enumerate(paths):
        colour, width = known.get(name, (style.SERIES[(k + 2) % len(style.SERIES)], 1.2))
        every = max(1, len(xy) // 600)
        line = np.vstack([xy[::every], xy[-1:]])
        axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=width)
        axes.plot(*xy[-1], color=colour, marker="o", markersize=4.5, linestyle="none")
        entries[name] = (colour, width)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(x=0.05, y=0.08)
    axes.set_title(" ")
    style.legend_above(axes, entries)


SCHEDULE_SIZE = (style.WIDTH, 1.6)


def draw_schedule(figure: "Figure", columns: Sequence[str], rows: Array) -> None:
    """Commands of an experiment over time, held between the rows."""
    axes = figure.add_subplot()
    entries = {}
    for j, name in enumerate(columns[1:]):
        colour = style.SERIES[j % len(style.SERIES)]
        axes.plot(rows[:, 0], rows[:, j + 1], color=colour, linewidth=1.2, drawstyle="steps-post")
        entries[name] = (colour, 1.6)
    axes.set_title(" ")
    axes.set_xlabel("time [s]")
    axes.locator_params(axis="y", nbins=4)
    style.legend_above(axes, entries)
