"""How block-oriented models are fitted: the best proposal, searched on all data.

The user's constraints hold there, every gain is put in one place, and the covariance is found.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError, Termination
from sysid.fitting.marquardt import loss
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial, Parameter
from sysid.fitting.robust import huber_widths
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome, outcome_of, with_covariance
from sysid.methods.search import STATE_LEVEL
from sysid.structures.base import Structure
from sysid.structures.blocks import hammerstein_wiener_proposals, wiener_hammerstein_proposals
from sysid.structures.blocks.gains import normalised
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.trials import ChainData, Effort, Trial, outer_abscissae
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein

EVALUATIONS = 100
"""Limit of the descent on the normal equations before the last search."""

HOPELESS = 1e50
"""Cost of a model that is not stable, or nearly so."""

APPROACH, SETTLED = 1e-5, 1e-7
"""Relative gain of a step below which that descent ends: before gains are pinned, and after."""

PATIENCE = 4
"""Steps of less gain than that after which the last search ends: along a point of a static that
hardly matters they would go on for a hundred."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Choose what is open on held-out samples, then fit it to everything."""
    if isinstance(structure, WienerHammerstein):
        best, tried = wiener_hammerstein_proposals.proposals(structure, records)
    else:
        assert isinstance(structure, HammersteinWiener)
        best, tried = hammerstein_wiener_proposals.proposals(structure, records)
    starts = [(best.label, best.theta)]
    starts += [(name, theta) for name, theta in initial_guesses if len(theta) == best.chain.n]
    reports = tuple(StartReport("all", t.label, None, t.cost, t.evaluations) for t in tried)
    return _final_fit(best.structure, records, options, parameters, starts, reports)


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
    outcome = _final_fit(structure, records, options, parameters, starts, before.starts)
    return replace(outcome, warnings=before.warnings)


def _final_fit(
    structure: BlockStructure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    starts: Sequence[tuple[str, Array]],
    reports: tuple[StartReport, ...],
) -> FitOutcome:
    """The last search on all data from the given starts, every gain in one place.

    Args:
        structure: orders and statics settled.
        parameters: bounds and fixed values the user gave, by name.
        starts: named θ of ``structure``.
        reports: starts tried before.

    Raises:
        DataError: fewer equations than unknowns.
        ModelError: no start gives a finite cost.
    """
    given = {p.name: p for p in parameters}
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    final = _LastSearch(
        structure, ChainData.of(records), options, tuple(given.get(p.name, p) for p in bare)
    )
    equations = final.data.samples * structure.ny
    unknowns = int(final.free.sum())
    if equations <= unknowns:
        raise DataError(
            f"{records[0].name}: {equations} equations for {unknowns} parameters; record longer "
            "or take lower orders and simpler statics"
        )
    runs = [(name, *final.approached(theta)) for name, theta in starts]
    rough = min((trial for _, _, trial in runs), key=lambda trial: trial.cost)
    asked = final
    final, theta = final.pinned(rough.theta)
    best = final.from_start(theta)
    if best.termination is Termination.DIVERGED or not best.cost < HOPELESS:
        raise ModelError(f"{structure.name}: {Termination.DIVERGED.value}{asked.because}")
    notes = [
        StartReport("all", name, before, best.cost, trial.evaluations + best.evaluations)
        if trial is rough
        else StartReport("all", name, before, trial.cost, trial.evaluations)
        for name, before, trial in runs
    ]
    return final.outcome(best, (*reports, *notes))


