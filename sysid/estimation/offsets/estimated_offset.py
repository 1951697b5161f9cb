"""Fits of linear structures with an offset, estimated as the coefficient of a constant input."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.operating_point import OperatingPoint, Origin
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Index, Record
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.robust_fit import fitter
from sysid.fitting.differences import propagated
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Initial, Parameter
from sysid.methods.method import Fitter
from sysid.methods.outcome import FitOutcome
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.constant_input import (
    widened,
    widened_theta,
    with_ones,
)

BEYOND = 10.0
"""An offset so many ranges of the output away from the data is none: the output integrates."""

STEP = 1e-6
"""Relative step of the differences that carry the covariance over: the offset is smooth in θ."""


@dataclass(frozen=True, eq=False)
class FitWithOffset:
    """A fit whose constant has become part of what is removed.

    Attributes:
        outcome: of the structure without the constant.
        at_fit: the same model's, with inputs counted from where the fit began: initial states that
            were taken as zero are zero there.
        operating_point: with standard errors.
    """

    outcome: FitOutcome
    detrend: Detrend
    at_fit: Detrend
    operating_point: OperatingPoint


def fit_with_offset(
    structure: LinearStructure,
    facts: LogFacts,
    offsets: Offsets,
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: Sequence[tuple[str, Array]],
    solver: Fitter | None = None,
) -> FitWithOffset | None:
    """Fit a linear structure with the constant as a further input.

    Args:
        offsets: what is removed first, and whose offset is estimated.
        parameters: of ``structure``, with bounds and fixed values.
        solver: what estimates, None for the structure's own way.

    Returns:
        The fit, or None where the data cannot distinguish the constant from the effect of the
    inputs.
    """
    records = facts.records
    wide = structure.with_constant(offsets.estimated)
    known = offsets.at_rest and len(records) == 1 and not structure.traits.has_noise_model
    if known and options.initial is Initial.AUTO:
        # zero about the rest; estimated, they would be hard to distinguish from an offset. What a
        # noise model remembers of the time before the record is not known.
        options = replace(options, initial=Initial.ZERO)
    plain = [with_ones(offsets.detrend.remove(r)) for r in records]
    outcome = (solver or fitter(wide, options))(
        wide,
        plain,
        options,
        widened(wide, parameters, records[0].outputs),
        [(name, widened_theta(wide, theta)) for name, theta in initial_guesses],
    )
    assert isinstance(outcome.structure, LinearStructure)
    wide = outcome.structure
    places, _ = wide.constant_places()
    if not np.all(np.isfinite(np.diag(outcome.covariance)[places])) or not _rests(wide, outcome):
        return None
    return narrowed(wide, outcome, facts, offsets)


def _rests(wide: LinearStructure, outcome: FitOutcome) -> bool:
    """Whether the fit has a steady state: what integrates rests nowhere."""
    shift, *_ = _SteadyState(wide, outcome, np.ones(wide.ny)).moved(np.zeros(wide.nu - 1))
    return all(bool(np.all(np.isfinite(part))) for part in shift)


def narrowed(
    wide: LinearStructure, outcome: FitOutcome, facts: LogFacts, offsets: Offsets
) -> FitWithOffset:
    """A fit with the constant as an offset of the structure without it.

    Args:
        wide: the structure with the constant as its last input.
        offsets: what was removed before.
    """
    places, _ = wide.constant_places()
    before = offsets.detrend
    records, seen = facts.records, facts.outliers.records
    u, y = (np.concatenate([getattr(r, side) for r in seen]) for side in ("u", "y"))
    ranges = np.ptp(y, axis=0)
    steady = _SteadyState(wide, outcome, ranges)
    base = np.asarray(before.u_offset)
    # an input that reaches its zero is spoken of at zero, a resting one where it rests
    reaches = (u.min(axis=0) <= 0.0) & (u.max(axis=0) >= 0.0)
    target = base if offsets.at_rest else np.where(reaches, 0.0, base)
    shift, u_error, y_error = steady.moved(target - base)
    at_base = steady.moved(np.zeros(len(base)))[0]
    y_error = np.maximum(y_error, _least_error(wide, outcome, records, before))
    return FitWithOffset(
        without_offset(wide, outcome),
        _moved(before, shift),
        _moved(before, at_base),
        OperatingPoint(
            Origin.ESTIMATED,
            tuple(u_error.tolist()),
            tuple(y_error.tolist()),
            len(places),
            offsets.why,
        ),
    )


def without_offset(wide: LinearStructure, outcome: FitOutcome) -> FitOutcome:
    """What a fit says of the structure without its constant."""
    kept = np.setdiff1d(np.arange(len(outcome.theta)), wide.constant_places()[0])
    null = outcome.null[kept]
    return replace(
        outcome,
        structure=wide.without_constant(),
        parameters=tuple(outcome.parameters[k] for k in kept),
        theta=outcome.theta[kept],
        covariance=outcome.covariance[np.ix_(kept, kept)],
        null=null[:, np.linalg.norm(null, axis=0) > 0.0] if null.size else null,
        determined=None,
    )


def _least_error(
    wide: LinearStructure, outcome: FitOutcome, records: Sequence[Record], before: Detrend
) -> Array:
    """σ_e/√N of each output that has an offset: less no noise that is not differenced leaves.

    A noise model whose zero has come to lie at frequency zero, as it often does where a mean is
    estimated with it, says that the offset is known exactly (pile-up; Davis & Dunsmuir 1996).
    """
    errors = []
    for r, outliers in zip(records, outcome.outliers or (None,) * len(records), strict=True):
        plain = with_ones(before.remove(r))
        if outliers is not None:  # what was left out of the fit says nothing about its offset
            plain = outliers.marked(plain)
        e = wide.errors(outcome.theta, plain.u, plain.y, len(plain))
        errors.append(np.where(plain.left_out, np.nan, e))
    e = np.concatenate(errors)
    e = e[np.all(np.isfinite(e), axis=1)]
    least = np.sqrt(np.mean(e**2, axis=0) / max(len(e), 1)) if len(e) else np.zeros(wide.ny)
    return np.where(np.isin(np.arange(wide.ny), wide.constant_places()[1]), least, 0.0)


def _moved(before: Detrend, shift: tuple[Array, Array]) -> Detrend:
    return replace(before, u_offset=before.u_offset + shift[0], y_offset=before.y_offset + shift[1])


@dataclass(frozen=True, eq=False)
class _SteadyState:
    """The steady state of a fit with its constant: A(1) Δy = B(1) Δu + c with B(1) that of B/F.

    Attributes:
        wide: the structure with the constant as its last input.
        ranges: of the outputs in the data, (ny,).
    """

    wide: LinearStructure
    outcome: FitOutcome
    ranges: Array

    @cached_property
    def drifting(self) -> Index:
        """Outputs that integrate: their offset would lie far outside the data, or is as uncertain.

        They have none; for them Δu is chosen such that nothing drifts.
        """
        try:
            return self._far(*self._with_error(self._nothing, np.zeros(0, dtype=np.intp)))
        except np.linalg.LinAlgError:
            return np.arange(self.wide.ny)

    def moved(self, du: Array) -> tuple[tuple[Array, Array], Array, Array]:
        """The moves of u and y where inputs are to move by du, and their standard errors."""
        values, errors = self._with_error(du, self.drifting)
        if len(self._far(values, errors)) and np.any(du):
            # the model cannot be followed that far: its offset is said where the fit was made
            values, errors = self._with_error(self._nothing, self.drifting)
        nu = len(du)
        return (values[:nu], values[nu:]), errors[:nu], errors[nu:]

    @property
    def _nothing(self) -> Array:
        return np.zeros(self.wide.nu - 1)

    def _operating_point(self, theta: Array, du: Array, drifting: Index) -> Array:
        """Δu and Δy, one after the other."""
        A, whole = self.wide.steady(theta)
        B, c = whole[:, :-1], whole[:, -1]
        if len(drifting):
            du = du - np.linalg.pinv(B[drifting]) @ (B[drifting] @ du + c[drifting])
        right = np.where(du == 0.0, 0.0, B * du).sum(axis=1) + c
        dy = np.zeros(len(c))
        rest = np.setdiff1d(np.arange(len(c)), drifting)
        if len(rest):
            dy[rest] = np.linalg.solve(A[np.ix_(rest, rest)], right[rest])
        return np.concatenate([du, dy])

    def _with_error(self, du: Array, drifting: Index) -> tuple[Array, Array]:
        """Δu and Δy, and their standard errors, (nu + ny,) each."""
        theta = self.outcome.theta
        known = np.isfinite(np.diag(self.outcome.covariance))
        covariance = np.where(np.outer(known, known), self.outcome.covariance, 0.0)
        steps = np.where(known, STEP * np.maximum(np.abs(theta), 1e-3), 0.0)

        def of(theta: Array) -> Array:
            return self._operating_point(theta, du, drifting)

        with np.errstate(all="ignore"):
            return of(theta), propagated(of, theta, covariance, steps)

    def _far(self, values: Array, errors: Array) -> Index:
        """Outputs whose offset lies far outside the data, or is as uncertain as that."""
        limit = BEYOND * np.where(self.ranges > 0.0, self.ranges, 1.0)
        n = len(self.ranges)
        return np.flatnonzero(~(np.abs(values[-n:]) + errors[-n:] <= limit))
