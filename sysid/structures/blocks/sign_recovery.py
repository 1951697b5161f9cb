"""Sensors without sign, y = |w|: the signs recovered by re-assigning them to a linear model.

Alternate between an ARX model of sign·(y − y_min) and the signs of its one-step predictions, from
the signs of the input behind several first-order lags; the errors in the sign of small values
matter little, and a joint fit of the whole chain follows.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.structures.blocks.linear_approximation import linear_starts
from sysid.structures.blocks.static.functions import Static
from sysid.structures.linear.output_error import reflected
from sysid.structures.orders import Orders

LAGS = (0.0, 0.3, 0.6, 0.8, 0.9, 0.97)
"""Poles of the lags behind which the input gives the first signs."""

ROUNDS = 30

POLE_LIMIT = 0.99


def signed_starts(
    records: Sequence[Record],
    orders: Orders,
    kept: Sequence[NDArray[np.bool_]],
    outputs: Sequence[Static],
) -> Iterator[dict[str, float]]:
    """Starting values by parameter name, one for each first guess of the signs.

    Args:
        orders: nb, nf, nk of the linear block.
        kept: samples that may be looked at.
        outputs: ``abs`` where an output has no sign, identity elsewhere.
    """
    single = records[0].nu == 1 and records[0].ny == 1
    plain = (
        dict(linear_starts(records, orders)[0][1]) if any(s.is_identity for s in outputs) else {}
    )
    for lag in LAGS:
        starts = dict(plain)
        for i, static in enumerate(outputs):
            if static.is_identity:
                continue
            # the lowest measurement is the sensor's zero
            zero = min(float(r.y[k, i].min()) for r, k in zip(records, kept, strict=True))
            A, B, offset = recovered(
                [r.u for r in records],
                [r.y[:, i] - zero for r in records],
                kept,
                max(orders.nf[i]),
                list(zip(orders.nk[i], orders.nb[i], strict=True)),
                lag,
            )
            out = records[0].output_names[i]
            for j, name in enumerate(records[0].input_names):
                tag = "" if single else f"[{out},{name}]"
                first = orders.nk[i][j]
                starts |= {f"b{first + k}{tag}": float(b) for k, b in enumerate(B[j])}
                tail = np.zeros(orders.nf[i][j])
                tail[: len(A) - 1] = A[1 : 1 + len(tail)]
                starts |= {f"f{k}{tag}": float(f) for k, f in enumerate(tail, 1)}
            tag = "" if single else f"[{out}]"
            starts[f"output.c{tag}"] = -offset / max(float(A.sum()), 1e-6)
            starts[f"y0{tag}"] = zero
        yield starts


def recovered(
    inputs: Sequence[Array],
    sizes: Sequence[Array],
    kept: Sequence[NDArray[np.bool_]],
    n: int,
    numerators: Sequence[tuple[int, int]],
    lag: float,
) -> tuple[Array, list[Array], float]:
    """(A, B of each input, offset) of the ARX model of ±y that keeps its signs.

    Args:
        inputs: u of each record, (N, nu).
        sizes: measurements without sign, (N,).
        kept: samples that may be looked at, (N,).
        n: order of A.
        numerators: (delay, coefficients) of B of each input.
        lag: pole of the lag behind which the input gives the first signs.
    """
    terms = [(j, k) for j, (nk, nb) in enumerate(numerators) for k in range(nk, nk + nb)]
    first = max([n, *(k for _, k in terms)])
    drives = [
        lfilter([1.0 - lag], [1.0, -lag], u - u.mean(axis=0), axis=0).sum(axis=1) for u in inputs
    ]
    signs = [np.where(d >= 0.0, 1.0, -1.0) for d in drives]
    theta = np.zeros(n + len(terms) + 1)
    for _ in range(ROUNDS):
        grams, rights, regressors = [], [], []
        for u, y, s, mask in zip(inputs, sizes, signs, kept, strict=True):
            z = s * y
            m = len(z)
            rows = [-z[first - k : m - k] for k in range(1, n + 1)]
            rows += [u[first - k : m - k, j] for j, k in terms]
            phi = np.array([*rows, np.ones(max(m - first, 0))])
            use = phi[:, mask[first:]]
            grams.append(use @ use.T)
            rights.append(use @ z[first:][mask[first:]])
            regressors.append(phi)
        theta = np.linalg.lstsq(sum(grams), sum(rights), rcond=1e-10)[0]
        new = []
        for s, phi in zip(signs, regressors, strict=True):
            flipped = s.copy()
            flipped[first:] = np.where(theta @ phi >= 0.0, 1.0, -1.0)
            new.append(flipped)
        if all(np.array_equal(a, b) for a, b in zip(new, signs, strict=True)):
            break
        signs = new
    A = reflected(np.concatenate([[1.0], theta[:n]]), POLE_LIMIT)
    B = np.split(theta[n:-1], np.cumsum([nb for _, nb in numerators])[:-1])
    return A, list(B), float(theta[-1])
