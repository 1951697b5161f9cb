"""Starts of Wiener–Hammerstein models: the poles of the linear approximation, dealt out.

The best linear approximation has the poles of both linear blocks but does not say which belong to
which. So all ways of dealing them out are tried, each with a few simple first numerators; for a
given first block and given poles behind it the rest is a linear least-squares problem (numerator
times spline values, of which the nearest product is taken). Splitting zeros as well was rejected:
such starts get stuck (Schoukens & Tiels 2017, §5.3, compare the ways).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record, shortened
from sysid.structures.blocks.layers import LinearLayer
from sysid.structures.blocks.linear_approximation import input_denominators
from sysid.structures.blocks.static.functions import Static, parse_static
from sysid.structures.blocks.trials import ChainData, Effort, Trial
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.orders import orders_text

BLA_SAMPLES = 40_000
"""Samples that the poles are taken from: they need more than the ranking does."""

FIRST = "spline:5"
"""The static of the ranking fits."""

REAL = 1e-9
"""Imaginary parts below this are rounding."""

USABLE = 1e50
"""Cost from which on a start is not stable, or nearly so."""

SAME = 0.01
"""Poles nearer than this lead to the same fit."""

Poles = NDArray[np.complex128]


def ranked_starts(
    structure: WienerHammerstein, records: Sequence[Record], data: ChainData
) -> list[Trial]:
    """Every deal of the poles with every first numerator, fitted briefly to ``data``."""
    nu, block = structure.nu, structure.linear_blocks[0]
    first = [block.nf[j][j] for j in range(nu)]
    second = [max(row[j] for row in structure.orders.nf) for j in range(nu)]
    degrees = [a + b for a, b in zip(first, second, strict=True)]
    deals: list[list[tuple[Poles, Poles]]] = [[] for _ in range(nu)]
    pools = input_denominators(shortened(records, BLA_SAMPLES), degrees)
    for known, pool, n in zip(deals, pools, first, strict=True):
        for denominator in pool:
            dealt = ways_to_deal(np.roots(denominator).astype(np.complex128), n)
            known += [d for d in dealt if not any(_same(d, k) for k in known)]
    count = max(len(d) for d in deals)
    starts = []
    for k in range(count):
        # with several inputs the k-th deal of each: all combinations would be too many
        dealt_out = [d[k % len(d)] for d in deals]
        for zeros in range(min(3, max(block.nb[j][j] for j in range(nu)))):
            start = _started(structure, dealt_out, zeros, data)
            if start is None:
                continue
            label = f"{orders_text(structure.order_values())}, deal {k + 1}, numerator {zeros}"
            fitted = replace(start, label=label).descended(data, Effort(8))
            if fitted.cost < USABLE:
                starts.append(fitted)
    return starts


def ways_to_deal(poles: Poles, first: int) -> list[tuple[Poles, Poles]]:
    """All ways to give ``first`` poles to the first block, complex pairs kept together.

    Where only a split pair gives that number, the pair of the largest damping ratio becomes two
    real poles: two that lie close together are often seen as such a pair.
    """
    groups: list[Poles] = []
    for z in sorted(poles, key=lambda z: (-abs(z), z.imag)):
        if abs(z.imag) < REAL:
            groups.append(np.array([z.real + 0j]))
        elif z.imag > 0:
            groups.append(np.array([z, np.conj(z)]))
    deals = []
    for taken in product((True, False), repeat=len(groups)):
        dealt_poles = [z for g, t in zip(groups, taken, strict=True) if t for z in g]
        rest = [z for g, t in zip(groups, taken, strict=True) if not t for z in g]
        if len(dealt_poles) == first:
            deals.append((np.array(dealt_poles), np.array(rest)))
    if deals:
        return deals
    best_damped = max((g[0] for g in groups if len(g) == 2), key=_damping)
    paired = np.abs(poles - best_damped) < REAL
    paired |= np.abs(poles - np.conj(best_damped)) < REAL
    return ways_to_deal(np.where(paired, np.abs(poles) + 0j, poles), first)


def _damping(z: complex) -> float:
    """Damping ratio −ln|z| / |ln z| of the pair of a pole z: 1 where it is two equal real poles."""
    log = np.log(complex(z))
    return float(-log.real / abs(log))


def _same(a: tuple[Poles, Poles], b: tuple[Poles, Poles]) -> bool:
    """Whether two deals are the same up to the order of poles."""
    return all(
        len(x) == len(y) and np.allclose(np.sort_complex(x), np.sort_complex(y), atol=SAME)
        for x, y in zip(a, b, strict=True)
    )


def _started(
    structure: WienerHammerstein,
    dealt: Sequence[tuple[Poles, Poles]],
    zeros: int,
    data: ChainData,
) -> Trial | None:
    """The chain with these poles: first block of unit spread, rest by least squares."""
    size = parse_static(FIRST).stages[0].size
    firsts: list[Array] = []
    passed: list[list[Array]] = []
    statics: list[Static] = []
    for j, (poles, _) in enumerate(dealt):
        nb, nf = structure.linear_blocks[0].nb[j][j], structure.linear_blocks[0].nf[j][j]
        B = np.zeros(nb)
        shape = np.atleast_1d(np.real(np.poly(-np.ones(min(zeros, nb - 1)))))
        B[: len(shape)] = shape
        F = np.zeros(nf + 1)
        poly = np.real(np.poly(poles)) if len(poles) else np.ones(1)
        F[: len(poly)] = poly
        v = [lfilter(B, F, r.u[:, j]) for r in data.records]
        spread = float(np.concatenate(v).std())
        if not np.isfinite(spread) or spread <= 0.0:
            return None
        gain = float(np.concatenate([r.u[:, j] for r in data.records]).std()) / spread
        v = [x * gain for x in v]
        joined = np.concatenate([x[kept] for x, kept in zip(v, data.kept, strict=True)])
        knots = np.linspace(joined.min(), joined.max(), size)
        stage = replace(parse_static(FIRST).stages[0], knots=tuple(knots.tolist()))
        statics.append(Static((stage,)))
        firsts.append(np.concatenate([B * gain, F[1:]]))
        passed.append(v)
    with_splines = replace(structure, statics=(tuple(statics),))
    values, second, offsets = _second_block(with_splines, dealt, passed, data)
    return Trial(with_splines, np.concatenate([*firsts, *values, second, offsets]))


def _second_block(
    structure: WienerHammerstein,
    dealt: Sequence[tuple[Poles, Poles]],
    passed: Sequence[Sequence[Array]],
    data: ChainData,
) -> tuple[list[Array], Array, Array]:
    """Spline values of each input, coefficients of the second block, offsets.

    y = Σ_j Σ_km c_jkm φ_m(v_j(t−k))/F_j is linear in c = b ⊗ values; least squares, then the
    nearest product by the singular value decomposition (Bai 1998), shared by all outputs.
    """
    layer = structure.chain.layers[2]
    assert isinstance(layer, LinearLayer)
    tails = [np.real(np.poly(rest)) if len(rest) else np.ones(1) for _, rest in dealt]
    bases = [
        [static.evaluated(x, np.zeros(static.n))[2] for x in v]
        for static, v in zip(structure.statics[0], passed, strict=True)
    ]
    zeros = [s.evaluated(np.zeros(1), np.zeros(s.n))[2] for s in structure.statics[0]]
    filtered = [
        [lfilter([1.0], tail, phi - zero, axis=1) for phi in of_input]
        for tail, of_input, zero in zip(tails, bases, zeros, strict=True)
    ]
    solved = [_products(structure, i, filtered, data) for i in range(structure.ny)]
    offsets = np.array([offset for offset, _ in solved])
    values, numerators = [], {}
    for j in range(structure.nu):
        stacked = np.concatenate([products[j] for _, products in solved])
        U, s, Vt = np.linalg.svd(stacked, full_matrices=False)
        values.append(Vt[0])
        at = 0
        for i in range(structure.ny):
            nb = structure.orders.nb[i][j]
            numerators[i, j] = U[at : at + nb, 0] * s[0]
            at += nb
    second = []
    for i, j in layer.pairs:
        F = np.zeros(structure.orders.nf[i][j])
        tail = tails[j][1 : 1 + len(F)]
        F[: len(tail)] = tail
        second.append(np.concatenate([numerators[i, j], F]))
    return values, np.concatenate(second), offsets


def _products(
    structure: WienerHammerstein, i: int, filtered: Sequence[Sequence[Array]], data: ChainData
) -> tuple[float, list[Array]]:
    """Offset of output i, and of each input the matrix of its products b_k values_m, (nb, m).

    ``filtered`` holds φ_m(v_j)/F_j by input and record, (m, N).
    """
    rows, targets = [], []
    for e, (r, kept) in enumerate(zip(data.records, data.kept, strict=True)):
        columns = [np.ones((1, len(r)))]
        for j in range(structure.nu):
            phi = filtered[j][e]
            for k in range(structure.orders.nb[i][j]):
                lag = structure.orders.nk[i][j] + k
                moved = np.zeros_like(phi)
                moved[:, lag:] = phi[:, : phi.shape[1] - lag] if lag else phi
                columns.append(moved)
        rows.append(np.concatenate(columns)[:, kept])
        targets.append(r.y[kept, i])
    X, t = np.concatenate(rows, axis=1), np.concatenate(targets)
    scale = np.sqrt(np.mean(X**2, axis=1))
    scale[scale == 0.0] = 1.0
    gram = (X / scale[:, None]) @ (X / scale[:, None]).T
    ridge = 1e-8 * np.trace(gram) / len(gram) * np.eye(len(gram))
    c = np.linalg.solve(gram + ridge, (X / scale[:, None]) @ t) / scale
    products, at = [], 1
    for j in range(structure.nu):
        nb, m = structure.orders.nb[i][j], structure.statics[0][j].n
        products.append(c[at : at + nb * m].reshape(nb, m))
        at += nb * m
    return float(c[0]), products
