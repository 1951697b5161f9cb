"""Whether a gain, a lag or the level of a process goes with a column that is not used.

The score test of ``constancy`` with the column c in place of time: the errors of the process,
beside static curves of inputs and response, are tested for c·x, c·∂x/∂ln S and c behind the
process's own lags (x: the responses; Wald statistic with the covariance of sums over blocks, of F's
law). A slow column goes along with anything that changes in time: it is told only where a free run
with it errs hardly more than with the best step or trend in time. A column that follows the output
is another view of it. What drifts goes with the column that acts and explains most of it.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from sysid.data.checks.constancy import (
    BLOCKS,
    EDGE,
    MIN_SAMPLES,
    Beside,
    Change,
    Part,
    main_input,
)
from sysid.data.checks.direction import acting_columns
from sysid.data.process import ProcessFit
from sysid.data.record import Array

ALARM = 1e-6
"""Level of the tests: a view of the output that is smoothed sees little of its noise."""

LEAVES, AS_TIME = 0.7, 1.2
"""Share of the squared errors of the free run that a column may leave; times what time leaves."""

MOST = 0.5
"""Share of a drift that a column explains at least."""

WITHIN = (0.05, 0.95)
"""Quantiles of a column between which a change is stated."""

CHANGES = 0.1
"""Relative change of a gain or a lag that is stated."""


def change_with_column(beside: Beside) -> Change | None:
    """What goes with the unused column that explains most of an output; None where none does."""
    records, j, fit = beside.records, beside.j, beside.fit
    names = records[0].unused_names
    unused = [r.unused for r in records if r.unused is not None and r.unused_names == names]
    if not names or len(unused) < len(records) or len(fit.residual) < MIN_SAMPLES:
        return None
    allowed, change = _allowed(beside), None
    for k in acting_columns(records, j, _rows(fit)):
        name = names[k]
        column = np.concatenate([part[:, k] for part in unused])
        low, high = np.quantile(column, WITHIN).tolist()
        if not high > low:
            continue
        middle, span = float(column.mean()), high - low
        c = ((column - middle) / span)[:, None]
        own = fit.through(main_input(fit), [(part[:, k] - middle) / span for part in unused])
        products = np.hstack([fit.responses * c, fit.responses * c**2, beside.lags * c])
        left = beside.left(np.column_stack([products, own]))
        if left > allowed:
            continue
        p = _chance(beside, c, own)
        level = beside.left(own[:, None]) <= beside.left(products)
        ends = np.array([[(v - middle) / span] for v in (low, high)])
        parts = () if level else _parts(beside, np.column_stack([products, own]), ends)
        if p < ALARM / len(names) and (parts or level):
            allowed, r = left, records[0]
            of = r.output_names[j], r.name, parts, np.nan, np.nan
            change = Change(*of, (name, low, high), level)
    return change


def drift_with_column(beside: Beside) -> Change | None:
    """The unused column that acts on an output and explains most of its drift; None without one."""
    records, j, fit = beside.records, beside.j, beside.fit
    drift, change, most = fit.drift - fit.drift.mean(), None, MOST
    for k in acting_columns(records, j, _rows(fit)):
        column = [r.unused[:, k] for r in records if r.unused is not None]
        own = fit.through(main_input(fit), [c - np.concatenate(column).mean() for c in column])
        own = own - own.mean()
        explained = float((own @ drift) ** 2 / max((own @ own) * (drift @ drift), 1e-300))
        if explained > most:
            low, high = np.quantile(np.concatenate(column), WITHIN).tolist()
            r, most = records[0], explained
            of = r.output_names[j], r.name, (), np.nan, np.nan
            change = Change(*of, (r.unused_names[k], low, high), level=True)
    return change


def _allowed(beside: Beside) -> float:
    """Squared errors up to which a column explains enough, and as much as time does."""
    x, lags = beside.fit.responses, beside.lags
    in_time = (beside.left(np.hstack([x * w, lags * w, w])) for w in _in_time(len(x)))
    return min(LEAVES * beside.left(), AS_TIME * min(in_time))


def _chance(beside: Beside, c: Array, own: Array) -> float:
    """p value of c without effect on gains, lags and level; its own is behind the lags."""
    columns = np.column_stack([beside.fit.responses * c, beside.lags * c, own])
    stats, _, _ = beside.statistics(beside.white, columns, np.ones((1, BLOCKS)))
    q = columns.shape[1]
    return float(fdtrc(q, BLOCKS - q, float(stats.min()) / q * (1.0 - q / BLOCKS)))


def _parts(beside: Beside, columns: Array, ends: Array) -> tuple[Part, ...]:
    """The gains that change between two values of c, else the lags that do."""
    r, fit, main = beside.records[0], beside.fit, main_input(beside.fit)
    every = np.column_stack([fit.responses, columns, np.ones(len(beside.y))])
    solved = np.linalg.lstsq(every, beside.y, rcond=1e-9)[0]
    a, b, d = solved[: 3 * r.nu].reshape(3, r.nu)
    gains = (fit.gain * (a + b * ends + d * ends**2)).T.tolist()
    lag = fit.lag[main] * r.dt * np.exp(solved[3 * r.nu] / a[main] * ends[:, 0])
    parts = [Part(n, True, v, w, 0.0) for n, (v, w) in zip(r.input_names, gains, strict=True)]
    lagging = Part(r.input_names[main], False, float(lag[0]), float(lag[1]), 0.0)
    told = [p for p in parts if abs(p.change) > CHANGES]
    return tuple(told or [lagging] * (abs(lagging.change) > CHANGES))


def _rows(fit: ProcessFit) -> int:
    """Length of the blocks that show which way signals go [samples]."""
    return max(round(float(fit.lag[main_input(fit)]) / 4.0), 1)


def _in_time(n: int) -> Iterator[Array]:
    """Steps at times all over the log, and a trend, (n, 1) each."""
    t = np.arange(n)[:, None] / n
    yield t
    for at in np.arange(EDGE, 1.0 - EDGE, 1.0 / BLOCKS).tolist():
        yield 1.0 * (t >= at)
