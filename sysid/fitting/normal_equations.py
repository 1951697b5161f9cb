"""Normal equations of lagged regressors without ever forming the regressor matrix.

For signals s_1 … s_m and lags 0 … L the Gram matrix over t = start … N−1,

    G[(p,k),(q,l)] = Σ_t s_p(t−k) s_q(t−l),

is nearly block Toeplitz: G[k+1, l+1] = G[k, l] + s_p(start−1−k) s_q(start−1−l)
− s_p(N−1−k) s_q(N−1−l) (covariance method; Morf, Dickinson, Kailath, Vieira 1977). So only the
entries with k = 0 or l = 0 need a pass over the data, and every order up to L is a sub-matrix.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Record

CONDITION_LIMIT = 1e8
"""Condition limit of the scaled Gram matrix; beyond it more than half of the digits are gone
and the triangular factor of the regressors themselves is used."""

BLOCK = 16384


@dataclass(frozen=True, eq=False)
class LagGram:
    """Gram matrix of signals (outputs are numbered first, then inputs) at lags 0 … ``lags``.

    Attributes:
        matrix: shape (m·(lags+1), m·(lags+1)), signal-major.
        samples: number of summed instants.
        lags: largest lag L.
        start: first summed instant of every record.
        signals: numbers of the m signals.
    """

    matrix: Array
    samples: int
    lags: int
    start: int
    signals: tuple[int, ...]

    def __add__(self, other: "LagGram") -> "LagGram":
        """The sums over the records of both, which have the same signals and lags."""
        return replace(
            self, matrix=self.matrix + other.matrix, samples=self.samples + other.samples
        )

    def column(self, signal: int, lag: int) -> int:
        """Row and column of signal ``signal`` delayed by ``lag``."""
        return self.signals.index(signal) * (self.lags + 1) + lag


def lag_gram(
    records: Sequence[Record],
    lags: int,
    start: int | None = None,
    signals: Iterable[int] | None = None,
) -> LagGram:
    """Accumulate the Gram matrix of y_1 … y_ny, u_1 … u_nu over all records.

    Args:
        records: experiments with equal channels; nothing is correlated across their borders.
        lags: largest lag L.
        start: first instant that is summed (default L, the first one with a measured past).
        signals: numbers of those that matter (default all).
    """
    start = lags if start is None else max(start, lags)
    every = range(records[0].ny + records[0].nu)
    kept = tuple(every if signals is None else sorted(set(signals)))
    m, width = len(kept), lags + 1
    total = np.zeros((m, width, m, width))
    for r in records:
        if len(r) > start:
            total += _one_gram(r, lags, start, kept)
    samples = sum(max(len(r) - start, 0) for r in records)
    return LagGram(total.reshape(m * width, m * width), samples, lags, start, kept)


def _one_gram(record: Record, lags: int, start: int, kept: Sequence[int]) -> Array:
    n = len(record)
    columns = (*record.y.T, *record.u.T)
    signals = [np.ascontiguousarray(columns[k]) for k in kept]
    m, width = len(signals), lags + 1
    g = np.zeros((m, width, m, width))
    # values just before the window and at its end, by lag: what the recursion exchanges
    heads = np.array(
        [[s[start - 1 - k] if start > k else 0.0 for k in range(width)] for s in signals]
    )
    tails = np.array([[s[n - 1 - k] for k in range(width)] for s in signals])
    for low in range(start, n, BLOCK):  # a block stays in the cache for all its lags
        high = min(low + BLOCK, n)
        for p, sp in enumerate(signals):
            now = sp[low:high]
            for q, sq in enumerate(signals):
                g[p, 0, q, :] += np.correlate(sq[low - lags : high], now, "valid")[::-1]
    for p in range(m):
        g[:, :, p, 0] = g[p, 0]
    for k in range(lags):
        gain = heads[:, k, None, None] * heads[None, :, :-1]
        loss = tails[:, k, None, None] * tails[None, :, :-1]
        g[:, k + 1, :, 1:] = g[:, k, :, :-1] + gain - loss
        g[:, k + 1, :, 0] = g[:, 0, :, k + 1].T
    return g


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Solution of min ‖target − Φ θ‖².

    Attributes:
        theta: minimum-norm solution, shape (n,).
        inverse: (ΦᵀΦ)⁻¹ on the directions with information, shape (n, n).
        loss: residual sum of squares.
        null: directions without information, shape (n, n_null): orthonormal weights of the
            regressors scaled to unit norm, so that units do not decide who takes part.
    """

    theta: Array
    inverse: Array
    loss: float
    null: Array


