"""Many small fits to free runs over chunks, all advanced at once.

The search for terms fits the same few samples again and again: each candidate on each fold. What
costs time is stepping through the chunks sample by sample, not the arithmetic of a step; so all
candidates and folds step together as one batch, and each has its own Levenberg-Marquardt damping
(Marquardt 1963). Normal equations of columns of unit norm serve a search; the coefficients of the
winner are estimated again by QR.

Simulation-error term selection: many candidate equations run over chunks of the data at once.

Forward selection by the one-step error prefers terms that predict over terms that simulate, most
of all on data sampled fast. Here each candidate is added (or each chosen term left out) in turn,
the coefficients are re-estimated by least squares, all resulting equations are run freely from
measured states, and the one with the smallest simulation error is kept (Piroddi & Spinelli 2003,
"An identification algorithm for polynomial NARX models based on simulation error minimization").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.fitting.batched import Damping, descend_together
from sysid.fitting.problem import Data
from sysid.structures.difference_equations.chunks import Piece, pieces, side_by_side
from sysid.structures.difference_equations.frols import TermGram
from sysid.structures.difference_equations.monomials import Term
from sysid.structures.narmax.runs import PolynomialRun

DAMPING = Damping(first=1e-9, fall=0.1, rise=30.0, least=1e-13, most=1e5, loose=1e-4)
"""Next to none at first: lagged signals are nearly collinear, and shorter steps lead nowhere."""


@dataclass(frozen=True, eq=False)
class ChunkFit:
    """One fit: its terms, where it starts, and the (u, y) it is fitted to, y of shape (N, 1)."""

    terms: tuple[Term, ...]
    theta: Array
    data: Data


def fit_together(
    fits: Sequence[ChunkFit],
    limits: tuple[float, float],
    length: int,
    evaluations: int,
    tolerance: float = 1e-5,
) -> list[Array]:
    """Coefficients of each fit from free runs of about ``length`` samples, (n,) each.

    Args:
        fits: terms, starts and data; all with the same inputs.
        limits: bounds of the output in free run.
        tolerance: relative decrease of the squared error at which a fit is over.
    """
    batch = _Batch(fits, limits, length)
    theta, mask = batch.starts()
    # with fewer samples than coefficients there is nothing to fit
    free = mask & (batch.samples > mask.sum(axis=1))[:, None]
    open_ = (np.array(-np.inf), np.array(np.inf))
    theta, _ = descend_together(batch.run, theta, free, open_, DAMPING, evaluations - 1, tolerance)
    return [theta[k, [batch.place[t] for t in fit.terms]] for k, fit in enumerate(fits)]


class _Batch:
    """The chunks of all fits side by side."""

    def __init__(self, fits: Sequence[ChunkFit], limits: tuple[float, float], length: int) -> None:
        self.fits = fits
        self.terms = tuple(dict.fromkeys(t for f in fits for t in f.terms))
        self.place = {t: k for k, t in enumerate(self.terms)}
        nu = fits[0].data[0][0].shape[1]
        run = self._run = PolynomialRun((self.terms,), nu, (limits,))
        data: list[tuple[Array, Array]] = []
        where: list[Piece] = []
        group: list[int] = []
        for k, fit in enumerate(fits):
            chunks_of_fit = pieces(run, fit.data, length)
            where += [piece._replace(record=len(data) + piece.record) for piece in chunks_of_fit]
            data += fit.data
            group += [k] * len(chunks_of_fit)
        self.group: Index = np.array(group, dtype=np.int64)
        chunks = side_by_side(run, data, where)
        self._chunks, self._y = chunks, chunks.y[:, 0]
        self._inside = chunks.inside.astype(np.float64)
        self.samples = self._by_fit(self._inside.sum(axis=0))

    def _by_fit(self, values: Array) -> Array:
        """Sums over the chunks of each fit; the chunks come first."""
        out = np.zeros((len(self.fits), *values.shape[1:]))
        np.add.at(out, self.group, values)
        return out

    def starts(self) -> tuple[Array, NDArray[np.bool_]]:
        """θ over all terms (zero where absent) and which are present, (fits, terms) each."""
        theta = np.zeros((len(self.fits), len(self.terms)))
        mask = np.zeros(theta.shape, dtype=bool)
        for k, fit in enumerate(self.fits):
            where = [self.place[t] for t in fit.terms]
            theta[k, where] = fit.theta
            mask[k, where] = True
        return theta, mask

    def run(self, theta: Array, which: Index) -> "_Trial":
        """Free runs of all chunks, of which those of some fits count."""
        each = theta[self.group].T
        return _Trial(self, each, self._run.outputs_over(each, self._chunks), which)

    def squares(self, outputs: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            errors = self._inside * (outputs[:, 0] - self._y) ** 2
            return self._by_fit(errors.sum(axis=0))

    def normal(self, theta: Array, outputs: Array) -> tuple[Array, Array]:
        """SᵀS and Sᵀ(y − ŷ) of each fit, S = ∂ŷ/∂θ."""
        with np.errstate(over="ignore", invalid="ignore"):
            S = self._run.slopes_over(theta, self._chunks, outputs)[:, 0]
            S = np.nan_to_num(S * self._inside[:, :, None], nan=0.0, posinf=0.0, neginf=0.0)
            e = np.nan_to_num(self._inside * (self._y - outputs[:, 0]))
            S = np.ascontiguousarray(S.transpose(1, 2, 0))
            A = self._by_fit(S @ S.transpose(0, 2, 1))
            g = self._by_fit(np.einsum("bkl,lb->bk", S, e))
        return np.nan_to_num(A), np.nan_to_num(g)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Free runs of all chunks at some coefficients."""

    batch: _Batch
    theta: Array
    outputs: Array
    which: Index

    @property
    def cost(self) -> Array:
        """Squared errors of the fits that count."""
        return self.batch.squares(self.outputs)[self.which, None]

    def normal(self, of: Index) -> tuple[Array, Array]:
        """Normal equations of some of them."""
        A, g = self.batch.normal(self.theta, self.outputs)
        return A[self.which[of]], g[self.which[of]]


