"""Drawing a diagnosis: regimes, residual profiles, the worst places and the paths of a mission."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.validation.localise import Region
from sysid.report import style
from sysid.report.diagnosis_picture import Profile, RegimeLine, Window, reach
from sysid.report.layout import LINE, WIDE, Layout, Row, arrange, broken, legend, legend_height

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = style.VERMILION, style.BLUE
_ROW, _REGION_ROW = 0.27, 0.36
_LEFT = 3.75
"""Room for the names of regimes beside their rows [in]."""
_SHARES = {
    "of the excess error, 90 % interval": (BEFORE, 5.0),
    "of the samples": (style.MEASURED, 4.0),
}


def regions_size(regions: Sequence[Region], layout: Layout = WIDE) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return _rows_size([r.region for r in regions], _REGION_ROW, list(_SHARES), layout)


def draw_regions(figure: "Figure", regions: Sequence[Region], layout: Layout = WIDE) -> None:
    """Bars: the share of the excess error in a regime over the share of the samples."""
    axes, k = _named_rows(figure, [r.region for r in regions], _REGION_ROW, layout)
    excess = 100.0 * np.array([r.share_of_excess for r in regions])
    samples = 100.0 * np.array([r.share_of_samples for r in regions])
    axes.barh(k - 0.14, excess, 0.3, color=BEFORE, alpha=0.9)
    axes.barh(k + 0.2, samples, 0.2, color=style.MEASURED)
    for y, r in zip(k, regions, strict=True):
        low, high = (100.0 * float(np.clip(v, 0.0, 1.2)) for v in r.interval)
        axes.plot([low, high], [y - 0.14] * 2, color=style.INK, linewidth=1.0)
    axes.set_xlim(0.0, max(100.0, float(excess.max()) * 1.05) if len(regions) else 100.0)
    axes.set_xlabel("%")
    legend(axes, _SHARES, layout)


def regimes_size(
    lines: Sequence[RegimeLine], *, changed: bool, layout: Layout = WIDE
) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return _rows_size(_regime_names(lines), _ROW, list(_regime_entries(changed)), layout)


def draw_regimes(
    figure: "Figure",
    lines: Sequence[RegimeLine],
    unit: str,
    floor: float,
    *,
    changed: bool,
    layout: Layout = WIDE,
) -> None:
    """Dumbbells: the RMS error in each regime before and after, over the noise floor."""
    axes, k = _named_rows(figure, _regime_names(lines), _ROW, layout)
    for y, line in zip(k, lines, strict=True):
        axes.plot([line.before, line.after], [y, y], color=style.FAINT, linewidth=2.2)
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5.5}
    axes.plot([line.before for line in lines], k, color=BEFORE, zorder=3, **dots)
    if changed:
        axes.plot([line.after for line in lines], k, color=AFTER, zorder=4, **dots)
    axes.axvline(floor, color=style.MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_xlim(0.0, 1.06 * max([floor, *(max(x.before, x.after) for x in lines)]))
    axes.set_xlabel(style.labelled("RMS error", unit))
    legend(axes, _regime_entries(changed), layout)


def _regime_names(lines: Sequence[RegimeLine]) -> list[str]:
    return [f"{line.regime}  ·  {100 * line.share:.0f} %" for line in lines]


def _regime_entries(changed: bool) -> dict[str, tuple[str, float]]:
    return {**_models(4.0, changed), "noise floor": (style.MUTED, 1.0)}


def _rows_size(
    names: Sequence[str], row: float, entries: Sequence[str], layout: Layout
) -> tuple[float, float]:
    """Width and height of a picture of named rows [in]."""
    top = legend_height(entries, layout) or 0.33
    return layout.width, 0.42 + float(_row_tops(names, row, layout)[-1]) + top


def _row_tops(names: Sequence[str], row: float, layout: Layout) -> Array:
    """Where each row begins, and the last ends, below the top of the panel [in]."""
    above = [LINE * len(_lines(n, layout)) if layout.stacked else 0.0 for n in names]
    heights = [row + v for v in above] or [row]
    return np.concatenate([[0.0], np.cumsum(heights)])


def _lines(name: str, layout: Layout) -> list[str]:
    """A name as it stands beside its row, or on as many lines as it needs above it."""
    return broken(name, layout.width - 0.25) if layout.stacked else [name]


def _named_rows(
    figure: "Figure", names: Sequence[str], row: float, layout: Layout
) -> tuple["Axes", Array]:
    """A panel with a row a name, and the middle of each row's marks; a unit is a row's height.

    The names stand at the left, or above their marks where panels are stacked.
    """
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    tops = _row_tops(names, row, layout)
    left, right = (0.14, 0.16) if layout.stacked else (_LEFT, 0.2)
    axes = figure.add_axes(
        (left / width, 0.42 / height, (width - left - right) / width, tops[-1] / height)
    )
    axes.set_ylim(tops[-1] / row, 0)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    middles = tops[1:] / row - 0.5
    for y, top, name in zip(middles, tops, names, strict=False):
        for k, words in enumerate(_lines(name, layout)):
            at = (top + LINE * (k + 0.5)) / row if layout.stacked else float(y)
            _row_name(axes, words, at, layout)
    return axes, middles[: len(names)]


def _row_name(axes: "Axes", words: str, y: float, layout: Layout) -> None:
    text = axes.annotate(
        words,
        (0.0, y),
        xycoords=("axes fraction", "data"),
        xytext=(-4.0 if layout.stacked else -7.0, 0.0),
        textcoords="offset points",
        ha="left" if layout.stacked else "right",
        va="center",
        size=style.SMALL if layout.stacked else style.NORMAL,
    )
    if layout.stacked:  # lines of the panel pass behind it
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})
    else:
        style.shorten(text, _LEFT - 0.2)
    text.set_in_layout(False)


_ABREAST = 3
"""Profiles beside one another in a wide picture."""


def profiles_size(
    profiles: Sequence[Profile], *, changed: bool, layout: Layout = WIDE
) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    rows = -(-len(profiles) // layout.columns(_ABREAST))
    top = legend_height(list(_models(2.0, changed)), layout) or 0.4
    return layout.width, top + (1.45 if layout.stacked else 1.75) * rows


def draw_profiles(
    figure: "Figure",
    profiles: Sequence[Profile],
    unit: str,
    floor: float,
    *,
    changed: bool,
    layout: Layout = WIDE,
) -> None:
    """Residuals against each regime variable: mean and the middle 80 %, before and after."""
    abreast = layout.columns(_ABREAST)
    columns: list[list[tuple[int, Axes]]] = [[] for _ in range(min(abreast, len(profiles)))]
    low, high = reach([p.before for p in profiles] + [p.after for p in profiles])
    pad = 0.06 * (high - low)
    for k, p in enumerate(profiles):
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"{k}")
        columns[k % abreast].append((k // abreast, axes))
        axes.axhspan(-1.28 * floor, 1.28 * floor, color=style.BAND, linewidth=0, zorder=0.5)
        for values, colour in ((p.before, BEFORE), (p.after, AFTER))[: 1 + changed]:
            axes.fill_between(p.x, values[0], values[2], color=colour, alpha=0.16, linewidth=0)
            axes.plot(p.x, values[1], color=colour, linewidth=1.4)
        axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
        axes.set_ylim(low - pad, high + pad)
        axes.locator_params(nbins=5)
        axes.set_xlabel(p.variable)
        axes.tick_params(labelleft=k % abreast == 0)
        if k % abreast == 0:
            axes.set_ylabel(style.labelled("residual", unit))
        if k == min(abreast, len(profiles)) - 1:
            legend(axes, _models(2.0, changed), layout)
    top = legend_height(list(_models(2.0, changed)), layout) or 0.26
    arrange(figure, [Row(0.1)] * len(columns[0]), columns, top)


def worst_size(
    windows: Sequence[Window], *, changed: bool, layout: Layout = WIDE
) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    top = legend_height(list(_worst_entries(changed)), layout) or 0.2
    return layout.width, top + 2.75 * -(-len(windows) // layout.columns(2))


def draw_worst(
    figure: "Figure", windows: Sequence[Window], *, changed: bool, layout: Layout = WIDE
) -> None:
    """Measured and simulated traces where the original model errs most, the command below."""
    abreast = layout.columns(2)
    rows = -(-len(windows) // abreast)
    columns: list[list[tuple[int, Axes]]] = [[] for _ in range(min(abreast, len(windows)))]
    for k, w in enumerate(windows):
        row = 2 * (k // abreast)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"{k}")
        for values, colour, width in (
            (w.measured, style.MEASURED, 3.0),
            (w.before, BEFORE, 1.2),
            (w.after, AFTER, 1.3),
        )[: 2 + changed]:
            style.stroke(axes, w.t, values, colour, linewidth=width)
        axes.tick_params(labelbottom=False)
        title = style.title(axes, style.labelled(w.output, w.unit), 2.6 if layout.stacked else 1.6)
        title.set_fontweight("bold")
        if k == 0:
            legend(axes, _worst_entries(changed), layout)
        below = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"command {k}", sharex=axes)
        columns[k % abreast] += [(row, axes), (row + 1, below)]
        below.plot(w.t, w.command, color=style.INK, linewidth=0.9, drawstyle="steps-post")
        below.locator_params(axis="x", nbins=6)
        below.locator_params(axis="y", nbins=3)
        style.title(
            below, w.command_name, 2.6 if layout.stacked else 3.0, color=style.MUTED, pad=2.0
        )
        below.set_xlabel(f"time in {w.record} [s]")
    top = legend_height(list(_worst_entries(changed)), layout)
    arrange(figure, [Row(0.3, 2.3, 0.1), Row(0.2)] * rows, columns, top)


def _worst_entries(changed: bool) -> dict[str, tuple[str, float]]:
    return {"measured": (style.MEASURED, 3.0), **_models(1.4, changed)}


def _models(width: float, changed: bool) -> dict[str, tuple[str, float]]:
    """Entries of a legend for the models that differ."""
    both = {"before": (BEFORE, width), "after": (AFTER, width)}
    return both if changed else {"simulated": (BEFORE, width)}


def path_size(paths: Sequence[tuple[str, Array]], layout: Layout = WIDE) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    top = legend_height([name for name, _ in paths], layout)
    return layout.width, 3.0 + top if layout.stacked else 4.6


def draw_path(figure: "Figure", paths: Sequence[tuple[str, Array]], layout: Layout = WIDE) -> None:
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
    axes.locator_params(nbins=6 if layout.stacked else 9)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(x=0.05, y=0.08)
    if not layout.stacked:
        axes.set_title(" ")
    legend(axes, entries, layout)


def schedule_size(columns: Sequence[str], layout: Layout = WIDE) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return layout.width, 1.6 + legend_height(columns[1:], layout)


def draw_schedule(
    figure: "Figure", columns: Sequence[str], rows: Array, layout: Layout = WIDE
) -> None:
    """Commands of an experiment over time, held between the rows."""
    axes = figure.add_subplot()
    entries = {}
    for j, name in enumerate(columns[1:]):
        colour = style.SERIES[j % len(style.SERIES)]
        axes.plot(rows[:, 0], rows[:, j + 1], color=colour, linewidth=1.2, drawstyle="steps-post")
        entries[name] = (colour, 1.6)
    if not layout.stacked:
        axes.set_title(" ")
    axes.set_xlabel("time [s]")
    axes.locator_params(axis="x", nbins=6 if layout.stacked else 9)
    axes.locator_params(axis="y", nbins=4)
    legend(axes, entries, layout)
