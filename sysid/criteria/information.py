"""Criteria that weigh a model's loss against its size: AIC, AICc, nAIC, BIC, MDL, FPE.

With V = det(EᵀE/N), N samples, n parameters (estimated initial states count, the noise variance
does not) and ny outputs:

    AIC  = N ln V + 2n + N ny (ln 2π + 1)          AICc = AIC + 2n(n+1)/(N−n−1)
    nAIC = ln V + 2n/N                             BIC  = N ln V + N ny (ln 2π + 1) + n ln N
    MDL  = V (1 + n ln N / N)                      FPE  = V (1 + n/N) / (1 − n/N)

Sources: Akaike (1969, 1974), Hurvich & Tsai (1989), Schwarz (1978), Rissanen (1978), Ljung (1999)
§16.4; thesis (3.39)–(3.41) with the bracket of (3.39) balanced. Values of different data, or of
different sets of predicted samples, must not be compared: see :func:`on_common_samples`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from sysid.criteria.fit import Array, Signals, as_records, complete_rows
from sysid.errors import DataError


@dataclass(frozen=True)
class InformationCriteria:
    """The criteria of one model on one data set; smaller is better for each.

    A perfect fit has loss, mdl and fpe 0 and the others −inf. With no more samples than
    parameters (N ≤ n) fpe is inf, with N ≤ n + 1 aicc is inf: such a model cannot be preferred.
    """

    aic: float
    aicc: float
    naic: float
    bic: float
    mdl: float
    fpe: float
    loss: float


class Criterion(NamedTuple):
    """How to read a criterion: its direction, and what it says in one sentence."""

    smaller_is_better: bool
    sentence: str


CRITERIA: MappingProxyType[str, Criterion] = MappingProxyType(
    {
        "aic": Criterion(True, "Akaike: expected information lost; favours good prediction."),
        "aicc": Criterion(True, "Akaike corrected for short records; use when N < 40 n."),
        "naic": Criterion(True, "Akaike per sample, without its constant; ranks as AIC does."),
        "bic": Criterion(True, "Schwarz: punishes size more; finds the true order as N grows."),
        "mdl": Criterion(True, "Rissanen: shortest description; ranks nearly as BIC does."),
        "fpe": Criterion(True, "Akaike's final prediction error: expected loss on new data."),
        "loss": Criterion(True, "Loss V = det(EᵀE/N); never rises with size, so it overfits."),
        "fit": Criterion(False, "Fit percent 100(1 − ‖y−ŷ‖/‖y−ȳ‖); judge it on held-out data."),
        "rmse": Criterion(True, "Root mean squared error; judge it on held-out data."),
    }
)
"""Name on the command line → direction and meaning."""


def information_criteria(errors: Signals, n_parameters: int) -> InformationCriteria:
    """The criteria from one-step prediction errors.

    V is formed through its logarithm with each output scaled to unit size, so that errors of
    1e-200 neither underflow nor make two outputs of very different units look singular.

    Args:
        errors: ε = y − ŷ one step ahead, (N, ny) or one such array a record; rows with a NaN
            (not predicted) are left out.
        n_parameters: free parameters n, estimated initial states included.

    Raises:
        DataError: no complete row, or a negative ``n_parameters``.
    """
    kept = complete_rows(errors)
    samples, outputs = kept.shape
    scale = np.array([np.abs(c).max() for c in kept.T])
    if not np.isfinite(scale).all():
        log_loss = np.inf
    elif not scale.all():
        log_loss = -np.inf
    else:
        scaled = kept / scale
        log_det = float(np.linalg.slogdet(scaled.T @ scaled / samples)[1])
        log_loss = log_det + 2.0 * float(np.log(scale).sum())
    return _from_log_loss(log_loss, samples, n_parameters, outputs)


def from_loss(V: float, N: int, n: int, ny: int = 1) -> InformationCriteria:
    """The criteria from a loss V = det(EᵀE/N), N samples, n parameters and ny outputs.

    Raises:
        DataError: V is negative or NaN, N < 1, n < 0 or ny < 1.
    """
    if not V >= 0.0:
        raise DataError(f"the loss V must not be negative, got {V}")
    return _from_log_loss(float(np.log(V)) if V > 0.0 else -np.inf, N, n, ny)


def on_common_samples(models: Sequence[Signals]) -> list[tuple[Array, ...]]:
    """Each model's errors with every row set to NaN that some model does not predict.

    Models of different orders or focus predict from different samples on; criteria that rank
    them must be computed from the rows all of them predict.

    Args:
        models: for each model its errors, all on the same records.

    Raises:
        DataError: the models' errors differ in shape.
    """
    all_errors = [as_records(m, "errors") for m in models]
    if len({tuple(e.shape for e in errors) for errors in all_errors}) > 1:
        raise DataError("errors of models to be compared must come from the same records")
    missing = [np.isnan(np.stack(es)).any(axis=(0, 2)) for es in zip(*all_errors, strict=True)]
    return [
        tuple(np.where(gone[:, None], np.nan, e) for e, gone in zip(errors, missing, strict=True))
        for errors in all_errors
    ]


def _from_log_loss(log_v: float, N: int, n: int, ny: int) -> InformationCriteria:
    if N < 1 or n < 0 or ny < 1:
        raise DataError(f"criteria need N ≥ 1, n ≥ 0 and ny ≥ 1, got N={N}, n={n}, ny={ny}")
    with np.errstate(over="ignore"):
        loss = float(np.exp(np.float64(log_v)))
    deviance = N * log_v + N * ny * (np.log(2.0 * np.pi) + 1.0)
    aic = deviance + 2.0 * n
    return InformationCriteria(
        aic=float(aic),
        aicc=float(aic + 2.0 * n * (n + 1) / (N - n - 1)) if n + 1 < N else np.inf,
        naic=float(log_v + 2.0 * n / N),
        bic=float(deviance + n * np.log(N)),
        mdl=float(loss * (1.0 + n * np.log(N) / N)),
        fpe=float(loss * (1.0 + n / N) / (1.0 - n / N)) if n < N else np.inf,
        loss=loss,
    )
