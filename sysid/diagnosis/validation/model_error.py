"""The model-error model: tests whether free-run errors depend on inputs and outputs.

The free-run errors e of a record are regressed on known terms (``known_terms.py``):

    e(t) = Z(t) ζ + X(t) β + v(t),    α(q) v(t) = w(t) white,

with Z the effect of the model's own parameters. An autoregression α whitens both sides, and β = 0
is tested by F on the filtered equations (generalised least squares; Durbin 1960). The terms hold
only the past, so that feedback does no harm. A ripple over the wheel's angle is tested separately,
as the highest of many periodogram ordinates.

Source: Ljung (1999), "Model validation and model error modeling".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.criteria.coloured import ar_fit
from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index, Record
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.validation.error_tests import (
    ORDER,
    f_test,
    level_chance,
    orthonormal,
    ripple_chance,
)
from sysid.diagnosis.validation.known_terms import CLOCK, Terms, angles, drives_of, known_terms
from sysid.errors import DataError

MIN_SAMPLES = 100
"""Fewer samples are too few for the test."""

BRIDGED = 10
"""Gaps in the errors up to this length [samples] are bridged; longer ones cut the record."""

FOLDS = 6
RIDGES = (1e-4, 1e-2, 1e-1)
"""Ridge weights that the cross-validated prediction chooses from, in units of the Gram matrix."""


PROVEN = 0.05
"""Above this p-value no share is claimed."""


@dataclass(frozen=True)
class ResidualVerdict:
    """Whether the errors of a model on held-out data still depend on what is known.

    Attributes:
        p_value: of no dependence on commands, speeds and their products, over all outputs.
        share: share of the squared error above the floor that such a dependence predicts.
    """

    model: str
    p_value: float
    share: float


@dataclass(frozen=True)
class OutputStructure:
    """What is left on one output.

    Attributes:
        p_value: of errors that depend on nothing known.
        share: share of the squared error above the floor (without what the model's own parameters
            could follow) that the known terms, the clock apart, predict on blocks not used for
            their coefficients, 0 … 1.
    """

    output: str
    p_value: float
    share: float


@dataclass(frozen=True)
class ResidualStructure:
    """Whether structure is left in the errors of a model.

    Attributes:
        p_value: over all outputs (Bonferroni).
        share: of the squared error above the floor, each output in units of its floor's error.
    """

    p_value: float
    share: float
    outputs: tuple[OutputStructure, ...]

    def verdict(self, model: str) -> ResidualVerdict:
        """As the noun of a diagnosis, for the model ``before`` or ``after``."""
        return ResidualVerdict(model, self.p_value, self.share)


def structured(errors: ResidualStructure | None) -> bool:
    """Whether errors depend on what is known."""
    return errors is not None and errors.p_value < VERDICT.structured_p


def error_structure(
    records: Sequence[Record],
    errors: Sequence[Array],
    simulated: Sequence[Array],
    floor: Array,
    scales: Array,
    slopes: Sequence[Array] | None = None,
) -> ResidualStructure:
    """Whether free-run errors depend on commands, simulated speeds, their products and time.

    Args:
        errors: measured minus simulated, (N, ny) a record; NaN where a sample does not count.
        simulated: the runs, (N, ny) a record.
        floor: measurement noise of each output, (ny,).
        slopes: ∂ŷ/∂θ of each record, (N, ny, n): changes that the model could follow with its own
            parameters are no structure. None: those of a first-order model per output. An empty
            last axis asks for everything, as for a given model that was not fitted on this system.
    """
    count = sum(len(e) for e in errors)
    if count < MIN_SAMPLES:
        raise DataError(f"a model of the errors needs at least {MIN_SAMPLES} samples, got {count}")
    shapes = [e.shape for e in errors]
    if shapes != [s.shape for s in simulated] or shapes != [r.y.shape for r in records]:
        raise DataError(f"errors have shapes {shapes}, records {[r.y.shape for r in records]}")
    outputs, power, predicted = [], 0.0, 0.0
    for i, name in enumerate(records[0].output_names):
        filled = [_filled(x[:, i]) for x in errors]
        terms = known_terms(records, simulated, i, scales)
        if slopes is None:
            gradients = first_order_slopes(records, simulated, i, scales)
        else:
            gradients = [s[:, i] for s in slopes]
        # with what a wrong initial speed would add
        pole = drives_of(records, simulated, i, scales).pole
        gradients = [np.column_stack([z, pole ** np.arange(len(z))]) for z in gradients]
        kept = [_fresh(x[:, i]) or _stretches(y) for x, y in zip(errors, filled, strict=True)]
        speeds = [s[:, i] for s in simulated]
        e, gradients, columns, angle, speed = (
            [x[part] for x, parts in zip(whole, kept, strict=True) for part in parts]
            for whole in (filled, gradients, terms.columns, angles(records, simulated, i), speeds)
        )
        total = sum(len(x) for x in e)
        if total < MIN_SAMPLES:
            continue
        p = _trial(e, gradients, Terms(terms.names, tuple(columns), terms.sizes), angle, speed)
        if np.isnan(p):
            continue
        basis = orthonormal(np.concatenate(gradients))
        y = np.concatenate(e)
        rest = y - basis @ (basis.T @ y)
        above = float(rest @ rest) - total * float(floor[i]) ** 2
        of_signals = [k for k, term in enumerate(terms.names) if not term.endswith(CLOCK)]
        signals = [x[:, of_signals] for x in columns]
        gain = _predicted(e, gradients, signals) if p < PROVEN else 0.0
        share = float(np.clip(gain / above, 0.0, 1.0)) if above > 0.0 else 0.0
        outputs.append(OutputStructure(name, p, share))
        unit = max(float(np.mean(np.concatenate(e) ** 2)), 1e-300)
        power += max(above, 0.0) / unit
        predicted += share * max(above, 0.0) / unit
    if not outputs:
        raise DataError(f"no output has {MIN_SAMPLES} samples in stretches long enough to test")
    p_value = min(1.0, len(outputs) * min(o.p_value for o in outputs))
    return ResidualStructure(p_value, predicted / power if power > 0.0 else 0.0, tuple(outputs))


def first_order_slopes(
    records: Sequence[Record], simulated: Sequence[Array], i: int, scales: Array
) -> list[Array]:
    """∂ŷ/∂K and ∂ŷ/∂a of ŷ(t) = a ŷ(t−1) + K (1 − a) d(t−1), but for factors."""
    a = drives_of(records, simulated, i, scales).pole
    columns = []
    for r, s in zip(records, simulated, strict=True):
        drive = r.u[:, min(i, r.nu - 1)] / scales[min(i, r.nu - 1)]
        gain = lfilter([0.0, 1.0], [1.0, -a], drive)
        pole = lfilter([0.0, 1.0], [1.0, -a], s[:, i])
        columns.append(np.column_stack([gain, pole]))
    return columns


def _filled(e: Array) -> Array:
    """Errors with gaps of up to ``BRIDGED`` samples filled by straight lines."""
    missing = ~np.isfinite(e)
    edges = np.flatnonzero(np.diff(missing.astype(int), prepend=0, append=0))
    out = e.copy()
    t = np.arange(len(e))
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        if high - low <= BRIDGED and not missing.all():
            out[low:high] = np.interp(t[low:high], t[~missing], e[~missing])
    return out


def _fresh(e: Array) -> list[Index]:
    """Rows of a sensor slower than the log, in stretches without gaps; none for a faster one.

    Lines between its measurements would be no errors of the model but a colour of our own.
    """
    there = np.flatnonzero(np.isfinite(e))
    if len(there) < 2:
        return []
    steps = np.diff(there)
    usual = float(np.median(steps))
    if usual < 2.0:
        return []
    parts = np.split(there, np.flatnonzero(steps > 2.0 * usual) + 1)
    return [p for p in parts if len(p) > 3 * ORDER]


def _stretches(e: Array) -> list[slice]:
    """Stretches without gaps, long enough to be whitened."""
    there = np.isfinite(e)
    edges = np.flatnonzero(np.diff(there.astype(int), prepend=0, append=0))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [slice(low, high) for low, high in pairs if high - low > 3 * ORDER]


def _trial(
    e: Sequence[Array],
    gradients: Sequence[Array],
    terms: Terms,
    angle: Sequence[Array],
    speed: Sequence[Array],
) -> float:
    """p-value of one output; NaN where the terms are too many for the samples."""
    ends = np.cumsum([len(x) for x in e])[:-1]
    basis = orthonormal(np.concatenate(gradients))
    y = np.concatenate(e)
    noise = ar_fit(np.split(y - basis @ (basis.T @ y), ends), ORDER)
    if noise.variance <= 1e-24 * max(float(np.max(np.abs(y))) ** 2, 1e-300):
        return 1.0

    def white(parts: Sequence[Array]) -> Array:
        skip = noise.order
        return np.concatenate([lfilter(noise.alpha, [1.0], p, axis=0)[skip:] for p in parts])

    nuisance = orthonormal(white(gradients))
    w = white(e)
    w = w - nuisance @ (nuisance.T @ w)
    X = white(terms.columns)
    before = np.sum(X**2, axis=0)
    X = X - nuisance @ (nuisance.T @ X)
    p = f_test(w, X[:, np.sum(X**2, axis=0) > 1e-6 * before], nuisance.shape[1])
    kinds = ([np.ones_like(s) for s in speed], speed)
    ripple = ripple_chance(w, noise.alpha, angle, kinds, nuisance)
    chance = 3.0 * float(np.nanmin([p, ripple, level_chance(e, gradients)]))
    if np.isnan(p) and chance > PROVEN:
        return float("nan")
    return min(1.0, chance)


def _predicted(e: Sequence[Array], gradients: Sequence[Array], columns: Sequence[Array]) -> float:
    """Squared error that the terms predict on blocks left out of their fit; at least 0.

    The coefficients come from whitened equations and are drawn to zero in proportion to what the
    terms say there: a constant says nothing against a wandering load and stays zero.
    """
    basis = orthonormal(np.concatenate(gradients))
    y, X = np.concatenate(e), np.concatenate(columns)
    y, X = y - basis @ (basis.T @ y), X - basis @ (basis.T @ X)
    X = X / np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
    ends = np.cumsum([len(x) for x in e])[:-1]
    noise = ar_fit(np.split(y, ends), ORDER)
    white = [
        np.concatenate([lfilter(noise.alpha, [1.0], p, axis=0) for p in np.split(z, ends)])
        for z in (X, y)
    ]
    blocks = np.array_split(np.arange(len(y)), FOLDS)
    grams = [white[0][rows].T @ white[0][rows] for rows in blocks]
    sides = [white[0][rows].T @ white[1][rows] for rows in blocks]
    whole, side = sum(grams), sum(sides)
    weight = float(np.trace(whole)) / len(whole)
    best = 0.0
    for ridge in RIDGES:
        gain = 0.0
        for rows, gram, part in zip(blocks, grams, sides, strict=True):
            A = whole - gram + ridge * weight * np.eye(len(whole))
            guess = X[rows] @ np.linalg.solve(A, side - part)
            gain += float(np.sum(y[rows] ** 2) - np.sum((y[rows] - guess) ** 2))
        best = max(best, gain)
    return best
