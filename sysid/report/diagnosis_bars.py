"""Bars of a diagnosis: errors before and after over the noise floor, and candidates by score."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.report import style
from sysid.report.diagnosis_words import ChannelLine, percent, score_words
from sysid.report.layout import LINE, WIDTH, legend, legend_height

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 14
"""Candidates drawn."""


@dataclass(frozen=True)
class Look:
    """How words beside a bar look.

    Attributes:
        size: of the letters where they are not faint [pt].
        room: width they may take [in].
    """

    bold: bool = False
    faint: bool = False
    size: float = style.NORMAL
    room: float = 2.5


PLAIN = Look()

_ERRORS = {
    "before": (style.VERMILION, 5.0),
    "after": (style.BLUE, 5.0),
    "noise floor": (style.INK, 1.6),
}
_GAP_ROW = 0.55 + 2.0 * LINE
_TIED = "#8dbfe0"
_CANDIDATE_ROW = 0.24


def draw_gap(figure: "Figure", lines: Sequence[ChannelLine]) -> None:
    """Two bars an output, RMSE before and after; what lies left of the tick is noise.

    Each output has its own unit, so the bars are in per cent of the error before.
    """
    axes = _panel(figure, _GAP_ROW, len(lines), (0.14, 0.18), _ERRORS)
    above = LINE / _GAP_ROW
    for k, line in enumerate(lines):
        whole = max(line.rmse_before, line.rmse_after, 1e-300)
        before, after, floor = (
            100.0 * v / whole for v in (line.rmse_before, line.rmse_after, line.noise_floor)
        )
        unit = f" {line.unit}" if line.unit else ""
        words = f"{line.rmse_before:.3g} → {line.rmse_after:.3g}{unit}"
        noise = f"noise {line.noise_floor:.3g}, closed {percent(line.closed_percent)}"
        top, row = k + 2.0 * above, 1.0 - 2.0 * above
        axes.barh(top + 0.3 * row, before, 0.26 * row, color=style.VERMILION)
        axes.barh(top + 0.62 * row, after, 0.26 * row, color=style.BLUE)
        ends = [top + 0.1 * row, top + 0.84 * row]
        axes.plot([floor] * 2, ends, color=style.INK, linewidth=1.6)
        _name(axes, k + 0.6 * above, line.name, -4.0, "left", Look(bold=True, room=1.4))
        _name(axes, k + 0.6 * above, words, 6.0, "right", Look(room=1.65), right=True)
        _name(axes, k + 1.6 * above, noise, -4.0, "left", Look(faint=True, room=3.1))
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("RMSE on held-out data [% of the larger]")
    legend(axes, _ERRORS)


def draw_candidates(
    figure: "Figure",
    candidates: Sequence[tuple[str, float]],
    accepted: Sequence[str],
    tied: Sequence[str],
) -> None:
    """The best effects tried first by their score, and every accepted one; those in colour."""
    more = [c for c in candidates[MOST:] if c[0] in accepted]
    shown = [*candidates[: MOST - len(more)], *more]
    left, entries = 1.5, _kinds(accepted, tied)
    axes = _panel(figure, _CANDIDATE_ROW, len(shown), (left, 0.6), entries)
    for k, (id, score) in enumerate(shown):
        colour = style.MEASURED
        if id in accepted:
            colour = style.BLUE
        elif id in tied:
            colour = _TIED
        value = score if np.isfinite(score) else 0.0
        axes.barh(k + 0.5, value, 0.62, color=colour)
        taken = id in accepted
        name = Look(bold=taken, size=style.SMALL, room=left - 0.15)
        _name(axes, k + 0.5, id, -8.0, "right", name)
        look = Look(faint=not taken, size=style.SMALL)
        _name(axes, k + 0.5, score_words(score), 8.0, "left", look, right=True)
    scores = [s for _, s in shown if np.isfinite(s)] or [0.0]
    axes.set_xlim(min(0.0, 1.05 * min(scores)), max(1.02 * max(scores), 1e-9))
    axes.locator_params(axis="x", nbins=3)
    axes.set_xlabel("fall of BIC, each alone")
    if entries:
        legend(axes, entries)


def _kinds(accepted: Sequence[str], tied: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Entries of the legend; none where nothing was accepted."""
    if not accepted:
        return {}
    kinds = {"accepted": (style.BLUE, 5.0), "tied": (_TIED, 5.0)}
    if not tied:
        kinds.pop("tied")
    return {**kinds, "not selected": (style.MEASURED, 5.0)}


def _panel(
    figure: "Figure",
    row: float,
    rows: int,
    margins: tuple[float, float],
    entries: Collection[str],
) -> "Axes":
    """Rows of a height [in] between margins at the left and the right, below room for a legend."""
    figure.set_layout_engine("none")
    (left, right), inches = margins, row * rows
    width, height = WIDTH, 0.4 + legend_height(entries) + inches
    figure.set_size_inches(width, height)
    axes = figure.add_axes(
        (left / width, 0.4 / height, (width - left - right) / width, inches / height)
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
    look: Look = PLAIN,
    *,
    right: bool = False,
) -> None:
    """Words ``shift`` points beside one end of the bars, cut to the room they have."""
    text = style.words(
        axes,
        words,
        (1.0 if right else 0.0, y),
        (shift, 0.0),
        style.FROM_LEFT,
        ha=side,
        va="center",
        weight="bold" if look.bold else "normal",
        color=style.MUTED if look.faint else style.INK,
        size=style.SMALL if look.faint else look.size,
        annotation_clip=False,
    )
    text.set_in_layout(False)
    style.shorten(text, look.room)
