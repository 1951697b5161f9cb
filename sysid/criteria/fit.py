"""Measures of fit between simulated and measured outputs: fit percent, RRSE, RMSE.

Every function takes one record (an array, time first) or several (a list or tuple of arrays) and
pools them: sums run over all records, and the mean ȳ that a fit is measured against is each
record's own. One record then gives the textbook figure, and several are not flattered by the
distance between their operating points, which a model of the levels alone would explain.

A sample whose prediction is NaN (the first ones, before all past samples exist) is left out on
*every* channel, so that all channels of a model are judged on the same instants. An infinite
prediction is not left out: a simulation that ran away has fit −inf, not the fit of its first part.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.errors import DataError

Array = NDArray[np.float64]
Signals = Array | Sequence[Array]
"""One record as an array (N, n) or (N,), or several records as a list or tuple of such arrays."""


def as_records(signals: Signals, what: str = "signals") -> tuple[Array, ...]:
    """``signals`` as a tuple of 2-D float64 arrays, time first; 1-D arrays become one column.

    Raises:
        DataError: there is no record, a record is neither 1-D nor 2-D, or the records differ in
            their number of columns.
    """
    given = [signals] if isinstance(signals, np.ndarray) else list(signals)
    records = tuple(np.asarray(s, dtype=np.float64) for s in given)
    records = tuple(s[:, None] if s.ndim == 1 else s for s in records)
    shapes = [s.shape for s in records]
    if not records or any(len(s) != 2 or s[1] != shapes[0][1] for s in shapes):
        raise DataError(
            f"{what}: expected arrays of shape (N, n), time first, with one n for all records, "
            f"got {shapes}"
        )
    return records


def fit_percent(y: Signals, y_hat: Signals, skip: int = 0) -> Array:
    """Fit of each output, 100 (1 − ‖y − ŷ‖ / ‖y − ȳ‖) [%].

    100 is perfect, 0 no better than the mean, negative worse than the mean (thesis 3.38).

    Args:
        y: measured outputs, (N, ny) or one such array a record.
        y_hat: predicted or simulated outputs, same shapes; NaN where nothing was predicted.
        skip: samples left out at the beginning of each record (they may set the initial state).

    Returns:
        (ny,); NaN for an output that is constant in every record (no fit is defined), or when no
        sample is left.
    """
    return 100.0 * (1.0 - rrse(y, y_hat, skip))


def rrse(y: Signals, y_hat: Signals, skip: int = 0) -> Array:
    """Root relative squared error ‖y − ŷ‖ / ‖y − ȳ‖ of each output; see :func:`fit_percent`."""
    pairs = _predicted(y, y_hat, skip)
    varies = np.any([np.ptp(m, axis=0) > 0.0 if len(m) else m.any(axis=0) for m, _ in pairs], 0)
    # a record of its own scale per output: neither 1e-200 nor 1e200 under- or overflows
    spread = _norm([m - m.mean(axis=0) for m, _ in pairs if len(m)], len(varies))
    spread[~varies] = np.nan
    return _norm([m - p for m, p in pairs], len(varies)) / spread


def rmse(y: Signals, y_hat: Signals, skip: int = 0) -> Array:
    """Root mean squared error of each output, √(Σ(y − ŷ)²/N), in the output's unit.

    Arguments and errors as in :func:`fit_percent`; NaN when no sample is left.
    """
    pairs = _predicted(y, y_hat, skip)
    count = sum(len(m) for m, _ in pairs)
    total = _norm([m - p for m, p in pairs], pairs[0][0].shape[1])
    return total / np.sqrt(count) if count else np.full_like(total, np.nan)


def complete_rows(errors: Signals) -> Array:
    """The rows without a NaN of all records, stacked: (N, ny)."""
    records = as_records(errors, "errors")
    stacked = records[0] if len(records) == 1 else np.concatenate(records)
    # column by column: NumPy's reductions along the short axis of (N, ny) are ten times slower
    missing = np.any([np.isnan(c) for c in stacked.T], axis=0)
    head = int(np.argmin(missing))
    kept = stacked[head:] if not missing[head:].any() else np.compress(~missing, stacked, axis=0)
    if not len(kept):
        raise DataError("errors: no sample is predicted on all outputs; give a longer record")
    return kept


def _predicted(y: Signals, y_hat: Signals, skip: int) -> list[tuple[Array, Array]]:
    """Measured and predicted rows of each record, without those skipped or not predicted."""
    measured, predicted = as_records(y, "y"), as_records(y_hat, "y_hat")
    shapes = [m.shape for m in measured], [p.shape for p in predicted]
    if shapes[0] != shapes[1]:
        raise DataError(f"y and y_hat must have the same shapes, got {shapes[0]} and {shapes[1]}")
    pairs = [(m[skip:], p[skip:]) for m, p in zip(measured, predicted, strict=True)]
    keep = [~(np.isnan(m) | np.isnan(p)).any(axis=1) for m, p in pairs]
    return [(m[k], p[k]) for (m, p), k in zip(pairs, keep, strict=True)]


def _norm(parts: Sequence[Array], columns: int) -> Array:
    """Euclidean norm of each column over all parts, free of under- and overflow."""
    stacked = np.concatenate([np.zeros((1, columns)), *parts])
    largest = np.abs(stacked).max(axis=0)
    usable = (largest > 0.0) & np.isfinite(largest)
    scaled = stacked[:, usable] / largest[usable]
    norm: Array = largest.copy()
    norm[usable] *= np.sqrt(np.einsum("ij,ij->j", scaled, scaled))
    return norm


def one_output(errors: Signals) -> list[Array]:
    """Residuals of one output as 1-D arrays, one a record."""
    records = as_records(errors, "errors")
    if records[0].shape[1] != 1:
        raise DataError(f"residuals of one output expected, got shape {records[0].shape}")
    if any(np.isinf(r).any() for r in records):
        raise DataError("the residuals are not finite; the model is unstable")
    if all(np.isnan(r).all() for r in records):
        raise DataError("no residual to test; give a longer record")
    return [r[:, 0] for r in records]


def inputs_of(inputs: Signals, lengths: list[int]) -> tuple[Array, ...]:
    """The inputs as 2-D arrays of the given lengths."""
    records = as_records(inputs, "inputs")
    if [len(u) for u in records] != lengths:
        raise DataError(f"{lengths} residuals but inputs of {[len(u) for u in records]} samples")
    if not all(np.isfinite(u).all() for u in records):
        raise DataError("the inputs hold values that are not finite; remove or repair them first")
    return records


def centred(signal: Array) -> Array:
    """A record's signal without its mean over the samples that are not NaN."""
    known = ~np.isnan(signal)
    count = np.maximum(known.sum(axis=0), 1)
    return np.asarray(signal - np.where(known, signal, 0.0).sum(axis=0) / count)