CHUNK = 150
"""Samples a run: several time constants, short enough that a bad candidate costs no more."""

SHORTEST = 20
"""Samples that a run at the end of a record needs to count: fewer show one step ahead only."""

SAMPLES = 5000
"""Samples that judge a candidate, at most; spread evenly over the data."""

AT_ONCE = 400_000
"""Numbers held at a time: candidates × chunks × terms."""

GAIN = 0.005
"""Relative decrease of the squared simulation error that a further term must bring."""


class CandidateRuns:
    """Chunks of the data over which subsets of some candidate terms are run.

    Args:
        terms: all candidate terms of one output; the others count as inputs here.
        data: (u, y) of each piece, y of shape (N, 1).
        limits: bounds of the output in free run.
    """

    def __init__(self, terms: Sequence[Term], data: Data, limits: tuple[float, float]) -> None:
        run = self.run = PolynomialRun((tuple(terms),), data[0][0].shape[1], (limits,))
        where = [
            Piece(k, a, min(a + CHUNK, len(y)))
            for k, (_, y) in enumerate(data)
            for a in range(run.first, len(y) - 1, CHUNK)
        ]
        where = [s for s in where if s.stop - s.start >= SHORTEST] or where
        most = max(SAMPLES // CHUNK, 1)
        if len(where) > most:
            where = [where[round(k * (len(where) - 1) / (most - 1))] for k in range(most)]
        self.chunks = side_by_side(run, data, where)

    def errors(self, theta: Array) -> Array:
        """Mean squared free-run error of each equation; theta (K, B), zero for absent terms."""
        used = np.flatnonzero(np.any(theta != 0.0, axis=1))
        each = max(AT_ONCE // max(len(used) * self.chunks.y.shape[2], 1), 1)
        parts = [
            self._some(theta[used, at : at + each], used) for at in range(0, theta.shape[1], each)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _some(self, theta: Array, used: Index) -> Array:
        """The same of some, all at once; only the terms in use."""
        terms = tuple(self.run.terms[0][k] for k in used)
        run = PolynomialRun((terms,), self.run.nu, self.run.limits)
        past = self.chunks.past[self.run.depth - run.depth :]
        u = self.chunks.u[self.run.before - run.before :]
        total = np.zeros((theta.shape[1], past.shape[2]))
        outputs = run.outputs(np, theta[:, :, None], u[:, :, None], past[:, :, None])
        y, inside = self.chunks.y[:, 0], self.chunks.inside
        with np.errstate(over="ignore", invalid="ignore"):
            for (value,), measured, counted in zip(outputs, y, inside, strict=True):
                total += counted * (value - measured) ** 2
        return np.asarray(total.sum(axis=1) / max(int(inside.sum()), 1))


def select_by_simulation(
    gram: TermGram, runs: CandidateRuns, start: Sequence[int], most: int
) -> list[tuple[tuple[int, ...], float]]:
    """Grow and prune a set of terms by its simulation error.

    Args:
        gram: least squares of the candidate terms.
        runs: the same terms, run freely.
        start: terms to begin with.

    Returns:
        Every set passed on the way with its squared simulation error, the last one the best.
    """
    size = len(gram.terms)
    chosen = list(start)
    error = float(runs.errors(_solutions(gram, [chosen], size))[0]) if chosen else np.inf
    sets = [(tuple(chosen), error)] if chosen else []
    while len(chosen) < most:
        rest = [k for k in range(size) if k not in chosen]
        if not rest:
            break
        errors = runs.errors(_solutions(gram, [[*chosen, k] for k in rest], size))
        pick = int(np.argmin(errors))
        if not errors[pick] < (1.0 - GAIN) * error:
            break
        chosen, error = [*chosen, rest[pick]], float(errors[pick])
        sets.append((tuple(chosen), error))
        while len(chosen) > 2:
            fewer = [[k for k in chosen if k != out] for out in chosen[:-1]]
            errors = runs.errors(_solutions(gram, fewer, size))
            pick = int(np.argmin(errors))
            if not errors[pick] < error:
                break
            chosen, error = fewer[pick], float(errors[pick])
            sets.append((tuple(chosen), error))
    return sets


def _solutions(gram: TermGram, sets: Sequence[Sequence[int]], size: int) -> Array:
    """Least-squares coefficients of each set of terms (all of one length), (size, len(sets))."""
    where = np.array(sets, dtype=int)
    blocks = gram.gram[where[:, :, None], where[:, None, :]]
    blocks = blocks + 1e-12 * np.eye(where.shape[1])
    solved = np.linalg.solve(blocks, gram.right[where][:, :, None])[:, :, 0]
    theta = np.zeros((len(sets), size))
    np.put_along_axis(theta, where, solved / gram.norms[where], axis=1)
    return theta.T
