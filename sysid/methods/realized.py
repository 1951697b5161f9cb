"""Fits of linear structures that are run by their state-space matrices."""

from collections.abc import Sequence

from sysid.data.record import Record
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import InitialGuesses
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.methods.search import by_search
from sysid.structures.base import Structure
from sysid.structures.state_space.structure import RealizedStructure


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """The search over all numbers together, of the structure as these records are to be fitted."""
    assert isinstance(structure, RealizedStructure)
    as_fitted = structure.for_fit(records, options.focus)
    if as_fitted != structure:
        names = [p.name for p in as_fitted.parameters(records[0].inputs, records[0].outputs)]
        kept = [k for k, p in enumerate(parameters) if p.name in names]
        parameters = tuple(parameters[k] for k in kept)
        initial_guesses = [(n, theta[kept]) for n, theta in initial_guesses]
    found = by_search(as_fitted, records, options, parameters, initial_guesses)
    return found.permuted(as_fitted.in_order(found.theta, parameters))


METHOD = Method(fit)
