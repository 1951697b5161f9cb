"""AR models of coloured residuals, and the Gram matrices JᵀΣJ of sums over time.

A sum c = Σ z(t) v(t) has variance zᵀΣz, and Σ = σ²I only for white v. Here Σ is the covariance of
an autoregression α(q) v(t) = w(t) fitted to the residuals: Σ = σ_w² H Hᵀ with H the (infinite to
the left) matrix of the impulse response of 1/α(q), so that

    JᵀΣJ = σ_w² MᵀM,    M = HᵀJ = J filtered by 1/α(q) backwards in time,

exactly, for the cost of one filter run. Used by the test of independence and by the sandwich
covariance (JᵀJ)⁻¹ JᵀΣJ (JᵀJ)⁻¹ of a fit that leaves coloured residuals.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from sysid.criteria.fit import Array, Signals, as_records
from sysid.data.filtering import lfilter
from sysid.errors import DataError

BLOCK = 8192
"""Rows handled at a time: bounds the working memory at BLOCK × columns."""


@dataclass(frozen=True, eq=False)
class AutoRegression:
    """A stable AR model v(t) + α₁v(t−1) + … + α_p v(t−p) = w(t).

    Attributes:
        alpha: (1, α₁, …, α_p), shape (p + 1,); its roots lie inside the unit circle.
        variance: variance σ_w² of the white w, in the square of v's unit.
    """

    alpha: Array
    variance: float

    @property
    def order(self) -> int:
        """Number p of coefficients."""
        return len(self.alpha) - 1

    @property
    def stationary_variance(self) -> float:
        """Variance R(0) of v = σ_w² times the energy of the impulse response of 1/α(q)."""
        after_impulse = -self.alpha[1:]
        return float(self.variance * (1.0 + after_impulse @ self._tail @ after_impulse))

    @property
    def long_run_variance(self) -> float:
        """Σ R(k) over all lags = σ_w²/α(1)²: N times the variance of the mean of N samples."""
        return float(self.variance / self.alpha.sum() ** 2)

    def gram(self, columns: Array) -> Array:
        """JᵀΣJ of one record's columns J, shape (N, n) → (n, n)."""
        starts = range(0, len(columns), BLOCK)
        return self.gram_of_blocks(columns[s : s + BLOCK] for s in reversed(starts))

    def gram_of_blocks(self, last_to_first: Iterable[Array]) -> Array:
        """JᵀΣJ of one record whose rows come in blocks, the last block first.

        What the backward filter still puts out before the record's first sample is the effect of
        noise that entered before it; its energy is added in closed form, so that Σ is the
        stationary covariance (Toeplitz, R(t − s)) and not that of noise starting at rest.
        """
        total: Array | None = None
        state: Array | None = None
        for block in last_to_first:
            if total is None or state is None:
                total = np.zeros((block.shape[1], block.shape[1]))
                state = np.zeros((self.order, block.shape[1]))
            if self.order:
                filtered, state = lfilter([1.0], self.alpha, block[::-1], axis=0, zi=state)
            else:
                filtered = block
            total += filtered.T @ filtered
        if total is None or state is None:
            raise DataError("a Gram matrix needs at least one sample")
        return np.asarray(self.variance * (total + state.T @ self._tail @ state))

    @cached_property
    def _tail(self) -> Array:
        """W with zᵀWz the energy that a filter left in state z still puts out.

        W = Σ (Aᵏ)ᵀ e₁e₁ᵀ Aᵏ over lfilter's (transposed direct form II) state matrix A, summed by
        doubling: poles at 1 − 1e−9 need 35 rounds, where a Lyapunov solver would be near singular.
        """
        p = self.order
        power = np.eye(p, k=1)
        power[:, :1] = -self.alpha[1:, None]
        energy = np.zeros((p, p))
        energy[:1, :1] = 1.0
        for _ in range(60):
            step = power.T @ energy @ power
            energy = energy + step
            if np.abs(step).max(initial=0.0) <= 1e-15 * np.abs(energy).max(initial=0.0):
                break
            power = power @ power
        return energy


