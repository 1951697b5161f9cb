"""How Wiener–Hammerstein models are fitted.

The best linear approximation has the poles of both linear blocks but does not say which belong to
which. So all ways of dealing them out are tried, each with a few simple first numerators; for a
given first block and given poles behind it the rest is a linear least-squares problem (numerator
times spline values, of which the nearest product is taken). Short fits rank them, the best few are
fitted longer, and the winner grows in samples and in intervals of its spline. Splitting zeros as
well was rejected: such starts get stuck (Schoukens & Tiels 2017, §5.3, compare the ways).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid.data.record import Array, Record
from sysid.estimation.bla import input_denominators
from sysid.estimation.block_fit import ChainData, Fitted, abscissae, descend, outer_abscissae
from sysid.estimation.block_outcome import finished
from sysid.estimation.holdout import hold_out, shortened
from sysid.estimation.orders import orders_text, tie_margin
from sysid.estimation.search import FitOptions
from sysid.estimation.static_change import with_statics
from sysid.estimation.strategies import Outcome, Warm
from sysid.structures.base import Parameter
from sysid.structures.block_chain import LinearLayer
from sysid.structures.model import StartReport
from sysid.structures.static import Static, parse_static
from sysid.structures.wiener_hammerstein import WienerHammerstein

SHORT, MIDDLE, LONG = 2_500, 10_000, 40_000
"""Samples of the fits that rank, that choose and that settle; the last search sees all."""

FIRST = "spline:5"
"""The static of the ranking fits."""

GROWTH = (8, 12, 18, 26)
"""Points of the splines tried after it."""

KINDS = ("dead-zone", "saturation", "saturation-upper", "saturation-lower", "polynomial:3")
"""Kinds tried in the place of the spline."""

RANKED, CHOSEN = 8, 2
"""Starts fitted longer, and of these those that are settled."""

TOTALS = (2, 4, 6)
"""Poles of the best linear approximation tried when no orders are given."""

PAYS = 0.99
"""A finer spline must lower the held-out error below this share."""

Poles = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One start or model."""

    structure: WienerHammerstein
    found: Fitted
    label: str


