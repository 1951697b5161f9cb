"""Whether a gain, a lag or the level of a process goes with a column that is not used.

The score test of ``constancy`` with the column c in place of time: the errors of the process,
beside static curves of inputs and response, are tested for c·x, c·∂x/∂ln S and c behind the
process's own lags (x: the responses; Wald statistic with the covariance of sums over blocks, of F's
law). A column that sees the noise of the output is another view of it.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc

from sysid.data.checks.constancy import (
    BLOCKS,
    CLEAR,
    MATTERS,
    MIN_SAMPLES,
    Change,
    between_ends,
    curves,
    main_input,
    statistics,
)
from sysid.data.impulse import orthonormal
from sysid.data.process import ProcessFit
from sysid.data.record import Array, Record

ALARM = 1e-6
"""Level of the tests: a view of the output that is smoothed sees little of its noise."""

LAGS = 8
"""Samples of its past that say what is new in a column."""

WITHIN = (0.05, 0.95)
"""Quantiles of a column between which a change is stated."""


def change_with_column(
    records: Sequence[Record], j: int, fit: ProcessFit
) -> tuple[Change | None, Array]:
    """What goes with the unused column that explains most of output j; (N, n) that explain it."""
    r, n = records[0], len(fit.residual)
    change, known, names = None, np.empty((n, 0)), r.unused_names
    if not names or n < MIN_SAMPLES or any(part.unused is None for part in records):
        return change, known
    white, x, main, m = fit.white.filtered, fit.responses, main_input(fit), fit.white.base.shape[1]
    X = np.hstack([fit.white.base, x, fit.slopes, curves(records, fit)])
    X, _ = orthonormal(white(X), 1e-9)
    target = white(np.concatenate([part.y[:, j] for part in records])[:, None])[:, 0]
    e = target - X @ (X.T @ target)
    edges = np.linspace(0, n, BLOCKS + 1).astype(int)
    least = ALARM / len(names)
    for k, name in enumerate(names):
        each = [part.unused[:, k] for part in records if part.unused is not None]
        column = np.concatenate(each)
        low, high = np.quantile(column, WITHIN).tolist()
        if not high > low or _shares_noise(column, e, x.sum(axis=1)):
            continue
        middle, span = float(column.mean()), high - low
        c = ((column - middle) / span)[:, None]
        own = fit.through(main, [(part - middle) / span for part in each])
        Z = np.column_stack([x * c, fit.slopes.sum(axis=1, keepdims=True) * c, own, np.ones(n)])
        size = np.sqrt(np.mean(white(Z) ** 2, axis=0)) + 1e-300
        stats, effects, errors = statistics(X, white(Z) / size, e, np.ones((1, BLOCKS)), edges)
        effect, error = effects[0] / size, errors[0] / size
        # gains where c is zero: those of the process are of its mean power
        regressors = white(np.hstack([fit.white.base, x, Z[:, :-1]]))
        solved = np.linalg.lstsq(regressors, target, rcond=1e-9)[0]
        gain, moved = solved[m : m + r.nu], solved[m + r.nu : m + 2 * r.nu]
        values = np.append(fit.gain * gain, fit.lag[main] * r.dt)
        effect[: r.nu], error[: r.nu] = moved / gain, error[: r.nu] / np.abs(gain)
        ends = (low - middle) / span, (high - middle) / span
        parts = between_ends(r, main, values, effect[:-2], error[:-2], ends)
        parts = [part for part in parts if part.clear]
        far = max(MATTERS * float(np.ptp(r.y[:, j])), CLEAR * float(error[-2]))
        level = not parts and bool(abs(effect[-2]) > far)  # a gain's has one from where u starts
        q = Z.shape[1] - 1
        p = float(fdtrc(q, BLOCKS - q, float(stats.min()) / q * (1.0 - q / BLOCKS)))
        if p < least and (parts or level):
            least, known, told = p, Z[:, :-1], (name, low, high)
            of = r.output_names[j], r.name, tuple(parts)
            change = Change(*of, np.nan, np.nan, p, told, level)
    return change, known


def _shares_noise(c: Array, e: Array, x: Array) -> bool:
    """Whether what is new in a column each sample goes with the errors e: it sees the output."""
    past = np.column_stack([np.roll(c, k) for k in range(1, LAGS + 1)] + [np.ones(len(c))])[LAGS:]
    new = c[LAGS:] - past @ np.linalg.lstsq(past, c[LAGS:], rcond=1e-9)[0]
    x = x / (x.std() + 1e-300)
    seen = np.column_stack([e, e * x, e * x**2])[LAGS:]
    rest = new - seen @ np.linalg.lstsq(seen, new, rcond=1e-9)[0]
    ratio = (new @ new - rest @ rest) / max(rest @ rest, 1e-300) * (len(new) - 3) / 3
    return bool(fdtrc(3, len(new) - 3, ratio) < ALARM)
