"""Terms added and left out while the coefficients are those of free runs.

Least squares one step ahead is a poor judge of a term whose use shows only after many steps. Along
a refined free run every candidate has a sensitivity S_c(t) = ∂ŷ(t)/∂θ_c at θ_c = 0; with those of
the present terms projected out, (S_cᵀ r)²/‖S_c‖² is what a Gauss-Newton step with that
candidate gains: orthogonal least squares in the tangent space of the simulation. The best
candidates are tried, refined, and kept where the held-out error falls.
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.structures.difference_equations.chunks import ChunkedRuns
from sysid.structures.difference_equations.monomials import Term
from sysid.structures.narmax.chunk_fits import ChunkFit, fit_together
from sysid.structures.narmax.term_trials import Row, Trial, fit_folds

TRIED = 3
"""Candidates refined at each step."""

GAIN = 0.005
"""Relative decrease of the held-out error that a further term must bring."""

KEEP = 0.002
"""Relative loss on the held-out data up to which a term is left out."""

CANDIDATES = 300
"""Candidates whose sensitivities are computed, low degrees and lags first."""

TANGENT_SAMPLES = 4000


def grown(row: Row, trial: Trial, pool: Sequence[Term], most: int, evaluations: int) -> list[Trial]:
    """The trial with one candidate after another added, as long as held-out data gain."""
    trials: list[Trial] = []
    while trial.chunk and len(trial.terms) < most:
        candidates = _promising(row, trial, pool)
        if not candidates:
            break
        zero = [np.append(theta, 0.0) for theta in trial.theta]
        sets = [((*trial.terms, c), zero) for c in candidates]
        better = min(_trials(row, trial, sets, evaluations, ", grown"), key=lambda t: t.error)
        if not better.error <= (1.0 - GAIN) * trial.error:
            break
        trials.append(better)
        trial = better
    return trials


def _trials(
    row: Row,
    trial: Trial,
    sets: Sequence[tuple[tuple[Term, ...], Sequence[Array]]],
    evaluations: int,
    word: str,
) -> list[Trial]:
    """The sets of terms, fitted and judged."""
    how = trial.how.removesuffix(word) + word
    fitted = fit_folds(row, sets, trial.chunk, evaluations)
    return [
        Trial(terms, thetas, row.held_out_error(terms, thetas), how, trial.chunk)
        for (terms, _), thetas in zip(sets, fitted, strict=True)
    ]


def _promising(row: Row, trial: Trial, pool: Sequence[Term]) -> list[Term]:
    """The candidates with the largest gain of a Gauss-Newton step, best first."""
    rest = [t for t in pool if t not in set(trial.terms)]
    rest = sorted(rest, key=lambda t: (len(t), sum(f.lag for f in t)))[:CANDIDATES]
    if not rest:
        return []
    data, room = [], TANGENT_SAMPLES
    for u, y in row.search:
        if room > 0:
            data.append((u[:room], y[:room]))
            room -= len(y)
    theta = np.mean(trial.theta, axis=0)
    if len(row.folds) > 1:
        whole = ChunkFit(trial.terms, theta, row.search)
        (theta,) = fit_together([whole], row.limits, trial.chunk, evaluations=10)
    n = len(theta)
    problem = ChunkedRuns(row.free_run((*trial.terms, *rest)), data, trial.chunk, row.scale)
    if sum(problem.lengths) <= 2 * n:
        return []
    p = np.concatenate([theta, np.zeros(len(rest))])
    J, r = problem.jacobian(p), problem.residual(p)
    Q, _ = np.linalg.qr(J[:, :n] / np.maximum(np.linalg.norm(J[:, :n], axis=0), 1e-300))
    S = J[:, n:]
    before = np.linalg.norm(S, axis=0)
    S = S - Q @ (Q.T @ S)
    r = r - Q @ (Q.T @ r)
    size = np.linalg.norm(S, axis=0)
    usable = (size > 1e-4 * before) & np.isfinite(size)
    gain = np.where(usable, (S.T @ r) ** 2 / np.maximum(size, 1e-300) ** 2, -1.0)
    order = [int(k) for k in np.argsort(-gain) if usable[k]]
    return [rest[k] for k in order[:TRIED]]


def pruned(row: Row, trial: Trial, evaluations: int) -> list[Trial]:
    """Terms left out one by one, the least certain first, while the held-out error allows it."""
    trials: list[Trial] = []
    while trial.chunk and len(trial.terms) > 2:
        sets = []
        for out in np.argsort(_certainty(row, trial))[:TRIED]:
            keep = [k for k in range(len(trial.terms)) if k != out]
            sets.append((tuple(trial.terms[k] for k in keep), [t[keep] for t in trial.theta]))
        tried = _trials(row, trial, sets, evaluations, ", pruned")
        accepted = min(tried, key=lambda t: t.error)
        if not accepted.error <= (1.0 + KEEP) * trial.error:
            break
        trials.append(accepted)
        trial = accepted
    return trials


def _certainty(row: Row, trial: Trial) -> Array:
    """|θ| over its spread, summed over the folds, up to a common factor, (n,)."""
    total = np.zeros(len(trial.terms))
    for fold, theta in zip(row.folds, trial.theta, strict=True):
        problem = ChunkedRuns(row.free_run(trial.terms), fold.train, trial.chunk, row.scale)
        if sum(problem.lengths) > len(theta):
            R = np.linalg.qr(problem.jacobian(theta), mode="r")
            norms = np.maximum(np.linalg.norm(R, axis=0), 1e-300)
            spread = np.linalg.norm(np.linalg.pinv(R / norms, rcond=1e-12), axis=1) / norms
            total += np.abs(theta) / np.maximum(spread, 1e-300)
    return total
