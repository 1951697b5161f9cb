"""How Hammerstein–Wiener models are fitted.

From the best linear approximation; every static first as a piecewise-linear one, whose shape the
kind that was asked for then takes; then all parameters and initial states together by
Levenberg–Marquardt with exact gradients. Whatever the user left open (orders, statics) is chosen
on held-out samples of the estimation data. A sensor without sign has its signs recovered first.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sysid.data.record import Record, shortened
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.structures.base import Structure
from sysid.structures.blocks.candidates import last_search, preferred
from sysid.structures.blocks.fit import ChainData
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.hammerstein_wiener_trials import (
    PROXY,
    Candidate,
    at_orders,
    fitted_pair,
    grown,
    linear_fit,
    refined,
    reshaped,
    signless,
    uses,
)
from sysid.structures.blocks.static.functions import IDENTITY, Static, parse_static
from sysid.structures.orders import Orders, spread
from sysid.structures.outcome import FitOutcome, InitialGuesses

CHOICE_SAMPLES = 5_000
"""Samples that choose statics and orders; the choice is fitted to all."""

LARGEST_ORDER = 3

INPUT_KINDS = ("dead-zone", "saturation", "dead-zone,saturation", "polynomial:3")
OUTPUT_KINDS = ("saturation", "polynomial:3")
"""Kinds tried in the place of a piecewise-linear static that pays."""

SIGNLESS_KINDS = ("abs", "abs,polynomial:3", "abs,piecewise:4", "abs,piecewise:6")

POOR = 0.5
"""Relative held-out error of the best signed model beyond which a sensor without sign is tried."""

NESTED = 0.98
"""A model whose cost exceeds this share of a smaller one's is searched from the smaller one too."""

ROUGH = 25
"""Evaluations of a descent while choosing."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Choose what is open on held-out samples, then fit it to everything."""
    assert isinstance(structure, HammersteinWiener)
    requested = structure.requested
    plain = structure.resolved(records[0].inputs, records[0].outputs)
    is_open = structure.choose_orders or (requested is not None and any(a.open for a in requested))
    if is_open:
        cut = hold_out(shortened(records, CHOICE_SAMPLES))
        data = ChainData.of(cut.whole, cut.counted)
        tried = list(Chooser(structure, cut.whole, data).candidates())
        best = preferred(tried, data)
    else:
        data = ChainData.of(records)
        tried = list(at_orders(plain, records, data, plain.inputs, plain.outputs))
        best = min(tried, key=lambda c: c.found.cost)
    best = replace(best, structure=replace(best.structure, requested=None, choose_orders=False))
    return last_search(best, tried, records, options, parameters, initial_guesses)


@dataclass(frozen=True, eq=False)
class Chooser:
    """The candidates for what a user left open."""

    structure: HammersteinWiener
    records: Sequence[Record]
    data: ChainData

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
                pair_fit = fitted_pair(base, *pair, self.data, ROUGH)
                if k in before and pair_fit.found.cost > NESTED * before[k].found.cost:
                    # a larger model that fits no better has missed its minimum
                    refitted = grown(before[k], o, self.records, self.data)
                    pair_fit = min(pair_fit, refitted, key=lambda c: c.found.cost)
                before[k] = pair_fit
                seen.append(pair_fit)
                yield pair_fit
        best = preferred(seen, self.data)
        for pair in self._kinds(best):
            yield refined(reshaped(best, *pair, self.data), self.data, ROUGH)
        if min(c.found.holdout_error for c in linear.values()) > POOR and self._open(1):
            for o in orders:
                yield from self._signless(o)

    def _linear(self, orders: Orders) -> Candidate:
        plain = replace(
            self.structure,
            orders=orders,
            inputs=(IDENTITY,) * self.structure.nu,
            outputs=(IDENTITY,) * self.structure.ny,
            requested=None,
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
        requested = self.structure.requested
        return requested is not None and requested[side].open

    def _pairs(
        self, inside: str, outside: str
    ) -> Iterator[tuple[tuple[Static, ...], tuple[Static, ...]]]:
        """All combinations of identity and these kinds where the user left that open."""
        for f in ("identity", inside) if self._open(0) else ("identity",):
            for g in ("identity", outside) if self._open(1) else ("identity",):
                yield self._filled(f, g)

    def _filled(self, f: str, g: str) -> tuple[tuple[Static, ...], tuple[Static, ...]]:
        """Statics of all channels: what was asked, else these kinds."""
        requested = self.structure.requested
        assert requested is not None
        return (
            requested[0].of_channels(self.records[0].inputs, parse_static(f)),
            requested[1].of_channels(self.records[0].outputs, parse_static(g)),
        )

    def _kinds(self, best: Candidate) -> Iterator[tuple[tuple[Static, ...], tuple[Static, ...]]]:
        """Other kinds in the place of the piecewise-linear ones that paid."""
        f = PROXY if self._open(0) and uses(best.structure.inputs) else "identity"
        g = PROXY if self._open(1) and uses(best.structure.outputs) else "identity"
        for kind in INPUT_KINDS if f != "identity" else ():
            yield self._filled(kind, g)
        for kind in OUTPUT_KINDS if g != "identity" else ():
            yield self._filled(f, kind)
        if f != "identity" and g != "identity":
            yield self._filled("polynomial:3", "polynomial:3")

    def _signless(self, orders: Orders) -> Iterator[Candidate]:
        plain = replace(self.structure, orders=orders, requested=None, choose_orders=False)
        inputs, _ = self._filled("identity", "identity")
        if not all(s.is_identity for s in inputs):
            return
        for kind in SIGNLESS_KINDS:
            outputs = self._filled("identity", kind)[1]
            yield from signless(plain, self.records, self.data, inputs, outputs)
