"""Information criteria of one-step errors; see the table.

Values of different data, or of different sets of predicted samples, must not be compared: see
:func:`on_common_samples`.
"""

from collections.abc import Sequence

import numpy as np

from sysid.criteria.fit import Array, Signals, as_records, complete_rows
from sysid.criteria.table import Loss, weighed
from sysid.errors import DataError


def information_criteria(errors: Signals, n_parameters: int) -> dict[str, float]:
    """Every criterion of one-step prediction errors by name; see :func:`loss_of`."""
    return weighed(loss_of(errors, n_parameters))


def loss_of(errors: Signals, n_parameters: int) -> Loss:
    """The loss of one-step prediction errors.

    V is formed through its logarithm with each output scaled to unit size, so that errors of
    1e-200 neither underflow nor make two outputs of very different units look singular.

    Args:
        errors: ε = y − ŷ one step ahead, (N, ny) or one such array a record; rows with a NaN
            (not predicted) are left out.
        n_parameters: free parameters n, estimated initial states included.
    """
    kept = complete_rows(errors)
    samples, outputs = kept.shape
    scale = np.array([max(c.max(), -c.min()) for c in kept.T])
    if not np.isfinite(scale).all():
        log_loss = np.inf
    elif not scale.all():
        log_loss = -np.inf
    else:
        scaled = kept / scale
        log_det = float(np.linalg.slogdet(scaled.T @ scaled / samples)[1])
        log_loss = log_det + 2.0 * float(np.log(scale).sum())
    return Loss(log_loss, samples, n_parameters, outputs)


def on_common_samples(models: Sequence[Signals]) -> list[tuple[Array, ...]]:
    """Each model's errors with every row set to NaN that some model does not predict.

    Models of different orders or focus predict from different samples on; criteria that rank
    them must be computed from the rows all of them predict.

    Args:
        models: for each model its errors, all on the same records.
    """
    all_errors = [as_records(m, "errors") for m in models]
    if len({tuple(e.shape for e in errors) for errors in all_errors}) > 1:
        raise DataError("errors of models to be compared must come from the same records")
    missing = [np.isnan(np.stack(es)).any(axis=(0, 2)) for es in zip(*all_errors, strict=True)]
    return [
        tuple(np.where(gone[:, None], np.nan, e) for e, gone in zip(errors, missing, strict=True))
        for errors in all_errors
    ]
