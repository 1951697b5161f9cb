"""Panels of the residual tests: each statistic, lag by lag, against its limit."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SINGLE = 2.576
"""Half-width of the band that holds a standard normal value with 99 %."""


@dataclass(frozen=True, eq=False)
class LagTest:
    """A residual test as a picture shows it.

    Attributes:
        lags: lags [samples], shape (L,); negative ones are in the future.
        signals: names of what was lagged, one a row of ``values``.
        values: (signals, L); standard normal each for a right model, their squares add up to the
            statistic.
        statistic: what decides.
        limit: what it must not exceed; 0 where there was nothing to test.
        verdict: the outcome in a few words, as the tables have it.
        judged: whether the outcome counts against the model.
    """

    lags: Array
    signals: tuple[str, ...]
    values: Array
    statistic: float
    limit: float
    verdict: str
    judged: bool = True

    @property
    def passed(self) -> bool:
        """Whether the statistic is within its limit."""
        return self.statistic <= self.limit or self.limit == 0.0


def draw_whiteness(axes: "Axes", test: LagTest) -> None:
    """Draw how past residuals predict the residuals of one output, and what decides."""
    _draw(axes, test, "past residuals", None)


def draw_independence(axes: "Axes", test: LagTest, feedback: LagTest | None) -> None:
    """Draw the correlation of residuals with past inputs, and the test.

    Future inputs, which correlate under feedback only, stand faded at negative lags.
    """
    what = f"past {test.signals[0]}" if len(test.signals) == 1 else "past inputs"
    _draw(axes, test, what, feedback)


def _draw(axes: "Axes", test: LagTest, what: str, future: LagTest | None) -> None:
    style.title(axes, f"{what}: {test.verdict}", 1.95)
    every = [test] if future is None else [future, test]
    lags = np.concatenate([t.lags for t in every])
    axes.fill_between(
        [lags.min(), lags.max()], -SINGLE, SINGLE, color="#d5e6f1", linewidth=0, zorder=0.5
    )
    axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
    several = len(test.signals) > 1
    for t in every:
        faded = 0.35 if t is future else 1.0
        for k, values in enumerate(t.values):
            beside = 0.3 * (k - 0.5 * (len(t.values) - 1)) if several else 0.0
            colour = style.SERIES[k % len(style.SERIES)] if t is not test or several else style.INK
            # one broken line for all stems: a hundredth of the bytes of so many lines
            x = np.repeat(t.lags + beside, 3)
            y = np.column_stack([0.0 * values, values, np.full(len(values), np.nan)]).ravel()
            axes.plot(x, y, color=colour, linewidth=1.3, alpha=faded, solid_capstyle="butt")
    sizes = np.abs(np.concatenate([t.values.ravel() for t in every]))
    top = 1.5 * max(SINGLE, float(sizes.max(initial=0.0)))
    axes.set_ylim(-top, top)
    axes.set_xlim(lags.min() - 1.0, lags.max() + 0.22 * np.ptp(lags) + 1.0)
    axes.locator_params(axis="y", nbins=5)
    axes.set_xticks([tick for tick in (-20, -10, 0, 10, 20) if lags.min() <= tick <= lags.max()])
    if future is not None:
        axes.axvline(-0.5, color=style.FAINT, linewidth=0.8, zorder=1.4)
        _note(axes, 0.02, 0.03, "← feedback", "left")
    _note(axes, 0.02, 0.97, "band: 99 %", "left")
    _gauge(axes, test)


def _gauge(axes: "Axes", test: LagTest) -> None:
    """A column at the right: the sum of squares over its limit."""
    if test.limit <= 0.0:
        return
    beside = axes.inset_axes((0.88, 0.0, 0.1, 1.0))
    ratio = test.statistic / test.limit
    colour = style.MUTED if test.passed or not test.judged else style.VERMILION
    beside.bar([0.0], [ratio], width=0.8, color=colour, alpha=0.9)
    beside.axhline(1.0, color=style.INK, linewidth=1.0)
    beside.set_xlim(-0.6, 0.6)
    beside.set_ylim(0.0, 1.35 * max(ratio, 1.0))
    beside.set_xticks([])
    beside.set_yticks([])
    beside.grid(visible=False)
    for side in beside.spines.values():
        side.set_visible(False)
    sign = "<" if test.passed else ">"
    words = f"Σ² {test.statistic:.3g} {sign} {test.limit:.3g}"
    _note(axes, 0.99, 0.97, words, "right", colour)


def _note(
    axes: "Axes", x: float, y: float, words: str, side: str, colour: str = style.MUTED
) -> None:
    axes.text(
        x,
        y,
        words,
        transform=axes.transAxes,
        ha=side,
        va="top" if y > 0.5 else "bottom",
        size=style.SMALL - 0.5,
        color=colour,
        zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
    )
