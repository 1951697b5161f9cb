"""Figures of a robustly fitted model, with outliers of the data left out."""

from collections.abc import Sequence

from sysid.data.record import Array, Record
from sysid.estimation.robust_fit import bounded_errors, outliers_of
from sysid.fitting.outliers import Outliers
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window


def is_robust(model: Model) -> bool:
    """Whether the model was fitted with outliers left out."""
    return model.provenance.options.get("loss") == "huber"


def judged(model: Model, records: Sequence[Record]) -> tuple[Record, ...]:
    """The records as a model is to be judged on them.

    For a model that was fitted robustly bad measurements are replaced by what it predicts there,
    since predictions start from them, and they and the samples of disturbances have weight zero.
    All other records come back as they are, and those whose outliers are known already.
    """
    if not is_robust(model):
        return tuple(records)
    return tuple(r if r.weights is not None else _outliers(model, r).marked(r) for r in records)


def judged_errors(model: Model, records: Sequence[Record]) -> list[Array]:
    """One-step prediction errors (N, ny) from which criteria are computed, by record.

    Outliers of a robustly fitted model count with the size at which an error begins to stand out,
    so that all models are judged on the same samples.
    """
    window = initial_state_window(model.structure, model.theta)
    if not is_robust(model):
        return [model.errors(r, window) for r in records]
    outliers = [_outliers(model, r) for r in records]
    return [
        bounded_errors(model.errors(f.marked(r), window), f)
        for r, f in zip(records, outliers, strict=True)
    ]


def _outliers(model: Model, record: Record) -> Outliers:
    model.check(record)
    window = initial_state_window(model.structure, model.theta)
    return outliers_of(model.structure, model.theta, model.detrend.remove(record), window)
