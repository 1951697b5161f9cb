"""Bars of a diagnosis: errors before and after over the noise floor, and candidates by score."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.report import style
from sysid.report.diagnosis_words import ChannelLine, percent, score_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 14
"""Candidates drawn."""


def gap_size(lines: Sequence[ChannelLine]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.75 + 0.55 * len(lines)


def draw_gap(figure: "Figure", lines: Sequence[ChannelLine]) -> None:
    """Two bars an output, RMSE before and after; what lies left of the tick is noise.

    Each output has its own unit, so the bars are in per cent of the error before.
    """
    axes = _panel(figure, len(lines), 0.55, 1.5, 2.5)
    for k, line in enumerate(lines):
        whole = max(line.rmse_before, line.rmse_after, 1e-300)
        before, after, floor = (
            100.0 * v / whole for v in (line.rmse_before, line.rmse_after, line.noise_floor)
        )
        axes.barh(k + 0.3, before, 0.26, color=style.VERMILION)
        axes.barh(k + 0.62, after, 0.26, color=style.BLUE)
        axes.plot([floor] * 2, [k + 0.1, k + 0.84], color=style.INK, linewidth=1.6)
        _name(axes, k + 0.46, line.name, -8.0, "right", bold=True)
        unit = f" {line.unit}" if line.unit else ""
        words = f"{line.rmse_before:.3g} → {line.rmse_after:.3g}{unit}"
        _name(axes, k + 0.32, words, 8.0, "left", right=True)
        noise = f"noise {line.noise_floor:.3g}, closed {percent(line.closed_percent)}"
        _name(axes, k + 0.64, noise, 8.0, "left", right=True, faint=True)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("RMSE on held-out data [% of the larger]")
    style.legend_above(
        axes,
        {
            "before": (style.VERMILION, 5.0),
            "after": (style.BLUE, 5.0),
            "noise floor": (style.INK, 1.6),
        },
    )


def candidates_size(candidates: Sequence[tuple[str, float]]) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, 0.7 + 0.24 * min(len(candidates), MOST)


def draw_candidates(
    figure: "Figure",
    candidates: Sequence[tuple[str, float]],
    accepted: Sequence[str],
    tied: Sequence[str],
) -> None:
    """Every effect tried first by its score; accepted ones and their ties in colour."""
    shown = candidates[:MOST]
    axes = _panel(figure, len(shown), 0.24, 1.9, 0.9)
    for k, (id, score) in enumerate(shown):
        colour = style.MEASURED
        if id in accepted:
            colour = style.BLUE
        elif id in tied:
            colour = "#8dbfe0"
        value = score if np.isfinite(score) else 0.0
        axes.barh(k + 0.5, value, 0.62, color=colour)
        _name(axes, k + 0.5, id, -8.0, "right", bold=id in accepted)
        _name(axes, k + 0.5, score_words(score), 8.0, "left", right=True, faint=id not in accepted)
    scores = [s for _, s in shown if np.isfinite(s)] or [0.0]
    axes.set_xlim(min(0.0, 1.05 * min(scores)), max(1.02 * max(scores), 1e-9))
    axes.set_xlabel("score of the first round")
    entries = {"accepted": (style.BLUE, 5.0), "tied": ("#8dbfe0", 5.0)}
    if not tied:
        entries.pop("tied")
    if accepted:
        style.legend_above(axes, {**entries, "not taken": (style.MEASURED, 5.0)})


def _panel(figure: "Figure", rows: int, row: float, left: float, right: float) -> "Axes":
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (left / width, 0.4 / height, (width - left - right) / width, row * rows / height)
    )
    axes.set_ylim(max(rows, 1), 0)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    return axes


def _name(
    axes: "Axes",
    y: float,
    words: str,
    shift: float,
    side: str,
    *,
    bold: bool = False,
    right: bool = False,
    faint: bool = False,
) -> None:
    text = axes.annotate(
        words,
        (1.0 if right else 0.0, y),
        xycoords=("axes fraction", "data"),
        xytext=(shift, 0.0),
        textcoords="offset points",
        ha=side,
        va="center",
        weight="bold" if bold else "normal",
        color=style.MUTED if faint else style.INK,
        size=style.SMALL if faint else style.NORMAL,
        annotation_clip=False,
    )
    text.set_in_layout(False)
    style.shorten(text, 2.5)
