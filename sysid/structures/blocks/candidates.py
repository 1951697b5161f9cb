"""Candidates of a block-oriented fit: started, refined, and the best chosen."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sysid.data.record import Array, Record
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.methods.outcome import FitOutcome
from sysid.structures.blocks.fit import (
    ROUGH_TOLERANCE,
    ChainData,
    Fitted,
    abscissae,
    descend,
    outer_abscissae,
)
from sysid.structures.blocks.outcome import final_fit
from sysid.structures.blocks.structure import BlockStructure

Chained = TypeVar("Chained", bound=BlockStructure)


@dataclass(frozen=True, eq=False)
class Candidate(Generic[Chained]):
    """One choice of orders and statics with its fit."""

    structure: Chained
    found: Fitted
    label: str

    @property
    def n(self) -> int:
        """Number of parameters."""
        return self.structure.chain.n

    def values(self, records: Sequence[Record]) -> dict[str, float]:
        """Its parameters by name."""
        names = (p.name for p in self.structure.parameters(records[0].inputs, records[0].outputs))
        return dict(zip(names, self.found.theta.tolist(), strict=True))


def preferred(tried: Sequence[Candidate[Chained]], data: ChainData) -> Candidate[Chained]:
    """Of the models within one standard error of the smallest held-out error that of least BIC.

    Held-out data cannot distinguish them, so the fitted data decide, where a parameter costs ln N.
    """
    ahead = min(tried, key=lambda c: c.found.holdout_error).found
    limit = (1.0 + data.holdout_margin(ahead.chain, ahead.p)) * ahead.holdout_error
    near = [c for c in tried if c.found.holdout_error <= limit] or list(tried)
    size = data.samples * len(data.scales)

    def bic(c: Candidate[Chained]) -> float:
        return float(size * np.log(max(c.found.cost, 1e-300)) + c.n * np.log(size))

    return min(near, key=lambda c: (bic(c), c.found.holdout_error))


def by_names(
    structure: BlockStructure, values: Mapping[str, float], records: Sequence[Record]
) -> Array:
    """θ of a structure from values by name, zero where there is none."""
    table = structure.parameters(records[0].inputs, records[0].outputs)
    return np.array([values.get(p.name, 0.0) for p in table])


def best_start(
    structure: BlockStructure,
    starts: Iterable[Mapping[str, float]],
    records: Sequence[Record],
    data: ChainData,
    evaluations: int,
) -> Fitted | None:
    """The best end of descents from values by name; None without any."""
    candidates = [
        descend(structure.chain, by_names(structure, s, records), data, evaluations=evaluations)
        for s in starts
    ]
    return min(candidates, key=lambda f: f.cost, default=None)


def points_last(
    start: Fitted, data: ChainData, evaluations: int, tolerance: float = ROUGH_TOLERANCE
) -> Fitted:
    """All parameters together, points of piecewise-linear statics last."""
    fixed = abscissae(start.chain)
    solution = descend(
        start.chain,
        start.p,
        data,
        evaluations=evaluations,
        fixed_entries=fixed,
        tolerance=tolerance,
    )
    if not fixed:
        return solution
    moved = descend(
        solution.chain,
        solution.p,
        data,
        evaluations=evaluations,
        fixed_entries=outer_abscissae(solution.chain),
        tolerance=tolerance,
    )
    # points may wander after noise: keep them where that does not help on held-out samples
    return solution if moved.holdout_error > solution.holdout_error else moved


def last_search(
    best: Candidate[Chained],
    tried: Sequence[Candidate[Chained]],
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """The last search from the best candidate and from further starts that fit its shape.

    Args:
        best: where nothing is left to choose.
        tried: every candidate, for the report.
        records, options, parameters, initial_guesses: as the fit was given.
    """
    starts = [(best.label, best.found.theta)]
    starts += [(name, theta) for name, theta in initial_guesses if len(theta) == best.n]
    reports = tuple(
        StartReport("all", c.label, None, c.found.cost, c.found.evaluations) for c in tried
    )
    return final_fit(best.structure, records, options, parameters, starts, reports)
