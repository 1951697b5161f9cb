"""Shift between the clocks of two files of one drive, estimated from the motion in both.

Wheels roll s = r (φ_l + φ_r)/2 and turn ψ = r (φ_r − φ_l)/B; a camera sees s and ψ. Increments of
both over a short window are compared: for every shift of the clocks the camera's are regressed on
the wheels', so that neither r nor B nor the order or sign of the wheels need be known.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.data.record import Array

WINDOW = 4.0
"""Length of the window in samples of the slower file: its increments are then above the noise."""

SHORTEST_WINDOW = 0.2
"""… and at least this long [s]: a robot's speed changes over tenths of a second."""

MOST_LAGS = 60_000
"""Shifts compared at once at most; on longer logs the windows are longer, and refined after."""

OVERLAP = 0.3
"""Share of the shorter file that both must cover."""

AGREES = 0.6
"""Share of the squared motion that must agree before a shift is believed. Two drives of a dozen
commands each that have nothing to do with one another reach 0.4 at their best shift; wheels and
pose of one drive reach 0.9 and more even on slippery ground."""

RIVAL = 1.5
"""Another shift that leaves less than so many times what the best one leaves makes it doubtful."""

PIECES = 6
"""Pieces of the log whose shifts give the drift of the clocks and the standard error."""

VISIBLE = 4.0
"""A drift counts when it is so many of its standard errors."""


MATTERS = 0.2
"""… and over the log moves the clocks by this share of a sample of the slower file."""


@dataclass(frozen=True)
class Shift:
    """How the clock of a second file runs against that of the log.

    t_log = t_other + ``seconds`` + ``drift`` · (t_other − ``middle``)

    Attributes:
        seconds: the shift [s].
        std_error: of the shift [s].
        drift: seconds a second, 0 where none is visible.
        middle: the instant of the second file at which the shift holds [s].
        agreement: share of the squared motion of the second file that the log's explains.
        rival: another shift that agrees nearly as well [s], None where there is none.
    """

    seconds: float
    std_error: float = 0.0
    drift: float = 0.0
    middle: float = 0.0
    agreement: float = 1.0
    rival: float | None = None

    def to_log(self, t: Array) -> Array:
        """Instants of the second file on the log's clock [s]."""
        return np.asarray(t + self.seconds + self.drift * (t - self.middle))


def way_and_turn(x: Array, y: Array, psi: Array) -> Array:
    """Way along the heading and heading itself since the first sample, (N, 2).

    Args:
        x, y: position, (N,).
        psi: heading without jumps [rad], (N,).
    """
    mid = 0.5 * (psi[1:] + psi[:-1])
    along = np.diff(x) * np.cos(mid) + np.diff(y) * np.sin(mid)
    return np.column_stack([np.concatenate([[0.0], np.cumsum(along)]), psi - psi[0]])


def travelled(t: Array, speeds: Array) -> Array:
    """Integrals of speeds (N, k) by the trapezoidal rule."""
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(t)[:, None]
    return np.vstack([np.zeros(speeds.shape[1]), np.cumsum(steps, axis=0)])


def clock_shift(t_log: Array, log: Array, t_other: Array, other: Array) -> Shift:
    """The shift at which two files agree best on the motion that both saw.

    Args:
        t_log: instants of the log [s], (N,), increasing.
        log: what its wheels have rolled, (N, k).
        t_other: instants of the second file [s], (M,), increasing.
        other: way and turn that it saw, (M, 2).
    """
    from scipy.optimize import minimize_scalar

    steps = (float(np.median(np.diff(t_log))), float(np.median(np.diff(t_other))))
    window = max(WINDOW * max(steps), SHORTEST_WINDOW)
    length = float(np.ptp(t_log) + np.ptp(t_other))
    coarse = max(0.5 * window, length / MOST_LAGS)
    a = _increments(t_log, log, np.arange(t_log[0], t_log[-1], coarse), window)
    b = _increments(t_other, other, np.arange(t_other[0], t_other[-1], coarse), window)
    lags, share, gain = _all_lags(a, b)
    at = int(np.argmax(gain))
    start = float(t_log[0] - t_other[0])
    best = start + coarse * lags[at]
    far = np.abs(lags - lags[at]) * coarse > max(2.0, 5.0 * window)
    rival = int(np.argmax(np.where(far, gain, -np.inf)))
    same = far.any() and 1.0 - share[rival] < RIVAL * (1.0 - share[at])

    def unexplained(shift: float, low: float, high: float) -> float:
        return 1.0 - _agreement(t_log, log, t_other, other, shift, window, (low, high))

    def refined(low: float, high: float, around: float) -> float:
        near = (around - 2.0 * coarse, around + 2.0 * coarse)
        lowest = minimize_scalar(
            unexplained, bounds=near, args=(low, high), options={"xatol": 1e-5 * window}
        )
        return float(lowest.x)

    low = max(float(t_other[0]), float(t_log[0]) - best)
    high = min(float(t_other[-1]), float(t_log[-1]) - best)
    shift = refined(low, high, best)
    agreement = 1.0 - unexplained(shift, low, high)
    edges = np.linspace(low, high, PIECES + 1)
    mids = 0.5 * (edges[1:] + edges[:-1])
    piece_shifts = np.array([refined(p, q, shift) for p, q in pairwise(edges.tolist())])
    kept = (
        np.abs(piece_shifts - shift) < 1.9 * coarse
    )  # a piece at rest has no information and ends anywhere
    middle, drift, error = 0.5 * (low + high), 0.0, 0.0
    if kept.sum() >= 4:
        centred = mids[kept] - mids[kept].mean()
        slope = float(centred @ piece_shifts[kept] / (centred @ centred))
        deviation = piece_shifts[kept] - piece_shifts[kept].mean() - slope * centred
        spread = float(np.sqrt(deviation @ deviation / (kept.sum() - 2)))
        error = spread / float(np.sqrt(kept.sum()))
        seen = abs(slope) > VISIBLE * spread / float(np.sqrt(centred @ centred))
        if seen and abs(slope) * (high - low) > MATTERS * max(steps):
            drift, shift = (
                slope,
                float(piece_shifts[kept].mean() + slope * (middle - mids[kept].mean())),
            )
    other_shift = start + coarse * float(lags[rival]) if same else None
    return Shift(shift, error, drift, middle, agreement, other_shift)


