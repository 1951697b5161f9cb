"""Panels of the residuals' correlations beside the bounds a correct model keeps."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array, Channel
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Correlation:
    """A correlation function of the residuals with the bound a correct model stays within.

    Attributes:
        lags: lags [samples], shape (L,).
        values: correlation coefficients, shape (L,).
        bound: half-width of the confidence band, a number or one per lag.
    """

    lags: Array
    values: Array
    bound: float | Array

    @property
    def band(self) -> Array:
        """The bound at each lag, shape (L,)."""
        return np.broadcast_to(np.asarray(self.bound, dtype=np.float64), np.shape(self.lags))


def draw_autocorrelation(axes: "Axes", correlation: Correlation, confidence: float) -> None:
    """Draw the residuals' own correlation over positive lags; at lag 0 it is 1 by definition."""
    lags, values = np.asarray(correlation.lags), np.asarray(correlation.values)
    later = lags > 0
    _stems(axes, lags[later], values[later], correlation.band[later], style.INK)
    axes.set_title("residual autocorrelation")
    _limits(axes, values[later], correlation.band[later])
    _note(axes, f"band: {confidence:g} %")


def draw_cross_correlation(
    axes: "Axes",
    correlations: tuple[Correlation, ...],
    inputs: tuple[Channel, ...],
    confidence: float,
) -> None:
    """Draw the residuals' correlation with each input.

    With one input the coefficients are drawn as they are. With several, each is divided by its
    own bound, so that one band serves all. Negative lags, where only feedback correlates, are
    greyed.
    """
    if len(correlations) == 1:
        only = correlations[0]
        lags, values, band = np.asarray(only.lags), np.asarray(only.values), only.band
        _stems(axes, lags, values, band, style.SERIES[0])
        style.title(axes, f"residual × {inputs[0].name}", 1.95)
        _note(axes, f"band: {confidence:g} %")
        _limits(axes, values, band)
    else:
        everything = [
            np.asarray(c.values) / np.where(c.band > 0, c.band, np.nan) for c in correlations
        ]
        lags = np.asarray(correlations[0].lags)
        _band(axes, lags, np.ones(len(lags)))
        for k, (c, values) in enumerate(zip(correlations, everything, strict=True)):
            axes.plot(c.lags, values, color=style.SERIES[k % len(style.SERIES)], linewidth=1.1)
        axes.set_title("residual × inputs")
        _note(axes, f"in units of the {confidence:g} % band")
        _limits(axes, np.concatenate(everything), np.ones(1))
    if lags.size and lags.min() < 0:
        axes.axvspan(lags.min() - 1.0, -0.5, color="white", alpha=0.6, linewidth=0, zorder=4)
        axes.axvline(-0.5, color=style.FAINT, linewidth=0.8, zorder=4.1)
        axes.text(
            0.02,
            0.03,
            "← feedback",
            transform=axes.transAxes,
            size=style.SMALL - 0.5,
            color=style.MUTED,
            zorder=5,
        )


def _note(axes: "Axes", words: str) -> None:
    axes.text(
        0.99,
        0.98,
        words,
        transform=axes.transAxes,
        ha="right",
        va="top",
        size=style.SMALL - 0.5,
        color=style.MUTED,
        zorder=5,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
    )


def _stems(axes: "Axes", lags: Array, values: Array, band: Array, colour: str) -> None:
    _band(axes, lags, band)
    axes.vlines(lags, 0.0, values, color=colour, linewidth=1.0)
    axes.plot(lags, values, linestyle="none", marker="o", markersize=2.4, color=colour)


def _band(axes: "Axes", lags: Array, band: Array) -> None:
    axes.fill_between(lags, -band, band, color="#d5e6f1", linewidth=0, zorder=0.5)
    axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)


def _limits(axes: "Axes", values: Array, band: Array) -> None:
    both = np.concatenate([np.abs(values), np.abs(band)])
    both = both[np.isfinite(both)]
    top = 1.45 * float(both.max()) if both.size and both.max() > 0 else 1.0
    axes.set_ylim(-top, top)
    axes.margins(x=0.02)
    axes.locator_params(axis="y", nbins=5)
    axes.locator_params(axis="x", nbins=6, integer=True)
