"""The spectrum of a signal over an angle that it passes back and forth, at any number of lines.

Samples are gathered in narrow bins of the angle, so that one Fourier transform shows all waves a
rad at once, as closely as the range of the angle can tell them apart.
"""

import numpy as np
from scipy.fft import next_fast_len

from sysid.data.record import Array

WIDEST = 1.0 / 8.0
"""Bins are this part of the shortest wave: what a bin blurs is then 2 %."""

FINER = 4
"""Lines for each that the range of the angle distinguishes: a wave between two loses 3 %."""

MOST_BINS = 2**20
"""A wheel that turns on and on is followed to so many bins; beyond, short waves are not seen."""

APART = 2.0
"""Two waves are two when they lie so many times apart what the range of the angle resolves."""


def over_angle(angle: Array, signal: Array, highest: float) -> tuple[Array, Array]:
    """Lines [waves a rad] up to ``highest``, and Σ signal·exp(−i·line·angle) at each.

    Args:
        angle: of every sample [rad], (N,).
        signal: (N,).
    """
    low, span = float(np.min(angle)), max(float(np.ptp(angle)), 1e-9)
    width = max(2.0 * np.pi / highest * WIDEST, span / MOST_BINS)
    bins = np.floor((angle - low) / width).astype(np.intp)
    sums = np.bincount(bins, weights=signal)
    padded = next_fast_len(FINER * len(sums), real=True)  # a prime length takes six times as long
    whole = np.fft.rfft(sums, padded)
    lines = 2.0 * np.pi / width * np.arange(len(whole)) / padded
    # phases count from the angle zero, and samples lie in the middle of their bins
    turned = whole * np.exp(-1j * lines * (low + 0.5 * width))
    return lines[lines <= highest], turned[lines <= highest]


def strongest_lines(
    lines: Array, size: Array, between: tuple[float, float], span: float, count: int
) -> list[float]:
    """The strongest waves a rad, apart from each other; as many as asked for.

    Args:
        between: least and largest line.
        span: range of the angle [rad].
    """
    size = np.where(lines >= between[0], size, 0.0)
    apart = APART * 2.0 * np.pi / max(span, 1e-9)
    strongest: list[float] = []
    for _ in range(count):
        best = float(np.clip(lines[int(np.argmax(size))], *between))
        strongest.append(best)
        size = np.where(np.abs(lines - best) < apart, 0.0, size)
    return strongest
