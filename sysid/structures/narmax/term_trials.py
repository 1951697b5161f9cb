"""Trials of one output's equation: terms, coefficients, and their error on held-out data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.fitting.holdout import hold_out
from sysid.structures.difference_equations.free_run import ranges, widened
from sysid.structures.difference_equations.monomials import Term, term
from sysid.structures.difference_equations.probing import stays_near
from sysid.structures.difference_equations.signals import OneOutput
from sysid.structures.difference_equations.trials import TIE
from sysid.structures.narmax.chunk_fits import ChunkFit, fit_together
from sysid.structures.narmax.runs import PolynomialRun
from sysid.structures.narmax.structure import NARMAX

SHORT = 1500
"""Samples below which every fifth block is held out in turn."""

BLOCKS = 10
FOLDS = 5

USUAL = 0.97
"""Share of the samples that an input's levels account for."""

LADDER = (30, 150, 600)
"""Chunk lengths of the refinement, each started from the last."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of terms of one output.

    Attributes:
        terms: in the row's own view (other outputs as inputs).
        theta: coefficients by fold, (n,) each.
        error: free-run error on the held-out data relative to the output's spread.
        how: where it came from, in words.
        chunk: chunk length its coefficients were refined with; 0 for least squares.
    """

    terms: tuple[Term, ...]
    theta: tuple[Array, ...]
    error: float
    how: str
    chunk: int = 0
    evaluations: int = 1

    @property
    def size(self) -> int:
        return len(self.terms)


@dataclass(frozen=True, eq=False)
class Fold:
    """What coefficients are fitted to, and the samples of each whole record that judge them."""

    train: list[tuple[Array, Array]]
    counted: Sequence[NDArray[np.bool_]]


class Row:
    """One output on the estimation data, the other outputs measured: they count as inputs.

    Long records are judged on the usual hold-out. In short ones its last 30 % may hold a single
    transient, so every fifth of their blocks is held out in turn; terms are then looked for in all
    of the data and only judged with coefficients that have not seen what is counted.

    Args:
        structure: with the ranges of the data.
        records: estimation data, offsets removed.
    """

    def __init__(self, structure: NARMAX, output: int, records: Sequence[Record]) -> None:
        self.structure, self.output = structure, output
        self.view = OneOutput(output, structure.nu, structure.ny)
        self.limits = structure.limits[output]
        self.whole = [self.view.data(r) for r in records]
        if sum(len(r) for r in records) < SHORT:
            self.folds = [self._fold(records, k) for k in range(FOLDS)]
            self.search = self.whole
        else:
            data = hold_out(records)
            self.folds = [Fold([self.view.data(r) for r in data.train], data.counted)]
            self.search = self.folds[0].train
        self.levels = [
            _levels(np.concatenate([r.u[:, j] for r in records])) for j in range(structure.nu)
        ]
        outputs = np.concatenate([
            y[counted, 0]
            for f in self.folds
            for (_, y), counted in zip(self.whole, f.counted, strict=True)
        ])  # fmt: skip
        self.tie = max(TIE, 1.0 / float(np.sqrt(2.0 * max(len(outputs), 1))))
        spread = float(np.sum((outputs - outputs.mean()) ** 2)) if len(outputs) else 0.0
        self.spread = spread if spread > 0.0 else 1.0
        power = float(np.mean(np.concatenate([y for _, y in self.whole]) ** 2))
        self.scale = np.array([np.sqrt(power) if power > 0.0 else 1.0])

    def _fold(self, records: Sequence[Record], k: int) -> Fold:
        """Blocks k, k + FOLDS … held out, so that every fold covers the operating range."""
        train: list[tuple[Array, Array]] = []
        counted = []
        for r, (u, y) in zip(records, self.whole, strict=True):
            edges = [round(b * len(r) / BLOCKS) for b in range(BLOCKS + 1)]
            mask = np.zeros(len(r), dtype=bool)
            start = 0
            for b in range(k, BLOCKS, FOLDS):
                mask[edges[b] : edges[b + 1]] = True
                train.append((u[start : edges[b]], y[start : edges[b]]))
                start = edges[b + 1]
            train.append((u[start:], y[start:]))
            counted.append(mask)
        return Fold(train, counted)

    def identifiable(self, t: Term) -> bool:
        """Whether the inputs have enough levels to distinguish this term from one of lower power.

        With two levels u² is a constant and u³ a multiple of u: y(t−1)·u² would fit as well as
        y(t−1), and be wrong at every other amplitude.
        """
        return all(f.kind != "u" or t.count(f) < self.levels[f.channel] for f in set(t))

    def inward(self, t: Term) -> Term:
        """A term of the structure in this row's view."""
        return term([self.view.inward(f) for f in t])

    def outward(self, t: Term) -> Term:
        return term([self.view.outward(f) for f in t])

    def free_run(self, terms: Sequence[Term]) -> PolynomialRun:
        """This row's equation alone."""
        return PolynomialRun((tuple(terms),), self.view.nu, (self.limits,))

    def stays_near(self, trial: "Trial") -> bool:
        """Whether the equation stays near its data under probing inputs, in every fold."""
        us = [u for u, _ in self.whole]
        steps = np.concatenate([np.abs(np.diff(u, axis=0)) for u in us])
        far = widened((self.structure.output_range[self.output],), self.structure.runaway)
        run = PolynomialRun((trial.terms,), self.view.nu, far)
        inside, largest = ranges(us), np.max(steps, axis=0, initial=0.0)
        return all(stays_near(run, theta, inside, largest) for theta in trial.theta)

    def held_out_error(self, terms: Sequence[Term], thetas: Sequence[Array]) -> float:
        """Free-run error on the held-out samples, by fold in runs through the whole records."""
        run = self.free_run(terms)
        first = run.first
        total = 0.0
        for fold, theta in zip(self.folds, thetas, strict=True):
            for (u, y), counted in zip(self.whole, fold.counted, strict=True):
                # what comes after the last sample that counts need not be run
                stop = int(np.flatnonzero(counted)[-1]) + 1 if counted.any() else 0
                if stop > first:
                    x0 = run.state(y[:first], u[:first])
                    outputs = run.simulate(theta, u[first:stop], x0)
                    total += float(np.sum((outputs - y[first:stop])[counted[first:stop]] ** 2))
        return float(np.sqrt(total / self.spread))


