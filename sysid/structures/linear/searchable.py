"""The linear structures as the parameter search sees them: problems, starts, open directions."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index, Record
from sysid.fitting.normal_equations import RANK_TOLERANCE
from sysid.fitting.problem import HUGE, Data, Focus, Initial, Problem
from sysid.fitting.run_errors import RunErrors
from sysid.fitting.searchable import InitialGuesses, Searchable
from sysid.fitting.uncertainty import PART
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.polynomials import Polynomials, adjugate, determinant
from sysid.structures.linear.predictor import (
    RowErrors,
    impulse,
    largest_radius,
    roots_inside,
)
from sysid.structures.linear.starts import stabilised, starts_of


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


@dataclass(frozen=True)
class LinearSearch(Searchable):
    """The search of a polynomial structure's θ."""

    structure: PolynomialStructure

    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        """One problem per output in prediction focus; one of all outputs in simulation focus."""
        s = self.structure
        data = [(r.u, r.y) for r in records]
        estimate = initial in (Initial.ESTIMATED, Initial.AUTO)
        rows = [
            RowErrors(s.layout(i), s.row_index(i), data, estimate, search=True) for i in range(s.ny)
        ]
        problems: tuple[Problem, ...] = tuple(rows)
        later: list[Problem] = []
        if focus is Focus.SIMULATION and s.traits.has_noise_model:
            problems = self._free_run_problems(data, estimate)
            known = s.deterministic_index()
            later = [Remaining(row, known) for row in rows if not np.all(np.isin(row.index, known))]
        if stable:
            n = sum(s.layout(i).n for i in range(s.ny))
            problems = (Stacked(problems, s.stable, n),)
        return (*problems, *later)

    def _free_run_problems(
        self, data: Sequence[tuple[Array, Array]], estimate: bool
    ) -> tuple[Problem, ...]:
        s = self.structure
        if "f" not in s.letters:
            return (FreeRunErrors(s, data, estimate),)
        known = s.deterministic_index()
        rows = []
        for i in range(s.ny):
            index = s.row_index(i)
            output_error = replace(s.layout(i), nc=0, nd=0)
            kept = index[np.isin(index, known)]
            rows.append(RowErrors(output_error, kept, data, estimate, search=True))
        return tuple(rows)

    def starts(self, records: Sequence[Record], focus: Focus) -> InitialGuesses:
        return starts_of(self.structure, records, focus)

    def stabilised(self, theta: Array) -> Array:
        return stabilised(self.structure, theta)

    def offset_entries(self) -> Index:
        s = self.structure
        return s.constant_places()[0] if s.orders.constant else super().offset_entries()

    def open_directions(self, records: Sequence[Record]) -> Array:
        """What inputs in fixed proportion to each other leave open, (n, k)."""
        return confounded(self.structure, records)


def confounded(structure: PolynomialStructure, records: Sequence[Record]) -> Array:
    """Directions of θ that inputs in fixed proportion to each other leave open, (n, n_open).

    With u₂ = α u₁ only B₁/F₁ + α B₂/F₂ is seen. Rows without F show that as a singular JᵀJ; with
    denominators of its own for each input the errors are curved along that line, JᵀJ is regular
    wherever the search ends, and still nothing says which input has which poles.
    """
    n = len(structure.parameters(records[0].inputs, records[0].outputs))
    if "f" not in structure.letters:
        return np.zeros((n, 0))
    groups = []
    for weights in _proportions(records).T:
        alike = np.abs(weights) > PART
        for i in range(structure.ny):
            lay, index = structure.layout(i), structure.row_index(i)
            _, b, _, _, f = lay.slices()
            members = [j for j in range(structure.nu) if alike[j] and lay.nb[j]]
            if len(members) < 2:
                continue
            direction = np.zeros(n)
            for j in members:
                direction[index[b[j]]] = direction[index[f[j]]] = weights[j]
            groups.append(direction / np.linalg.norm(direction))
    return np.array(groups).T if groups else np.zeros((n, 0))


def _proportions(records: Sequence[Record]) -> Array:
    """Null space of the inputs, each scaled to unit norm, (nu, k)."""
    R = np.linalg.qr(np.vstack([np.linalg.qr(r.u, mode="r") for r in records]), mode="r")
    scale = np.linalg.norm(R, axis=0)
    scale[scale == 0] = 1.0
    _, s, Vt = np.linalg.svd(R / scale, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
    return np.asarray(Vt[s <= s.max(initial=0.0) * RANK_TOLERANCE].T)