@dataclass(frozen=True, eq=False)
class _LastSearch:
    """The search with what the user asked of it.

    Attributes:
        table: bounds and fixed values of θ.
    """

    structure: BlockStructure
    data: ChainData
    options: FitOptions
    table: tuple[Parameter, ...]

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which entries of θ move."""
        return np.array([p.fixed is None for p in self.table], dtype=bool)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest θ."""
        return np.array([p.lower for p in self.table]), np.array([p.upper for p in self.table])

    @property
    def _bounded(self) -> bool:
        return bool(np.isfinite(self.bounds).any())

    @property
    def because(self) -> str:
        """What the user may have done to leave no stable model."""
        named = [
            p.name
            for p in self.table
            if p.fixed is not None or np.isfinite([p.lower, p.upper]).any()
        ]
        if not named:
            return ""
        return f" No stable model was found with {', '.join(named)} as fixed or bounded."

    @cached_property
    def at_rest(self) -> ChainData:
        """The data with runs that begin at rest."""
        return replace(self.data, states=False)

    def approached(self, theta: Array) -> tuple[float, Trial]:
        """(cost at the start, where a quick descent from it ends)."""
        data = self.at_rest if self.options.initial is Initial.ZERO else self.data
        p = data.with_states(self.structure.chain, self._allowed(theta))
        trial = Trial(self.structure, p)
        before = loss(data.problem(trial.chain).residual(p))
        if self._bounded:
            end = self._searched(data, p)
            return before, replace(trial, p=end.p, cost=end.cost, evaluations=end.evaluations)
        return before, self._descended(trial, data, APPROACH)

    def pinned(self, theta: Array) -> tuple["_LastSearch", Array]:
        """The same model with its gains pinned: its cost does not change, its covariance exists.

        Where the user fixed or bounded something, gains stay where they are.
        """
        if self._bounded or not np.all(self.free):
            return self, theta
        chain, theta, pins = normalised(self.structure.chain, theta, self.data.pairs)
        pins = sorted({*pins, *outer_abscissae(chain)})
        table = tuple(
            replace(p, fixed=float(theta[k])) if k in pins else p for k, p in enumerate(self.table)
        )
        return replace(self, structure=self.structure.with_chain(chain), table=table), theta

    def from_start(self, theta: Array) -> Solution:
        """Where the search with all its care ends."""
        theta = self._allowed(theta)
        if self.options.initial is Initial.ZERO:
            return self._searched(self.at_rest, theta)
        solution = self._searched(self.data, self.data.with_states(self.structure.chain, theta))
        if self.options.initial is Initial.AUTO:
            return self._from_rest(solution) or solution
        return solution

    def _allowed(self, theta: Array) -> Array:
        """θ with fixed values and within the bounds."""
        fixed = [t if p.fixed is None else p.fixed for t, p in zip(theta, self.table, strict=True)]
        return np.asarray(np.clip(fixed, *self.bounds))

    def _descended(self, trial: Trial, data: ChainData, tolerance: float) -> Trial:
        effort = Effort(min(EVALUATIONS, self.options.limit()), tolerance)
        return trial.descended(data, effort, np.flatnonzero(~self.free).tolist())

    def _searched(self, data: ChainData, p: Array) -> Solution:
        if not self._bounded:
            p = self._descended(Trial(self.structure, p), data, SETTLED).p
        problem = data.problem(self.structure.chain)
        states = np.full(problem.n_initial, np.inf)
        lower, upper = self.bounds
        return levenberg_marquardt(
            problem,
            p,
            Descent(
                free=np.concatenate([self.free, np.ones(len(states), dtype=bool)]),
                lower=np.concatenate([lower, -states]),
                upper=np.concatenate([upper, states]),
                huber=huber_widths(problem, problem.residual(p)) if self.options.robust else None,
                max_evaluations=self.options.limit(),
                tolerance=self.options.precision(SETTLED),
                patience=PATIENCE,
            ),
        )

    def _from_rest(self, solution: Solution) -> Solution | None:
        """The search from rest, unless the F-test of the initial states says they matter (99 %)."""
        from scipy.stats import f

        n = self.structure.chain.n
        k = len(solution.p) - n
        if k == 0 or self.options.robust:
            return None
        r = self.at_rest.problem(self.structure.chain).residual(solution.p[:n])
        dof = len(r) - k - n
        if dof <= 0 or not np.isfinite(solution.cost):
            return self._searched(self.at_rest, solution.p[:n])
        # at the same θ: a search from rest would find less
        limit = max(2.0 * solution.cost, 1e-300)
        if 2.0 * loss(r) > 4.0 * limit:
            return None
        rest = self._searched(self.at_rest, solution.p[:n])
        ratio = (2.0 * rest.cost - limit) / k / (limit / dof)
        return None if ratio > f.ppf(STATE_LEVEL, k, dof) else rest

    def outcome(self, best: Solution, reports: tuple[StartReport, ...]) -> FitOutcome:
        """What the search found, initial states counted where they were estimated."""
        n = self.structure.chain.n
        states = len(best.p) - n
        counted = self.options.initial is not Initial.BACKCAST
        which = np.flatnonzero(np.concatenate([self.free, np.full(states, counted)]))
        data = self.data if states else self.at_rest
        part = with_covariance(data.problem(self.structure.chain), best, which)
        return outcome_of(self.structure, self.table, best.p[:n], [part], reports)


METHOD = Method(fit, refit, takes_method=False)
