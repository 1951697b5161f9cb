"""Directions of θ that a fit estimated, which residual tests project out.

A parameter that was fixed, or that a bound stopped, absorbed nothing of the residuals; projecting
its gradient out would hide a wrong value. Directions without information need no care: their
columns of the gradient are zero within the tolerance of the projector.
"""

from collections.abc import Sequence

import numpy as np

from sysid.criteria.fit import Array
from sysid.criteria.fixed_parameters import FixedParameter, fixed_parameter_tests
from sysid.criteria.verdicts import ResidualTest
from sysid.data.record import Index, Record
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.constant_input import widened_theta, with_ones
from sysid.structures.model import Model


def fixed_entries(model: Model) -> Index:
    """Entries of θ that were fixed or ended on a bound."""
    stuck = set(model.at_bound)
    return np.array(
        [k for k, p in enumerate(model.parameters) if p.fixed is not None or p.name in stuck],
        dtype=int,
    )


def estimated_columns(model: Model, columns: Array) -> Array:
    """The columns of one output's gradient that belong to estimated parameters, (N, k)."""
    return np.delete(columns, fixed_entries(model), axis=1)


def uncertain_columns(model: Model, columns: Array) -> Array:
    """G√P: what the parameters' uncertainty puts into predictions of data not fitted to, (N, k).

    Entries without information (infinite variance) count as known: they are part of the model, and
    data that contradict them contradict the model.
    """
    variance = np.diag(model.covariance)
    sure = np.isfinite(variance) & (variance > 0.0)
    sure[fixed_entries(model)] = False
    entries = np.flatnonzero(sure)
    spread = np.sqrt(variance[sure])
    correlation = model.covariance[np.ix_(entries, entries)] / np.outer(spread, spread)
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray((columns[:, sure] * spread) @ root)


def offset_column(model: Model, record: Record, output: int, fitted: bool) -> Array:
    """∂ŷ/∂c of an estimated offset, (N, 1), or no column.

    On data not fitted to it is scaled by the offset's standard error; that the offset's error goes
    with those of other parameters is left out.

    Args:
        record: without its offsets: about them the constant is zero.
        fitted: whether the model was fitted to these data.
    """
    s = model.structure
    # an offset is the coefficient of a constant input, which linear structures have
    if not model.operating_point.estimated or not isinstance(s, LinearStructure):
        return np.zeros((len(record), 0))
    wide = s.with_constant(tuple(k == output for k in range(s.ny)))
    r, theta = with_ones(record), widened_theta(wide, model.theta)
    columns = wide.gradients(theta, r.u, r.y)[output]
    place = int(wide.constant_places()[0][0])
    scale = 1.0
    if not fitted:
        error = model.operating_point.y_error[output] if model.operating_point.y_error else 0.0
        scale = float(s.steady(model.theta)[0][output, output]) * error
    return np.asarray(columns[:, [place]] * (scale if np.isfinite(scale) else 1.0))


def fixed_parameter_tests_of(
    model: Model, errors: Sequence[Array], jacobians: Sequence[Sequence[Array]], level: float
) -> tuple[ResidualTest, ...]:
    """Whether the data agree with what the user fixed and with what a bound stopped.

    What a structure holds by itself (a mechanism it left out) is a choice of structure, which the
    other tests judge.

    Args:
        errors: its residuals on the estimation data, (N, ny) each record.
        jacobians: all its gradient columns, by output and record.
    """
    entries = fixed_entries(model)
    defaults = model.structure.parameters(model.inputs, model.outputs)
    estimated = np.array([k for k in entries if defaults[k].fixed is None], dtype=int)
    if not len(estimated):
        return ()
    fixed = [
        FixedParameter(p.name, float(model.theta[k]), p.lower, p.upper, p.fixed is None)
        for k, p in enumerate(model.parameters)
        if k in estimated
    ]
    whole = [np.stack(of_outputs, axis=1) for of_outputs in zip(*jacobians, strict=True)]
    kept = np.setdiff1d(np.arange(len(model.theta)), entries)
    return fixed_parameter_tests(
        errors,
        [w[:, :, kept] for w in whole],
        [w[:, :, estimated] for w in whole],
        fixed,
        noise_model=model.structure.traits.has_noise_model,
        level=level,
    )