def fit(
    structure: WienerHammerstein,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> Outcome:
    """Rank the ways of dealing the poles out, fit the best ones, grow the winner."""
    plain = replace(structure.resolved(records[0].inputs), asked=None, choose_orders=False)
    open_static = structure.asked is None or structure.asked.open
    short, middle, settled = (_held_out(records, n) for n in (SHORT, MIDDLE, LONG))
    tried: list[Candidate] = []
    for orders in _orders(structure):
        tried += _ranked(orders, records, short)
    if structure.choose_orders:
        kept = _best_of_each_size(tried)
    else:
        kept = sorted(tried, key=lambda c: c.found.cost)[:RANKED]
    longer = [_moved(c, middle, 25) for c in kept]
    longer.sort(key=lambda c: c.found.held)
    models = [_moved(c, settled, 40) for c in longer[:CHOSEN]]
    best = min(models, key=lambda c: c.found.held)
    if open_static:
        best, more = _grown(best, settled)
    else:
        best = _as_asked(best, plain.statics, settled)
        more = [best]
    starts = [(best.label, best.found.theta)]
    starts += [(name, theta) for name, theta in warm if len(theta) == best.structure.chain.n]
    reports = tuple(
        StartReport("all", c.label, None, c.found.cost, c.found.evaluations)
        for c in (*tried, *longer, *models, *more)
    )
    return finished(best.structure, records, options, parameters, starts, reports)


@dataclass(frozen=True, eq=False)
class Part:
    """Part of the data with its hold-out."""

    records: tuple[Record, ...]
    data: ChainData
    margin: float


def _held_out(records: Sequence[Record], samples: int) -> Part:
    cut = hold_out(shortened(records, samples))
    return Part(cut.whole, ChainData.of(cut.whole, cut.counted), tie_margin(cut.held))


def _orders(structure: WienerHammerstein) -> Iterator[WienerHammerstein]:
    """The structures whose poles are dealt out: as given, or of several sizes."""
    plain = replace(structure, asked=None, choose_orders=False)
    if not structure.choose_orders:
        yield plain
        return
    nk = structure.orders.value("nk")
    for total in TOTALS:
        for first in range(1, total):
            second = total - first
            yield WienerHammerstein.from_orders(
                {"nb1": first + 1, "nf1": first, "nb": second + 1, "nf": second, "nk": nk},
                structure.nu,
                structure.ny,
            )


def _best_of_each_size(tried: Sequence[Candidate]) -> list[Candidate]:
    """The best few of every total order."""
    sizes: dict[int, list[Candidate]] = {}
    for c in sorted(tried, key=lambda c: c.found.cost):
        sizes.setdefault(c.structure.chain.n, []).append(c)
    return [c for group in sizes.values() for c in group[: RANKED // 2]]


def _ranked(
    structure: WienerHammerstein, records: Sequence[Record], part: Part
) -> list[Candidate]:
    """Every deal of the poles with every first numerator, fitted briefly."""
    nu = structure.nu
    first = [structure.first.nf[j][j] for j in range(nu)]
    second = [max(row[j] for row in structure.orders.nf) for j in range(nu)]
    pools = input_denominators(
        shortened(records, LONG), [a + b for a, b in zip(first, second, strict=True)]
    )
    deals = [
        list(_deals(np.roots(pool), a)) for pool, a in zip(pools, first, strict=True)
    ]
    count = max(len(d) for d in deals)
    found = []
    for k in range(count):
        # with several inputs the k-th deal of each: all combinations would be too many
        dealt = [d[k % len(d)] for d in deals]
        for zeros in range(min(3, max(structure.first.nb[j][j] for j in range(nu)))):
            start = _started(structure, dealt, zeros, part.data)
            if start is None:
                continue
            label = f"{_orders_text(structure)}, deal {k + 1}, numerator {zeros}"
            fitted = descend(start[0].chain, start[1], part.data, evaluations=8)
            if np.isfinite(fitted.cost) and fitted.cost < 1e50:
                found.append(Candidate(start[0].with_chain(fitted.chain), fitted, label))
    return found


def _deals(poles: Poles, first: int) -> Iterator[tuple[Poles, Poles]]:
    """All ways to give ``first`` poles to the first block, complex pairs kept together."""
    groups: list[Poles] = []
    for z in sorted(poles, key=lambda z: (-abs(z), z.imag)):
        if abs(z.imag) < 1e-9:
            groups.append(np.array([z.real + 0j]))
        elif z.imag > 0:
            groups.append(np.array([z, np.conj(z)]))
    for taken in product((True, False), repeat=len(groups)):
        mine = [z for g, t in zip(groups, taken, strict=True) if t for z in g]
        rest = [z for g, t in zip(groups, taken, strict=True) if not t for z in g]
        # where a pair cannot be split to the wanted number, the block gets one pole fewer
        if len(mine) in (first, first - 1) and (len(mine) == first or not _exact(groups, first)):
            yield np.array(mine), np.array(rest)


def _exact(groups: Sequence[Poles], wanted: int) -> bool:
    """Whether some choice of groups has exactly that many poles."""
    return any(
        sum(len(g) for g, t in zip(groups, taken, strict=True) if t) == wanted
        for taken in product((True, False), repeat=len(groups))
    )


def _started(
    structure: WienerHammerstein,
    dealt: Sequence[tuple[Poles, Poles]],
    zeros: int,
    data: ChainData,
) -> tuple[WienerHammerstein, Array] | None:
    """The chain with these poles: first block of unit spread, rest by least squares."""
    size = parse_static(FIRST).stages[0].size
    firsts: list[Array] = []
    passed: list[list[Array]] = []
    statics: list[Static] = []
    for j, (mine, _) in enumerate(dealt):
        nb, nf = structure.first.nb[j][j], structure.first.nf[j][j]
        B = np.zeros(nb)
        shape = np.atleast_1d(np.real(np.poly(-np.ones(min(zeros, nb - 1)))))
        B[: len(shape)] = shape
        F = np.zeros(nf + 1)
        poly = np.real(np.poly(mine)) if len(mine) else np.ones(1)
        F[: len(poly)] = poly
        v = [lfilter(B, F, u[:, j]) for u, _ in data.data]
        spread = float(np.concatenate(v).std())
        if not np.isfinite(spread) or spread <= 0.0:
            return None
        gain = float(np.concatenate([u[:, j] for u, _ in data.data]).std()) / spread
        v = [x * gain for x in v]
        joined = np.concatenate(v)
        knots = np.linspace(joined.min(), joined.max(), size)
        stage = replace(parse_static(FIRST).stages[0], knots=tuple(knots.tolist()))
        statics.append(Static((stage,)))
        firsts.append(np.concatenate([B * gain, F[1:]]))
        passed.append(v)
    named = replace(structure, statics=tuple(statics))
    values, second, offsets = _second_block(named, dealt, passed, data)
    theta = np.concatenate([*firsts, *values, second, offsets])
    return named, theta


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
    nu, ny = structure.nu, structure.ny
    tails = []
    for _, rest in dealt:
        tails.append(np.real(np.poly(rest)) if len(rest) else np.ones(1))
    products: list[list[Array]] = [[np.zeros((0, 0))] * nu for _ in range(ny)]
    offsets = np.zeros(ny)
    bases = [
        [static.evaluated(x, np.zeros(static.n))[2] for x in v]
        for static, v in zip(structure.statics, passed, strict=True)
    ]
    zeros = [s.evaluated(np.zeros(1), np.zeros(s.n))[2] for s in structure.statics]
    for i in range(ny):
        rows, targets = [], []
        for e, (_, y) in enumerate(data.data):
            columns = [np.ones((1, len(y)))]
            for j in range(nu):
                phi = lfilter([1.0], tails[j], bases[j][e] - zeros[j], axis=1)
                for k in range(structure.orders.nb[i][j]):
                    lag = structure.orders.nk[i][j] + k
                    moved = np.zeros_like(phi)
                    moved[:, lag:] = phi[:, : phi.shape[1] - lag] if lag else phi
                    columns.append(moved)
            rows.append(np.concatenate(columns)[:, data.kept[e]])
            targets.append(y[data.kept[e], i])
        X, t = np.concatenate(rows, axis=1), np.concatenate(targets)
        scale = np.sqrt(np.mean(X**2, axis=1))
        scale[scale == 0.0] = 1.0
        gram = (X / scale[:, None]) @ (X / scale[:, None]).T
        ridge = 1e-8 * np.trace(gram) / len(gram) * np.eye(len(gram))
        c = np.linalg.solve(gram + ridge, (X / scale[:, None]) @ t) / scale
        offsets[i] = c[0]
        at = 1
        for j in range(nu):
            nb, m = structure.orders.nb[i][j], structure.statics[j].n
            products[i][j] = c[at : at + nb * m].reshape(nb, m)
            at += nb * m
    values, numerators = [], {}
    for j in range(nu):
        stacked = np.concatenate([products[i][j] for i in range(ny)])
        U, s, Vt = np.linalg.svd(stacked, full_matrices=False)
        values.append(Vt[0])
        at = 0
        for i in range(ny):
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


def _moved(c: Candidate, part: Part, evaluations: int, tolerance: float = 1e-5) -> Candidate:
    """The same model fitted to other data."""
    found = descend(
        c.found.chain,
        c.found.theta,
        part.data,
        evaluations=evaluations,
        held_entries=abscissae(c.found.chain),
        tolerance=tolerance,
    )
    return replace(c, found=found)


def _with_static(c: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """Another static that follows the present one, then fitted; points move last."""
    changed = with_statics(c.found, 1, statics, part.data)
    fixed = abscissae(changed.chain)
    found = descend(
        changed.chain, changed.p, part.data, evaluations=40, held_entries=fixed, tolerance=1e-5
    )
    if fixed:
        inner = outer_abscissae(changed.chain)
        moved = descend(
            found.chain, found.p, part.data, evaluations=40, held_entries=inner, tolerance=1e-5
        )
        if not moved.held > found.held:
            found = moved
    texts = ", ".join(dict.fromkeys(s.text for s in statics))
    structure = c.structure.with_chain(found.chain)
    return Candidate(structure, found, f"{_orders_text(structure)}, static {texts}")


def _grown(best: Candidate, part: Part) -> tuple[Candidate, list[Candidate]]:
    """Finer splines as long as they pay, then simpler kinds that do as well."""
    nu = best.structure.nu
    tried = []
    for size in GROWTH:
        finer = _with_static(best, [parse_static(f"spline:{size}")] * nu, part)
        tried.append(finer)
        if finer.found.held > PAYS * best.found.held:
            break
        best = finer
    limit = (1.0 + part.margin) * best.found.held
    for kind in KINDS:
        other = _with_static(best, [parse_static(kind)] * nu, part)
        tried.append(other)
        if other.found.held <= limit and other.structure.chain.n < best.structure.chain.n:
            best = other
    return best, tried


def _as_asked(best: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """The statics the user asked for, by way of a finer spline."""
    finer = [s if s.is_identity else parse_static(f"spline:{GROWTH[0]}") for s in statics]
    return _with_static(_with_static(best, finer, part), statics, part)


def _orders_text(s: WienerHammerstein) -> str:
    return orders_text(s.order_values())
