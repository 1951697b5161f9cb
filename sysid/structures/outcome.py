"""FitOutcome: the result of a fit, and the signature of fit functions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sysid.data.record import Array, Record
from sysid.errors import Termination
from sysid.fitting.options import FitOptions
from sysid.fitting.outliers import Outliers
from sysid.fitting.problem import Parameter
from sysid.structures.base import Structure


@dataclass(frozen=True)
class StartReport:
    """One starting value of the search and what became of it.

    ``cost_at_start`` is None where the cost is not finite or nothing was searched, ``cost`` where
    the search was not run from this start.
    """

    output: str
    start: str
    cost_at_start: float | None
    cost: float | None
    evaluations: int


@dataclass(frozen=True, eq=False)
class FitOutcome:
    """What a fit found.

    Attributes:
        structure: what was fitted; with what was read off the data, where a structure does that.
        parameters: names, bounds and fixed values of θ.
        theta: estimates, (n,).
        covariance: their covariance, (n, n), infinite where the data say nothing.
        null: directions without information, (n, n_null).
        n_states: initial states that were estimated.
        at_bound: names of the parameters that ended on a bound.
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


InitialGuesses = Sequence[tuple[str, Array]]
"""Further starts, each with a name."""

Fitter = Callable[
    [Structure, Sequence[Record], FitOptions, tuple[Parameter, ...], InitialGuesses], FitOutcome
]
"""(structure, records without offsets, options, parameters, further starts) → what was found."""

Refitter = Callable[[FitOutcome, Sequence[Record], FitOptions, tuple[Parameter, ...]], FitOutcome]
"""(a fit, nearly the same records, options, parameters) → the same fitted to them."""
