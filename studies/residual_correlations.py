"""Correlation sequences of residuals, with their bands: what the literature looks at.

Whether something is left is decided by the portmanteau tests of ``residuals.py``: of 26 lags one
leaves its 99 % band in every fourth right model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import ndtri

from sysid.criteria.coloured import ar_fit
from sysid.criteria.fit import Array, Signals, centred, inputs_of, one_output


@dataclass(frozen=True)
class Correlation:
    """A correlation sequence to draw, with the band in which a right model leaves it.

    Attributes:
        lags: (n,), in samples; positive lags look into the past of the second signal.
        values: normalised correlation, (n, number of second signals).
        bound: half-width of the band for each second signal.
    """

    lags: NDArray[np.int64]
    values: Array
    bound: Array


def autocorrelation(errors: Signals, lags: int = 25, level: float = 0.99) -> Correlation:
    """r(τ) = R(τ)/R(0), R(τ) = Σε(t)ε(t−τ)/N for τ = 0…lags, with the band z/√N of white ε.

    Args:
        errors: residuals of one output, (N,), or one such array a record; NaN counts as missing.
        lags: largest lag; shortened to the longest record.
        level: probability that one lag of a white sequence lies inside the band.

    Returns:
        ``values`` (lags + 1, 1) with r(0) = 1; all 0 for residuals that are zero.

    Raises:
        DataError: more than one column, or no sample.
    """
    es = one_output(errors)
    lags = min(lags, max(len(e) for e in es) - 1)
    filled = [np.nan_to_num(e) for e in es]
    products = _lagged_products(filled, [e[:, None] for e in filled], 0, lags)
    samples = sum(int((~np.isnan(e)).sum()) for e in es)
    energy = products[0, 0]
    values = products / energy if energy > 0.0 else np.zeros_like(products)
    return Correlation(np.arange(lags + 1), values, np.array([_normal(level) / np.sqrt(samples)]))


def cross_correlation(
    errors: Signals, inputs: Signals, lags: int = 25, level: float = 0.99
) -> Correlation:
    """r_εu(τ) = R_εu(τ)/√(R_ε(0)R_u(0)), R_εu(τ) = Σε(t)u(t−τ)/N for τ = −lags…lags.

    The band is z √(P/N)/√(R_ε(0)R_u(0)) with P = R_ε(0)R_u(0) + 2ΣR_ε(k)R_u(k) over all k ≥ 1
    (Ljung 1999, §16.6): the naive z/√N flags most right models when both are coloured. The sum is
    taken as uᵀΣ̂u/N with Σ̂ of an AR(20) fit of ε, because the sum of products of two sample
    autocovariances over all lags does not settle as N grows. Each record's means are removed.

    Args:
        errors: residuals of one output, (N,), or one such array a record; NaN counts as missing.
        inputs: (N, nu), or one such array a record.
        lags: largest lag each way; shortened to the longest record.
        level: probability that one lag of an independent pair lies inside the band.

    Returns:
        ``values`` (2·lags + 1, nu), ``bound`` (nu,); 0 for a constant input.

    Raises:
        DataError: shapes do not fit, an input is not finite, or there is no residual.
    """
    es = [centred(e) for e in one_output(errors)]
    us = [centred(u) for u in inputs_of(inputs, [len(e) for e in es])]
    lags = min(lags, max(len(e) for e in es) - 1)
    filled = [np.nan_to_num(e) for e in es]
    seen = [np.where(np.isnan(e)[:, None], 0.0, u) for e, u in zip(es, us, strict=True)]
    model = ar_fit(es)
    e_energy = sum(float(e @ e) for e in filled)
    u_energy = np.sum([np.einsum("ij,ij->j", u, u) for u in seen], axis=0)
    spread = np.sum([np.diag(model.gram(u)) for u in seen if len(u)], axis=0)
    norm = np.sqrt(e_energy * u_energy)
    per_unit = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
    values = _lagged_products(filled, us, -lags, lags) * per_unit
    bound = _normal(level) * np.sqrt(spread) * per_unit
    return Correlation(np.arange(-lags, lags + 1), values, bound)


def _lagged_products(es: list[Array], us: list[Array], first: int, last: int) -> Array:
    """Σₜ ε(t) u(t−τ), τ = first…last, over all records without crossing their borders, by FFT."""
    total = np.zeros((last - first + 1, us[0].shape[1]))
    for e, u in zip(es, us, strict=True):
        if len(e):
            size = next_fast_len(len(e) + max(last, -first), real=True)
            spectrum = rfft(e, size)[:, None] * np.conj(rfft(u, size, axis=0))
            products = irfft(spectrum, size, axis=0)
            total += products[np.arange(first, last + 1) % size]
    return total


def _normal(level: float) -> float:
    """Two-sided normal quantile: 2.576 for 99 %."""
    return float(ndtri(0.5 + 0.5 * level))
