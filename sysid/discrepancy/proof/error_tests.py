"""Tests of errors that a regression leaves: a group of terms, a level, a ripple over the angle."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import fdtrc

from sysid.criteria.coloured import ar_fit
from sysid.data.record import Array

ORDER = 20
"""Coefficients of the noise's autoregression."""

LEVEL_SPREAD = 0.35
"""A level must stand in each of so many parts of the records, within this share of its mean."""

LEVEL_PARTS = 6

FEWEST_FREE = 10
"""Degrees of freedom that a variance needs to be compared with."""

RIPPLES = np.arange(0.5, 20.0, 0.05)
"""Waves per radian of the wheel that a ripple is looked for at."""


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis of the columns' span, directions without information left out."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    kept = columns[:, size > 0.0] / size[size > 0.0]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    values, vectors = np.linalg.eigh(kept.T @ kept)
    known = values > 1e-9 * values[-1]
    return np.asarray(kept @ (vectors[:, known] / np.sqrt(values[known])))


def f_test(w: Array, X: Array, spent: int) -> float:
    """p-value of no dependence of white w on the columns of X; ``spent``: numbers fitted before.

    NaN where too few samples are left to compare with.
    """
    basis = orthonormal(X)
    explained = float(np.sum((basis.T @ w) ** 2))
    q = basis.shape[1]
    free = len(w) - q - spent
    rest = float(w @ w) - explained
    if q and free < FEWEST_FREE:
        return float("nan")
    if q == 0 or rest <= 0.0:
        return 1.0
    return float(fdtrc(q, free, explained / q / (rest / free)))


def level_chance(e: Sequence[Array], own: Sequence[Array]) -> float:
    """p-value of no constant level, by the long-run variance of what a level leaves.

    A wandering load also has a mean. A level counts only if it stands in every part of the records.
    """
    ends = np.cumsum([len(x) for x in e])[:-1]
    y, Z = np.concatenate(e), np.concatenate(own)
    one = np.ones((len(y), 1))
    basis = orthonormal(Z)
    constant = one[:, 0] - basis @ (basis.T @ one[:, 0])
    if float(constant @ constant) < 1e-3 * len(y):
        return 1.0
    level = float(constant @ y) / float(constant @ constant)
    residual = y - basis @ (basis.T @ y)
    parts = np.array_split(residual, LEVEL_PARTS)
    flat = np.array_split(constant, LEVEL_PARTS)
    means = np.array(
        [float(c @ p) / max(float(c @ c), 1e-12) for c, p in zip(flat, parts, strict=True)]
    )
    if np.any(np.abs(means - level) > LEVEL_SPREAD * abs(level)):
        return 1.0
    rest = residual - level * constant
    noise = ar_fit(np.split(rest, ends), ORDER)
    t = level**2 * float(constant @ constant) / max(noise.long_run_variance, 1e-300)
    return float(fdtrc(1, max(len(y) // 50, 5), t))


def ripple_chance(
    w: Array,
    white: Callable[[Sequence[Array]], Array],
    angle: Sequence[Array],
    nuisance: Array,
) -> float:
    """p-value of the highest ordinate over waves per radian, Bonferroni over those apart."""
    span = float(np.ptp(np.concatenate(angle)))
    if span < 20.0:
        return 1.0
    best = 0.0
    for part in np.array_split(RIPPLES, max(len(RIPPLES) // 64, 1)):
        phase = [np.concatenate([a[:1], a[:-1]])[:, None] * part for a in angle]
        c, s = white([np.cos(p) for p in phase]), white([np.sin(p) for p in phase])
        c, s = c - nuisance @ (nuisance.T @ c), s - nuisance @ (nuisance.T @ s)
        cc, ss, cs = np.sum(c * c, axis=0), np.sum(s * s, axis=0), np.sum(c * s, axis=0)
        cw, sw = c.T @ w, s.T @ w
        det = np.maximum(cc * ss - cs**2, 1e-9 * cc * ss + 1e-300)
        best = max(best, float(np.max((ss * cw**2 - 2.0 * cs * cw * sw + cc * sw**2) / det)))
    free = len(w) - nuisance.shape[1] - 2
    rest = max(float(w @ w) - best, 1e-300)
    one = float(fdtrc(2, free, best / 2.0 / (rest / free)))
    apart = min(len(RIPPLES), 2.0 * span * float(np.ptp(RIPPLES)) / (2.0 * np.pi))
    return min(1.0, apart * one)
