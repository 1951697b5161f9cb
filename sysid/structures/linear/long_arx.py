"""ARX models as a means: least-squares rows, long ARX models, and regressions on their errors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import fdtri

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.fitting import normal_equations as ne
from sysid.fitting.uncertainty import portmanteau_white
from sysid.structures.linear.least_squares import solved_row
from sysid.structures.linear.output_error import passing, reflected
from sysid.structures.linear.predictor import RowErrors, RowLayout

PLENTY = 5000
"""Samples from which a start that leaves nothing to predict spares the search of the others.

Of 450 simulated records of 6000 samples (ARMAX, output error and slow noise; poles up to 0.995,
signal-to-noise ratios from 0.5 to 100) 194 were settled, and none ended worse for it.
"""

SETTLED = 0.95
"""Confidence up to which a long ARX may predict better by chance."""


def arx_row(records: Sequence[Record], lay: RowLayout) -> Array:
    """Least squares of one ARX row: [a…, b…] in the row's order."""
    used = {lay.output, *(s for s, _ in lay.terms)}
    gram = ne.lag_gram(records, max(lay.start, 1), lay.start, used)
    return lay.signs * solved_row(gram, lay, records).theta


def plain_row(lay: RowLayout) -> RowLayout:
    """The ARX part of a row."""
    return replace(lay, nc=0, nd=0, nf=(0,) * len(lay.nf))


def shared_poles(lay: RowLayout) -> RowLayout:
    """The ARX row whose A stands for the largest F of an output-error row."""
    na = tuple(max(lay.nf) if j == lay.output else 0 for j in range(len(lay.na)))
    return replace(lay, na=na, nc=0, nd=0, nf=(0,) * len(lay.nf))


def hannan_rissanen(
    records: Sequence[Record], lay: RowLayout, long_errors: Sequence[Array] | None = None
) -> Array:
    """ARMAX row by two regressions: [a…, b…, c]; the first one may be done already."""
    plain = plain_row(lay)
    if long_errors is None:
        long_errors = long_arx_errors(records, plain)
    errors = [
        passing(r.u, np.column_stack([r.y, e]), r.dt)
        for r, e in zip(records, long_errors, strict=True)
    ]
    ny = records[0].ny
    wide = replace(plain, na=(*plain.na, lay.nc))
    theta = arx_row([r.rows(_long_order(records, plain), len(r)) for r in errors], wide)
    n_a = sum(plain.na)
    c = reflected(np.concatenate([[1.0], -theta[n_a : n_a + lay.nc]]))[1:]
    assert wide.na[ny] == lay.nc
    return np.concatenate([theta[:n_a], theta[n_a + lay.nc :], c])


def settled(
    records: Sequence[Record], lay: RowLayout, theta: Array, long_errors: Sequence[Array]
) -> bool:
    """Whether a start leaves nothing to predict, so that no other can lead to a better end.

    Its errors are white, and a long ARX, which has many times the freedom, does not predict
    significantly better (F-test). Short records decide nothing, and searching them costs nothing.
    """
    if sum(len(r) for r in records) < PLENTY:
        return False
    problem = RowErrors(lay, np.arange(lay.n), [(r.u, r.y) for r in records], False)
    with_start = np.split(problem.residual(theta), np.cumsum(problem.lengths)[:-1])
    long = _long_layout(records, plain_row(lay))
    errors = [e[long.start - problem.skipped :] for e in with_start]
    more, free = long.n - lay.n, sum(len(e) for e in errors) - long.n
    if more < 1 or free < 1 or not portmanteau_white(errors):
        return False
    floor = sum(float(e @ e) for e in long_errors)
    excess = sum(float(e @ e) for e in errors) - floor
    return bool(excess / more <= fdtri(more, free, SETTLED) * floor / free)


def _long_order(records: Sequence[Record], lay: RowLayout) -> int:
    """Order of the long ARX: grows with the record, leaves twenty samples a coefficient."""
    n = sum(len(r) for r in records)
    driven = lay.nb[:-1] if lay.constant else lay.nb
    signals = 1 + sum(1 for nb in driven if nb) + sum(1 for na in lay.na if na)
    return int(np.clip(n // (20 * signals), max(lay.start, 2), 3 * max(lay.start, 8)))


def _long_layout(records: Sequence[Record], lay: RowLayout) -> RowLayout:
    order = _long_order(records, lay)
    na = tuple(order if n or j == lay.output else 0 for j, n in enumerate(lay.na))
    nb = tuple(max(order + 1 - nk, nb) if nb else 0 for nb, nk in zip(lay.nb, lay.nk, strict=True))
    if lay.constant:
        nb = (*nb[:-1], lay.nb[-1])
    return replace(plain_row(lay), na=na, nb=nb)


def long_arx_errors(records: Sequence[Record], lay: RowLayout) -> list[Array]:
    """Errors of a long ARX, zero where its regressors reach before the record."""
    return arx_errors(records, _long_layout(records, lay))


def arx_errors(records: Sequence[Record], lay: RowLayout) -> list[Array]:
    """Errors of an ARX row by least squares, zero where its regressors reach before the record."""
    theta = arx_row(records, lay)
    out = []
    for r in records:
        e, terms = np.zeros(len(r)), lay.weighed(theta)
        e[lay.start :] = ne.residual_row((*r.y.T, *r.u.T), lay.start, lay.output, terms)
        out.append(e)
    return out


def long_arx_output(records: Sequence[Record], lay: RowLayout) -> list[Record]:
    """The records with the row's output replaced by the free run of a long ARX (noise gone)."""
    common = shared_poles(lay)
    long = _long_layout(records, common)
    theta = arx_row(records, long)
    a, b, *_ = long.slices()
    A = reflected(np.concatenate([[1.0], theta[a[lay.output]]]))
    out = []
    for r in records:
        drive = np.zeros(len(r))
        for j, s in enumerate(b):
            if s.stop > s.start:
                drive += lfilter(np.concatenate([np.zeros(lay.nk[j]), theta[s]]), [1.0], r.u[:, j])
        y = np.array(r.y)
        y[:, lay.output] = lfilter([1.0], A, drive)
        usable = np.all(np.isfinite(y)) and np.max(np.abs(y)) < 1e6 * np.max(np.abs(r.y))
        out.append(replace(r, y=y) if usable else r)
    return out
