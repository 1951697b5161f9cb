"""Fit of an augmented structure from its own values, by its free run."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import ModelError
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.fitting.searchable import FreeRunSearch, InitialGuesses
from sysid.fitting.uncertainty import with_infinite
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.methods.search import by_search
from sysid.structures.augmented.runs import ChainRuns
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure

EVALUATIONS = 40
"""Usual limit: the search starts where another one ended."""

TOLERANCE = 1e-6
"""Usual tolerance: slopes by differences of runs that jump at edges allow no less."""

UNKNOWN = 3.0
"""A combination of parameters with a standard error beyond so many times its size (what its bounds
allow, else its value) is not determined: such errors say how flat the slopes are, and no more."""

TAKES_PART = 0.1
"""Least weight of a parameter in such a combination."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """The general search from given values.

    Raises:
        ModelError: there are none; finding effects and their first values is a diagnosis.
    """
    if not initial_guesses:
        raise ModelError(
            "an augmented model is fitted again from its own values only; make one of a log with "
            "sysid diagnose"
        )
    limited = replace(
        options,
        max_evaluations=options.limit(EVALUATIONS),
        tolerance=options.precision(TOLERANCE),
    )
    assert isinstance(structure, Augmented)
    # the diagnosis finds effects and their first values in its full model; from there on the
    # structure is fitted like any other
    search = FreeRunSearch(lambda data, _: ChainRuns(structure, data))
    outcome = by_search(structure, records, limited, parameters, initial_guesses, search)
    more = _undetermined(outcome)
    if not more.size:
        return outcome
    return replace(
        outcome,
        covariance=with_infinite(outcome.covariance, more),
        null=np.column_stack([outcome.null, more]),
        determined=None,
    )


def _undetermined(outcome: FitOutcome) -> Array:
    """Combinations of parameters known worse than ``UNKNOWN`` times their sizes, (n, k)."""
    room = np.array([p.upper - p.lower for p in outcome.parameters])
    size = np.where(np.isfinite(room), room, np.abs(outcome.theta))
    variance = np.diag(outcome.covariance)
    at = np.flatnonzero(np.isfinite(variance) & (variance > 0.0) & (size > 0.0))
    scale = size[at]
    values, vectors = np.linalg.eigh(outcome.covariance[np.ix_(at, at)] / np.outer(scale, scale))
    open_ = values > UNKNOWN**2
    directions = np.zeros((len(outcome.theta), int(np.sum(open_))))
    directions[at] = np.where(np.abs(vectors[:, open_]) > TAKES_PART, vectors[:, open_], 0.0)
    return directions


METHOD = Method(fit, begins_at_values=True)
