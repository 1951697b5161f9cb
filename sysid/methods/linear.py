"""Linear structures: least squares in one step where the problem is linear, else a search."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import Termination, UsageError
from sysid.fitting.marquardt import Method as SolverMethod
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Parameter
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.methods.search import by_search
from sysid.structures.base import Structure
from sysid.structures.linear.families import ARX
from sysid.structures.linear.instrumental import iv4
from sysid.structures.linear.least_squares import solve
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.searchable import LinearSearch


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Least squares in one step for ARX without constraints or another loss; else a search."""
    assert isinstance(structure, PolynomialStructure)
    if options.method is SolverMethod.IV4:
        assert isinstance(structure, ARX)
        if not is_linear(options, parameters):
            raise UsageError(
                "`method='iv4'` knows no bounds, no `fixed`, no `robust`, no `stable` and no "
                "`focus`: omit them, or omit `method`"
            )
        return solved_outcome(structure, parameters, iv4(structure, records), "iv4")
    weighted = any(r.weights is not None for r in records)
    if weighted or not (isinstance(structure, ARX) and is_linear(options, parameters)):
        search = LinearSearch(structure)
        return by_search(structure, records, options, parameters, initial_guesses, search)
    return solved_outcome(structure, parameters, solve(structure, records), "least squares")


def solved_outcome(
    structure: ARX,
    parameters: tuple[Parameter, ...],
    solved: tuple[Array, Array, Array],
    how: str,
) -> FitOutcome:
    """The outcome of a fit that was solved directly.

    Args:
        solved: θ, its covariance and the directions without information.
        how: what was solved, for the report of starts.
    """
    theta, covariance, null = solved
    return FitOutcome(
        structure,
        parameters,
        theta,
        covariance,
        null,
        termination=Termination.CLOSED_FORM,
        starts=(StartReport("all", how, None, None, 1),),
    )


def is_linear(options: FitOptions, parameters: Sequence[Parameter]) -> bool:
    """Whether the fit is one unconstrained linear least-squares problem."""
    free = all(p.fixed is None and not np.isfinite([p.lower, p.upper]).any() for p in parameters)
    prediction = options.focus is Focus.PREDICTION
    return prediction and free and not options.robust and not options.stable


METHOD = Method(fit)
