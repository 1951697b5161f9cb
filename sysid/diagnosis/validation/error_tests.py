"""Tests of regression residuals: a group of terms, an offset, a ripple over the angle."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import fdtrc

from sysid.criteria.coloured import ar_fit
from sysid.data.filtering import lfilter
from sysid.data.record import Array
from sysid.diagnosis.over_angle import over_angle, strongest_lines

ORDER = 20
"""Coefficients of the noise's autoregression."""

LEVEL_SPREAD = 0.35
"""A level must stand in each of so many parts of the records, within this share of its mean."""

LEVEL_PARTS = 6

MIN_DEGREES_OF_FREEDOM = 10
"""Degrees of freedom that a variance needs to be compared with."""

RIPPLES = (0.5, 20.0)
"""Waves per radian of the wheel that a ripple is looked for at, least and most."""

LEVELS = 48
"""Lines at which the size of a whitened wave is computed; between them it runs smoothly."""

PEAKS = 6
"""Highest lines of a spectrum that are computed exactly."""

SHORTEST_WAY = 20.0
"""A wheel that has turned less [rad] shows no ripple that is one for certain."""


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
    """p-value of no dependence of white w on the columns of X; ``spent``: parameters fitted before.

    NaN where too few samples are left to compare with.
    """
    basis = orthonormal(X)
    explained = float(np.sum((basis.T @ w) ** 2))
    q = basis.shape[1]
    free = len(w) - q - spent
    rest = float(w @ w) - explained
    if q and free < MIN_DEGREES_OF_FREEDOM:
        return float("nan")
    if q == 0 or rest <= 0.0:
        return 1.0
    return float(fdtrc(q, free, explained / q / (rest / free)))


def level_chance(e: Sequence[Array], gradients: Sequence[Array]) -> float:
    """p-value of no constant level, by the long-run variance of what a level leaves.

    A wandering load also has a mean. A level counts only if it stands in every part of the records.
    """
    ends = np.cumsum([len(x) for x in e])[:-1]
    y, Z = np.concatenate(e), np.concatenate(gradients)
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
    alpha: Array,
    angle: Sequence[Array],
    factors: Sequence[Sequence[Array]],
    nuisance: Array,
) -> float:
    """p-value of the highest ordinate over waves per radian, Bonferroni over those apart.

    Args:
        w: whitened errors of all parts, the first ``len(alpha) − 1`` of each left out.
        alpha: the filter that whitened them.
        angle: angle of each part [rad].
        factors: of each kind of ripple, what the wave is multiplied by in each part.
        nuisance: orthonormal columns that ``w`` holds nothing of.
    """
    span = float(np.ptp(np.concatenate(angle)))
    if span < SHORTEST_WAY:
        return 1.0
    apart = max(2.0 * span * (RIPPLES[1] - RIPPLES[0]) / (2.0 * np.pi), 1.0)
    free = len(w) - nuisance.shape[1] - 2
    chance = 1.0
    for factor in factors:
        waves = _Whitened(w, alpha, angle, factor, nuisance)
        best = float(np.max(waves.ordinates(waves.peaks(span))))
        rest = max(float(w @ w) - best, 1e-300)
        chance = min(chance, float(fdtrc(2, free, best / 2.0 / (rest / free))))
    return min(1.0, len(factors) * apart * chance)


class _Whitened:
    """Waves over the angle behind the filter that whitened the errors."""

    def __init__(
        self,
        w: Array,
        alpha: Array,
        angle: Sequence[Array],
        factor: Sequence[Array],
        nuisance: Array,
    ) -> None:
        self.w, self.alpha, self.nuisance = w, alpha, nuisance
        self.angle, self.factor = angle, factor

    def peaks(self, span: float) -> Array:
        """The lines at which the errors hold most of a wave, for its size."""
        skip = len(self.alpha) - 1
        ends = np.cumsum([len(a) - skip for a in self.angle])[:-1]
        back = [
            lfilter(self.alpha, [1.0], np.concatenate([np.zeros(skip), part])[::-1])[::-1]
            for part in np.split(self.w, ends)
        ]
        signal = np.concatenate(back) * np.concatenate(self.factor)
        lines, whole = over_angle(np.concatenate(self.angle), signal, RIPPLES[1])
        some = np.geomspace(*RIPPLES, LEVELS)
        sizes = np.interp(lines, some, self._sums(some)[0])
        score = np.abs(whole) ** 2 / np.maximum(sizes, 1e-12 * np.max(sizes) + 1e-300)
        return np.array(strongest_lines(lines, score, RIPPLES, span, PEAKS))

    def _sums(self, lines: Array) -> tuple[Array, Array, Array]:
        """Σc² + Σs², Σc²Σs² − (Σcs)², and what w holds of both, at each line."""
        c, s = self._columns(np.cos, lines), self._columns(np.sin, lines)
        cc, ss, cs = np.sum(c * c, axis=0), np.sum(s * s, axis=0), np.sum(c * s, axis=0)
        cw, sw = c.T @ self.w, s.T @ self.w
        return cc + ss, cc * ss - cs**2, ss * cw**2 - 2.0 * cs * cw * sw + cc * sw**2

    def ordinates(self, lines: Array) -> Array:
        """What a wave of each line explains of w, in units of its square."""
        both, det, explained = self._sums(lines)
        return np.asarray(explained / np.maximum(det, 1e-9 * both**2 + 1e-300))

    def _columns(self, wave: Callable[[Array], Array], lines: Array) -> Array:
        parts = [
            lfilter(self.alpha, [1.0], wave(a[:, None] * lines) * f[:, None], axis=0)
            for a, f in zip(self.angle, self.factor, strict=True)
        ]
        columns = np.concatenate([p[len(self.alpha) - 1 :] for p in parts])
        return np.asarray(columns - self.nuisance @ (self.nuisance.T @ columns))
