"""The linear structures as the parameter search sees them: problems, starts, open directions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Index, Record
from sysid.fitting.normal_equations import RANK_TOLERANCE
from sysid.fitting.problem import Focus, Initial, Problem
from sysid.fitting.searchable import InitialGuesses, Searchable
from sysid.fitting.uncertainty import PART
from sysid.structures.linear.constant_input import constant_places
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.predictor import RowErrors
from sysid.structures.linear.problems import FreeRunErrors, Remaining, Stacked
from sysid.structures.linear.starts import stabilised, starts_of


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
        return constant_places(s)[0] if s.orders.constant else super().offset_entries()

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
