"""Final fit of a block-oriented model: all data, the user's constraints, covariance."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError, Termination
from sysid.fitting.marquardt import loss
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial, Parameter
from sysid.fitting.robust import huber_widths
from sysid.fitting.searchable import StartReport
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.methods.outcome import FitOutcome, outcome_of, with_covariance
from sysid.methods.search import STATE_LEVEL
from sysid.structures.blocks.errors import ChainErrors
from sysid.structures.blocks.fit import (
    ChainData,
    Fitted,
    descend,
    outer_abscissae,
)
from sysid.structures.blocks.gains import normalised
from sysid.structures.blocks.structure import BlockStructure

EVALUATIONS = 100
"""Limit of the descent on the normal equations before the last search."""

HOPELESS = 1e50
"""Cost of a model that is not stable, or nearly so."""

APPROACH, SETTLED = 1e-5, 1e-7
"""Relative gain of a step below which that descent ends: before gains are pinned, and after."""

PATIENCE = 4
"""Steps of less gain than that after which the last search ends: along a point of a static that
hardly matters they would go on for a hundred."""


def final_fit(
    structure: BlockStructure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    starts: Sequence[tuple[str, Array]],
    reports: tuple[StartReport, ...],
    warnings: tuple[str, ...] = (),
) -> FitOutcome:
    """The last search on all data from the given starts, every gain in one place.

    Args:
        structure: orders and statics settled.
        records: experiments, offsets removed.
        parameters: bounds and fixed values the user gave, by name.
        starts: named θ of ``structure``.
        reports: starts tried before.
        warnings: what the user should know.

    Raises:
        DataError: fewer equations than unknowns.
        ModelError: no start gives a finite cost.
    """
    given = {p.name: p for p in parameters}
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    table = tuple(given.get(p.name, p) for p in bare)
    data = ChainData.of(records)
    final = FinalFit(structure, data, options, table)
    _check_equations(records, final)
    runs = [(name, *final.approached(theta)) for name, theta in starts]
    rough = min((run[2] for run in runs), key=lambda solution: solution.cost)
    theta = rough.theta
    if not final.constrained:
        # the same model with its gains pinned; the cost does not change, the covariance exists
        chain, theta, pins = normalised(structure.chain, theta, data.data)
        structure = structure.with_chain(chain)
        pins = sorted({*pins, *outer_abscissae(chain)})
        table = tuple(
            replace(p, fixed=float(theta[k])) if k in pins else p for k, p in enumerate(table)
        )
        final = FinalFit(structure, data, options, table)
    best = final.from_start(theta)
    if best.termination is Termination.DIVERGED or not best.cost < HOPELESS:
        raise ModelError(f"{structure.name}: {Termination.DIVERGED.value}{_because(final)}")
    notes = [
        StartReport("all", name, before, best.cost, solution.evaluations + best.evaluations)
        if solution is rough
        else StartReport("all", name, before, solution.cost, solution.evaluations)
        for name, before, solution in runs
    ]
    return final.outcome(best, (*reports, *notes), warnings)


def refit(
    before: FitOutcome,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
) -> FitOutcome:
    """The last search once more, on nearly the same data, from where a fit ended."""
    structure = before.structure
    assert isinstance(structure, BlockStructure)
    starts = [("the fit before", before.theta)]
    return final_fit(
        structure, records, options, parameters, starts, before.starts, before.warnings
    )


def _because(final: "FinalFit") -> str:
    """What the user may have done to leave no stable model."""
    named = [
        p.name for p in final.table if p.fixed is not None or np.isfinite([p.lower, p.upper]).any()
    ]
    if not final.constrained or not named:
        return ""
    return f" No stable model was found with {', '.join(named)} as fixed or bounded."


def _check_equations(records: Sequence[Record], final: "FinalFit") -> None:
    equations = sum(final.rest.lengths)
    unknowns = int(final.free.sum())
    if equations <= unknowns:
        raise DataError(
            f"{records[0].name}: {equations} equations for {unknowns} parameters; record longer "
            "or take lower orders and simpler statics"
        )


class FinalFit:
    """The search with what the user asked of it."""

    def __init__(
        self,
        structure: BlockStructure,
        data: ChainData,
        options: FitOptions,
        table: Sequence[Parameter],
    ) -> None:
        self.structure, self.data, self.options, self.table = structure, data, options, table
        chain = structure.chain
        self.moving = ChainErrors(chain, data.data, True, data.kept, data.scales)
        self.rest = ChainErrors(chain, data.data, False, data.kept, data.scales)
        self.lower = np.array([p.lower for p in table])
        self.upper = np.array([p.upper for p in table])
        self.free = np.array([p.fixed is None for p in table], dtype=bool)
        self.values = np.array([0.0 if p.fixed is None else p.fixed for p in table])

    @property
    def constrained(self) -> bool:
        """Whether the user fixed or bounded something: gains then stay where they are."""
        finite = np.isfinite(self.lower) | np.isfinite(self.upper)
        return bool(np.any(finite) or not np.all(self.free))

    def approached(self, theta: Array) -> tuple[float, Fitted]:
        """(cost at the start, where a quick descent from it ends)."""
        theta = self._allowed(theta)
        problem, p = self.moving, self.data.with_states(self.structure.chain, theta)
        if self.options.initial is Initial.ZERO:
            problem, p = self.rest, theta
        before = loss(problem.residual(p))
        if self._bounded:
            solution = self._searched(problem, p)
            return before, Fitted(
                problem.chain, solution.p, solution.cost, float("nan"), solution.evaluations
            )
        return before, self._descended(problem, p, APPROACH)

    def from_start(self, theta: Array) -> Solution:
        """Where the search with all its care ends."""
        theta = self._allowed(theta)
        if self.options.initial is Initial.ZERO:
            return self._searched(self.rest, theta)
        solution = self._searched(self.moving, self.data.with_states(self.structure.chain, theta))
        if self.options.initial is Initial.AUTO:
            return self._at_rest(solution) or solution
        return solution

    def _allowed(self, theta: Array) -> Array:
        """θ with fixed values and within the bounds."""
        inside = np.clip(np.where(self.free, theta, self.values), self.lower, self.upper)
        return np.asarray(inside)

    @property
    def _bounded(self) -> bool:
        return bool(np.any(np.isfinite(self.lower)) or np.any(np.isfinite(self.upper)))

    def _descended(self, problem: ChainErrors, p: Array, tolerance: float) -> Fitted:
        fixed = np.flatnonzero(~self.free).tolist()
        return descend(
            problem.chain,
            p,
            self.data,
            evaluations=min(EVALUATIONS, self.options.limit()),
            fixed_entries=tuple(fixed),
            tolerance=tolerance,
            problem=problem,
        )

    def _searched(self, problem: ChainErrors, p: Array) -> Solution:
        n, states = self.structure.chain.n, problem.n_initial
        free = np.concatenate([self.free, np.ones(states, dtype=bool)])
        limit = np.full(states, np.inf)
        lower, upper = (
            np.concatenate([self.lower, -limit]),
            np.concatenate([self.upper, limit]),
        )
        huber = None
        if not self._bounded:
            p = self._descended(problem, p, SETTLED).p
        if self.options.robust:
            huber = huber_widths(problem, problem.residual(p))
        return levenberg_marquardt(
            problem,
            p[: n + states],
            Descent(
                free=free,
                lower=lower,
                upper=upper,
                huber=huber,
                max_evaluations=self.options.limit(),
                tolerance=self.options.precision(SETTLED),
                patience=PATIENCE,
            ),
        )

    def _at_rest(self, solution: Solution) -> Solution | None:
        """The search from rest, unless the F-test of the initial states says they matter (99 %)."""
        from scipy.stats import f

        k, n = self.moving.n_initial, self.structure.chain.n
        if k == 0 or self.options.robust:
            return None
        r = self.rest.residual(solution.p[:n])
        dof = len(r) - k - n
        if dof <= 0 or not np.isfinite(solution.cost):
            return self._searched(self.rest, solution.p[:n])
        # at the same θ: a search from rest would find less
        limit = max(2.0 * solution.cost, 1e-300)
        if 2.0 * loss(r) > 4.0 * limit:
            return None
        rest = self._searched(self.rest, solution.p[:n])
        ratio = (2.0 * rest.cost - limit) / k / (limit / dof)
        return None if ratio > f.ppf(STATE_LEVEL, k, dof) else rest

    def outcome(
        self, best: Solution, reports: tuple[StartReport, ...], warnings: tuple[str, ...]
    ) -> FitOutcome:
        """What the search found, initial states counted where they were estimated."""
        n = self.structure.chain.n
        states = len(best.p) - n
        counted = self.options.initial is not Initial.BACKCAST
        which = np.flatnonzero(np.concatenate([self.free, np.full(states, counted)]))
        part = with_covariance(self.moving if states else self.rest, best, which)
        table = tuple(self.table)
        return outcome_of(self.structure, table, best.p[:n], [part], reports, warnings)
