"""Delays too long for a regression: the lags at which an input first shows in an output.

Input and output pass the filter that makes the input white; their cross-correlation over all lags,
by FFT, is then the impulse response but for scale (Box, Jenkins & Reinsel 1994, §11.2). Its
standard error is Bartlett's. Slow plants respond a little at many lags, so sums over neighbouring
lags are looked at as well. The lags found are coarse: they say where a regression is to look.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sysid.data.impulse import correlation, whitener
from sysid.data.record import Array, Record

SHARE = 4
"""A delay of more than a quarter of the record leaves too little of it behind the delay."""

CHANCE = 1e-3
"""Level over all lags at which a correlation counts as seen; a regression confirms it or not."""

NEAR = 12
"""Delays up to this one are within every regression that looks for them."""

CLEAR = 0.25
"""Share of the largest correlation from which on a lag belongs to the response: smaller ones may be
what the whitening left of the input's own memory."""

WIDTHS = (1, 4, 16, 64)
"""Numbers of neighbouring lags that are summed; the clearest of them decides."""

ORDER = 30
RIDGE = 1e-3
"""Power added to the input before it is whitened, relative to its own: smooth inputs (multisines,
chirps) would else be whitened to noise."""


MARGIN = 8
"""Lags on either side of a window in which the response may begin, and which a regression takes."""


def far_lags(windows: Sequence[range | None], near: int) -> NDArray[np.int64]:
    """Lags around windows of lags that reach beyond the lags 0 … ``near``, in order; often none."""
    ranges = [
        np.arange(max(w[0] - MARGIN, near + 1), w[-1] + MARGIN + 1)
        for w in windows
        if w is not None and w[-1] + MARGIN > near and w[-1] > NEAR
    ]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *ranges]))


def longest_delay(records: Sequence[Record]) -> int:
    """The longest delay [samples] looked for in these records."""
    return max(min(len(r) for r in records) // SHARE, 0)


def first_seen(records: Sequence[Record]) -> list[list[range | None]]:
    """Where each input is first seen in each output, [output][input]; None for nowhere."""
    ny, nu = records[0].ny, records[0].nu
    windows: list[list[range | None]] = [[None] * nu for _ in range(ny)]
    most = longest_delay(records)
    if most < 2:
        return windows
    for i in range(nu):
        us = [r.u[:, i] - r.u[:, i].mean() for r in records]
        white = whitener(us, min(ORDER, sum(map(len, us)) // 20), RIDGE)
        if white is None:
            continue
        filtered = [_filtered(white, u) for u in us]
        for j in range(ny):
            ys = [_filtered(white, r.y[:, j] - r.y[:, j].mean()) for r in records]
            windows[j][i] = _window(filtered, ys, most)
    return windows


def _filtered(white: Array, x: Array) -> Array:
    """The signal behind the whitening filter, at rest before the record."""
    return np.asarray(np.convolve(white, x)[: len(x)])


def _window(us: Sequence[Array], ys: Sequence[Array], most: int) -> range | None:
    """The first lags whose sum is beyond chance and not small beside the largest."""
    tried = [(_sizes(us, ys, most, w), w) for w in WIDTHS]
    size, width = max(tried, key=lambda t: float(t[0].max()))
    chance = float(-special.ndtri(CHANCE / (2.0 * len(size) * len(WIDTHS))))
    if not float(size.max()) >= chance:
        return None
    first = int(np.flatnonzero(size >= max(chance, CLEAR * float(size.max())))[0])
    return range(first, first + width)


def _sizes(us: Sequence[Array], ys: Sequence[Array], most: int, width: int) -> Array:
    """|Σ y(t+…) u(t−k)| over its standard error for k = 0 … most, ``width`` lags summed."""
    us = [u for u in us if len(u) >= width]
    sums = [np.convolve(y, np.ones(width), "valid") for y in ys if len(y) >= width]
    heads = [u[: len(s)] for u, s in zip(us, sums, strict=True)]
    if not sums:
        return np.zeros(most + 1)
    cross = np.asarray(sum(correlation(y, u, most) for u, y in zip(heads, sums, strict=True)))
    autocorrelations = [
        np.asarray(sum(correlation(x, x, most) for x in xs)) for xs in (heads, sums)
    ]
    # Bartlett: variance of Σ u(t−k) y(t) = N Σ R_u(l) R_y(l), from sums that are N times R each
    products = autocorrelations[0] * autocorrelations[1]
    variance = max(float(products[0] + 2.0 * products[1:].sum()), float(products[0]))
    variance /= max(sum(len(u) for u in heads), 1)
    return np.abs(cross) / np.sqrt(variance) if variance > 0.0 else np.zeros(most + 1)
