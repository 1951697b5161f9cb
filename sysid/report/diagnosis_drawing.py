"""Drawing a diagnosis: regimes, residual profiles, the worst places and the paths of a mission."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.validation.localise import Region
from sysid.report import style
from sysid.report.diagnosis_picture import Profile, RegimeLine, Window, reach
from sysid.report.layout import LINE, WIDTH, Look, Row, arrange, broken, legend, legend_height

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = style.VERMILION, style.BLUE
_ROW, _REGION_ROW = 0.27, 0.36
_SHARES = {
    "of the excess error, 95 % interval": (BEFORE, 5.0),
    "of the samples": (style.MEASURED, 4.0),
}


def draw_regions(figure: "Figure", regions: Sequence[Region]) -> None:
    """Bars: the share of the excess error in a regime over the share of the samples."""
    axes, k = _named_rows(figure, [r.region for r in regions], _REGION_ROW, _SHARES)
    excess = 100.0 * np.array([r.share_of_excess for r in regions])
    samples = 100.0 * np.array([r.share_of_samples for r in regions])
    axes.barh(k - 0.14, excess, 0.3, color=BEFORE, alpha=0.9)
    axes.barh(k + 0.2, samples, 0.2, color=style.MEASURED)
    for y, r in zip(k, regions, strict=True):
        low, high = (100.0 * float(np.clip(v, 0.0, 1.2)) for v in r.interval)
        axes.plot([low, high], [y - 0.14] * 2, color=style.INK, linewidth=1.0)
    axes.set_xlim(0.0, max(100.0, float(excess.max()) * 1.05) if len(regions) else 100.0)
    axes.set_xlabel("%")
    legend(axes, _SHARES)


def draw_regimes(
    figure: "Figure",
    lines: Sequence[RegimeLine],
    unit: str,
    floor: float,
    *,
    changed: bool,
) -> None:
    """Dumbbells: the RMS error in each regime before and after, over the noise floor."""
    entries = {**_models(4.0, changed), "noise floor": (style.MUTED, 1.0)}
    names = [f"{line.regime}  ·  {100 * line.share:.0f} %" for line in lines]
    axes, k = _named_rows(figure, names, _ROW, entries)
    for y, line in zip(k, lines, strict=True):
        axes.plot([line.before, line.after], [y, y], color=style.FAINT, linewidth=2.2)
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5.5}
    axes.plot([line.before for line in lines], k, color=BEFORE, zorder=3, **dots)
    if changed:
        axes.plot([line.after for line in lines], k, color=AFTER, zorder=4, **dots)
    axes.axvline(floor, color=style.MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_xlim(0.0, 1.06 * max([floor, *(max(x.before, x.after) for x in lines)]))
    axes.set_xlabel(style.labelled("RMS error", unit))
    legend(axes, entries)


def _row_tops(names: Sequence[str], row: float) -> Array:
    """Where each row begins, and the last ends, below the top of the panel [in]."""
    heights = [row + LINE * len(_lines(n)) for n in names] or [row]
    return np.concatenate([[0.0], np.cumsum(heights)])


def _lines(name: str) -> list[str]:
    """A name on as many lines as it needs above its row."""
    return broken(name, WIDTH - 0.25)


def _named_rows(
    figure: "Figure", names: Sequence[str], row: float, entries: Mapping[str, Look]
) -> tuple["Axes", Array]:
    """A panel with a row a name below room for a legend, and the middle of each row's marks; a unit
    is a row's height.

    The names stand above their marks.
    """
    figure.set_layout_engine("none")
    tops = _row_tops(names, row)
    width, height = WIDTH, 0.42 + float(tops[-1]) + legend_height(entries)
    figure.set_size_inches(width, height)
    left, right = 0.14, 0.16
    axes = figure.add_axes(
        (left / width, 0.42 / height, (width - left - right) / width, tops[-1] / height)
    )
    axes.set_ylim(tops[-1] / row, 0)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    middles = tops[1:] / row - 0.5
    for top, name in zip(tops, names, strict=False):
        for k, words in enumerate(_lines(name)):
            _row_name(axes, words, (top + LINE * (k + 0.5)) / row)
    return axes, middles[: len(names)]


def _row_name(axes: "Axes", words: str, y: float) -> None:
    text = style.words(axes, words, (0.0, y), (-4.0, 0.0), style.FROM_LEFT, ha="left", va="center")
    text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # over the panel's lines
    text.set_in_layout(False)


def draw_profiles(
    figure: "Figure",
    profiles: Sequence[Profile],
    unit: str,
    floor: float,
    *,
    changed: bool,
) -> None:
    """Residuals against each regime variable: mean and the middle 80 %, before and after."""
    panels: list[Axes] = []
    top = legend_height(_models(2.0, changed))
    figure.set_size_inches(WIDTH, top + 1.45 * len(profiles))
    low, high = reach([p.before for p in profiles] + [p.after for p in profiles])
    pad = 0.06 * (high - low)
    for k, p in enumerate(profiles):
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"{k}")
        panels.append(axes)
        axes.axhspan(-1.28 * floor, 1.28 * floor, color=style.BAND, linewidth=0, zorder=0.5)
        for values, colour in ((p.before, BEFORE), (p.after, AFTER))[: 1 + changed]:
            axes.fill_between(p.x, values[0], values[2], color=colour, alpha=0.16, linewidth=0)
            axes.plot(p.x, values[1], color=colour, linewidth=1.4)
        axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
        axes.set_ylim(low - pad, high + pad)
        axes.locator_params(nbins=5)
        axes.set_xlabel(p.variable)
        axes.set_ylabel(style.labelled("residual", unit))
    legend(panels[0], _models(2.0, changed))
    arrange(figure, [Row(0.1)] * len(panels), panels, top)


def draw_worst(figure: "Figure", windows: Sequence[Window], *, changed: bool) -> None:
    """Measured and simulated traces where the original model errs most, the command below."""
    panels: list[Axes] = []
    entries = {"measured": (style.MEASURED, 3.0), **_models(1.4, changed)}
    top = legend_height(entries)
    figure.set_size_inches(WIDTH, top + 2.75 * len(windows))
    for k, w in enumerate(windows):
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"{k}")
        for values, colour, width in (
            (w.measured, style.MEASURED, 3.0),
            (w.before, BEFORE, 1.2),
            (w.after, AFTER, 1.3),
        )[: 2 + changed]:
            style.stroke(axes, w.t, values, colour, linewidth=width)
        axes.tick_params(labelbottom=False)
        title = style.title(axes, style.labelled(w.output, w.unit), 2.6)
        title.set_fontweight("bold")
        if k == 0:
            legend(axes, entries)
        below = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=f"command {k}", sharex=axes)
        panels += [axes, below]
        below.plot(w.t, w.command, color=style.INK, linewidth=0.9, drawstyle="steps-post")
        below.locator_params(axis="x", nbins=6)
        below.locator_params(axis="y", nbins=3)
        style.title(below, w.command_name, 2.6, color=style.MUTED, pad=2.0)
        below.set_xlabel(f"time in {w.record} [s]")
    arrange(figure, [Row(0.3, 2.3, 0.1), Row(0.2)] * len(windows), panels, top)


def _models(width: float, changed: bool) -> dict[str, tuple[str, float]]:
    """Entries of a legend for the models that differ."""
    both = {"before": (BEFORE, width), "after": (AFTER, width)}
    return both if changed else {"simulated": (BEFORE, width)}


def draw_path(figure: "Figure", paths: Sequence[tuple[str, Array]]) -> None:
    """Paths over the plane: measured, before and after; others in further colours."""
    figure.set_size_inches(WIDTH, 3.0 + legend_height([name for name, _ in paths]))
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
    axes.locator_params(nbins=6)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(x=0.05, y=0.08)
    legend(axes, entries)


def draw_schedule(figure: "Figure", columns: Sequence[str], rows: Array) -> None:
    """Commands of an experiment over time, held between the rows."""
    figure.set_size_inches(WIDTH, 1.6 + legend_height(columns[1:]))
    axes = figure.add_subplot()
    entries = {}
    for j, name in enumerate(columns[1:]):
        colour = style.SERIES[j % len(style.SERIES)]
        axes.plot(rows[:, 0], rows[:, j + 1], color=colour, linewidth=1.2, drawstyle="steps-post")
        entries[name] = (colour, 1.6)
    axes.set_xlabel("time [s]")
    axes.locator_params(axis="x", nbins=6)
    axes.locator_params(axis="y", nbins=4)
    legend(axes, entries)
