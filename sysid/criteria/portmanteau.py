"""The statistic of all residual tests: cᵀC⁺c with the estimated parameters projected out.

Instruments Z are lagged copies of signals. From them everything is removed that a right model's
residuals are, or may be, correlated with by construction: the Jacobian J of what was estimated from
these very data, the mean of each record, and optionally other lags of the same signals
("nuisance"). The rest Z̃ gives c = Z̃ᵀε and C = Z̃ᵀΣ̂Z̃. What was estimated from other data is not
removed but adds its uncertainty, Z̃ᵀGP GᵀZ̃ with G the gradient and P the parameters' covariance.
Z is built in blocks of rows and never held as a whole.

For a picture the statistic is shared out among the lags, d = U e with |e|² = cᵀC⁺c and U the
orthonormal matrix that brings d closest to the standardised c/√C (zero-phase whitening): each d is
standard normal for a right model, and their squares add up to the statistic, which single
correlations do not (Kessy, Lewin & Strimmer 2018, "ZCA-cor").
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dgeqrf
from scipy.special import chdtrc

from sysid.criteria.coloured import BLOCK, AutoRegression
from sysid.criteria.fit import Array

Mask = NDArray[np.bool_]

ILL_CONDITIONED = 1e4
"""Condition of the scaled Jacobian from which its basis is made orthonormal again."""

ENERGY_TOLERANCE = 1e-8
"""An instrument (or combination) with less than this share of its energy left counts as removed."""
COLOUR_TOLERANCE = 1e-12
"""Eigenvalues of C, relative to the largest, below which C is singular to working precision."""


@dataclass(frozen=True)
class Score:
    """A portmanteau statistic, its degrees of freedom, and where the correlation is largest.

    ``worst`` is (signal, lag) of the largest |c|/√C; None when nothing was left to test. The
    squares of ``parts``, (signals, lags), add up to the statistic.
    """

    statistic: float
    dof: int
    worst: tuple[int, int] | None
    parts: Array

    @property
    def p_value(self) -> float:
        """Chance of such a statistic where nothing is there."""
        return float(chdtrc(self.dof, self.statistic)) if self.dof else 1.0


@dataclass(frozen=True)
class Trial:
    """What is tested against what; one array a record everywhere.

    Attributes:
        errors: residuals of one output, (N,), 0 where missing.
        signals: signals whose lags are the instruments, (N, m), 0 where missing.
        jacobian: ∂ŷ/∂θ, (N, n), 0 where missing.
        keep: (N,), False where the residual is missing: such rows take no part at all.
        tested: lags that make Z.
        nuisance: lags whose effect is removed from Z.
        rows: (N,), False where an instrument would reach outside the record: it is 0 there.
        centred: whether each record's mean is removed.
        noise: model of the residuals' colour; None for white.
        uncertain: G√P, (N, k): what the uncertainty of parameters that were estimated from other
            data puts into the residuals; empty for data the model was fitted to.
        basis: ``orthonormal`` of the Jacobian where another test has it already.
    """

    errors: Sequence[Array]
    signals: Sequence[Array]
    jacobian: Sequence[Array]
    keep: Sequence[Mask]
    tested: range
    rows: Sequence[Mask]
    nuisance: range = range(0)
    centred: bool = False
    noise: AutoRegression | None = None
    uncertain: Sequence[Array] = ()
    basis: Sequence[Array] | None = None


def score(trial: Trial) -> Score:
    """cᵀC⁺c of a trial; asymptotically χ²(dof) when the model is right.

    C is inverted on the directions where Z̃ has energy left (``ENERGY_TOLERANCE``), after they
    were scaled to unit energy, so that neither the inputs' units nor their collinearity matter.
    """
    basis = trial.basis
    if basis is None:
        basis = orthonormal(trial.jacobian, trial.keep, trial.centred)
    scale = _column_scale(trial)
    c, energy, covariance, borrowed = _by_blocks(trial, basis, scale)
    return _quadratic_form(trial, c, covariance + borrowed @ borrowed.T, energy)


Products = tuple[Array, Array, Array, Array]
"""Z̃ᵀε, Z̃ᵀZ̃, Z̃ᵀΣ̂Z̃ and Z̃ᵀG√P."""


def _by_blocks(trial: Trial, basis: Sequence[Array], scale: Array) -> Products:
    """The products of the instruments, block by block."""
    shadows, means = _projections(trial, basis, scale)

    def instruments(r: int, start: int, stop: int) -> Array:
        """Rows of record r without Jacobian and mean, still with the nuisance lags."""
        block = _lagged(trial, r, start, stop) * scale
        block -= basis[r][start:stop] @ shadows + means[r]
        block[~trial.keep[r][start:stop]] = 0.0
        return block

    weights = _without_nuisance(trial, instruments)
    c = np.zeros(len(scale) if weights is None else weights.shape[1])
    energy = np.zeros((len(c), len(c)))
    covariance = np.zeros_like(energy)
    width = trial.uncertain[0].shape[1] if trial.uncertain else 0
    borrowed = np.zeros((len(c), width))
    for r in range(len(trial.errors)):

        def last_to_first(r: int = r) -> Iterator[Array]:
            for _, start, stop in reversed(list(_blocks(trial, r))):
                block = instruments(r, start, stop)
                block = block if weights is None else block @ weights
                c[:] += block.T @ trial.errors[r][start:stop]
                energy[:] += block.T @ block
                if trial.uncertain:
                    borrowed[:] += block.T @ trial.uncertain[r][start:stop]
                yield block

        if trial.noise is not None and len(trial.errors[r]):
            covariance += trial.noise.gram_of_blocks(last_to_first())
        else:
            for _ in last_to_first():
                pass
    if trial.noise is None:
        samples = sum(int(k.sum()) for k in trial.keep)
        return c, energy, energy * sum(float(e @ e) for e in trial.errors) / samples, borrowed
    return c, energy, covariance * _absorbed(trial.noise, trial.keep, basis), borrowed


def _without_nuisance(trial: Trial, instruments: Callable[[int, int, int], Array]) -> Array | None:
    """Of all lags the combinations that the nuisance lags do not predict, (lags, tested).

    None where there are none of these.
    """
    if not trial.nuisance:
        return None
    lags = len(trial.tested) + len(trial.nuisance)
    nuisance = np.tile(np.arange(lags), trial.signals[0].shape[1]) >= len(trial.tested)
    gram = np.zeros((len(nuisance), len(nuisance)))
    for where in _blocks(trial):
        block = instruments(*where)
        gram += block.T @ block
    weights = np.eye(len(nuisance))[:, ~nuisance]
    weights[nuisance] = (
        -_pseudo_inverse(gram[np.ix_(nuisance, nuisance)]) @ gram[np.ix_(nuisance, ~nuisance)]
    )
    return weights


def _absorbed(noise: AutoRegression, keep: Sequence[Mask], basis: Sequence[Array]) -> float:
    """How much more variance the noise v has than the residuals ε = (I − P)v that show it.

    tr Σ / tr (I − P)Σ, with the projector P on J and the records' means: N/(N − n) for white
    noise, more where the fit took the very frequencies that hold the noise's power. Without it
    right OE models of 300 samples alarm up to three times too often. At most 2: beyond that
    too few independent samples are left for Σ̂ to be corrected by one number.

    Args:
        noise: model of v.
        keep: rows that count.
        basis: of J, orthonormal.
    """
    taken = 0.0
    for q, k in zip(basis, keep, strict=True):
        if k.any():
            mean = np.where(k, 1.0, 0.0)[:, None] / np.sqrt(k.sum())
            taken += float(np.trace(noise.gram(np.hstack([q, mean]))))
    total = sum(int(k.sum()) for k in keep) * noise.stationary_variance
    return 1.0 / max(1.0 - taken / total, 0.5) if total > 0.0 else 1.0


def _quadratic_form(trial: Trial, c: Array, covariance: Array, energy: Array) -> Score:
    values, vectors = np.linalg.eigh(energy)
    left = values > ENERGY_TOLERANCE * len(c)
    whiten = vectors[:, left] / np.sqrt(values[left])
    values, vectors = np.linalg.eigh(whiten.T @ covariance @ whiten)
    regular = values > COLOUR_TOLERANCE * values.max(initial=0.0)
    to_unit = (whiten @ vectors[:, regular]) / np.sqrt(values[regular])
    unit = to_unit.T @ c
    shape = (trial.signals[0].shape[1], len(trial.tested))
    testable = (np.diag(energy) > ENERGY_TOLERANCE * len(c)) & (np.diag(covariance) > 0.0)
    if not testable.any() or not regular.any():
        return Score(0.0, 0, None, np.zeros(shape))
    spread = np.sqrt(np.where(testable, np.diag(covariance), np.inf))
    signal, lag = divmod(int(np.argmax(np.abs(c) / spread)), len(trial.tested))
    left_of, _, right_of = np.linalg.svd(
        (covariance / spread[:, None]) @ to_unit, full_matrices=False
    )
    parts = (left_of @ (right_of @ unit)).reshape(shape)
    return Score(float(unit @ unit), int(regular.sum()), (signal, trial.tested[lag]), parts)


def _blocks(trial: Trial, only: int | None = None) -> Iterator[tuple[int, int, int]]:
    """(record, first row, one past the last row) of every block of rows."""
    for r, errors in enumerate(trial.errors):
        if only is None or r == only:
            for start in range(0, len(errors), BLOCK):
                yield r, start, min(start + BLOCK, len(errors))


def _lagged(trial: Trial, r: int, start: int, stop: int) -> Array:
    """Rows of [z₁(t−tested), z₁(t−nuisance), z₂(t−tested), …]; 0 outside the record."""
    signals = trial.signals[r]
    lags = [*trial.tested, *trial.nuisance]
    block = np.zeros((stop - start, signals.shape[1], len(lags)))
    for i, lag in enumerate(lags):
        first, last = max(start - lag, 0), min(stop - lag, len(signals))
        if first < last:
            block[first + lag - start : last + lag - start, :, i] = signals[first:last]
    block[~trial.rows[r][start:stop]] = 0.0
    return block.reshape(stop - start, -1)


def _column_scale(trial: Trial) -> Array:
    """One over the norm of each instrument (0 for one that is zero), same for all its lags."""
    energy = sum(np.einsum("ij,ij->j", z, z) for z in trial.signals)
    norm = np.sqrt(np.asarray(energy))
    scale = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
    return np.repeat(scale, len(trial.tested) + len(trial.nuisance))


def orthonormal(jacobian: Sequence[Array], keep: Sequence[Mask], centred: bool) -> list[Array]:
    """Orthonormal basis of the Jacobian's columns (each record centred if asked), by record.

    From the triangle of a QR of blocks of rows, whose columns have the norms of the Jacobian's:
    scaled to one, pivoting shortens the basis where parameters are collinear, whereas the normal
    equations would lose half the digits.
    """
    parts, R = [], np.zeros((0, jacobian[0].shape[1]))
    for j, k in zip(jacobian, keep, strict=True):
        part = np.where(k[:, None], j, 0.0)
        if centred and k.any():
            part -= k[:, None] * (part.sum(axis=0) / k.sum())
        parts.append(part)
        for start in range(0, len(part), BLOCK):
            factors, *_ = dgeqrf(np.vstack([R, part[start : start + BLOCK]]))
            R = np.triu(factors[: R.shape[1]])
    norm = np.linalg.norm(R, axis=0)
    seen = np.flatnonzero(norm > 0.0)
    if not len(seen):
        return [part[:, :0] for part in parts]
    _, r, order = qr(R[:, seen] / norm[seen], mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(r)) > 1e-10 * abs(r[0, 0])).sum())
    to_unit = np.zeros((len(norm), rank))
    inverse = np.asarray(solve_triangular(r[:rank, :rank], np.eye(rank)))
    kept = seen[order[:rank]]
    to_unit[kept] = inverse / norm[kept, None]
    basis = [part @ to_unit for part in parts]
    if np.linalg.norm(inverse) > ILL_CONDITIONED:
        # rounding left of the other columns what the condition makes of it
        half = np.linalg.cholesky(np.asarray(sum(q.T @ q for q in basis)))
        basis = [np.asarray(solve_triangular(half, q.T, lower=True)).T for q in basis]
    return basis


def _projections(trial: Trial, basis: Sequence[Array], scale: Array) -> tuple[Array, list[Array]]:
    """QᵀZ over all records, and the mean of Z in each record (0 unless centred)."""
    shadows = np.zeros((basis[0].shape[1], len(scale)))
    means = [np.zeros(len(scale)) for _ in basis]
    for r, start, stop in _blocks(trial):
        block = _lagged(trial, r, start, stop) * scale
        shadows += basis[r][start:stop].T @ block
        if trial.centred:
            means[r] += block.sum(axis=0) / max(int(trial.keep[r].sum()), 1)
    return shadows, means


def _pseudo_inverse(gram: Array) -> Array:
    values, vectors = np.linalg.eigh(gram)
    kept = values > 1e-12 * values.max(initial=0.0)
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)
