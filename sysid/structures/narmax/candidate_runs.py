"""Simulation-error term selection: many candidate equations run over chunks of the data at once.

Forward selection by the one-step error prefers terms that predict over terms that simulate, most
of all on data sampled fast. Here each candidate is added (or each chosen term left out) in turn,
the coefficients are re-estimated by least squares, all resulting equations are run freely from
measured states, and the one with the smallest simulation error is kept (Piroddi & Spinelli 2003,
"An identification algorithm for polynomial NARX models based on simulation error minimization").
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Index
from sysid.fitting.problem import Data
from sysid.structures.difference_equations.chunks import Piece, side_by_side
from sysid.structures.difference_equations.frols import TermGram
from sysid.structures.difference_equations.monomials import Term
from sysid.structures.narmax.runs import PolynomialRun

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
        most: largest number of terms.

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
