"""Four-stage instrumental variables for A y = B u + v, v of any colour (IV4).

Least squares are biased where v is not white. Instruments ζ that follow the input alone do not see
v: E ζ v = 0 (Söderström & Stoica 1983; Ljung 1999, §7.6 and 15.3):

1. least squares;
2. ζ holds the lags of u and of the noise-free output x = (B/A) u of stage 1: Σ ζ (y − φᵀθ) = 0;
3. an autoregression L v = e of the errors of stage 2;
4. with x of stage 2, both sides filtered by L: Σ Lζ (L y − Lφᵀ θ) = 0.

cov θ = λ (Σ Lζ Lφᵀ)⁻¹ Σ Lζ Lζᵀ (Σ Lφ Lζᵀ)⁻¹, with λ the variance of e (Ljung 1999, eq. 9.83).
The input must not answer the output: behind a controller it carries v, and so do the instruments.
"""

from collections.abc import Sequence

import numpy as np

from sysid.criteria.coloured import ar_fit
from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.fitting.uncertainty import half_and_null, with_infinite
from sysid.structures.linear.families import ARX
from sysid.structures.linear.least_squares import solve
from sysid.structures.linear.predictor import RowLayout
from sysid.structures.linear.starts import stabilised

WHITENED = 20
"""Order of the autoregression at most; n_a + n_b where that is more."""


def iv4(structure: ARX, records: Sequence[Record]) -> tuple[Array, Array, Array]:
    """θ, its covariance, and the directions without information (n, n_null)."""
    rows = [structure.layout(i) for i in range(structure.ny)]
    theta, _, null = solve(structure, records)
    runs = _noise_free(structure, records, theta)
    for i, lay in enumerate(rows):
        values, _ = _solved(lay, runs, records, np.ones(1))
        theta[structure.row_index(i)] = lay.signs * values
    runs = _noise_free(structure, records, theta)
    covariance = np.zeros((len(theta), len(theta)))
    for i, lay in enumerate(rows):
        index, sign = structure.row_index(i), lay.signs
        errors = [
            r.y[lay.start :, i] - _lags((*r.y.T, *r.u.T), lay) @ (sign * theta[index])
            for r in records
        ]
        values, block = _solved(lay, runs, records, ar_fit(errors, max(WHITENED, lay.n)).alpha)
        theta[index] = sign * values
        covariance[np.ix_(index, index)] = np.outer(sign, sign) * block
    return theta, with_infinite(covariance, null), null


def _noise_free(structure: ARX, records: Sequence[Record], theta: Array) -> list[Array]:
    """Outputs that follow from the inputs alone, (N, ny) a record."""
    theta = stabilised(structure, theta)
    return [structure.simulate(theta, r.u) for r in records]


def _lags(signals: Sequence[Array], lay: RowLayout) -> Array:
    """Regressors of a row from its first whole sample on, (M, n)."""
    m = len(signals[0]) - lay.start
    return np.column_stack([signals[s][lay.start - k : lay.start - k + m] for s, k in lay.terms])


def _solved(
    lay: RowLayout, runs: Sequence[Array], records: Sequence[Record], whiten: Array
) -> tuple[Array, Array]:
    """What solves Σ Lζ (L y − Lφᵀ θ) = 0 for a row, in its terms, and its covariance."""
    parts = []
    for r, x in zip(records, runs, strict=True):
        columns = (r.y[lay.start :, [lay.output]], _lags((*r.y.T, *r.u.T), lay))
        whole = np.column_stack([*columns, _lags((*x.T, *r.u.T), lay)])
        parts.append(lfilter(whiten, [1.0], whole, axis=0)[len(whiten) - 1 :])
    y, phi, zeta = np.split(np.concatenate(parts), [1, 1 + len(lay.terms)], axis=1)
    size = np.maximum(np.linalg.norm(zeta, axis=0), 1e-300)
    theta, *_ = np.linalg.lstsq(zeta.T @ phi / size[:, None], zeta.T @ y[:, 0] / size, rcond=1e-12)
    e = y[:, 0] - phi @ theta
    half, _ = half_and_null(zeta)
    # of Lφ only what the instruments explain counts: (Z'Φ)⁻¹ Z'Z (Φ'Z)⁻¹ = (Φ' P_Z Φ)⁻¹
    seen, _ = half_and_null((zeta @ half).T @ phi)
    variance = float(e @ e) / max(len(e) - len(theta), 1)
    return theta, variance * seen @ seen.T
