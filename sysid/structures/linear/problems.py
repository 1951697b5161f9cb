"""Problems made of others: free-run errors, what remains after them, several at once."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index
from sysid.fitting.problem import HUGE, Data, Problem
from sysid.fitting.run_errors import RunErrors
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.polynomials import Polynomials, adjugate, determinant
from sysid.structures.linear.predictor import (
    RowErrors,
    impulse,
    largest_radius,
    roots_inside,
)


class FreeRunErrors(RunErrors):
    """Simulation errors y − ŷ of A y = B u (no F), all outputs together.

    With H = A⁻¹ and x_l = Σ_j B_lj u_j + ζ_l(q) δ the free run is ŷ_i = Σ_l H_il x_l, and

        ∂ŷ_i/∂a_lm,k = −H_il ŷ_m(t−k)   ∂ŷ_i/∂b_lj,k = H_il u_j(t−k)   ∂ŷ_i/∂ζ_l,k = H_il δ(t−k).

    A noise model is fitted afterwards by ``Remaining``. Parameters whose free run grows by more
    than e over the record are inadmissible.
    """

    def __init__(
        self,
        structure: PolynomialStructure,
        data: Data,
        estimate_initial: bool,
    ) -> None:
        layouts = [structure.layout(i) for i in range(structure.ny)]
        self._structure, self._n = structure, sum(lay.n for lay in layouts)
        self._states = [lay.start if estimate_initial else 0 for lay in layouts]
        entries = structure.deterministic_index()
        super().__init__(len(entries), data, sum(self._states), scales=np.ones(structure.ny))
        self.index = entries
        self._radius = largest_radius([y for _, y in data])
        self._cache: tuple[bytes, list[Array]] | None = None

    def runs(self, p: Array) -> list[Array] | None:
        det = np.array(determinant(self._polynomials(p).A))
        return self._runs(p) if roots_inside(det[1:], self._radius) else None

    def tangents(self, p: Array) -> Iterator[Array]:
        s, A = self._structure, self._polynomials(p).A
        det, adj = determinant(A), adjugate(A)
        for (u, y), run in zip(self.data, self._runs(p), strict=True):
            n, state = len(y), len(self.index)
            block = np.zeros((s.ny, state + self.states_each, n))
            for m in range(s.ny):
                lay, index = s.layout(m), np.searchsorted(self.index, s.row_index(m))
                a, b, *_ = lay.slices()
                sources = [(index[place], -run[:, j], 1) for j, place in enumerate(a)]
                sources += [(index[q], u[:, j], lay.nk[j]) for j, q in enumerate(b)]
                sources.append((np.arange(state, state + self._states[m]), impulse(n), 0))
                state += self._states[m]
                for columns, signal, first in sources:
                    responses = np.array([lfilter(row[m], det, signal) for row in adj])
                    for lag, column in enumerate(columns.tolist(), first):
                        block[:, column, lag:] = responses[:, : max(n - lag, 0)]
            yield block

    def _polynomials(self, p: Array) -> Polynomials:
        theta = np.zeros(self._n)
        theta[self.index] = p[: len(self.index)]
        return self._structure.polynomials(theta)

    def _runs(self, p: Array) -> list[Array]:
        key = p.tobytes()
        if self._cache is None or self._cache[0] != key:
            s, poly = self._structure, self._polynomials(p)
            det, adj = determinant(poly.A), adjugate(poly.A)
            runs, at = [], len(self.index)
            for u, y in self.data:
                run = np.zeros((len(y), s.ny))
                for m in range(s.ny):
                    x = sum(
                        (lfilter(poly.B[m][j], [1.0], u[:, j]) for j in range(s.nu)),
                        np.zeros(len(y)),
                    )
                    room = x[: self._states[m]]
                    room += p[at : at + len(room)]
                    at += self._states[m]
                    for i in range(s.ny):
                        run[:, i] += lfilter(adj[i][m], det, x)
                runs.append(run)
            self._cache = (key, runs)
        return self._cache[1]


class Remaining(Problem):
    """The part of a row's prediction problem that is left when other entries of θ are known."""

    def __init__(self, row: RowErrors, known: Index, theta: Array | None = None) -> None:
        self._row, self._known, self._theta = row, known, theta
        free = ~np.isin(row.index, known)
        self.index = row.index[free]
        self.lengths, self.channels = row.lengths, row.channels
        self.n_initial = row.n_initial
        self._columns = np.concatenate(
            [np.flatnonzero(free), len(row.index) + np.arange(row.n_initial)]
        )

    def given(self, theta: Array) -> Problem:
        return Remaining(self._row, self._known, theta)

    def _full(self, p: Array) -> Array:
        theta = np.zeros(int(self._row.index[-1]) + 1) if self._theta is None else self._theta
        full = self._row.initial_guess(theta)
        full[self._columns] = p
        return full

    def residual(self, p: Array) -> Array:
        return self._row.residual(self._full(p))

    def jacobian(self, p: Array) -> Array:
        return self._row.jacobian(self._full(p))[:, self._columns]


class Stacked(Problem):
    """Several problems solved as one, with a condition that every iterate must meet."""

    def __init__(
        self, parts: Sequence[Problem], feasible: Callable[[Array], bool], n_theta: int
    ) -> None:
        self._parts, self._feasible, self._n = tuple(parts), feasible, n_theta
        self.index = np.concatenate([part.index for part in parts])
        self.n_initial = sum(part.n_initial for part in parts)
        self.lengths = tuple(n for part in parts for n in part.lengths)
        self.channels = tuple(i for part in parts for i in part.channels)
        self._places, theta_at, state_at = [], 0, len(self.index)
        for part in parts:
            n = len(part.index)
            self._places.append(
                np.concatenate(
                    [
                        np.arange(theta_at, theta_at + n),
                        np.arange(state_at, state_at + part.n_initial),
                    ]
                )
            )
            theta_at, state_at = theta_at + n, state_at + part.n_initial

    def residual(self, p: Array) -> Array:
        """Errors of all parts; huge where the condition fails."""
        e = np.concatenate(
            [q.residual(p[place]) for q, place in zip(self._parts, self._places, strict=True)]
        )
        theta = np.zeros(self._n)
        theta[self.index] = p[: len(self.index)]
        return e if self._feasible(theta) else np.full(len(e), HUGE)

    def jacobian(self, p: Array) -> Array:
        blocks = [q.jacobian(p[place]) for q, place in zip(self._parts, self._places, strict=True)]
        out = np.zeros((sum(len(b) for b in blocks), len(p)))
        at = 0
        for block, place in zip(blocks, self._places, strict=True):
            out[at : at + len(block), place] = block
            at += len(block)
        return out