def ar_fit(errors: Signals, order: int = 20) -> AutoRegression:
    """Fit an AR model to residuals by Burg's method over all records at once.

    Each reflection coefficient minimises the forward and backward error summed over the records,
    so no product crosses a border between records, and the model is always stable. Burg was
    preferred to the Yule–Walker equations because their bias grows near the unit circle, which
    is where slow residuals put their poles.

    Args:
        errors: residuals of one output, (N,) or (N, 1), or one such array a record; NaN splits a
            record in two. The mean is not removed.
        order: number of coefficients; lowered to a tenth of the samples in short records, and to
            what predicts them but for 1e-8 of their variance (a constant, a pure sine). A fixed
            order served as well as one chosen by AIC or BIC and does not depend on the draw.

    Source: Burg (1975); Marple (1987), ch. 8.
    """
    pieces = _finite_pieces(errors)
    samples = sum(len(p) for p in pieces)
    if not samples or order < 0:
        raise DataError(f"an AR fit needs samples and an order ≥ 0, got {samples} and {order}")
    scale = max(float(np.abs(p).max()) for p in pieces)
    if not np.isfinite(scale):
        raise DataError("an AR fit needs finite residuals; the model is unstable")
    alpha = np.ones(1)
    if scale == 0.0:
        return AutoRegression(alpha, 0.0)
    forward = [p / scale for p in pieces]
    backward = forward
    power = variance = sum(float(p @ p) for p in forward) / samples
    for _ in range(min(order, samples // 10)):
        if variance < _PREDICTED * power:
            break
        forward = [f[1:] for f in forward]
        backward = [b[:-1] for b in backward]
        cross = sum(float(f @ b) for f, b in zip(forward, backward, strict=True))
        energy = sum(float(f @ f + b @ b) for f, b in zip(forward, backward, strict=True))
        k = float(np.clip(-2.0 * cross / energy, -_MOST, _MOST)) if energy > 0.0 else 0.0
        forward, backward = (
            [f + k * b for f, b in zip(forward, backward, strict=True)],
            [b + k * f for f, b in zip(forward, backward, strict=True)],
        )
        padded = np.append(alpha, 0.0)
        alpha = padded + k * padded[::-1]
        variance *= 1.0 - k * k
    return AutoRegression(alpha, variance * scale**2)


_MOST = 1.0 - 1e-9
"""Largest reflection coefficient: perfectly predictable residuals have 1, a pole on the circle."""
_PREDICTED = 1e-8
"""Share of unpredicted power below which more coefficients only model rounding errors."""


def coloured_gram(columns: Signals, errors: Signals, order: int = 20) -> Array:
    """JᵀΣ̂J with Σ̂ from an AR fit of the residuals: what coloured noise makes of JᵀJσ².

    Args:
        columns: J, (N, n), or one such array a record (records are independent of each other).
        errors: residuals of one output, (N,), or one such array a record. Rows where they are NaN
            contribute nothing.
        order: order of the AR model, see :func:`ar_fit`.

    Returns:
        (n, n), symmetric, positive semidefinite.
    """
    js, es = as_records(columns, "columns"), as_records(errors, "errors")
    if [len(j) for j in js] != [len(e) for e in es]:
        raise DataError(f"{[len(j) for j in js]} rows of J but {[len(e) for e in es]} residuals")
    model = ar_fit(es, order)
    grams = [
        model.gram(np.where(np.isnan(e), 0.0, j)) for j, e in zip(js, es, strict=True) if len(e)
    ]
    return np.asarray(sum(grams))


def effective_sample_size(errors: Signals, order: int = 20) -> float:
    """Number of independent samples that give the mean as well: N R(0) / Σ R(k).

    Below N for slow residuals, N for white ones, above N for alternating ones; R from
    :func:`ar_fit`, whose arguments and errors apply. N for residuals that are zero.
    """
    model = ar_fit(errors, order)
    samples = sum(len(p) for p in _finite_pieces(errors))
    if model.variance == 0.0:
        return float(samples)
    return samples * model.stationary_variance / model.long_run_variance


def _finite_pieces(errors: Signals) -> list[Array]:
    """The stretches without NaN of all records of one output."""
    records = as_records(errors, "errors")
    if records[0].shape[1] != 1:
        raise DataError(f"residuals of one output expected, got shape {records[0].shape}")
    pieces: list[Array] = []
    for record in records:
        gaps = np.flatnonzero(np.isnan(record[:, 0]))
        edges = [-1, *gaps.tolist(), len(record)]
        pieces += [record[a + 1 : b, 0] for a, b in pairwise(edges) if b > a + 1]
    return pieces
