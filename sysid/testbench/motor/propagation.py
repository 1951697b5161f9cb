"""Error propagation for constants from one experiment at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest
from sysid.testbench.motor.separate import routes, values_of

_STEP = 1e-5
"""Relative change of a measurement for a central difference."""


def propagated(
    tests: Sequence[SteadyTest],
    known: Mapping[str, KnownValue],
    gear: float,
    sigma: Mapping[tuple[str, str], float],
    tied: bool,
) -> tuple[tuple[float, ...], Array, tuple[str, ...]]:
    """Standard errors of every route, and the covariance of the first value of each constant.

    First-order propagation, cov = Σ σ² g gᵀ with g the slope of all values over one measurement:
    the same measurements and the same R enter several constants, whose errors are thereby
    correlated.

    Args:
        known: values that are known, with their standard errors.
        gear: turns of the motor for one of the output shaft.
        sigma: noise level by (file, quantity), in SI.
        tied: whether Kc is Kem.

    Returns:
        Standard errors of the routes; covariance (n, n); names of the n constants.
    """
    here = routes(tests, known, gear)
    names = tuple(n for n in CONSTANTS if n in values_of(here))
    spread = np.zeros(len(here))
    covariance = np.zeros((len(names), len(names)))

    def add(step: float, error: float, high: Slope, low: Slope) -> None:
        nonlocal spread, covariance
        slope = (high[0] - low[0]) / (2.0 * step) * error
        change = (high[1] - low[1]) / (2.0 * step) * error
        spread = spread + slope**2
        covariance = covariance + np.outer(change, change)

    def at(some: Sequence[SteadyTest], values: Mapping[str, KnownValue]) -> Slope:
        perturbed = routes(some, values, gear)
        first = values_of(perturbed)
        return np.array([r.value for r in perturbed]), np.array([first[n] for n in names])

    for name, value in known.items():
        h = _STEP * value.value
        ends = [
            at(tests, {**known, name: replace(value, value=value.value + s * h)}) for s in (1, -1)
        ]
        add(h, value.std_error, ends[0], ends[1])
    for k, test in enumerate(tests):
        for quantity in ("current", "speed", "torque"):
            error = sigma.get((test.name, quantity), 0.0)
            applied = quantity == "torque" and test.kind is Kind.EXTERNAL
            if applied or not error or not test.has(quantity):
                continue
            measurements = test.of(quantity)
            for row in np.flatnonzero(np.isfinite(measurements) & (measurements != 0.0)):
                h = _STEP * abs(float(measurements[row]))
                ends = []
                for s in (1.0, -1.0):
                    moved = measurements.copy()
                    moved[row] += s * h
                    others = [*tests[:k], test.changed(quantity, moved), *tests[k + 1 :]]
                    ends.append(at(others, known))
                add(h, error, ends[0], ends[1])
    return tuple(np.sqrt(spread).tolist()), covariance, names


Slope = tuple[Array, Array]
