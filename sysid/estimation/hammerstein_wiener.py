"""How Hammerstein–Wiener models are fitted.

From the best linear approximation; every static first as a piecewise-linear one, whose shape the
kind that was asked for then takes; then all parameters and initial states together by
Levenberg–Marquardt with exact gradients. Whatever the user left open (orders, statics) is chosen
on held-out samples of the estimation data. A sensor without sign has its signs recovered first.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.estimation.bla import linear_starts
from sysid.estimation.block_fit import (
    ChainData,
    Fitted,
    abscissae,
    descend,
    outer_abscissae,
)
from sysid.estimation.block_outcome import finished
from sysid.estimation.holdout import hold_out, shortened
from sysid.estimation.orders import orders_text, tie_margin
from sysid.estimation.search import FitOptions
from sysid.estimation.sign_recovery import signed_starts
from sysid.estimation.static_change import with_statics
from sysid.estimation.strategies import Outcome, Warm
from sysid.structures.base import Parameter
from sysid.structures.hammerstein_wiener import HammersteinWiener
from sysid.structures.model import StartReport
from sysid.structures.orders import Orders, spread
from sysid.structures.static import IDENTITY, Static, parse_static

CHOICE_SAMPLES = 5_000
"""Samples that choose statics and orders; the choice is fitted to all."""

LARGEST_ORDER = 3

PROXY = "piecewise:8"
"""What every static is before its kind is settled."""

INPUT_KINDS = ("dead-zone", "saturation", "dead-zone,saturation", "polynomial:3")
OUTPUT_KINDS = ("saturation", "polynomial:3")
"""Kinds tried in the place of a piecewise-linear static that pays."""

SIGNLESS_KINDS = ("abs", "abs,polynomial:3", "abs,piecewise:4", "abs,piecewise:6")

POOR = 0.5
"""Relative held-out error of the best signed model beyond which a sensor without sign is tried."""

NESTED = 0.98
"""A model whose cost exceeds this share of a smaller one's is searched from the smaller one too."""

ROUGH, FULL = 25, 60
"""Evaluations of a descent while choosing, and before the last search."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One choice of orders and statics with its fit."""

    structure: HammersteinWiener
    found: Fitted
    label: str

    @property
    def n(self) -> int:
        """Number of parameters."""
        return self.structure.chain.n


