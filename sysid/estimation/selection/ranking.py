"""Rank fitted structures, and say why the first leads."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.criteria import table
from sysid.criteria.information import information_criteria, loss_of, on_common_samples
from sysid.data.record import Record
from sysid.estimation.robust_fit import judged_errors
from sysid.estimation.selection.orders import OrderSearch
from sysid.estimation.soundness import bounded_run, doubts_about, excess, leader
from sysid.fitting.options import FitOptions
from sysid.methods.held_out_error import free_run_error
from sysid.structures.model import Model
from sysid.structures.orders import orders_text

IN_LOOP = (
    "Judged one step ahead, because the log was recorded in closed loop: there the free run is "
    "biased in favour of models without noise model (oe)."
)

DRIFTED = (
    "Judged one step ahead, because a level drifts or a drift was taken out: in free run a model "
    "that follows it, or what is left of it, by slow modes of its own would err least."
)

FOLLOWS = 1.5
"""A model whose free run over all data errs by more than so many times the best one's does not
lead: its search saw a good fit that the fit to all data did not find again."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One structure's model and how its orders were found.

    Attributes:
        model: fitted to all estimation data.
        search: the order search, or None when the orders were given.
        seconds: time of search and fit.
        notes: what was changed on the way, for the user.
    """

    model: Model
    search: OrderSearch | None
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def error(self) -> float | None:
        """Free-run error on the held-out part of the estimation data, relative to its spread."""
        return None if self.search is None else self.search.best.error


@dataclass(frozen=True, eq=False)
class StructureRanking:
    """Entries, the leading one first, and what put it there.

    Attributes:
        sound: those that may lead.
        margin: fraction within which held-out errors tie.
        rule: the criterion that ranks where no held-out error does.
        tied: those whose held-out errors tie with the smallest, the one that leads first.
        passed: an entry that would lead, had it nothing against it.
        one_step: whether held-out samples were judged one step ahead, not in free run.
    """

    entries: tuple[Entry, ...]
    sound: tuple[Entry, ...]
    margin: float
    rule: str
    tied: tuple[Entry, ...] = ()
    passed: Entry | None = None
    one_step: bool = False


def ranked_entries(
    entries: Sequence[Entry],
    records: Sequence[Record],
    options: FitOptions,
    criterion: str,
    margin: float,
    one_step: bool = False,
) -> StructureRanking:
    """Entries by held-out error; of those within ``margin`` of the best the smallest leads.

    Free runs of different structures tie more often than not: of those within one standard error
    the one with the fewest parameters is taken (Breiman et al. 1984, §3.4.3), and the lowest BIC of
    equally many. Under an information criterion that one ranks alone. Of those that tie, one that
    settles and whose search has ended is taken before others. Models that cannot lead come last:
    those whose free run is unbounded, and those whose fit to all data follows them much worse than
    another one does. ``one_step``: held-out samples were judged one step ahead, as data of a closed
    loop, or with what is left of a drift, have to be.
    """
    counted = [np.ones(len(r), dtype=bool) for r in records]
    follows = [
        free_run_error(
            e.model.structure,
            e.model.theta,
            [e.model.detrend.remove(r) for r in records],
            counted,
            options.robust,
            one_step=one_step,
        )
        for e in entries
    ]
    limit = FOLLOWS * min(follows)
    following = [e for e, error in zip(entries, follows, strict=True) if error <= limit]
    bounded = [e for e in following if bounded_run(e.model.structure, e.model.theta)]
    sound = bounded or following or list(entries)
    searched = all(e.error is not None for e in entries)
    of_free_run = table.criterion(criterion).of_free_run
    rule = criterion if not of_free_run else "bic" if searched else "aic"
    values = _costs(entries, records, rule)
    score = {id(e): (v, _size(e)) for e, v in zip(entries, values, strict=True)}
    calm = {id(e): doubts_about(e.model).settled for e in entries}
    by_error, errors = searched and of_free_run, score
    if by_error:
        errors = {id(e): (float(e.error or 0.0), _size(e)) for e in entries}
    equations, judge = (sum(map(len, records)), records[0].ny), criterion if by_error else rule
    ordered = sorted(entries, key=lambda e: (e not in sound, errors[id(e)]))

    def equal(e: Entry, best: Entry) -> bool:
        apart = excess(judge, errors[id(e)][0], errors[id(best)][0], equations)
        return e in sound and apart <= margin

    def first_of(settled: Callable[[Entry], bool]) -> Entry:
        return leader(
            ordered,
            lambda e: e in sound,
            equal,
            settled,
            lambda e: (_size(e), *errors[id(e)]) if by_error else score[id(e)],
        )

    first, lead = first_of(lambda e: True), first_of(lambda e: calm[id(e)])
    rest = [e for e in ordered if e is not lead]
    passed = None if lead is first else first
    tied = [e for e in (lead, *rest) if by_error and equal(e, ordered[0])]
    tied = tied if lead in tied else []
    return StructureRanking(
        (lead, *rest), tuple(sound), margin, rule, tuple(tied), passed, one_step
    )


def _costs(entries: Sequence[Entry], records: Sequence[Record], name: str) -> list[float]:
    """What a criterion says of each entry, from one-step errors on the samples all predict."""
    errors = [judged_errors(e.model, records) for e in entries]
    costs = []
    for e, common in zip(entries, on_common_samples(errors), strict=True):
        value = table.criterion(name).cost_of(loss_of(common, e.model.n_estimated))
        costs.append(value if np.isfinite(value) else np.inf)
    return costs


def common_criteria(
    models: Sequence[Model], records: Sequence[Sequence[Record]]
) -> tuple[dict[str, float], ...]:
    """Information criteria of models over the samples that all of them predict.

    Args:
        records: for each model the same experiments, with its channels.
    """
    errors = on_common_samples(
        [judged_errors(m, own) for m, own in zip(models, records, strict=True)]
    )
    return tuple(
        information_criteria(e, m.n_estimated) for m, e in zip(models, errors, strict=True)
    )


def _size(entry: Entry) -> int:
    return free_parameters(entry.model)


def free_parameters(model: Model) -> int:
    """Parameters to estimate; initial states belong to the record, not to the model."""
    return sum(p.fixed is None for p in model.parameters) + model.operating_point.estimated


def reason(
    order: StructureRanking, criterion: str, words: str, ahead: str = IN_LOOP, *, given: bool
) -> str:
    """One sentence on why the first entry is first.

    Args:
        words: the held-out data, as a sentence names them.
        ahead: why these are judged one step ahead, where they are.
        given: whether the user gave the orders.
    """
    sentence = _ahead(order, criterion, words, ahead, given=given)
    if order.passed is not None:
        return (
            f"{sentence} {_called(order.passed)} would lead, but "
            f"{doubts_about(order.passed.model).words}."
        )
    against = doubts_about(order.entries[0].model)
    if against.unbounded and len(order.entries) == 1:
        return f"{sentence} {against.words[0].upper()}{against.words[1:]}."
    if against.settled or len(order.entries) == 1:
        return sentence
    return f"{sentence} It leads although {against.words}: no settled model is as good."


def _called(entry: Entry) -> str:
    s = entry.model.structure
    return f"{s.name} {orders_text(s.order_values())}".rstrip()


def _ahead(order: StructureRanking, criterion: str, words: str, ahead: str, *, given: bool) -> str:
    first = order.entries[0]
    text = _called(first)
    unsearched = any(e.error is None for e in order.entries)
    if first.error is None or unsearched:  # there are no held-out figures to compare
        if len(order.entries) == 1:
            return f"{text}: {_origin(first.model, given)}."
        return f"{text} leads: its {order.rule.upper()} on the estimation data is the lowest."
    if not table.criterion(criterion).of_free_run:
        return (
            f"{text} leads: its {criterion.upper()}, from one-step errors on the estimation data, "
            f"is the {'lowest' if table.criterion(criterion).smaller_is_better else 'highest'}."
        )
    ahead_by_one = order.one_step or not first.model.inputs
    kind, how = (
        ("one-step prediction", "one step ahead") if ahead_by_one else ("free run", "in free run")
    )
    if len(order.entries) == 1:
        return f"{text} was chosen by {criterion} on {words}: {_share(first)} {how}."
    judged = f" {ahead}" if order.one_step else ""
    if len(order.tied) > 1:
        tied = ", ".join(f"{e.model.structure.name} {_share(e)}" for e in order.tied)
        return (
            f"{text} leads: fewest parameters ({_size(first)}) among models tied on held-out data "
            f"({tied} {how}; errors within {100.0 * order.margin:.2g} %).{judged}"
        )
    second = order.entries[1]
    sentence = (
        f"{text} leads: on {words} its {kind} fits {_share(first)}; next is "
        f"{second.model.structure.name} with {_share(second)}"
    )
    if second in order.sound:
        return f"{sentence}.{judged}"
    return f"{sentence}, but over all estimation data it errs much more {how}.{judged}"


def _share(entry: Entry) -> str:
    """Fit on the held-out samples, in words."""
    return f"{100.0 * (1.0 - (entry.error or 0.0)):.2f} %"


def _origin(model: Model, given: bool) -> str:
    if not model.structure.order_values():
        return "fitted; it has no orders"
    if given:
        return "fitted with the orders given"
    if model.structure.traits.linear:
        return "the only orders that so short a record bears"
    return "chosen by the structure's own search in the estimation data"
