"""Fits of one Hammerstein–Wiener structure: from its best linear approximation to all at once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from sysid.data.record import Record
from sysid.structures.blocks import candidates
from sysid.structures.blocks.bla import linear_starts
from sysid.structures.blocks.changed_statics import with_statics
from sysid.structures.blocks.fit import (
    ChainData,
    abscissae,
    descend,
)
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.sign_recovery import signed_starts
from sysid.structures.blocks.static.functions import IDENTITY, Static, parse_static
from sysid.structures.orders import Orders, orders_text

PROXY = "piecewise:8"
"""What every static is before its kind is settled."""

FULL = 60
"""Evaluations of a descent before the last search."""


Candidate = candidates.Candidate[HammersteinWiener]


def uses(statics: Sequence[Static]) -> bool:
    """Whether any of them does something."""
    return not all(s.is_identity for s in statics)


def at_orders(
    structure: HammersteinWiener,
    records: Sequence[Record],
    data: ChainData,
    inputs: tuple[Static, ...],
    outputs: tuple[Static, ...],
) -> Iterator[Candidate]:
    """Fits of one structure from all its starts."""
    if any(s.stages and s.stages[0].kind == "abs" for s in outputs):
        yield from signless(structure, records, data, inputs, outputs)
    full = fitted_pair(linear_fit(structure, records, data), inputs, outputs, data, FULL)
    yield full
    low = replace(structure, orders=_first_order(structure.orders))
    if low.orders != structure.orders:
        small = fitted_pair(linear_fit(low, records, data), inputs, outputs, data, FULL)
        yield grown(small, structure.orders, records, data)


def linear_fit(
    structure: HammersteinWiener, records: Sequence[Record], data: ChainData
) -> Candidate:
    """The best linear approximation with these orders: the chain with all statics identities."""
    plain = replace(
        structure,
        inputs=(IDENTITY,) * structure.nu,
        outputs=(IDENTITY,) * structure.ny,
        requested=None,
        choose_orders=False,
    )
    starts = [values for _, values in linear_starts(records, structure.orders)]
    best = candidates.best_start(plain, starts, records, data, FULL)
    assert best is not None  # ARX always gives a start
    return Candidate(plain, best, _label(plain))


def fitted_pair(
    base: Candidate,
    inputs: tuple[Static, ...],
    outputs: tuple[Static, ...],
    data: ChainData,
    evaluations: int,
) -> Candidate:
    """These statics around the linear block of ``base``: first piecewise linear, then as asked."""
    if not uses(inputs) and not uses(outputs):
        return base
    proxy = parse_static(PROXY)
    stand_ins = [tuple(s if s.is_identity else proxy for s in side) for side in (inputs, outputs)]
    now = reshaped(base, *(stand_ins[0], stand_ins[1]), data)
    if (inputs, outputs) != (stand_ins[0], stand_ins[1]):
        fixed = abscissae(now.structure.chain)
        solution = descend(
            now.structure.chain, now.found.p, data, evaluations=evaluations, fixed_entries=fixed
        )
        now = reshaped(replace(now, found=solution), inputs, outputs, data)
    return refined(now, data, evaluations)


def _first_order(orders: Orders) -> Orders:
    """At most one pole and one numerator coefficient for each pair."""
    return replace(
        orders,
        nb=tuple(tuple(min(n, 1) for n in row) for row in orders.nb),
        nf=tuple(tuple(min(n, 1) for n in row) for row in orders.nf),
    )


def grown(
    small: Candidate, orders: Orders, records: Sequence[Record], data: ChainData
) -> Candidate:
    """The statics of a model of lower order, and its linear block with further coefficients."""
    structure = replace(small.structure, orders=orders)
    theta = candidates.by_names(structure, small.values(records), records)
    p = data.with_states(structure.chain, theta)
    start = replace(small.found, chain=structure.chain, p=p)
    return refined(Candidate(structure, start, _label(structure)), data, FULL)


def refined(start: Candidate, data: ChainData, evaluations: int) -> Candidate:
    """All parameters together, points of piecewise-linear statics last."""
    solution = candidates.points_last(start.found, data, evaluations)
    return replace(start, found=solution)


def reshaped(
    base: Candidate, inputs: tuple[Static, ...], outputs: tuple[Static, ...], data: ChainData
) -> Candidate:
    """Other statics that follow those of ``base`` as well as they can, before any descent."""
    chain_and_theta = with_statics(base.found, 0, inputs, data)
    chain_and_theta = with_statics(chain_and_theta, 2, outputs, data)
    structure = base.structure.with_chain(chain_and_theta.chain)
    return Candidate(structure, chain_and_theta, _label(structure))


def signless(
    structure: HammersteinWiener,
    records: Sequence[Record],
    data: ChainData,
    inputs: tuple[Static, ...],
    outputs: tuple[Static, ...],
) -> Iterator[Candidate]:
    """Fits of outputs that start with an absolute value, from recovered signs."""
    plain = parse_static("abs")
    first = tuple(plain if s.stages and s.stages[0].kind == "abs" else IDENTITY for s in outputs)
    base = replace(
        structure,
        inputs=(IDENTITY,) * structure.nu,
        outputs=first,
        requested=None,
        choose_orders=False,
    )
    starts = signed_starts(records, structure.orders, data.kept, first)
    best = candidates.best_start(base, starts, records, data, FULL)
    if best is None:
        return
    start = Candidate(base, best, _label(base))
    if (inputs, outputs) == (base.inputs, base.outputs):
        yield start
        return
    yield refined(reshaped(start, inputs, outputs, data), data, FULL)


def _label(s: HammersteinWiener) -> str:
    ins = " ".join(dict.fromkeys(f.text for f in s.inputs))
    outs = " ".join(dict.fromkeys(g.text for g in s.outputs))
    orders = {n: s.orders.value(n) for n in s.traits.order_names}
    return f"{orders_text(orders)}, input {ins}, output {outs}"
