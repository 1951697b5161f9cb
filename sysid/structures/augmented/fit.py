"""Fitting a structure that a diagnosis made: from its own values, by its free run."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.record import Record
from sysid.errors import ModelError
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.structures.base import Structure
from sysid.structures.outcome import FitOutcome, Warm
from sysid.structures.search import by_search

EVALUATIONS = 40
"""Usual limit: the search starts where another one ended."""

TOLERANCE = 1e-6
"""Usual tolerance: slopes by differences of runs that jump at edges tell no more."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> FitOutcome:
    """The general search from given values.

    Raises:
        ModelError: there are none; finding effects and their first values is a diagnosis.
    """
    if not warm:
        raise ModelError(
            "an augmented model is fitted again from its own values only; make one of a log with "
            "sysid diagnose"
        )
    own = replace(
        options,
        max_evaluations=options.limit(EVALUATIONS),
        tolerance=options.precision(TOLERANCE),
    )
    return by_search(structure, records, own, parameters, warm)