def _increments(t: Array, whole: Array, at: Array, window: float) -> Array:
    """Increments of the columns over ``window`` around the instants ``at``, (n, k)."""
    late, early = at + 0.5 * window, at - 0.5 * window
    return np.column_stack([np.interp(late, t, c) - np.interp(early, t, c) for c in whole.T])


def _all_lags(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Lags, share of b that a explains by least squares at each, and what it gains.

    At lag l row i of b meets row i − l of a. Sums over the rows that meet are correlations; the
    gain −n ln(1 − R²) compares overlaps of different length.
    """
    from scipy.signal import correlate

    a = np.column_stack([np.ones(len(a)), a / (np.std(a, axis=0) + 1e-300)])
    b = b / (np.std(b, axis=0) + 1e-300)
    n, m, k = len(a), len(b), a.shape[1]

    def sums(p: Array, q: Array) -> Array:
        return np.asarray(correlate(q, p, method="fft"))

    lags = np.arange(-(n - 1), m).astype(np.float64)
    one = np.ones(m)
    count = np.rint(sums(np.ones(n), one))
    gram = np.empty((len(lags), k, k))
    for i in range(k):
        for j in range(i, k):
            gram[:, i, j] = gram[:, j, i] = sums(a[:, i] * a[:, j], one)
    gram += 1e-6 * count[:, None, None] * np.eye(k)
    rest = np.zeros(len(lags))
    for column in b.T:
        cross = np.stack([sums(a[:, i], column) for i in range(k)], axis=1)
        explained = np.einsum("li,li->l", cross, np.linalg.solve(gram, cross[:, :, None])[:, :, 0])
        power = sums(np.ones(n), column**2)
        mean = sums(np.ones(n), column)
        spread = np.maximum(power - mean**2 / np.maximum(count, 1.0), 1e-9 * np.maximum(count, 1.0))
        rest += np.clip((power - explained) / spread, 1e-9, 1.0)
    share = 1.0 - rest / b.shape[1]
    enough = count >= OVERLAP * min(n, m)
    gain = np.where(enough, -count * np.log(np.maximum(1.0 - share, 1e-9)), -np.inf)
    return -lags, share, gain


def _agreement(
    t_log: Array,
    log: Array,
    t_other: Array,
    other: Array,
    shift: float,
    window: float,
    span: tuple[float, float],
) -> float:
    """Share of the motion between two instants of the second file that the log explains."""
    low = max(span[0], t_log[0] - shift) + 0.5 * window
    high = min(span[1], t_log[-1] - shift) - 0.5 * window
    if high - low < 4.0 * window:
        return 0.0
    at = np.arange(low, high, 0.25 * window)

    a = _increments(t_log, log, at + shift, window)
    b = _increments(t_other, other, at, window)
    a = np.column_stack([np.ones(len(a)), a])
    b = b - b.mean(axis=0)
    unexplained = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    power = np.sum(b**2, axis=0)
    moving = power > 0.0
    if not moving.any():
        return 0.0
    return float(1.0 - np.mean(np.sum(unexplained**2, axis=0)[moving] / power[moving]))
