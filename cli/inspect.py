"""``sysid inspect``: the contents of a log, and whether a model can be fitted to it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from . import reading, render, targets
from .bag_contents import show_bag
from .options import command, flag, group, option
from .read_as import decided, show_decisions

if TYPE_CHECKING:
    from sysid.data.finding import Finding
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.diagnosis.isolability import Isolability


@command
def inspect(
    logs: list[Path] = reading.LOGS,
    excitation: int = option(
        "N", "Order of excitation the inputs should have.", default=8, min=1, max=200
    ),
    effects: bool = flag(
        "Also say which missing effects the log would show, and which it could distinguish."
    ),
    plot: Path | None = targets.picture("With --effects: draw what it can distinguish."),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading),
    json: bool = reading.JSON,
) -> None:
    """Show what is in a log, what is wrong with it, and what to do.

    For a bag without --map it lists the topics and proposes a mapping.
    """
    from sysid.data.bags.opening import is_bag
    from sysid.data.facts import LogFacts
    from sysid.data.finding import Severity, worst
    from sysid.data.inspection import inspect_records
    from sysid.data.preparation import read_prepared

    if not read.map and len(logs) == 1 and is_bag(logs[0]):
        show_bag(logs[0], json)
        return
    records, reading_findings = read_prepared(logs, read, steps)
    findings = inspect_records(LogFacts(records, reading_findings), excitation)
    verdict = worst(findings)
    isolability = _isolability(records, plot) if effects and verdict is not Severity.FATAL else None
    if json:
        _document(records, findings, verdict.word, isolability)
    else:
        _show(records, findings, verdict.word)
        if isolability is not None:
            _show_effects(isolability)
    if verdict is Severity.FATAL:
        raise typer.Exit(1)


MOST_TABLES = 4
"""Experiments whose channels are shown; a log with many gaps has many."""
_VERDICTS = {
    "ok": "Data usable: no problems found.",
    "note": "Data usable.",
    "warning": "Data usable, with the warnings above.",
    "fatal": "Data not usable: see the fatal findings above.",
}


def _isolability(records: "tuple[Record, ...]", plot: Path | None) -> "Isolability":
    """What a diagnosis of the logs could show, drawn where that was asked for."""
    from sysid.diagnosis.isolability import isolability

    found = isolability(records)
    if plot is not None:
        from dataclasses import replace

        from sysid.errors import ModelError
        from sysid.report.diagnosis_panels import isolability as panels_of
        from sysid.report.panels import draw_panels

        panels = tuple(replace(p, large=True) for p in panels_of(found))  # many rows
        if not panels:
            raise ModelError("fewer than two effects would show: there is nothing to draw")
        names = ", ".join(dict.fromkeys(r.name for r in records))
        draw_panels(plot, "What the log can distinguish", names, panels)
    return found


MOST_PAIRS = 4


def _show_effects(found: "Isolability") -> None:
    """The effects that would show, those that would not, and those that would be one entry."""
    sizes = list(zip(found.ids, found.shows.tolist(), found.shown, strict=True))
    shown = [f"{id} {size:.1f}" for id, size, shows in sizes if shows]
    hidden = [id for id, _, shows in sizes if not shows]
    render.say("")
    render.say(f"Would show (usual size, times the noise): {', '.join(shown) or 'no effect'}.")
    if hidden:
        render.say(f"Would not show: {', '.join(hidden)}.")
    for pair in found.pairs[:MOST_PAIRS]:
        render.say(pair.sentence)
    if len(found.pairs) > MOST_PAIRS:
        more = (" = ".join(p.effects) for p in found.pairs[MOST_PAIRS:])
        render.say(f"One entry, too: {', '.join(more)}.")


def _document(
    records: "tuple[Record, ...]",
    findings: "tuple[Finding, ...]",
    verdict: str,
    isolability: "Isolability | None",
) -> None:
    effects = {} if isolability is None else {"effects": isolability.to_json()}
    render.document(
        {
            **effects,
            "records": [_facts(r) for r in records],
            "read_as": decided(records),
            "findings": findings,
            "verdict": verdict,
        }
    )


def _show(records: "tuple[Record, ...]", findings: "tuple[Finding, ...]", verdict: str) -> None:
    from sysid.data.record import names_of

    show_decisions(decided(records))
    for record in records[:MOST_TABLES]:
        channels = zip((*record.inputs, *record.outputs), _facts(record)["channels"], strict=True)
        render.table(
            ("channel", "role", "unit", "lowest", "highest", "mean"),
            [
                (c.name, f["role"], unit, *(factor * f[end] for end in ("min", "max", "mean")))
                for c, f in channels
                for factor, unit in [c.to_file]
            ],
            title=f"{record.name}: {len(record)} samples, one every {record.dt:.6g} s, "
            f"{len(record) * record.dt:.6g} s in all",
        )
    if len(records) > MOST_TABLES:
        more = names_of(records[MOST_TABLES:])
        render.say(f"{sum(map(len, records))} samples in all, with {more}.")
    render.findings(findings)
    render.say(_VERDICTS[verdict], "bold")


def _facts(record: "Record") -> dict[str, Any]:
    sides = (("input", record.inputs, record.u), ("output", record.outputs, record.y))
    return {
        "name": record.name,
        "samples": len(record),
        "sample_time_s": record.dt,
        "duration_s": len(record) * record.dt,
        "first_s": record.t0,
        "has_pose": record.pose is not None,
        "sha256": record.sha256,
        "channels": [
            {
                "name": channel.name,
                "role": role,
                "unit": channel.unit,
                "file_unit": channel.file_unit,
                "scale": channel.scale,
                "min": float(values[:, i].min()),
                "max": float(values[:, i].max()),
                "mean": float(values[:, i].mean()),
            }
            for role, channels, values in sides
            for i, channel in enumerate(channels)
        ],
    }
