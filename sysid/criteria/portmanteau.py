"""The statistic of all residual tests: cᵀC⁺c with the estimated parameters projected out.

Instruments Z are lagged copies of signals. From them everything is removed that a right model's
residuals are, or may be, correlated with by construction: the Jacobian J of what was estimated from
these very data, the mean of each record, and optionally other lags of the same signals
("nuisance"). The rest Z̃ gives c = Z̃ᵀε and C = Z̃ᵀΣ̂Z̃. What was estimated from other data is not
removed but adds its uncertainty, Z̃ᵀGP GᵀZ̃ with G the gradient and P the parameters' covariance.
Z is built in blocks of rows and never held as a whole; of long records it is not built at all, see
``lag_sums``.

For a picture the statistic is shared out among the lags, d = U e with |e|² = cᵀC⁺c and U the
orthonormal matrix that brings d closest to the standardised c/√C (zero-phase whitening): each d is
standard normal for a right model, and their squares add up to the statistic, which single
correlations do not (Kessy, Lewin & Strimmer 2018, "ZCA-cor").
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dgeqrf

from sysid.criteria.coloured import BLOCK, AutoRegression
from sysid.criteria.fit import Array
from sysid.criteria.lag_sums import LONG, autocovariance, lag_sums

Mask = NDArray[np.bool_]

ILL_CONDITIONED = 1e4
"""Condition of the scaled Jacobian from which its basis is made orthonormal again."""

ENERGY_TOLERANCE = 1e-8
"""An instrument (or combination) with less than this share of its energy left counts as removed."""
COLOUR_TOLERANCE = 1e-12
"""Eigenvalues of C, relative to the largest, below which C is singular to working precision."""
WELL_CONDITIONED = 1e-8
"""Smallest eigenvalue of the nuisance lags' products, relative to the largest, from which products
alone say what these lags predict: more than half of the digits are left."""


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
    c, energy, covariance, borrowed = _from_sums(trial, basis, scale) or _by_blocks(
        trial, basis, scale
    )
    return _quadratic_form(trial, c, covariance + borrowed @ borrowed.T, energy)


Products = tuple[Array, Array, Array, Array]
"""Z̃ᵀε, Z̃ᵀZ̃, Z̃ᵀΣ̂Z̃ and Z̃ᵀG√P."""


def _from_sums(trial: Trial, basis: Sequence[Array], scale: Array) -> Products | None:
    """The products of long records whose instruments have no gaps, from sums over lags.

    None where a record is short or has gaps, the noise has a long memory, or the nuisance lags are
    nearly collinear, so that products of Z, J and the means would not leave enough digits.
    """
    asked = [*trial.tested, *trial.nuisance]
    lags = range(min(asked), max(asked) + 1)
    windows = [_only_window(rows) for rows in trial.rows]
    R = autocovariance(trial.noise)
    if R is None or len(lags) != len(asked) or min(map(len, trial.errors)) < LONG:
        return None
    if any(b - a < LONG // 2 for a, b in windows):
        return None
    m, n, q = trial.signals[0].shape[1], len(asked), basis[0].shape[1]
    place = np.array([j * n + k - lags[0] for j in range(m) for k in asked])
    place = np.concatenate([place, m * n + np.arange(q + 1)])
    weight = np.concatenate([scale, np.ones(q + 1)])
    sums = []
    for r, window in enumerate(windows):
        V = [*basis[r].T, trial.keep[r]]
        W = [trial.errors[r], *(trial.uncertain[r].T if trial.uncertain else ())]
        found = lag_sums(trial.signals[r], lags, window, R, V, W)
        square = np.outer(weight, weight)
        sums.append(
            (
                found.plain[np.ix_(place, place)] * square,
                found.coloured[np.ix_(place, place)] * square,
                found.against[place] * weight[:, None],
            )
        )
    shadows = sum(plain[m * n : -1, : m * n] for plain, _, _ in sums)
    energy, covariance = np.zeros((m * n, m * n)), np.zeros((m * n, m * n))
    against, taken = np.zeros((m * n, sums[0][2].shape[1])), 0.0
    for plain, coloured, further in sums:
        mean = plain[-1:, : m * n] / plain[-1, -1] * trial.centred
        clear = np.vstack([np.eye(m * n), -shadows, -mean])
        energy += clear.T @ plain @ clear
        covariance += clear.T @ coloured @ clear
        against += clear.T @ further
        taken += float(np.trace(coloured[m * n : -1, m * n : -1]))
        taken += float(coloured[-1, -1] / plain[-1, -1])
    nuisance = _nuisance(trial)
    if nuisance.any():
        values = np.linalg.eigvalsh(energy[np.ix_(nuisance, nuisance)])
        if not values[0] > WELL_CONDITIONED * values[-1]:
            return None
    mix = _without_nuisance(energy, nuisance)
    energy, covariance, against = mix.T @ energy @ mix, mix.T @ covariance @ mix, mix.T @ against
    if trial.noise is None:
        covariance = energy * _variance(trial)
    else:
        covariance = covariance * _absorbed(trial.noise, trial.keep, taken)
    return against[:, 0], energy, covariance, against[:, 1:]


def _only_window(rows: Mask) -> tuple[int, int]:
    """First row and one past the last one where all between them are kept, else nothing."""
    kept = np.flatnonzero(rows)
    whole = len(kept) > 0 and int(kept[-1]) + 1 - int(kept[0]) == len(kept)
    return (int(kept[0]), int(kept[-1]) + 1) if whole else (0, 0)


def _by_blocks(trial: Trial, basis: Sequence[Array], scale: Array) -> Products:
    """The products of any records, from their instruments block by block."""
    shadows, means = _projections(trial, basis, scale)

    def instruments(r: int, start: int, stop: int) -> Array:
        """Rows of record r without Jacobian and mean, still with the nuisance lags."""
        block = _lagged(trial, r, start, stop) * scale
        block -= basis[r][start:stop] @ shadows + means[r]
        block[~trial.keep[r][start:stop]] = 0.0
        return block

    nuisance = _nuisance(trial)
    gram = np.zeros((len(nuisance), len(nuisance)))
    for where in _blocks(trial) if nuisance.any() else ():
        block = instruments(*where)
        gram += block.T @ block
    weights = _without_nuisance(gram, nuisance)
    c = np.zeros(weights.shape[1])
    energy = np.zeros((len(c), len(c)))
    covariance = np.zeros_like(energy)
    width = trial.uncertain[0].shape[1] if trial.uncertain else 0
    borrowed = np.zeros((len(c), width))
    for r in range(len(trial.errors)):

        def last_to_first(r: int = r) -> Iterator[Array]:
            for _, start, stop in reversed(list(_blocks(trial, r))):
                block = instruments(r, start, stop) @ weights
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
        return c, energy, energy * _variance(trial), borrowed
    taken = _taken(trial.noise, trial.keep, basis)
    return c, energy, covariance * _absorbed(trial.noise, trial.keep, taken), borrowed


def _variance(trial: Trial) -> float:
    """Mean square of the residuals."""
    return sum(float(e @ e) for e in trial.errors) / sum(int(k.sum()) for k in trial.keep)


def _nuisance(trial: Trial) -> Mask:
    """Which of all instruments are nuisance lags."""
    lags = len(trial.tested) + len(trial.nuisance)
    return np.tile(np.arange(lags), trial.signals[0].shape[1]) >= len(trial.tested)


def _without_nuisance(gram: Array, nuisance: Mask) -> Array:
    """Of all lags the combinations that the nuisance lags do not predict, (lags, tested)."""
    weights = np.eye(len(nuisance))[:, ~nuisance]
    if nuisance.any():
        weights[nuisance] = (
            -_pseudo_inverse(gram[np.ix_(nuisance, nuisance)]) @ gram[np.ix_(nuisance, ~nuisance)]
        )
    return weights


def _taken(noise: AutoRegression, keep: Sequence[Mask], basis: Sequence[Array]) -> float:
    """tr PΣ with the projector P on a basis and the records' means."""
    taken = 0.0
    for q, k in zip(basis, keep, strict=True):
        if k.any():
            mean = np.where(k, 1.0, 0.0)[:, None] / np.sqrt(k.sum())
            taken += float(np.trace(noise.gram(np.hstack([q, mean]))))
    return taken


def _absorbed(noise: AutoRegression, keep: Sequence[Mask], taken: float) -> float:
    """How much more variance the noise v has than the residuals ε = (I − P)v that show it.

    tr Σ / tr (I − P)Σ, with the projector P on J and the records' means: N/(N − n) for white
    noise, more where the fit took the very frequencies that hold the noise's power. Without it
    right OE models of 300 samples alarm up to three times too often. At most 2: beyond that
    too few independent samples are left for Σ̂ to be corrected by one number.

    Args:
        noise: model of v.
        keep: rows that count.
        taken: tr PΣ.
    """
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
