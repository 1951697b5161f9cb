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
from scipy.special import chdtrc

from sysid.data.impulse import clipped, correlation, least_squares, regressors
from sysid.data.record import Array, Record

ANSWER = 8
"""Number of samples within which a loop shows a disturbance in its command."""

COPIED = 1e-6
"""Size of the remainder relative to the command's below which the reference explains all of it."""


TIED = 0.01
"""Share of what reference and output explain of the command that their difference may miss."""


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
