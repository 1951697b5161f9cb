"""Several logs of one machine in a table: what each shows, its estimates, and which agree."""

from sysid.diagnosis.several.constancy import BASE
from sysid.diagnosis.several_logs import (
    ABSENT,
    INCONCLUSIVE,
    SIGNIFICANT,
    LogParameter,
    SeveralLogs,
    chance,
)

STATES = {SIGNIFICANT: "significant", ABSENT: "absent", INCONCLUSIVE: "inconclusive"}

UNKNOWN = LogParameter("", None, None, "")


def table_of_logs(several: SeveralLogs) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: a column for each log, a row for each effect, parameter and noise."""
    logs = several.logs
    heads = ["", *(f"{v.name} (validation)" if v.validation else v.name for v in logs), "agree"]
    rows: list[list[str]] = []
    for k, e in enumerate(logs[0].effects):
        rows.append([e.id, *(STATES[v.effects[k].state] for v in logs), ""])
        rows += _parameter_rows(several, e.id, [v.effects[k].parameters for v in logs])
    rows += _parameter_rows(several, BASE, [v.base for v in logs])
    for d in several.differences:
        values = [d.parameters[v.name] for v in logs]
        for each in zip(*values, strict=True):
            rows.append([f"{d.id} {each[0].name}", *(n.words for n in each), "no"])
    for name in logs[0].noise:
        rows.append([f"noise of {name}", *(f"{v.noise[name]:.3g}" for v in logs), ""])
    return heads, rows


def _parameter_rows(
    several: SeveralLogs, owner: str, per_log: list[tuple[LogParameter, ...]]
) -> list[list[str]]:
    """A row for each parameter that a log determines."""
    tested = {c.name: c for c in several.constancy if c.owner == owner}
    rows = []
    for name in dict.fromkeys(n.name for some in per_log for n in some):
        each = [next((n for n in some if n.name == name), UNKNOWN) for some in per_log]
        if all(n.value is None for n in each):
            continue
        test = tested.get(name)
        verdict = "" if test is None else f"{'yes' if test.same else 'no'} ({chance(test.p_value)})"
        rows.append([name, *(n.words for n in each), verdict])
    return rows


def sentences(several: SeveralLogs) -> tuple[str, ...]:
    """What differs between the logs, and that the rest does not; empty for one log."""
    if not several.logs:
        return ()
    lines = [d.sentence for d in several.differences]
    done = {(BASE, n.name) for d in several.differences for n in next(iter(d.parameters.values()))}
    lines += [c.sentence for c in several.constancy if not c.same and (c.owner, c.name) not in done]
    same = [c for c in several.constancy if c.same and c.owner != BASE]
    if same:
        names = ", ".join(c.name if k else f"{c.owner} {c.name}" for k, c in enumerate(same))
        lines.append(f"Estimates agree across logs: {names}.")
    for k, e in enumerate(several.logs[0].effects):
        states = [(v.name, v.effects[k].state) for v in several.logs]
        for state, words in ((ABSENT, "is absent in"), (INCONCLUSIVE, "is inconclusive in")):
            where = [name for name, s in states if s == state]
            if where:
                lines.append(f"{e.id} {words} {', '.join(where)}.")
    return tuple(lines)