def fit(
    structure: HammersteinWiener,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> Outcome:
    """Choose what is open on held-out samples, then fit it to everything."""
    asked = structure.asked
    plain = structure.resolved(records[0].inputs, records[0].outputs)
    is_open = structure.choose_orders or (asked is not None and any(a.open for a in asked))
    if is_open:
        cut = hold_out(shortened(records, CHOICE_SAMPLES))
        data = ChainData.of(cut.whole, cut.counted)
        tried = list(Chooser(structure, cut.whole, data, tie_margin(cut.held)).candidates())
        best = preferred(tried, data, tie_margin(cut.held))
    else:
        data = ChainData.of(records)
        tried = list(at_orders(plain, records, data, plain.inputs, plain.outputs))
        best = min(tried, key=lambda c: c.found.cost)
    chosen = replace(best.structure, asked=None, choose_orders=False)
    starts = [(best.label, best.found.theta)]
    starts += [(name, theta) for name, theta in warm if len(theta) == chosen.chain.n]
    reports = tuple(
        StartReport("all", c.label, None, c.found.cost, c.found.evaluations) for c in tried
    )
    return finished(chosen, records, options, parameters, starts, reports)


def preferred(tried: Sequence[Candidate], data: ChainData, margin: float) -> Candidate:
    """Of the models within one standard error of the smallest held-out error that of least BIC.

    Held-out data cannot tell them apart, so the fitted data decide, where a parameter costs ln N.
    """
    limit = (1.0 + margin) * min(c.found.held for c in tried)
    near = [c for c in tried if c.found.held <= limit] or list(tried)
    size = data.samples * len(data.scales)

    def bic(c: Candidate) -> float:
        return float(size * np.log(max(c.found.cost, 1e-300)) + c.n * np.log(size))

    return min(near, key=lambda c: (bic(c), c.found.held))


@dataclass(frozen=True, eq=False)
class Chooser:
    """The candidates for what a user left open."""

    structure: HammersteinWiener
    records: Sequence[Record]
    data: ChainData
    margin: float

    def candidates(self) -> Iterator[Candidate]:
        """Orders with piecewise-linear statics first, then other kinds at the best orders."""
        orders = [o for o in self._orders() if self._bears(o)] or [self.structure.orders]
        seen: list[Candidate] = []
        linear: dict[Orders, Candidate] = {}
        before: dict[int, Candidate] = {}
        for o in orders:
            base = self._linear(o)
            linear[o] = base
            for k, pair in enumerate(self._pairs(PROXY, PROXY)):
                found = fitted_pair(base, *pair, self.data, ROUGH)
                if k in before and found.found.cost > NESTED * before[k].found.cost:
                    # a larger model that fits no better has missed its minimum
                    again = grown(before[k], o, self.records, self.data)
                    found = min(found, again, key=lambda c: c.found.cost)
                before[k] = found
                seen.append(found)
                yield found
        best = preferred(seen, self.data, self.margin)
        for pair in self._kinds(best):
            yield refined(reshaped(best, *pair, self.data), self.data, ROUGH)
        if min(c.found.held for c in linear.values()) > POOR and self._open(1):
            for o in orders:
                yield from self._signless(o)

    def _linear(self, orders: Orders) -> Candidate:
        plain = replace(
            self.structure,
            orders=orders,
            inputs=(IDENTITY,) * self.structure.nu,
            outputs=(IDENTITY,) * self.structure.ny,
            asked=None,
            choose_orders=False,
        )
        return linear_fit(plain, self.records, self.data)

    def _orders(self) -> list[Orders]:
        s = self.structure
        if not s.choose_orders:
            return [s.orders]
        nk = s.orders.value("nk")
        return [
            spread({"nb": n, "nf": n, "nk": nk}, "bf", s.nu, s.ny, s.name)
            for n in range(1, LARGEST_ORDER + 1)
        ]

    def _bears(self, orders: Orders) -> bool:
        """Whether ten samples stand behind every coefficient."""
        per_output = 2 * sum(sum(row) for row in orders.nb) / self.structure.ny
        return self.data.samples >= 10 * (per_output + 16)

    def _open(self, side: int) -> bool:
        asked = self.structure.asked
        return asked is not None and asked[side].open

    def _pairs(
        self, inside: str, outside: str
    ) -> Iterator[tuple[tuple[Static, ...], tuple[Static, ...]]]:
        """All combinations of identity and these kinds where the user left that open."""
        for f in ("identity", inside) if self._open(0) else ("identity",):
            for g in ("identity", outside) if self._open(1) else ("identity",):
                yield self._filled(f, g)

    def _filled(self, f: str, g: str) -> tuple[tuple[Static, ...], tuple[Static, ...]]:
        """Statics of all channels: what was asked, else these kinds."""
        asked = self.structure.asked
        assert asked is not None
        return (
            asked[0].of_channels(self.records[0].inputs, parse_static(f)),
            asked[1].of_channels(self.records[0].outputs, parse_static(g)),
        )

    def _kinds(self, best: Candidate) -> Iterator[tuple[tuple[Static, ...], tuple[Static, ...]]]:
        """Other kinds in the place of the piecewise-linear ones that paid."""
        f = PROXY if self._open(0) and _uses(best.structure.inputs) else "identity"
        g = PROXY if self._open(1) and _uses(best.structure.outputs) else "identity"
        for kind in INPUT_KINDS if f != "identity" else ():
            yield self._filled(kind, g)
        for kind in OUTPUT_KINDS if g != "identity" else ():
            yield self._filled(f, kind)
        if f != "identity" and g != "identity":
            yield self._filled("polynomial:3", "polynomial:3")

    def _signless(self, orders: Orders) -> Iterator[Candidate]:
        plain = replace(self.structure, orders=orders, asked=None, choose_orders=False)
        inputs, _ = self._filled("identity", "identity")
        if not all(s.is_identity for s in inputs):
            return
        for kind in SIGNLESS_KINDS:
            outputs = self._filled("identity", kind)[1]
            yield from signless(plain, self.records, self.data, inputs, outputs)


def _uses(statics: Sequence[Static]) -> bool:
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
        asked=None,
        choose_orders=False,
    )
    names = [p.name for p in plain.parameters(records[0].inputs, records[0].outputs)]
    found = []
    for _, values in linear_starts(records, structure.orders):
        theta = np.array([values.get(n, 0.0) for n in names])
        found.append(descend(plain.chain, theta, data, evaluations=FULL))
    best = min(found, key=lambda f: f.cost)
    return Candidate(plain, best, _label(plain))


