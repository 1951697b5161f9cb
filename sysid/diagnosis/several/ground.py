"""Effects between tracks and ground in each of several logs: its pose is diagnosed alone."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.record import Record
from sysid.diagnosis.named_effects import NamedEffect
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.search.prepared import Logs
from sysid.diagnosis.several.constancy import constancies
from sysid.diagnosis.several.results import (
    ABSENT,
    INCONCLUSIVE,
    SIGNIFICANT,
    LogEffect,
    LogParameter,
    SeveralLogs,
)
from sysid.effects.catalogue import effect
from sysid.vehicle.kinematics import Geometry

CLEARLY = 2.0
"""A log that would show so small a share of the effect of all logs, and does not, speaks against
it: half as large is found in nearly all logs."""


def with_ground(
    several: SeveralLogs,
    records: Sequence[Record],
    logs: Logs,
    pose: PoseDiagnosis | None,
    geometry: Geometry | None,
) -> SeveralLogs:
    """The findings with the effects between tracks and ground that all logs show together.

    Args:
        records: those of all logs, as ``logs`` has them: first those that were searched on.
    """
    if not several.logs or pose is None or not pose.effects:
        return several
    if geometry is None:
        geometry = Geometry() if pose.geometry is None else pose.geometry.geometry
    of = (*logs.estimation, *logs.holdout)
    views = []
    for k, view in enumerate(several.logs):
        of_log = {id(r): r for r, i in zip(records, of, strict=False) if i == k}
        alone = diagnose_pose(tuple(of_log.values()), (), geometry)
        shown = tuple(_shown(e, alone) for e in pose.effects)
        views.append(replace(view, effects=(*view.effects, *shown)))
    ids = [e.id for e in views[0].effects]
    return replace(several, logs=tuple(views), constancy=constancies(views, ids))


def _shown(e: NamedEffect, alone: PoseDiagnosis | None) -> LogEffect:
    """What one log shows of an effect; parameters where it names the same one."""
    effects = () if alone is None else alone.effects
    same = next((f for f in effects if f.id == e.id), None)
    if same is not None:
        own = tuple(LogParameter(v.name, v.value, v.std_error, v.unit) for v in same.parameters)
        return LogEffect(e.id, SIGNIFICANT, own)
    names = {e.id, *e.indistinguishable}
    if any(names & {f.id, *f.indistinguishable} for f in effects):
        return LogEffect(e.id, SIGNIFICANT, ())
    least = None if alone is None else alone.detectable.get(e.id)
    null = {p.name: p.null for p in effect(e.id).parameters}
    first = e.parameters[0]
    size = abs(first.value - null[first.name.partition("[")[0]])
    seen = least is not None and CLEARLY * least < size
    return LogEffect(e.id, ABSENT if seen else INCONCLUSIVE, ())
