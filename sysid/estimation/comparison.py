"""Ranking models on equal terms: the same data, the same samples, one initial-state policy."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.criteria.information import CRITERIA, information_criteria, on_common_samples
from sysid.data.record import Record
from sysid.errors import ModelError
from sysid.estimation.assessment import DataFigures, Policy, figures_on
from sysid.estimation.orders import ERROR_CRITERIA, check_criterion
from sysid.estimation.pem import head_window
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class Contender:
    """A stored model and what is known about it.

    Attributes:
        id: its name in the workspace.
        model: the model.
        records: its estimation data read again, or None when they are gone or have changed.
        report: what was said about it when it was fitted.
    """

    id: str
    model: Model
    records: tuple[Record, ...] | None
    report: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Ranked:
    """One line of a ranking."""

    contender: Contender
    value: float
    criteria: Mapping[str, float]
    figures: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """{model, structure, orders, fit_percent, aic, …, residuals}."""
        m = self.contender.model
        return {
            "model": self.contender.id,
            "structure": m.structure.name,
            "orders": m.structure.order_values(),
            "n": m.n_estimated,
            "fit_percent": self.figures["fit_percent"],
            "rmse": self.figures["rmse"],
            "figures": self.figures,
            **self.criteria,
            "residuals": self.contender.report.get("residuals"),
        }


@dataclass(frozen=True, eq=False)
class Ranking:
    """Comparable models, best first, and those that cannot be compared, with the reason."""

    criterion: str
    lines: tuple[Ranked, ...]
    excluded: Mapping[str, str]
    notes: tuple[str, ...]
    data: str

    @property
    def best(self) -> Ranked:
        """The first of the ranking."""
        return self.lines[0]


def compare(
    contenders: Sequence[Contender],
    criterion: str,
    validation: tuple[Sequence[Record], str] | None,
    policy: Policy | None = None,
) -> Ranking:
    """Rank models by a criterion.

    ``fit`` and ``rmse`` rank by the free run on the validation data (or, without any, on the data
    each model was judged on when it was fitted). Information criteria rank by one-step errors on
    the estimation data, over the samples that all compared models predict, and only models
    fitted to the same data: the others are excluded, and it is said why.

    Raises:
        ModelError: there is nothing to compare.
        UsageError: the criterion is unknown.
    """
    criterion = check_criterion(criterion)
    policy = policy or Policy()
    if not contenders:
        raise ModelError("there is no model to compare; run `sysid fit` first")
    notes: list[str] = []
    excluded: dict[str, str] = {}
    figures: dict[str, dict[str, Any]] = {}
    for c in contenders:
        try:
            figures[c.id] = _figures(c, validation, policy)
        except ModelError as error:
            excluded[c.id] = str(error)
    usable = [c for c in contenders if c.id in figures]
    if criterion not in ERROR_CRITERIA or validation is None:
        usable = _same_data(usable, excluded)
    if not usable:
        raise ModelError("no model can be compared: " + "; ".join(excluded.values()))
    if validation is None and len({figures[c.id]["data"] for c in usable}) > 1:
        notes.append(
            "Not all of these models were judged on the same held-out data, so the figures are "
            "those on the data they were fitted to: give --val LOG."
        )
        for c in usable:
            figures[c.id] = {**c.report["estimation"], "held_out": False}
    criteria = _criteria(usable, notes)
    lines = []
    for c in usable:
        value = _value(criterion, criteria[c.id], figures[c.id])
        lines.append(Ranked(c, value, criteria[c.id], figures[c.id]))
    sign = 1.0 if CRITERIA[criterion].smaller_is_better else -1.0
    lines.sort(
        key=lambda x: (
            not np.isfinite(x.value),
            sign * x.value,
            x.contender.model.n_estimated,
            x.contender.id,
        )
    )
    if validation is None and criterion in ERROR_CRITERIA and not lines[0].figures["held_out"]:
        notes.append(
            "Judged on the data the models were fitted to, which favours large models: give "
            "--val LOG, or fit with `sysid fit --split`."
        )
    data = validation[1] if validation else str(lines[0].figures["data"])
    return Ranking(criterion, tuple(lines), excluded, tuple(notes), data)


def _figures(
    c: Contender, validation: tuple[Sequence[Record], str] | None, policy: Policy
) -> dict[str, Any]:
    if validation is not None:
        for r in validation[0]:
            c.model.check(r)
        found: DataFigures = figures_on(c.model, validation[0], validation[1], policy)
        return {**found.to_json(), "held_out": True}
    part = c.report.get("validation") or c.report.get("estimation")
    if not isinstance(part, Mapping):
        raise ModelError(f"{c.id} holds no figures; fit it again")
    return {**part, "held_out": c.report.get("validation") is not None}


def _identity(c: Contender) -> tuple[object, ...]:
    m = c.model
    data = tuple((s.sha256, s.first, s.samples) for s in m.provenance.data)
    return data, tuple(x.name for x in m.inputs), tuple(x.name for x in m.outputs)


def _same_data(contenders: Sequence[Contender], excluded: dict[str, str]) -> list[Contender]:
    """Those fitted to the same data as the newest model; the others are excluded."""
    if not contenders:
        return []
    newest = contenders[-1]
    kept = []
    for c in contenders:
        if _identity(c) == _identity(newest):
            kept.append(c)
        else:
            excluded[c.id] = (
                f"{c.id} was fitted to other data or channels than {newest.id}: such models must "
                "not be ranked against each other by this criterion (use --val LOG with "
                "--criteria fit)"
            )
    return kept


def _criteria(contenders: Sequence[Contender], notes: list[str]) -> dict[str, dict[str, float]]:
    """Criteria on common samples where the data are at hand, else as stored with each model."""
    stored = {c.id: dict(asdict(c.model.criteria)) for c in contenders}
    first = contenders[0]
    same = all(_identity(c) == _identity(first) for c in contenders)
    if not same:
        return stored
    if first.records is None:
        if len(contenders) > 1:
            notes.append(
                "The estimation data are gone or have changed; the criteria are those stored at "
                "each fit, each over the samples its own model predicts."
            )
        return stored
    errors = [
        [c.model.errors(r, head_window(c.model.structure, c.model.theta)) for r in first.records]
        for c in contenders
    ]
    common = on_common_samples(errors)
    return {
        c.id: dict(asdict(information_criteria(e, c.model.n_estimated)))
        for c, e in zip(contenders, common, strict=True)
    }


def _value(criterion: str, criteria: Mapping[str, float], figures: Mapping[str, Any]) -> float:
    if criterion not in ERROR_CRITERIA:
        return criteria[criterion]
    values = [
        v
        for v in figures["fit_percent" if criterion == "fit" else "rmse"].values()
        if v is not None
    ]
    if not values:
        return float("nan")
    return float(np.mean(values) if criterion == "fit" else np.sqrt(np.mean(np.square(values))))