def fitted_pair(
    base: Candidate,
    inputs: tuple[Static, ...],
    outputs: tuple[Static, ...],
    data: ChainData,
    evaluations: int,
) -> Candidate:
    """These statics around the linear block of ``base``: first piecewise linear, then as asked."""
    if not _uses(inputs) and not _uses(outputs):
        return base
    proxy = parse_static(PROXY)
    stand_ins = [
        tuple(s if s.is_identity else proxy for s in side) for side in (inputs, outputs)
    ]
    now = reshaped(base, *(stand_ins[0], stand_ins[1]), data)
    if (inputs, outputs) != (stand_ins[0], stand_ins[1]):
        fixed = abscissae(now.structure.chain)
        found = descend(
            now.structure.chain, now.found.p, data, evaluations=evaluations, held_entries=fixed
        )
        now = reshaped(replace(now, found=found), inputs, outputs, data)
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
    channels = records[0].inputs, records[0].outputs
    structure = replace(small.structure, orders=orders)
    known = dict(
        zip(
            [p.name for p in small.structure.parameters(*channels)],
            small.found.theta.tolist(),
            strict=True,
        )
    )
    theta = np.array([known.get(p.name, 0.0) for p in structure.parameters(*channels)])
    p = data.with_states(structure.chain, theta)
    start = replace(small.found, chain=structure.chain, p=p)
    return refined(Candidate(structure, start, _label(structure)), data, FULL)


def refined(start: Candidate, data: ChainData, evaluations: int) -> Candidate:
    """All parameters together, points of piecewise-linear statics last."""
    chain = start.structure.chain
    fixed = abscissae(chain)
    found = descend(chain, start.found.p, data, evaluations=evaluations, held_entries=fixed)
    if fixed:
        inner = outer_abscissae(chain)
        moved = descend(chain, found.p, data, evaluations=evaluations, held_entries=inner)
        # points may wander after noise: keep them where that does not help on held-out samples
        if not moved.held > found.held:
            found = moved
    return replace(start, found=found)


def reshaped(
    base: Candidate, inputs: tuple[Static, ...], outputs: tuple[Static, ...], data: ChainData
) -> Candidate:
    """Other statics that follow those of ``base`` as well as they can, before any descent."""
    found = with_statics(base.found, 0, inputs, data)
    found = with_statics(found, 2, outputs, data)
    structure = base.structure.with_chain(found.chain)
    return Candidate(structure, found, _label(structure))


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
        asked=None,
        choose_orders=False,
    )
    names = [p.name for p in base.parameters(records[0].inputs, records[0].outputs)]
    found: list[Fitted] = []
    for values in signed_starts(records, structure.orders, data.kept, first):
        theta = np.array([values.get(n, 0.0) for n in names])
        found.append(descend(base.chain, theta, data, evaluations=FULL))
    if not found:
        return
    best = min(found, key=lambda f: f.cost)
    start = Candidate(base, best, _label(base))
    if (inputs, outputs) == (base.inputs, base.outputs):
        yield start
        return
    yield refined(reshaped(start, inputs, outputs, data), data, FULL)


def _label(s: HammersteinWiener) -> str:
    ins = " ".join(dict.fromkeys(f.text for f in s.inputs))
    outs = " ".join(dict.fromkeys(g.text for g in s.outputs))
    orders = {n: s.orders.value(n) for n in s.order_names}
    return f"{orders_text(orders)}, input {ins}, output {outs}"
