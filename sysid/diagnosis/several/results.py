"""Several logs of one machine: what each shows, which estimates agree, and which differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.data.documents import by_field
from sysid.estimation.assessment.delta_method import NORMAL

SIGNIFICANT, ABSENT, INCONCLUSIVE = "significant", "absent", "inconclusive"
"""What a log says of an effect: it shows it; it would show it and does not; it cannot show it."""

BASE = "base"
"""The owner of parameters that belong to no effect."""

NO_VALUE = "–"

SURE = 1e-6
"""Smaller p-values are only bounded."""


def chance(p: float) -> str:
    """A p-value in words."""
    return f"p < {SURE:g}" if p < SURE else f"p = {p:.2g}"


@dataclass(frozen=True)
class LogParameter:
    """A parameter as one log alone has it, its output in brackets; None: not determined by it."""

    name: str
    value: float | None
    std_error: float | None
    unit: str

    @property
    def words(self) -> str:
        """Value and half of its 95 % interval; a dash where there is none."""
        if self.value is None:
            return NO_VALUE
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        if self.std_error is None:
            return f"{self.value:.4g}{unit}"
        return f"{self.value:.4g} ± {NORMAL * self.std_error:.2g}{unit}"


@dataclass(frozen=True)
class LogEffect:
    """What one log shows of one effect.

    Attributes:
        error_ratio: RMS error of the log with the effect over that without it; None where that
            was not measured.
    """

    id: str
    state: str
    parameters: tuple[LogParameter, ...]
    error_ratio: float | None = None


@dataclass(frozen=True)
class LogView:
    """One log beside the others.

    Attributes:
        base: gain and time constant of each output as the log alone has them.
        noise: noise of each output in this log, by name.
    """

    name: str
    validation: bool
    effects: tuple[LogEffect, ...]
    base: tuple[LogParameter, ...]
    noise: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """Its fields, the effects by id."""
        return by_field(self) | {"effects": {e.id: e for e in self.effects}}


@dataclass(frozen=True)
class Constancy:
    """Whether the estimates of a parameter agree across logs.

    Attributes:
        owner: effect, or ``base``.
        value, std_error: weighted mean over the logs.
        chi_squared, degrees: Σ((value_k − mean)/error_k)², and the logs less one.
        p_value: chance of as much or more if it is the same.
        same: whether it is, at 1 % over all parameters tested.
    """

    owner: str
    name: str
    unit: str
    value: float
    std_error: float
    chi_squared: float
    degrees: int
    p_value: float
    same: bool
    sentence: str


@dataclass(frozen=True)
class Difference:
    """What differs between logs and is no effect: admitted by the rule that effects are, too.

    Attributes:
        id: ``gain-by-log`` or ``load-by-log``.
        p_value: chance of its gain among all that was tried.
        error_ratio_without: held-out RMSE without it over that with it.
    """

    id: str
    channels: tuple[str, ...]
    logs: dict[str, tuple[LogParameter, ...]]
    p_value: float
    error_ratio_without: float
    sentence: str


@dataclass(frozen=True)
class SeveralLogs:
    """What several logs say together; empty for one: constancy of what two logs determine."""

    logs: tuple[LogView, ...] = ()
    constancy: tuple[Constancy, ...] = ()
    differences: tuple[Difference, ...] = ()


def table_of_logs(several: SeveralLogs) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: a column for each log, a row for each effect, parameter and noise."""
    logs = several.logs
    heads = ["", *(f"{v.name} (validation)" if v.validation else v.name for v in logs), "agree"]
    rows: list[list[str]] = []
    for k, e in enumerate(logs[0].effects):
        rows.append([e.id, *(v.effects[k].state for v in logs), ""])
        rows += _parameter_rows(several, e.id, [v.effects[k].parameters for v in logs])
    rows += _parameter_rows(several, BASE, [v.base for v in logs])
    for d in several.differences:
        for each in zip(*(d.logs[v.name] for v in logs), strict=True):
            rows.append([f"{d.id} {each[0].name}", *(n.words for n in each), "no"])
    for name in logs[0].noise:
        rows.append([f"noise of {name}", *(f"{v.noise[name]:.3g}" for v in logs), ""])
    return heads, rows


def _parameter_rows(
    several: SeveralLogs, owner: str, per_log: Sequence[Sequence[LogParameter]]
) -> list[list[str]]:
    """A row for each parameter that a log determines."""
    tested = {c.name: c for c in several.constancy if c.owner == owner}
    known: list[Mapping[str, LogParameter]] = [{n.name: n for n in some} for some in per_log]
    rows = []
    for name in dict.fromkeys(n for some in known for n in some):
        each = [some[name].words if name in some else NO_VALUE for some in known]
        test = tested.get(name)
        verdict = "" if test is None else f"{'yes' if test.same else 'no'} ({chance(test.p_value)})"
        if set(each) != {NO_VALUE}:
            rows.append([name, *each, verdict])
    return rows


def sentences(several: SeveralLogs) -> tuple[str, ...]:
    """What differs between the logs, and that the rest does not; empty for one log."""
    if not several.logs:
        return ()
    lines = [d.sentence for d in several.differences]
    done = {(BASE, n.name) for d in several.differences for n in next(iter(d.logs.values()))}
    lines += [c.sentence for c in several.constancy if not c.same and (c.owner, c.name) not in done]
    same = [c for c in several.constancy if c.same and c.owner != BASE]
    if same:
        names = ", ".join(c.name if k else f"{c.owner} {c.name}" for k, c in enumerate(same))
        lines.append(f"Estimates agree across logs: {names}.")
    for k, e in enumerate(several.logs[0].effects):
        for state in (ABSENT, INCONCLUSIVE):
            where = [v.name for v in several.logs if v.effects[k].state == state]
            if where:
                lines.append(f"{e.id} is {state} in {', '.join(where)}.")
    return tuple(lines)
