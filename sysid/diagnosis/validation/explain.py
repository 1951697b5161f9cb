"""Sparse descriptions of unexplained errors as functions of inputs and simulated states.

The errors are regressed on a library of torques through the simulation's lag (``known_terms.py``)
by sequentially thresholded least squares (pysindy's STLSQ), among the first terms of an orthogonal
forward selection. The threshold is the largest whose prediction of left-out blocks is within one
standard error of the best (Breiman et al. 1984). Changes of gain and time constant are removed.

Source: Brunton, Proctor & Kutz (2016), PNAS 113, 3932. The only importer of pysindy.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.validation.error_tests import orthonormal
from sysid.diagnosis.validation.known_terms import known_terms
from sysid.diagnosis.validation.model_error import first_order_slopes
from sysid.structures.difference_equations.frols import forward, gram_beyond

THRESHOLDS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6)
"""Coefficients below this share of the errors' size are set to zero."""

FOLDS = 5
MOST_TERMS = 3
RIDGE = 1e-3
SIMPLER = 0.9
"""Fewer terms may cost this share of what is predicted."""

LEAST_SHARE = 0.05
"""Below this share of the squared error above the noise a description is not worth its words."""


@dataclass(frozen=True)
class Description:
    """A sparse description of one output's errors.

    Attributes:
        coefficients: their factors, in the output's unit per unit of the term.
        share: share of the squared error above the noise that it predicts on blocks left out.
    """

    output: str
    terms: tuple[str, ...]
    coefficients: tuple[float, ...]
    share: float

    @property
    def sentence(self) -> str:
        """Such as ``omega_l error ≈ 0.41·F(d_l·|d_l|) − 0.12·omega_l; explains 63 % of …``."""
        text = ""
        for k, (c, term) in enumerate(zip(self.coefficients, self.terms, strict=True)):
            sign = ("− " if c < 0 else "+ ") if k else ("−" if c < 0 else "")
            factor = f"{abs(c):.3g}" + ("" if term == "1" else f"·{term}")
            text += f"{' ' if k else ''}{sign}{factor}"
        lag = " (F: through the lag of the model)" if "F(" in text else ""
        return (
            f"{self.output} error ≈ {text}; explains {100 * self.share:.0f} % of the error above "
            f"the noise{lag}"
        )


def explain(
    records: Sequence[Record],
    errors: Sequence[Array],
    simulated: Sequence[Array],
    floor: Array,
    scales: Array,
) -> tuple[Description, ...]:
    """Sparse descriptions of the errors, one for each output on which one is worth its words.

    Args:
        errors: measured minus simulated, (N, ny) a record; NaN where a sample does not count.
        simulated: the runs, (N, ny) a record.
        floor: measurement noise of each output, (ny,).
    """
    descriptions = []
    for i, name in enumerate(records[0].output_names):
        y = np.concatenate([e[:, i] for e in errors])
        terms = known_terms(records, simulated, i, scales)
        X = np.concatenate(terms.columns)
        rows = np.isfinite(y)
        y, X = y[rows], X[rows]
        # what another gain or time constant would do is no missing term
        basis = orthonormal(np.concatenate(first_order_slopes(records, simulated, i, scales)))[rows]
        X, y = X - basis @ (basis.T @ X), y - basis @ (basis.T @ y)
        above = float(y @ y) - len(y) * float(floor[i]) ** 2
        if len(y) < 100 or above <= 0.0:
            continue
        size = float(np.sqrt(np.mean(y**2)))
        threshold, gain = _chosen(X, y / size)
        share = float(np.clip(gain * size**2 / above, 0.0, 1.0))
        order = _first(X, y)
        beta = np.zeros(X.shape[1])
        beta[order] = _thresholded(X[:, order], y / size, threshold) * size
        kept = np.flatnonzero(beta)
        if share < LEAST_SHARE or not len(kept):
            continue
        kept = kept[np.argsort(-np.abs(beta[kept]))]
        factors = (beta[kept] / terms.sizes[kept]).tolist()
        named = tuple(terms.names[k] for k in kept)
        descriptions.append(Description(name, named, tuple(factors), share))
    return tuple(descriptions)


def described(descriptions: Sequence[Description]) -> str:
    """All descriptions in one text, empty without one."""
    return "; ".join(d.sentence for d in descriptions)


def _chosen(X: Array, y: Array) -> tuple[float, float]:
    """(threshold, squared error that it predicts on blocks left out)."""
    blocks = np.array_split(np.arange(len(y)), FOLDS)
    gains = np.zeros((len(THRESHOLDS), FOLDS))
    for j, rows in enumerate(blocks):
        train = np.setdiff1d(np.arange(len(y)), rows)
        order = _first(X[train], y[train])
        for k, threshold in enumerate(THRESHOLDS):
            beta = _thresholded(X[train][:, order], y[train], threshold)
            residual = y[rows] - X[rows][:, order] @ beta
            gains[k, j] = float(y[rows] @ y[rows] - residual @ residual)
    total = gains.sum(axis=1)
    best = int(np.argmax(total))
    if total[best] <= 0.0:
        return THRESHOLDS[-1], 0.0
    spread = np.std(gains - gains[best], axis=1, ddof=1) * np.sqrt(FOLDS)
    near = (total >= total[best] - spread) & (total >= SIMPLER * total[best])
    k = int(np.flatnonzero(near)[-1])
    return THRESHOLDS[k], float(total[k])


def _thresholded(X: Array, y: Array, threshold: float) -> Array:
    """STLSQ coefficients, (n,)."""
    import pysindy

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all terms below the threshold is an answer here
        fit = pysindy.STLSQ(threshold=threshold, alpha=RIDGE).fit(X, y[:, None])
    coefficients: Array = np.asarray(fit.coef_, dtype=np.float64).ravel()
    return coefficients


def _first(X: Array, y: Array) -> Array:
    """The first terms of an orthogonal forward selection."""
    gram, usable, _ = gram_beyond(np.zeros((len(y), 0)), X, y)
    return np.asarray(forward(gram, usable, MOST_TERMS).order)
