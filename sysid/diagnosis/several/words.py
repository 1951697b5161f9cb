"""Several logs of one machine in a table: what each shows, its own numbers, which are the same."""

from sysid.diagnosis.several.constancy import BASE
from sysid.diagnosis.several_logs import ABSENT, HIDDEN, PRESENT, LogNumber, SeveralLogs, chance

STATES = {PRESENT: "shows it", ABSENT: "shows that it is not there", HIDDEN: "cannot tell"}

NOT_TOLD = LogNumber("", None, None, "")


def table_of_logs(several: SeveralLogs) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: a column for each log, a row for each effect, number and noise."""
    logs = several.logs
    heads = ["", *(f"{v.name} (judges)" if v.judges else v.name for v in logs), "the same"]
    rows: list[list[str]] = []
    for k, e in enumerate(logs[0].effects):
        rows.append([e.id, *(STATES[v.effects[k].state] for v in logs), ""])
        rows += _numbers(several, e.id, [v.effects[k].numbers for v in logs])
    rows += _numbers(several, BASE, [v.base for v in logs])
    for d in several.differences:
        mine = [d.numbers[v.name] for v in logs]
        for each in zip(*mine, strict=True):
            rows.append([f"{d.id} {each[0].name}", *(n.words for n in each), "no"])
    for name in logs[0].noise:
        rows.append([f"noise of {name}", *(f"{v.noise[name]:.3g}" for v in logs), ""])
    return heads, rows


def _numbers(
    several: SeveralLogs, owner: str, mine: list[tuple[LogNumber, ...]]
) -> list[list[str]]:
    """A row for each number that a log tells."""
    tested = {c.name: c for c in several.constancy if c.owner == owner}
    rows = []
    for name in dict.fromkeys(n.name for some in mine for n in some):
        each = [next((n for n in some if n.name == name), NOT_TOLD) for some in mine]
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
    found = [d.sentence for d in several.differences]
    told = {(BASE, n.name) for d in several.differences for n in next(iter(d.numbers.values()))}
    found += [c.sentence for c in several.constancy if not c.same and (c.owner, c.name) not in told]
    same = [c for c in several.constancy if c.same and c.owner != BASE]
    if same:
        names = ", ".join(c.name if k else f"{c.owner} {c.name}" for k, c in enumerate(same))
        found.append(f"The same number in all logs that tell it: {names}.")
    for k, e in enumerate(several.logs[0].effects):
        mine = [(v.name, v.effects[k].state) for v in several.logs]
        for state, words in ((ABSENT, "is not there in"), (HIDDEN, "cannot be seen in")):
            where = [name for name, s in mine if s == state]
            if where:
                found.append(f"{e.id} {words} {', '.join(where)}.")
    return tuple(found)
