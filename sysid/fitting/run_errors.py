"""Free-run errors of a model as a least-squares problem, however it is run."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.fitting.problem import HUGE, Data, Problem

Masks = Sequence[NDArray[np.bool_]]


class RunErrors(Problem):
    """Free-run errors (y − ŷ)/scale, record after record, output after output.

    Args:
        n: length of θ.
        data: (u, y) of each record.
        states_each: initial states of a record that are estimated, 0 where none is.
        kept: samples that count, by record; all when None. The run goes through the others, which
            is how data are held out without cutting a record.
        scales: divisor of each output's errors, so that units do not decide what matters; their
            standard deviation when None.
        largest: an error beyond this counts as divergence.
    """

    def __init__(
        self,
        n: int,
        data: Data,
        states_each: int,
        kept: Masks | None = None,
        scales: Array | None = None,
        largest: float = HUGE,
    ) -> None:
        self.data, self.states_each, self._largest = list(data), states_each, largest
        self.index = np.arange(n)
        self.n_initial = states_each * len(data)
        self.kept = [np.ones(len(y), dtype=bool) for _, y in data] if kept is None else list(kept)
        self.scales: Array = output_scales([y for _, y in data]) if scales is None else scales
        ny = len(self.scales)
        self.lengths = tuple(int(k.sum()) for k in self.kept for _ in range(ny))
        self.channels = tuple(i for _ in data for i in range(ny))

    @abstractmethod
    def runs(self, p: Array) -> Sequence[Array] | None:
        """ŷ (N, ny) of each record; None where p has no run to speak of."""

    @abstractmethod
    def tangents(self, p: Array) -> Iterator[Array]:
        """∂ŷ/∂(θ, own initial state) of each record, (ny, n + states_each, N)."""

    def states(self, p: Array) -> Array:
        """Initial states in p, (records, states_each)."""
        return p[len(self.index) :].reshape(len(self.data), self.states_each)

    def residual(self, p: Array) -> Array:
        """ε, or HUGE throughout where the run is not bounded."""
        diverged = np.full(sum(self.lengths), HUGE)
        with np.errstate(all="ignore"):
            runs = self.runs(p)
            if runs is None:
                return diverged
            parts = [
                ((y - run)[kept] / self.scales).T.ravel()
                for run, (_, y), kept in zip(runs, self.data, self.kept, strict=True)
            ]
            e = np.concatenate(parts)
        bounded = np.isfinite(e).all() and np.abs(e).max(initial=0.0) <= self._largest
        return e if bounded else diverged

    def jacobian(self, p: Array) -> Array:
        out = np.zeros((sum(self.lengths), len(p)))
        at = 0
        for columns, block in self._blocks(p):
            out[at : at + block.shape[1], columns] = block.T
            at += block.shape[1]
        if not np.isfinite(out).all():
            out = np.nan_to_num(out, nan=0.0, posinf=HUGE, neginf=-HUGE)
        return out

    def normal_equations(self, p: Array, r: Array) -> tuple[Array, Array]:
        """JᵀJ and Jᵀr without ever holding J."""
        gram, gradient = np.zeros((len(p), len(p))), np.zeros(len(p))
        at = 0
        for columns, block in self._blocks(p):
            gram[np.ix_(columns, columns)] += block @ block.T
            gradient[columns] += block @ r[at : at + block.shape[1]]
            at += block.shape[1]
        return gram, gradient

    def _blocks(self, p: Array) -> Iterator[tuple[Index, Array]]:
        """Of each record and output: which entries of p count, and their rows of Jᵀ."""
        n = len(self.index)
        with np.errstate(all="ignore"):
            for k, (D, kept) in enumerate(zip(self.tangents(p), self.kept, strict=True)):
                first = n + k * self.states_each
                columns = np.concatenate([np.arange(n), np.arange(first, first + self.states_each)])
                for d, scale in zip(D, np.atleast_1d(self.scales), strict=True):
                    yield columns, (d if kept.all() else d[:, kept]) / -scale


def output_scales(outputs: Sequence[Array]) -> Array:
    """Standard deviation of each output over all records, 1 where it is constant, (ny,)."""
    spread = np.std(np.concatenate(outputs), axis=0)
    return np.where(spread > 0.0, spread, 1.0)
