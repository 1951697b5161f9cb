"""The last search of a block-oriented fit: all data, the user's constraints, what it is worth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError, Termination
from sysid.estimation.block_fit import ChainData, descend, outer_abscissae
from sysid.estimation.block_gains import normalised
from sysid.estimation.search import STATE_LEVEL, FitOptions, half_square
from sysid.estimation.solvers import HUBER_WIDTH, Solution, levenberg_marquardt
from sysid.estimation.strategies import Outcome
from sysid.estimation.uncertainty import uncertainty
from sysid.structures.base import Initial, Parameter
from sysid.structures.block_errors import ChainErrors
from sysid.structures.block_structure import BlockStructure
from sysid.structures.model import StartReport

EVALUATIONS = 100
"""Limit of the descent on the normal equations before the last search."""


def finished(
    structure: BlockStructure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    starts: Sequence[tuple[str, Array]],
    reports: tuple[StartReport, ...],
    warnings: tuple[str, ...] = (),
) -> Outcome:
    """The last search on all data from the given starts, every gain in one place.

    Args:
        structure: orders and statics settled.
        records: experiments, offsets removed.
        options: how to fit.
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
    last = _Last(structure, data, options, table)
    _check_equations(records, last)
    runs = [(name, *last.from_start(theta)) for name, theta in starts]
    best = min((run[2] for run in runs), key=lambda solution: solution.cost)
    if best.termination is Termination.DIVERGED or not np.isfinite(best.cost):
        raise ModelError(f"{structure.name}: {Termination.DIVERGED.value}")
    if not last.constrained:
        # the same model with its gains pinned; the cost does not change, the covariance exists
        chain, theta, pins = normalised(structure.chain, best.p[: structure.chain.n], data.data)
        structure = structure.with_chain(chain)
        pins = sorted({*pins, *outer_abscissae(chain)})
        table = tuple(
            replace(p, fixed=float(theta[k])) if k in pins else p for k, p in enumerate(table)
        )
        last = _Last(structure, data, options, table)
        _, best = last.from_start(theta)
    said = [StartReport("all", run[0], run[1], run[2].cost, run[2].evaluations) for run in runs]
    return last.outcome(best, (*reports, *said), warnings)


def _check_equations(records: Sequence[Record], last: "_Last") -> None:
    equations = sum(last.rest.lengths)
    unknowns = int(last.free.sum())
    if equations <= unknowns:
        raise DataError(
            f"{records[0].name}: {equations} equations for {unknowns} parameters; record longer "
            "or take lower orders and simpler statics"
        )


class _Last:
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
        self.moving = ChainErrors(chain, data.data, True, scales=data.scales)
        self.rest = ChainErrors(chain, data.data, False, scales=data.scales)
        self.lower = np.array([p.lower for p in table])
        self.upper = np.array([p.upper for p in table])
        self.free = np.array([p.fixed is None for p in table], dtype=bool)
        self.values = np.array([0.0 if p.fixed is None else p.fixed for p in table])

    @property
    def constrained(self) -> bool:
        """Whether the user fixed or bounded something: gains then stay where they are."""
        finite = np.isfinite(self.lower) | np.isfinite(self.upper)
        return bool(np.any(finite) or not np.all(self.free))

    def from_start(self, theta: Array) -> tuple[float, Solution]:
        """(cost at the start, where the search ends)."""
        theta = np.clip(np.where(self.free, theta, self.values), self.lower, self.upper)
        chain = self.structure.chain
        wanted = self.options.initial
        moving = self.data.with_states(chain, theta)
        before = half_square(self.moving.residual(moving))
        if wanted is Initial.ZERO:
            return before, self._searched(self.rest, theta)
        found = self._searched(self.moving, moving)
        if wanted is Initial.AUTO and not self._states_matter(found):
            return before, self._searched(self.rest, found.p[: chain.n])
        return before, found

    def _searched(self, problem: ChainErrors, p: Array) -> Solution:
        n, states = self.structure.chain.n, problem.n_initial
        free = np.concatenate([self.free, np.ones(states, dtype=bool)])
        limit = np.full(states, np.inf)
        lower, upper = (
            np.concatenate([self.lower, -limit]),
            np.concatenate([self.upper, limit]),
        )
        huber = None
        if np.all(np.isinf(lower)) and np.all(np.isinf(upper)):
            p = descend(
                problem.chain,
                p,
                self.data,
                evaluations=min(EVALUATIONS, self.options.max_evaluations),
                held_entries=tuple(np.flatnonzero(~free).tolist()),
                tolerance=1e-7,
                problem=problem,
            ).p
        if self.options.robust:
            r = problem.residual(p)
            spread = float(np.median(np.abs(r - np.median(r))))
            huber = HUBER_WIDTH * max(1.4826 * spread, 1e-12 * float(np.max(np.abs(r))))
        return levenberg_marquardt(
            problem,
            p[: n + states],
            free=free,
            lower=lower,
            upper=upper,
            huber=huber,
            max_evaluations=self.options.max_evaluations,
            tolerance=1e-8,
        )

    def _states_matter(self, found: Solution) -> bool:
        """F-test of the initial states against those of rest, 99 %."""
        from scipy.stats import f

        k, n = self.moving.n_initial, self.structure.chain.n
        if k == 0 or self.options.robust:
            return k > 0
        r = self.rest.residual(found.p[:n])
        dof = len(r) - k - n
        if dof <= 0 or not np.isfinite(found.cost):
            return False
        # at the same θ: a search from rest would find less
        left = max(2.0 * found.cost, 1e-300)
        at_rest = 2.0 * half_square(r)
        if at_rest > 4.0 * left:
            return True
        at_rest = min(at_rest, 2.0 * self._searched(self.rest, found.p[:n]).cost)
        return bool((at_rest - left) / k / (left / dof) > f.ppf(STATE_LEVEL, k, dof))

    def outcome(
        self, best: Solution, reports: tuple[StartReport, ...], warnings: tuple[str, ...]
    ) -> Outcome:
        """Covariance, directions without information and what ended on a bound."""
        n = self.structure.chain.n
        states = len(best.p) - n
        counted = self.options.initial is not Initial.BACKCAST
        which = np.flatnonzero(np.concatenate([self.free, np.full(states, counted)]))
        problem = self.moving if states else self.rest
        worth = uncertainty(
            best.jacobian[:, which],
            best.residual,
            tuple(zip(problem.channels, problem.lengths, strict=True)),
            best.weights,
        )
        covariance = np.zeros((n, n))
        inside = which < n
        entries = which[inside]
        covariance[np.ix_(entries, entries)] = worth.covariance[np.ix_(inside, inside)]
        null = np.zeros((n, worth.null.shape[1]))
        null[entries] = worth.null[inside]
        size = np.linalg.norm(null, axis=0)
        null = null[:, size > 1e-3] / size[size > 1e-3]
        return Outcome(
            self.structure,
            tuple(self.table),
            best.p[:n],
            covariance,
            null,
            n_states=states if counted else 0,
            termination=best.termination,
            at_bound=tuple(self.table[k].name for k in best.at_bound if k < n),
            starts=reports,
            warnings=warnings,
        )
