"""Fits to all estimation data of orders that a search has chosen."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.errors import DataError, ModelError
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.pem import fit
from sysid.estimation.selection.defaults import Grid
from sysid.estimation.selection.orders import SEARCH_TOLERANCE, OrderSearch, search_orders
from sysid.estimation.selection.ranking import Entry
from sysid.estimation.soundness import bounded_run
from sysid.estimation.two_stage import STAGED, inputs_by_reference, marked, whitened
from sysid.fitting.holdout import HoldOut
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.orders import orders_text
from sysid.structures.registry import structure_class

Data = tuple[HoldOut, tuple[bool, ...]]
"""What a structure's search sees, and by output whether it estimates an offset."""

NEXT = 3
"""Orders that are tried where the free run of the best diverges; each costs a fit."""

INSIDE = "The unconstrained fit had an unstable pole; the poles were kept inside the unit circle."

DIVERGES = "{} {} was ahead, but fitted to all data its free run diverges: {} is taken."


@dataclass(frozen=True, eq=False)
class FinalFits:
    """How structures are fitted to all estimation data.

    Attributes:
        beside: structures that nobody named: fitted no further than ranks them.
    """

    facts: LogFacts
    options: FitOptions
    offsets: Offsets
    beside: Container[str] = ()

    def entry(self, name: str, orders: Mapping[str, Any], search: OrderSearch | None) -> Entry:
        """A structure with these orders, or with the next ones where its free run diverges."""
        started = perf_counter()
        model, notes = self._fitted(name, orders)
        if search is not None and not bounded_run(model.structure, model.theta):
            model, search, notes = self._bounded(model, search, notes)
        return Entry(model, search, perf_counter() - started, notes)

    def _fitted(self, name: str, orders: Mapping[str, Any]) -> tuple[Model, tuple[str, ...]]:
        """The fit; for output-error structures a second one with stable poles where it needs it.

        An unstable predictor of OE or BJ cannot even be evaluated on a longer record, so stability
        is part of what the structure means; for ARX and ARMAX it is reported and left to the user.
        """
        options = self.options
        if name in self.beside:
            options = replace(options, tolerance=max(options.precision(), SEARCH_TOLERANCE))
        made = structure_of(name, orders, self.facts.records, options)
        model = fit(made, self.facts, options, detrend=self.offsets)
        # a structure that chooses within itself knows its θ only when it is fitted
        settled = bounded_run(model.structure, model.theta)
        if settled or options.stable or not made.traits.stable_by_meaning:
            return model, ()
        return fit(made, self.facts, replace(options, stable=True), detrend=self.offsets), (INSIDE,)

    def _bounded(
        self, model: Model, search: OrderSearch, notes: tuple[str, ...]
    ) -> tuple[Model, OrderSearch, tuple[str, ...]]:
        """Of the next orders the first whose free run is bounded; where none is, what there was."""
        name, (ahead, *others) = model.structure.name, search.candidates
        for candidate in [c for c in others if c.stable][:NEXT]:
            try:
                instead, said = self._fitted(name, candidate.orders)
            except (DataError, ModelError):
                continue
            if bounded_run(instead.structure, instead.theta):
                rest = [c for c in search.candidates if c is not candidate]
                orders = (orders_text(c.orders) for c in (ahead, candidate))
                note = DIVERGES.format(name, *orders)
                return instead, replace(search, candidates=(candidate, *rest)), (*said, note)
        return model, search, notes

    def without_feedback(
        self, entry: Entry, grids: Mapping[str, Grid], seen: Mapping[str, Data], criterion: str
    ) -> Entry:
        """The entry of a log of a closed loop: where feedback biases its fit that is noted for the
        ranking, and where its inputs were replaced its orders are searched on these, too.

        On the inputs as logged a wrong order may follow the disturbance. The held-out error stays
        that on the inputs as logged, as others have it.
        """
        facts, options = self.facts, self.options
        if entry.search is None or STAGED not in entry.model.provenance.options:
            return replace(entry, model=marked(entry.model, facts, options))
        started, name = perf_counter(), entry.model.structure.name
        data, estimated = seen[name]
        whole = inputs_by_reference(data.whole, options.method)
        if whole is None:
            return entry
        clean = data.same_cuts_of(whitened(whole, entry.model))
        judged = replace(data.same_cuts_of(whole), whole=data.whole)
        model, notes = entry.model, entry.notes
        try:
            search = search_orders(
                name, grids[name], clean, options, criterion, estimated=estimated
            )
            best, *rest = search.candidates
            logged = search_orders(name, [best.orders], judged, options, estimated=estimated).best
            if best.orders != entry.search.best.orders:
                model, notes = self._fitted(name, best.orders)
        except (DataError, ModelError):
            return entry
        search = replace(search, candidates=(replace(best, error=logged.error), *rest))
        model = marked(model, facts, options)
        return Entry(model, search, entry.seconds + perf_counter() - started, notes)


def structure_of(
    name: str, orders: Mapping[str, Any], records: Sequence[Record], options: FitOptions
) -> Structure:
    """A structure with these orders for records' channels."""
    nu, ny = records[0].nu, records[0].ny
    return structure_class(name).from_orders(dict(orders), nu, ny, options.structure_options)
