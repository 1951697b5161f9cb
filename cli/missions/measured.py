"""``sysid simulate --measured``: a measured drive compared with the runs predicted for it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import render
from ..field_options import with_options
from ..read_as import decided, show_decisions
from .many_runs import Repeats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sysid.data.finding import Finding
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.robot.mission.measured.fan import Comparison
    from sysid.robot.mission.spec import Mission
    from sysid.structures.model import Model


def lay_over(
    log: Path, mission: "Mission", models: "Sequence[Model]", how: Repeats, read: "ReadOptions"
) -> "tuple[Comparison, dict[str, Any], list[str]]":
    """Compare a log with runs of its mission, and have its diagnosis name why it leaves them.

    Returns:
        The comparison, ``measured`` of the document, and warnings.
    """
    from sysid.data.finding import warned
    from sysid.diagnosis.likely_cause import likely_cause
    from sysid.robot.mission.measured.fan import RUNS, against_runs

    record, findings = _drive(log, read)
    runs = min(how.runs or RUNS, MOST)
    with render.progress(f"Driving towards {log.name}"):
        comparison = against_runs(record, mission, models, runs, how.seed or 0, how.vary)
    facts: dict[str, Any] = {**comparison.summary(), "cause": None, "other_causes": []}
    facts["notes"] = list(comparison.notes)
    facts["read_as"] = decided([record])
    if comparison.leaves is not None:
        with render.stages("Diagnosing") as progress:
            why = likely_cause(record, models[0], mission.vehicle.given_geometry, progress)
        facts |= {"cause": why.name, "other_causes": list(why.others)}
        facts["sentence"] += f" {with_options(why.sentence)}"
    return comparison, facts, [with_options(f) for f in warned(findings)]


MOST = 4000
"""Paths that a fan keeps: more make it no smoother, and memory grows with them."""


def _drive(log: Path, read: "ReadOptions") -> "tuple[Record, tuple[Finding, ...]]":
    """The longest record of a log, on an even grid with lost measurements held."""
    from sysid.data.preparation import Preparation, read_prepared

    if read.resample == "auto":
        read = replace(read, resample="hold")
    records, findings = read_prepared([log], read, Preparation())
    return max(records, key=len), findings


def show_measured(comparison: dict[str, Any]) -> None:
    """What the comparison says, and what was done for it."""
    show_decisions(comparison["read_as"])
    for note in comparison["notes"]:
        render.say(note)
    share = 100 * comparison["inside_share"]
    render.say(f"{comparison['sentence']} {share:.3g} % of the drive lies inside.")