def solve(gram: LagGram, target: int, regressors: Sequence[int]) -> LeastSquares | None:
    """Least squares from the Gram matrix, or None when it is too ill-conditioned for that."""
    from scipy.linalg import cho_factor, cho_solve  # what fits nothing does not wait for it

    index = np.asarray(regressors, dtype=np.intp)
    H = gram.matrix[np.ix_(index, index)]
    g = gram.matrix[index, target]
    scale = np.sqrt(np.diag(H))
    if len(index) == 0:
        return LeastSquares(
            np.zeros(0), np.zeros((0, 0)), float(gram.matrix[target, target]), np.zeros((0, 0))
        )
    if not np.all(scale > 0):
        return None
    S = H / np.outer(scale, scale)
    try:
        factor = cho_factor(S, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    diagonal = np.abs(np.diag(factor[0]))
    if (diagonal.max() / diagonal.min()) ** 2 > CONDITION_LIMIT:
        return None
    theta = cho_solve(factor, g / scale, check_finite=False) / scale
    inverse = cho_solve(factor, np.eye(len(index)), check_finite=False) / np.outer(scale, scale)
    loss = float(gram.matrix[target, target] - g @ theta)
    return LeastSquares(theta, inverse, loss, np.zeros((len(index), 0)))


def solve_by_blocks(
    records: Iterable[Record], start: int, target: int, regressors: Sequence[tuple[int, int]]
) -> LeastSquares:
    """The same problem by QR over blocks of the regressor: full precision, little memory.

    Args:
        start: first instant used.
        target: signal (outputs first, then inputs) at lag 0.
        regressors: (signal, lag) pairs.
    """
    n = len(regressors)
    R: Array = np.zeros((0, n + 1))
    for r in records:
        signals = (*r.y.T, *r.u.T)
        for low in range(start, len(r), BLOCK):
            high = min(low + BLOCK, len(r))
            block = np.empty((high - low, n + 1))
            for c, (s, lag) in enumerate(regressors):
                block[:, c] = signals[s][low - lag : high - lag]
            block[:, n] = signals[target][low:high]
            R = triangle(np.vstack([R, block]))
    return solve_triangular_form(R[:, :n], R[:, n])


def triangle(A: Array) -> Array:
    """R of the QR factorisation of a tall (M, n) matrix, shape (min(M, n), n); A is used up.

    LAPACK itself: ``numpy.linalg.qr(mode="r")`` takes five times as long for 10⁴ x 8.
    """
    from scipy.linalg.lapack import dgeqrf

    return np.asarray(np.triu(dgeqrf(A, overwrite_a=True)[0][: A.shape[1]]))


def solve_triangular_form(R: Array, z: Array) -> LeastSquares:
    """min ‖z − R θ‖² by singular values; directions below rounding are set aside."""
    n = R.shape[1]
    scale = np.linalg.norm(R, axis=0)
    scale[scale == 0] = 1.0
    U, s, Vt = np.linalg.svd(R / scale, full_matrices=False)
    keep = s > s.max(initial=0.0) * RANK_TOLERANCE
    V = Vt[keep].T
    theta = V @ ((U[:, keep].T @ z) / s[keep]) / scale
    half = V / s[keep] / scale[:, None]
    missing = np.eye(n) - V @ V.T
    values, vectors = np.linalg.eigh(missing)
    loss = float(np.sum((z - R @ theta) ** 2))
    return LeastSquares(theta, half @ half.T, loss, vectors[:, values > 0.5])


def scaled_lstsq(A: Array, b: Array) -> Array:
    """argmin ‖A x − b‖², the columns of A brought to unit norm before directions are set aside."""
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(A / size, b, rcond=1e-12)[0] / size)


def scaled_solution(H: Array, g: Array) -> Array:
    """The same from H = AᵀA and g = Aᵀb."""
    size = np.sqrt(np.maximum(np.diag(H), 0.0))
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(H / np.outer(size, size), g / size, rcond=1e-12)[0] / size)


RANK_TOLERANCE = 1e-10
"""Relative singular value below which a (scaled) direction counts as without information."""


def residual_row(
    signals: Sequence[Array], start: int, target: int, terms: Sequence[tuple[int, int, float]]
) -> Array:
    """target(t) − Σ c·s(t − lag) for t ≥ start, without a regressor matrix.

    Args:
        signals: outputs, then inputs, (N,) each.
        start: first instant.
        target: number of the signal at lag 0.
        terms: (signal, lag, coefficient) of each regressor.
    """
    used = {s: np.ascontiguousarray(signals[s]) for s in {target, *(s for s, _, _ in terms)}}
    e = np.array(used[target][start:])
    for low in range(start, start + len(e), BLOCK):  # a block stays in the cache for all terms
        block = e[low - start : low - start + BLOCK]
        for s, lag, c in terms:
            block -= c * used[s][low - lag : low - lag + len(block)]
    return e
