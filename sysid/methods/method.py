"""Method: how the structures of a family are fitted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sysid.data.record import Record
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import InitialGuesses
from sysid.methods.outcome import FitOutcome
from sysid.structures.base import Structure

Fitter = Callable[
    [Structure, Sequence[Record], FitOptions, tuple[Parameter, ...], InitialGuesses], FitOutcome
]
"""(structure, records without offsets, options, parameters, further starts) → what was found."""

Refitter = Callable[[FitOutcome, Sequence[Record], FitOptions, tuple[Parameter, ...]], FitOutcome]
"""(a fit, nearly the same records, options, parameters) → the same fitted to them."""


@dataclass(frozen=True)
class Method:
    """How the structures of a family are fitted.

    Attributes:
        fit: a fit from nothing but records.
        refit: how a fit is repeated on nearly the same data; None where that is a fit like any.
        has_losses: whether it knows Huber's loss, not the quadratic one alone.
        takes_method: whether ``FitOptions.method`` says how it is searched.
        begins_at_values: whether it begins at values it is given, and at no others.
    """

    fit: Fitter
    refit: Refitter | None = None
    has_losses: bool = True
    takes_method: bool = True
    begins_at_values: bool = False
