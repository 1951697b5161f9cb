"""What the fit of a Hammerstein–Wiener model tries.

From the best linear approximation; every static first as a piecewise-linear one, whose shape the
kind that was asked for then takes. Whatever the user left open (orders, statics) is chosen on
held-out samples of the estimation data. A sensor without sign has its signs recovered first.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sysid.data.record import Record
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.linear_approximation import linear_model
from sysid.structures.blocks.sign_recovery import signed_starts
from sysid.structures.blocks.static.functions import IDENTITY, Static, parse_static
from sysid.structures.blocks.trials import ChainData, Effort, Trial, best_start, preferred
from sysid.structures.orders import Orders, spread

CHOICE_SAMPLES = 5_000
"""Samples that choose statics and orders; the choice is fitted to all."""

LARGEST_ORDER = 3

PROXY = parse_static("piecewise:8")
"""What every static is before its kind is settled."""

INPUT_KINDS = ("dead-zone", "saturation", "dead-zone,saturation", "polynomial:3")
OUTPUT_KINDS = ("saturation", "polynomial:3")
"""Kinds tried in the place of a piecewise-linear static that pays."""

SIGNLESS_KINDS = ("abs", "abs,polynomial:3", "abs,piecewise:4", "abs,piecewise:6")

POOR = 0.5
"""Relative held-out error of the best signed model beyond which a sensor without sign is tried."""

NESTED = 0.98
"""A model whose cost exceeds this share of a smaller one's is searched from the smaller one too."""

ROUGH, FULL = Effort(25), Effort(60)
"""Of a descent while choosing, and before the last search."""

Pair = tuple[tuple[Static, ...], tuple[Static, ...]]
"""Statics of the inputs and of the outputs."""


def proposals(
    structure: HammersteinWiener, records: Sequence[Record]
) -> tuple[Trial, Sequence[Trial]]:
    """The trial to fit to everything, what is open chosen on held-out samples, and all trials."""
    if not (structure.choose_orders or structure.is_open(0) or structure.is_open(1)):
        data = ChainData.of(records)
        resolved = structure.resolved(records[0].inputs, records[0].outputs)
        tried = list(_at_orders(resolved, data))
        return min(tried, key=lambda t: t.cost), tried
    data = ChainData.held_out(records, CHOICE_SAMPLES)
    tried = list(_Choice(structure, data).trials())
    return preferred(tried, data), tried


def _at_orders(structure: HammersteinWiener, data: ChainData) -> Iterator[Trial]:
    """Fits of one structure from all its starts."""
    inputs, outputs = structure.statics
    if any(_is_signless(s) for s in outputs):
        yield from _signless(structure.orders, (inputs, outputs), data)
    yield _around(linear_model(structure.orders, data, FULL), (inputs, outputs), data, FULL)
    low = replace(
        structure.orders,
        nb=tuple(tuple(min(n, 1) for n in row) for row in structure.orders.nb),
        nf=tuple(tuple(min(n, 1) for n in row) for row in structure.orders.nf),
    )
    if low != structure.orders:
        small = _around(linear_model(low, data, FULL), (inputs, outputs), data, FULL)
        yield small.with_orders((structure.orders,), data, FULL)


def _around(base: Trial, statics: Pair, data: ChainData, effort: Effort) -> Trial:
    """These statics around a linear model, which is already fitted."""
    if not any(_acts(at) for at in statics):
        return base
    return base.with_statics(statics, data, effort, PROXY)


def _signless(orders: Orders, statics: Pair, data: ChainData) -> Iterator[Trial]:
    """Fits of outputs that start with an absolute value, from recovered signs."""
    inputs, outputs = statics
    plain = parse_static("abs")
    first = tuple(plain if _is_signless(s) else IDENTITY for s in outputs)
    base = HammersteinWiener((orders,), ((IDENTITY,) * len(inputs), first))
    starts = signed_starts(data.records, orders, data.kept, first)
    start = best_start(base, starts, data, FULL)
    if start is not None:
        yield start if statics == base.statics else start.with_statics(statics, data, FULL)


def _acts(statics: Sequence[Static]) -> bool:
    """Whether any of them does something."""
    return not all(s.is_identity for s in statics)


def _is_signless(static: Static) -> bool:
    return bool(static.stages) and static.stages[0].kind == "abs"


@dataclass(frozen=True, eq=False)
class _Choice:
    """The trials for what a user left open."""

    structure: HammersteinWiener
    data: ChainData

    def trials(self) -> Iterator[Trial]:
        """Orders with piecewise-linear statics first, then other kinds at the best orders."""
        orders = [o for o in self._orders() if self._bears(o)] or [self.structure.orders]
        linear = [linear_model(o, self.data, FULL) for o in orders]
        seen: list[Trial] = []
        before: dict[Pair, Trial] = {}
        for base in linear:
            for pair in self._pairs():
                trial = _around(base, pair, self.data, ROUGH)
                smaller = before.get(pair)
                if smaller is not None and trial.cost > NESTED * smaller.cost:
                    # a larger model that fits no better has missed its minimum
                    grown = smaller.with_orders(base.structure.linear_blocks, self.data, FULL)
                    trial = min(trial, grown, key=lambda t: t.cost)
                before[pair] = trial
                seen.append(trial)
                yield trial
        best = preferred(seen, self.data)
        for pair in self._kinds(best):
            yield best.with_statics(pair, self.data, ROUGH)
        if min(base.holdout_error for base in linear) > POOR and self.structure.is_open(1):
            inputs, _ = self._filled()
            if not _acts(inputs):
                for o in orders:
                    for kind in SIGNLESS_KINDS:
                        yield from _signless(o, self._filled(outside=kind), self.data)

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

    def _filled(self, inside: str = "identity", outside: str = "identity") -> Pair:
        """Statics of all channels: what was asked, else these kinds."""
        requested, first = self.structure.requested, self.data.records[0]
        assert requested is not None
        return (
            requested[0].of_channels(first.inputs, parse_static(inside)),
            requested[1].of_channels(first.outputs, parse_static(outside)),
        )

    def _pairs(self) -> Iterator[Pair]:
        """All combinations of identity and a piecewise-linear static where that is open."""
        inside, outside = (
            ("identity", PROXY.text) if self.structure.is_open(place) else ("identity",)
            for place in (0, 1)
        )
        yield from (self._filled(f, g) for f in inside for g in outside)

    def _kinds(self, best: Trial) -> Iterator[Pair]:
        """Other kinds in the place of the piecewise-linear ones that paid."""
        f, g = (
            PROXY.text if self.structure.is_open(place) and _acts(statics) else "identity"
            for place, statics in enumerate(best.structure.statics)
        )
        for kind in INPUT_KINDS if f != "identity" else ():
            yield self._filled(kind, g)
        for kind in OUTPUT_KINDS if g != "identity" else ():
            yield self._filled(f, kind)
        if f != "identity" and g != "identity":
            yield self._filled("polynomial:3", "polynomial:3")
