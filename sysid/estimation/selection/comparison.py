"""Rank models on equal terms: same data, same samples, same initial-state policy."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.criteria import table
from sysid.data.documents import plain
from sysid.data.record import Record, names_of
from sysid.errors import ModelError, SysidError
from sysid.estimation.assessment.figures import residual_tests
from sysid.estimation.assessment.findings import Policy, figures_on
from sysid.estimation.selection.ranking import common_criteria, free_parameters
from sysid.estimation.soundness import doubts_about, leader, relative_gap
from sysid.fitting.holdout import CLOSE
from sysid.outside_text import html_lines, html_table
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class Contender:
    """A stored model and what is known about it.

    Attributes:
        id: its name in the workspace.
        records: its estimation data read again, or None when they are gone or have changed.
        report: what was said about it when it was fitted.
        validation: what it was judged on then, read again; None where that is gone or unknown.
    """

    id: str
    model: Model
    records: tuple[Record, ...] | None
    report: Mapping[str, Any]
    validation: tuple[Record, ...] | None = None


@dataclass(frozen=True, eq=False)
class Ranked:
    """One line of a ranking.

    Attributes:
        value: of the criterion that ranks.
        criteria, figures, residuals: what is known of it.
        step_time: processor time of one step [s]; None where it cannot be stepped.
    """

    contender: Contender
    value: float
    criteria: Mapping[str, float]
    figures: Mapping[str, Any]
    residuals: Mapping[str, Any] | None = None
    step_time: float | None = None

    def to_json(self) -> dict[str, Any]:
        """{model, structure, orders, fit_percent, aic, …, residuals}; no criterion hides a key."""
        m = self.contender.model
        return {
            **self.criteria,
            "model": self.contender.id,
            "structure": m.structure.name,
            "orders": m.structure.order_values(),
            "n": m.n_estimated,
            "fit_percent": self.figures["fit_percent"],
            "rmse": self.figures["rmse"],
            "figures": self.figures,
            "residuals": self.residuals,
            "doubts": doubts_about(m).clauses,
            "step_time_s": self.step_time,
            "tells": m.structure.traits.tells,
        }


@dataclass(frozen=True, eq=False)
class Ranking:
    """Comparable models by one criterion, and those that cannot be compared, with the reason.

    Attributes:
        lines: the models, the first by the criterion first.
        excluded: id → why it cannot be compared.
        notes: what to know about the ranking.
        data: what the models were judged on.
        best: the one to take: by fit the smallest of those that tie with the first, else the
            first; a settled one before others that are as good.
    """

    criterion: str
    lines: tuple[Ranked, ...]
    excluded: Mapping[str, str]
    notes: tuple[str, ...]
    data: str
    best: Ranked

    def __repr__(self) -> str:
        ids = ", ".join(line.contender.id for line in self.lines)
        return f"<Ranking by {self.criterion} on {self.data}: {ids}>"

    def _repr_html_(self) -> str:
        names = list(self.best.figures["fit_percent"])
        heads = ("model", "parameters", *(f"{n}, fit [%]" for n in names), self.criterion)
        rows = [
            (
                ("* " if x is self.best else "") + x.contender.id,
                str(x.contender.model.n_estimated),
                *(f"{v:.2f}" if v is not None else "–" for v in x.figures["fit_percent"].values()),
                f"{x.value:.5g}",
            )
            for x in self.lines
        ]
        return html_lines(f"On {self.data}") + html_table(rows, heads) + html_lines(*self.notes)


def compare(
    contenders: Sequence[Contender],
    criterion: str,
    validation: tuple[Sequence[Record], str] | None,
    policy: Policy | None = None,
    advance: Callable[[int], None] | None = None,
) -> Ranking:
    """Rank models by a criterion.

    ``fit`` and ``rmse`` rank by the free run on the validation data (or, without any, on the data
    each model was judged on when it was fitted). Information criteria rank by one-step errors on
    the estimation data, over the samples that all compared models predict, and only models
    fitted to the same data: the others are excluded, and it is said why.

    Args:
        advance: called after each model that was run; as many times as there are models.

    Raises:
        ModelError: there is nothing to compare.
        UsageError: the criterion is unknown.
    """
    criterion, ranks = table.known_name(criterion), table.criterion(criterion)
    policy = policy or Policy()
    if not contenders:
        raise ModelError("no model to compare; run `sysid fit` first")
    notes: list[str] = [] if validation is None else _seen_before(contenders, validation[0])
    excluded: dict[str, str] = {}
    figures = _all_figures(contenders, validation, policy, excluded, advance)
    usable = [c for c in contenders if c.id in figures]
    if not ranks.of_free_run or validation is None:
        usable = _same_data(usable, excluded)
    if not usable:
        raise ModelError("no model can be compared: " + "; ".join(reasons(excluded)))
    judged_on = {(figures[c.id]["data"], figures[c.id]["held_out"]) for c in usable}
    unlike = validation is None and len(judged_on) > 1
    if unlike:
        notes.append(
            "Not all of these models were judged on the same held-out data, so the figures are "
            "those on the data they were fitted to: give `validation=LOG`."
        )
        for c in usable:
            figures[c.id] = _figures_made(c, "estimation", policy)
    criteria = _criteria(usable, notes)
    lines = []
    for c in usable:
        if not ranks.of_free_run and criterion not in criteria[c.id]:
            excluded[c.id] = (
                f"stored without {criterion}, and the data are gone or have changed; fit it again"
            )
            continue
        value = _value(criterion, criteria[c.id], figures[c.id])
        lines.append(
            Ranked(c, value, criteria[c.id], figures[c.id], _residuals(c), step_time(c.model))
        )
    if not lines:
        raise ModelError("no model can be compared: " + "; ".join(reasons(excluded)))
    lines.sort(
        key=lambda x: (
            not np.isfinite(x.value),
            ranks.cost(x.value),
            x.contender.model.n_estimated,
            x.contender.id,
        )
    )
    fitted_to = validation is None and not lines[0].figures["held_out"]
    if fitted_to and ranks.of_free_run and not unlike:
        notes.append(
            "Judged on the data the models were fitted to, which favours large models: give "
            "`validation=LOG`, or fit with `split`."
        )
    data = validation[1] if validation else str(lines[0].figures["data"])
    best = _leading(lines, criterion, notes)
    return Ranking(criterion, tuple(lines), excluded, tuple(notes), data, best)


def reasons(excluded: Mapping[str, str]) -> list[str]:
    """A sentence for each reason, with the models that it leaves out before it."""
    by_reason: dict[str, list[str]] = {}
    for id, reason in excluded.items():
        by_reason.setdefault(reason.removesuffix("."), []).append(id)
    return [f"{', '.join(ids)} left out: {reason}." for reason, ids in by_reason.items()]


def common_validation(
    contenders: Sequence[Contender],
) -> tuple[tuple[Record, ...], str] | None:
    """What the newest model was validated on, for all of them, and what to call it.

    None where all were validated alike or none was, and where the log has gone or is one that a
    model was fitted to: figures of the fit then stand.
    """
    data = {tuple((r.sha256, r.t0, len(r)) for r in c.validation or ()) for c in contenders}
    newest = next((c.validation for c in reversed(contenders) if c.validation), None)
    if newest is None or len(data) == 1 or _seen_before(contenders, newest):
        return None
    return newest, names_of(newest)


def _seen_before(contenders: Sequence[Contender], judged: Sequence[Record]) -> list[str]:
    """A note where models are judged on what some of them were fitted to: those look too good."""
    seen = [c.id for c in contenders if _seen(c.model, judged)]
    if not seen:
        return []
    who = f"{', '.join(seen)}: {'was' if len(seen) == 1 else 'were'}"
    if len(seen) == len(contenders):
        who = "All models were"
    return [
        f"{who} fitted to data of {names_of(judged)}, on which they are judged here; that favours "
        "large models and those that saw the log. Judge on a log that no model saw."
    ]


def _seen(model: Model, judged: Sequence[Record]) -> bool:
    """Whether the model was fitted to samples of these records."""
    return any(
        bool(s.sha256)
        and s.sha256 == r.sha256
        and s.first < r.t0 + len(r) * r.dt
        and r.t0 < s.first + s.samples * model.dt
        for s in model.provenance.data
        for r in judged
    )


def _leading(lines: Sequence[Ranked], criterion: str, notes: list[str]) -> Ranked:
    """The model to take, and a note where it is not the first or has something against it."""
    doubts = {x.contender.id: doubts_about(x.contender.model) for x in lines}
    by_size = table.criterion(criterion).of_free_run

    def tied(x: Ranked, first: Ranked) -> bool:
        ny, samples = len(x.contender.model.outputs), int(first.figures.get("samples") or 0)
        return relative_gap(criterion, x.value, first.value, samples, ny) <= _margin(first)

    best = leader(
        lines,
        lambda x: not doubts[x.contender.id].unbounded,
        tied,
        lambda x: doubts[x.contender.id].settled,
        lambda x: (free_parameters(x.contender.model) if by_size else 0, lines.index(x)),
    )
    first, doubt = lines[0].contender.id, doubts[lines[0].contender.id].words
    if best is not lines[0] and doubt:
        notes.append(f"{first} is first by {criterion} but does not lead: {doubt}.")
    elif best is not lines[0]:
        notes.append(
            f"{best.contender.id} leads: fewest parameters among the models tied with {first} "
            f"(errors within {100.0 * _margin(lines[0]):.2g} %)."
        )
    against = doubts[best.contender.id]
    if not against.settled:
        notes.append(
            f"{best.contender.id} leads although {against.words}: no settled model is as good. Fit "
            "with stability enforced, lower orders or a longer log before you build on it."
        )
    return best


def _margin(line: Ranked) -> float:
    samples = int(line.figures.get("samples") or 0) * len(line.contender.model.outputs)
    return max(CLOSE, 1.0 / float(np.sqrt(2.0 * max(samples, 1))))


def _residuals(c: Contender) -> Mapping[str, Any] | None:
    stored: Mapping[str, Any] | None = c.report.get("residuals")
    if stored or c.records is None:
        return stored or None
    return residual_tests(c.model, c.records).as_dict()


def _all_figures(
    contenders: Sequence[Contender],
    validation: tuple[Sequence[Record], str] | None,
    policy: Policy,
    excluded: dict[str, str],
    advance: Callable[[int], None] | None,
) -> dict[str, dict[str, Any]]:
    """Figures of every model that has some; why others have none is written to ``excluded``."""
    figures = {}
    for c in contenders:
        try:
            if validation is None:
                role = "validation" if c.report.get("validation") else "estimation"
                figures[c.id] = _figures_made(c, role, policy)
                continue
            judged = _of_model(c.model, validation[0])
            made = figures_on(c.model, judged, validation[1], policy)
            figures[c.id] = {**made.to_json(), "held_out": True}
        except ModelError as error:
            excluded[c.id] = str(error)
        finally:
            if advance is not None:
                advance(1)
    return figures


def _of_model(model: Model, records: Sequence[Record]) -> list[Record]:
    """The records with their channels in the order that the model has them in."""
    wanted = [c.name for c in model.inputs], [c.name for c in model.outputs]
    there = records[0].input_names, records[0].output_names
    if [*map(sorted, wanted)] != [*map(sorted, there)]:
        ours, theirs = (f"{', '.join(u)} → {', '.join(y)}" for u, y in (wanted, there))
        on = f"{records[0].name} ({theirs})"
        raise ModelError(f"a model of {ours} cannot be judged on {on}, nor be ranked there")
    ordered = [r.select(*wanted) for r in records]
    for r in ordered:
        model.check(r)
    return ordered


def _figures_made(c: Contender, role: str, policy: Policy) -> dict[str, Any]:
    """Figures on the data a model was judged on, under this policy.

    Those of the fit where they were made under the same policy; else they are made anew.
    """
    part, held_out = c.report.get(role), role == "validation"
    if not isinstance(part, Mapping):
        raise ModelError("it holds no figures; fit it again")
    if c.report.get("policy") == plain(policy):
        return {**part, "held_out": held_out}
    records = c.validation if held_out else c.records
    if records is not None:
        made = figures_on(c.model, records, str(part["data"]), policy)
        return {**made.to_json(), "held_out": held_out}
    if "policy" not in c.report and policy == Policy():
        return {**part, "held_out": held_out}  # reports of other commands and versions
    raise ModelError(
        "validated in another way, and the validation log is missing or has changed; give "
        "`validation=LOG`"
    )


def _identity(c: Contender) -> tuple[object, ...]:
    m = c.model
    data = tuple((s.sha256, s.first, s.samples) for s in m.provenance.data)
    return data, *(tuple(sorted(x.name for x in side)) for side in (m.inputs, m.outputs))


def _same_data(contenders: Sequence[Contender], excluded: dict[str, str]) -> list[Contender]:
    """Those fitted to the same data as the newest model; the others are excluded."""
    kept = [c for c in contenders if _identity(c) == _identity(contenders[-1])]
    excluded |= {
        c.id: f"fitted to other data or channels than {contenders[-1].id}; rank them by "
        "`criterion='fit'` on `validation=LOG`"
        for c in contenders
        if c not in kept
    }
    return kept


def _criteria(contenders: Sequence[Contender], notes: list[str]) -> dict[str, dict[str, float]]:
    """Criteria on common samples where the data are at hand, else as stored with each model."""
    first = contenders[0]
    same = all(_identity(c) == _identity(first) for c in contenders)
    if same and first.records is None and len(contenders) > 1:
        notes.append(
            "The estimation data are gone or have changed; the criteria are those stored at each "
            "fit, each over the samples its own model predicts."
        )
    if not same or first.records is None:
        return {c.id: dict(c.model.criteria) for c in contenders}
    records = [_of_model(c.model, first.records) for c in contenders]
    common = common_criteria([c.model for c in contenders], records)
    return {c.id: made for c, made in zip(contenders, common, strict=True)}


def _value(criterion: str, criteria: Mapping[str, float], figures: Mapping[str, Any]) -> float:
    if criterion in criteria:
        return criteria[criterion]
    each = figures["fit_percent" if criterion == "fit" else "rmse"].values()
    values = [v for v in each if v is not None]
    if not values:
        return float("nan")
    return float(np.mean(values) if criterion == "fit" else np.sqrt(np.mean(np.square(values))))


STEPS, ROUNDS = 50, 4
"""Steps timed together, and how often: the quickest round is the one that nothing disturbed."""


def step_time(model: Model) -> float | None:
    """Processor time of one step of the model's plant in Python [s]; None where it has none.

    Args:
        model: stepped from rest with the middle of its inputs' range.
    """
    try:
        plant = model.plant()
        state, u = plant.initial_state(), plant.u_offset
        best = float("inf")
        for _ in range(ROUNDS):
            start = time.process_time()
            for _ in range(STEPS):
                state, _ = plant.step(state, u)
            best = min(best, time.process_time() - start)
    except SysidError:
        return None
    return best / STEPS
