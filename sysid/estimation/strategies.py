"""How each structure is fitted: the general search, or a road of its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import Termination
from sysid.estimation import closed_form
from sysid.estimation.outliers import Outliers
from sysid.estimation.search import FitOptions, Search, assembled
from sysid.estimation.uncertainty import with_confounded
from sysid.structures.base import Parameter, Structure
from sysid.structures.model import StartReport


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a strategy found.

    Attributes:
        structure: what was fitted; with what was read off the data, where a structure does that.
        parameters: names, bounds and fixed values of θ.
        theta: estimates, (n,).
        covariance: their covariance, (n, n), infinite where the data say nothing.
        null: directions without information, (n, n_null).
        n_states: initial states that were estimated.
        termination: how it ended.
        at_bound: names of the parameters that ended on a bound.
        starts: every start tried.
        warnings: what the user should know.
        outliers: what was left out of each record, empty where nothing was looked for.
    """

    structure: Structure
    parameters: tuple[Parameter, ...]
    theta: Array
    covariance: Array
    null: Array
    n_states: int = 0
    termination: Termination = Termination.CONVERGED_COST
    at_bound: tuple[str, ...] = ()
    starts: tuple[StartReport, ...] = ()
    warnings: tuple[str, ...] = ()
    outliers: tuple[Outliers, ...] = ()


Warm = Sequence[tuple[str, Array]]
Strategy = Callable[[Structure, Sequence[Record], FitOptions, tuple[Parameter, ...], Warm], Outcome]

_OWN: dict[str, str] = {
    "augmented": "sysid.estimation.augmented:fit",
    "hammerstein-wiener": "sysid.estimation.hammerstein_wiener:fit",
    "wiener-hammerstein": "sysid.estimation.wiener_hammerstein:fit",
    "narmax": "sysid.estimation.narmax:fit_narmax",
    "narx-wavelet": "sysid.estimation.narx:fit_narx",
}
"""Structure → ``module:function`` of its own strategy, imported when it is first needed."""

GREY = "sysid.estimation.grey_box:by_multi_start"
"""How every grey box is fitted, those of other packages too."""


def strategy(structure: Structure) -> Strategy:
    """The way to fit this structure."""
    own = _OWN.get(structure.name, GREY if _grey(structure) else None)
    if own is None:
        return by_search
    module, _, name = own.partition(":")
    found: Strategy = getattr(import_module(module), name)
    return found


_AGAIN: dict[str, str] = {
    "hammerstein-wiener": "sysid.estimation.block_outcome:again",
    "wiener-hammerstein": "sysid.estimation.block_outcome:again",
}
"""Structure → how it is fitted to nearly the same data from where a fit ended."""


_LEAST_SQUARES_ONLY = frozenset({"narx-wavelet"})
"""Structures whose fits know no other loss: linear algebra over thousands of units."""


def has_losses(structure: Structure) -> bool:
    """Whether Huber's loss and the quadratic one lead to different fits of this structure."""
    return structure.name not in _LEAST_SQUARES_ONLY


def again(
    strategy: Strategy,
    before: Outcome,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
) -> Outcome:
    """Fit what a fit found to nearly the same data: nothing is chosen anew where that is costly."""
    own = _AGAIN.get(before.structure.name)
    if own is None:
        start = [("the fit before", before.theta)]
        return strategy(before.structure, records, options, parameters, start)
    module, _, name = own.partition(":")
    found: Outcome = getattr(import_module(module), name)(before, records, options, parameters)
    return found


def _grey(structure: Structure) -> bool:
    if structure.linear:  # most fits are, and need not wait for the import
        return False
    from sysid.structures.grey_box import GreyBox

    return isinstance(structure, GreyBox)


def by_search(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> Outcome:
    """Linear algebra where the problem is linear, else a search from every known start."""
    plain = not options.robust and all(r.weights is None for r in records)
    if plain and closed_form.applies(structure, options.focus, parameters, options.stable):
        theta, covariance, null, warnings = closed_form.solve(structure, records)
        return Outcome(
            structure,
            parameters,
            theta,
            covariance,
            null,
            termination=Termination.CLOSED_FORM,
            starts=(StartReport("all", "least squares", None, None, 1),),
            warnings=warnings,
        )
    theta, parts, starts = Search(structure, records, options, parameters).run(warm)
    covariance, null = assembled(parts, len(theta))
    covariance, null = with_confounded(structure, records, covariance, null)
    stuck = tuple(
        parameters[p.problem.index[k]].name
        for p in parts
        for k in p.solution.at_bound
        if k < len(p.problem.index)
    )
    return Outcome(
        structure,
        parameters,
        theta,
        covariance,
        null,
        n_states=sum(int(np.sum(p.free >= len(p.problem.index))) for p in parts),
        termination=_worst([p.solution.termination for p in parts]),
        at_bound=stuck,
        starts=starts,
    )


def _worst(endings: Sequence[Termination]) -> Termination:
    order = list(Termination)
    return max(endings, key=order.index)