# ------------------------------------------------------------------------- in free run


def _levels(u: Array) -> int:
    """Number of values that make up an input but for a few samples, to a thousandth of its range.

    A two-level sequence that begins at rest still has two.
    """
    span = float(np.ptp(u))
    if span <= 0.0:
        return 1
    _, counts = np.unique(np.round((u - u.min()) / span, 3), return_counts=True)
    reached = np.cumsum(np.sort(counts)[::-1])
    return int(np.searchsorted(reached, USUAL * len(u))) + 1


def refined(
    row: Row, trial: Trial, evaluations: int, ladder: Sequence[int] = LADDER
) -> list[Trial]:
    """The same terms with coefficients fitted to free runs over longer and longer chunks."""
    thetas: tuple[Array, ...] = trial.theta
    refined_trials: list[Trial] = []
    longest = max(len(y) for fold in row.folds for _, y in fold.train)
    for rung in ladder:
        chunk = min(rung, longest)
        (thetas,) = fit_folds(row, [(trial.terms, thetas)], chunk, evaluations)
        error = row.held_out_error(trial.terms, thetas)
        words = f"{trial.how}, refined over {chunk} samples"
        refined_trials.append(Trial(trial.terms, thetas, error, words, chunk))
        if chunk == longest:
            break
    return refined_trials


def fit_folds(
    row: Row,
    sets: Sequence[tuple[tuple[Term, ...], Sequence[Array]]],
    chunk: int,
    evaluations: int,
) -> list[tuple[Array, ...]]:
    """Coefficients of several sets of terms on every fold, all fitted at once.

    Args:
        sets: terms with their starts by fold.
        chunk: samples of the free runs.
    """
    fits = [
        ChunkFit(terms, theta, fold.train)
        for terms, thetas in sets
        for fold, theta in zip(row.folds, thetas, strict=True)
    ]
    solutions = fit_together(fits, row.limits, chunk, evaluations)
    n = len(row.folds)
    return [tuple(solutions[k : k + n]) for k in range(0, len(solutions), n)]
