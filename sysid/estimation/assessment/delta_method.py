"""Standard errors of functions of the parameters: var g(θ̂) ≈ ∇gᵀ P ∇g."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from sysid.data.record import Array
from sysid.data.schema import Null
from sysid.fitting.uncertainty import Determined
from sysid.structures.model import Model

MANY = 60
"""Parameters from which the delta method takes random directions instead of every one."""

DIRECTIONS = 48
"""Random directions then: the standard error is known within a tenth."""

DELTA = 0.01
"""Step of the differences, in standard errors: small against every curvature that matters."""


NORMAL = 1.96
"""Standard errors on either side of a value that hold 95 % of a normal distribution."""

Number = Annotated[float, Null()]
"""A number that may not be defined, which documents write as null."""

StandardError = Annotated[float, Null(np.inf)]
"""Infinite where the data say nothing, which documents write as null."""


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error; infinite where the data say nothing about it."""

    value: Number
    std_error: StandardError

    @property
    def reach(self) -> float:
        """Half the width of the 95 % interval around the value."""
        return NORMAL * float(self.std_error)

    @property
    def clear(self) -> bool:
        """Whether the 95 % interval excludes zero; a value without an error is."""
        return abs(float(self.value)) > self.reach or not self.std_error > 0.0


def estimates(model: Model, numbers: Callable[[Array], Array]) -> Iterator[Estimate]:
    """Numbers that follow from θ, with their standard errors.

    Args:
        numbers: θ → (m,).
    """
    centre = numbers(model.theta)
    errors = delta_errors(model, numbers, centre)
    return (Estimate(float(v), float(e)) for v, e in zip(centre, errors, strict=True))


def delta_errors(model: Model, numbers: Callable[[Array], Array], centre: Array) -> Array:
    """Standard errors of numbers that follow from θ, by differences along the axes of P.

    Args:
        numbers: θ → (m,).
        centre: the numbers at θ, (m,).

    Returns:
        (m,); infinite where a direction that the data say nothing about changes the number, NaN
        where the number itself is not defined.
    """
    root = delta_root(model, numbers, centre)
    with np.errstate(invalid="ignore"):
        variance = np.sum(root**2, axis=1)
    return np.where(np.isfinite(centre), np.sqrt(variance), np.nan)


def delta_root(model: Model, numbers: Callable[[Array], Array], centre: Array) -> Array:
    """A root R of the covariance R Rᵀ of numbers that follow from θ, (m, k).

    Args:
        numbers: θ → (m,).
        centre: the numbers at θ, (m,).

    Returns:
        Infinite in the rows of numbers that a direction without information changes.
    """
    known = _determined(model)
    columns = [np.zeros(len(centre))]
    for axis, weight in _axes(known.covariance):
        slope = _slope(numbers, model.theta, axis)
        columns.append(np.sqrt(weight) * np.nan_to_num(slope, nan=0.0))
    size = np.abs(model.theta)
    size[size == 0.0] = max(float(size.max(initial=0.0)), 1e-12)
    for step in known.open.T:
        # slopes of a run are known to eight digits or so, and so is the direction
        moved = np.abs(_slope(numbers, model.theta, 1e-3 * step / np.max(np.abs(step) / size)))
        columns.append(np.where(moved > 1e-6 * np.abs(centre), np.inf, 0.0))
    return np.column_stack(columns)


def _determined(model: Model) -> Determined:
    """What is known of functions of θ; of a fit that does not say it, what single entries allow."""
    if model.determined is not None:
        return model.determined
    covariance = np.asarray(model.covariance, dtype=np.float64)
    names = [p.name for p in model.parameters]
    steps = [np.array([d.get(n, 0.0) for n in names]) for d in model.null_directions]
    steps = [s for s in steps if np.any(s)]
    return Determined(
        np.where(np.isfinite(covariance), covariance, 0.0),
        np.array(steps).T if steps else np.zeros((len(names), 0)),
    )


def _axes(covariance: Array) -> list[tuple[Array, float]]:
    """Directions of one standard error, with weights: all of them, or random ones where many."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    if len(values) <= MANY:
        return [(c, 1.0) for c in root.T if np.any(c)]
    draws = np.random.default_rng(0).standard_normal((len(values), DIRECTIONS))
    return [(c, 1.0 / DIRECTIONS) for c in (root @ draws).T]


def _slope(numbers: Callable[[Array], Array], theta: Array, axis: Array) -> Array:
    return (numbers(theta + DELTA * axis) - numbers(theta - DELTA * axis)) / (2.0 * DELTA)
