"""Test for feedback with the reference in the log: does a command depend on an output beside it?

What a command takes from the reference is no response to the output. Less that, and only then, even
a command whose reference is white shows what it takes from the measurements. So u(t) is regressed
on the references r, y(t) on all that the plant can know, and the remainders of the two are
correlated:

    u(t) = Σ_{k≥0} g_k r(t−k) + n(t),
    y(t) = Σ_{k≥1} a_k y(t−k) + Σ_{k≥0} b_k u(t−k) + w(t),        c_k = Σ_t Δn(t) w(t−k), k ≥ 1.

In open loop n and w are independent whatever makes n, for n is what the operator adds to the
reference; w is white, so that cov(c_k, c_l) = N σ_w² R_Δn(k−l) (Bartlett), and cᵀ C⁻¹ c ~ χ². A
controller hands each disturbance on as long as the loop needs to suppress it. Differences Δn, since
an integral part remembers the reference longer than there are lags, and slowly. It is not asked
whether u(t) holds w(t): a plant that responds within the sample would look the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.special import chdtrc, fdtrc

from sysid.data.impulse import clipped, correlation, least_squares, regressors
from sysid.data.record import Array, Record

ANSWER = 8
"""Number of samples within which a loop shows a disturbance in its command."""

COPIED = 1e-6
"""Size of the remainder relative to the command's below which the reference explains all of it."""


TIED = 0.01
"""Share of what reference and output explain of the command that their difference may miss."""

SURELY = 1e-6
"""Level of a response to a column that is not used: several columns may be looked at."""

MOSTLY = 0.5
"""Share of what a column adds that its difference to the reference explains at least."""


def with_reference(records: Sequence[Record]) -> list[Record]:
    """The records that have references; none where these are not the same ones.

    Records without one say nothing here; the other tests of feedback look at them.
    """
    kept = [r for r in records if r.references is not None]
    return kept if len({r.reference_names for r in kept}) == 1 else []


def answers_beside_reference(
    records: Sequence[Record], order: int, lags: NDArray[np.int64]
) -> list[list[tuple[float, float]]]:
    """(p-value, share) of each output's response in each input, [output][input].

    The share is that of the command's remainder, 0 … 1.

    Args:
        records: with the same references.
        order: lags of the outputs.
        lags: those of inputs and references, from 0 on, the last one not below ``order``.
    """
    none = [[(1.0, 0.0)] * records[0].nu for _ in records[0].output_names]
    references = [
        replace(r, u=_wished(r), y=r.u, inputs=(), outputs=(), weights=None) for r in records
    ]
    command, total, _ = regressors(references, 0, lags)
    past, output, groups = regressors(records, order, lags)
    free = len(total) - max(command.shape[1], past.shape[1]) - groups
    if free < max(10, past.shape[1] // 2):
        return none
    n, w = (least_squares(X, Y, 1e-10)[1] for X, Y in ((command, total), (past, output)))
    used = [len(r) - int(lags[-1]) for r in records]
    edges = np.cumsum([m for m in used if m > 1])[:-1]
    for j in range(records[0].nu):
        input_innovations = clipped(np.diff(n[:, j], prepend=n[:1, j]))
        if np.std(input_innovations) <= COPIED * np.std(total[:, j]):
            continue
        for i, row in enumerate(none):
            output_innovations = clipped(w[:, i])
            row[j] = _answer(
                np.split(input_innovations, edges), np.split(output_innovations, edges), free
            )
    return none


def followed_difference(records: Sequence[Record], i: int, j: int, order: int) -> str:
    """The reference r of which r − y_i moves the input u_j as well as r and y_i on their own do.

    Empty where there is none, or where r is in another unit than the file's y_i.
    """
    lags = np.arange(max(order, ANSWER) + 1)
    single = [replace(r, u=r.y[:, [i]], y=r.u[:, [j]], outputs=(), weights=None) for r in records]
    past, total, _ = regressors([replace(r, inputs=()) for r in single], int(lags[-1]), lags)
    scale = records[0].outputs[i].scale
    for k, name in enumerate(records[0].reference_names):
        references = [replace(r, u=_wished(r)[:, [k]] * scale, inputs=()) for r in single]
        wish, _, _ = regressors(references, 0, lags)
        command, output = past[:, : lags[-1]], past[:, lags[-1] :]
        apart = np.hstack([command, wish, output])
        together = np.hstack([command, wish - output])
        without, by_both, by_difference = (
            float(np.sum(least_squares(X, total, 1e-10)[1] ** 2))
            for X in (command, apart, together)
        )
        if by_difference - by_both <= TIED * (without - by_both):
            return name
    return ""


def followed_column(records: Sequence[Record], i: int, j: int) -> tuple[str, str, float, float]:
    """The (reference r, unused column c, p value, share of input j) of a loop closed over c.

    An altitude that a thrust holds is such a column where the climb is the output. Beside the past
    of u, r and c move u_j, and r − c does so by most of what c adds: a controller's difference,
    that no plant computes. Past y_i predicts c beside the past of c and u, so that what disturbs
    the output comes back. The names are empty and p is 1 where there is none.
    """
    found = "", "", 1.0, 0.0
    names = records[0].unused_names
    kept = [r for r in records if r.unused is not None and r.unused_names == names]
    if len(kept) < len(records):
        return found
    own, now, before = [r.u[:, [j]] for r in kept], range(1), range(1, ANSWER + 1)
    at_all = range(ANSWER + 1)
    u, past = _lagged(own, now), _lagged(own, before)
    of_y = _lagged([r.y[:, [i]] for r in kept], before)
    of_u = _lagged([r.u for r in kept], at_all)
    wished = np.split(_lagged([_wished(r) for r in kept], at_all), len(at_all), axis=1)
    for k, column in enumerate(names):
        c = _lagged([r.unused[:, [k]] for r in kept if r.unused is not None], at_all)
        if _more(np.hstack([c[:, 1:], of_u]), of_y, c[:, :1])[0] > SURELY / len(names):
            continue
        for m, reference in enumerate(kept[0].reference_names):
            wish = np.column_stack([x[:, m] for x in wished])
            p, share = _more(np.hstack([past, wish]), c, u)
            by_difference, by_reference = (_more(past, x, u)[1] for x in (wish - c, wish))
            tied = 1.0 - by_difference < (1.0 - by_reference) * (1.0 - MOSTLY * share)
            if tied and p * len(names) < min(SURELY, found[2]):
                found = reference, column, p * len(names), share
    return found


def _lagged(parts: Sequence[Array], lags: Sequence[int]) -> Array:
    """The columns of each record at these lags, lag after lag, about their means."""
    rows = [np.hstack([x[ANSWER - k : len(x) - k] for k in lags]) for x in parts if len(x) > ANSWER]
    return np.vstack([x - x.mean(axis=0) for x in rows])


def _more(X: Array, more: Array, y: Array) -> tuple[float, float]:
    """(p-value, share) of what further columns explain of what X leaves of y (N, 1)."""
    without, left = (
        float(np.sum(least_squares(columns, y, 1e-10)[1] ** 2))
        for columns in (X, np.hstack([X, more]))
    )
    q, free = more.shape[1], len(y) - X.shape[1] - more.shape[1]
    if free < X.shape[1] or not left > 0.0:
        return 1.0, 0.0
    gained = max(without - left, 0.0)
    return float(fdtrc(q, free, gained / q / (left / free))), gained / max(without, 1e-300)


def _wished(record: Record) -> Array:
    assert record.references is not None  # as with_reference gives them
    return record.references


def _answer(n: Sequence[Array], w: Sequence[Array], free: int) -> tuple[float, float]:
    """(p-value, share) of cᵀ C⁻¹ c over all records."""
    c = np.sum([correlation(a, b, ANSWER)[1:] for a, b in zip(n, w, strict=True)], axis=0)
    autocorrelation = np.sum([correlation(a, a, ANSWER - 1) for a in n], axis=0)
    samples = sum(map(len, n))
    power = float(sum(b @ b for b in w)) * samples / free
    covariance = toeplitz(autocorrelation) / free * power
    if not power > 0.0:
        return 1.0, 0.0
    value = float(c @ np.linalg.lstsq(covariance, c, rcond=1e-10)[0])
    return float(chdtrc(ANSWER, value)), value / (value + free)
