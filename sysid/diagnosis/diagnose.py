"""The whole diagnosis: where, what, added, proven."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.record import Record
from sysid.data.same_kind import require_same_kind
from sysid.diagnosis.assembly import assembled
from sysid.diagnosis.base_model import full_drive, given_base, plain_base
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.given_model import around_model, or_on_first_order
from sysid.diagnosis.pose.readings import put_right
from sysid.diagnosis.search.naming import Progress
from sysid.diagnosis.several.ground import with_ground
from sysid.diagnosis.study import Study, noise_of
from sysid.diagnosis.tied_readings import with_pose
from sysid.diagnosis.validation.mission import prove_on_mission
from sysid.effects.catalogue import chain_effects
from sysid.effects.measured import Measured, within
from sysid.errors import DataError, UsageError
from sysid.estimation.identify import shares_samples
from sysid.mission.spec import load_mission
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

NO_POSE = (
    "The geometry was not used: the log holds no pose (columns x, y, psi) with the speeds of a "
    "left and a right track, or too little of it."
)

PATH_ROWS = 400
"""Points of a path kept for the picture."""


def diagnose(
    estimation: Sequence[Record],
    held: Sequence[Record] | None = None,
    *,
    model: Model | None = None,
    mission: Path | None = None,
    geometry: Geometry | None = None,
    measured: Mapping[str, Measured] | None = None,
    progress: Progress | None = None,
    seed: int = 0,
) -> Diagnosis:
    """Where a model and logs disagree, which effects are missing, and how far they close the gap.

    Args:
        estimation: logs that effects are searched on.
        held: logs that judge; None holds out blocks of the estimation logs.
        model: the model that disagrees; None fits the plainest base first.
        mission: the mission that the logs drove: both models drive it again, and its geometry,
            where it gives one, is the vehicle's.
        geometry: the vehicle's lengths; None takes the mission's, and where that gives none those
            of the bundled robot, unless the pose contradicts them: then they are estimated.
        measured: what a bench measured of battery and bridge, by key of ``vehicle.supply``: effects
            that these are numbers of are looked for near them.
        progress: called with what is being done and how far it is.
        seed: of every bootstrap.

    Raises:
        DataError: the logs cannot serve.
        ModelError: the model cannot be run on them.
        UsageError: a log that judges is one that effects are searched on.
    """
    started = time.perf_counter()
    _require_enough(estimation, held)
    require_apart(estimation, held or ())
    require_same_kind((*estimation[1:], *(held or ())), estimation[0])
    say = progress or (lambda text, share: None)
    say("the model before", 0.02)
    effects = within(chain_effects(), measured or {})
    if model is None:
        base = plain_base(estimation, held, effects)
    else:
        base = given_base(model, estimation, held, effects)
    study = Study(base, noise_of(base), full_drive(estimation), seed)
    say("is there anything to explain?", 0.06)
    if model is None:
        found = study.searched(base.search.model.effects, say)
        found = or_on_first_order(found, estimation, held, say)
    else:
        found = around_model(model, study, estimation, held, say)
    say("the proof", 0.72)
    if geometry is None and mission is not None:
        geometry = load_mission(mission).vehicle.given_geometry
    found, pose_diagnosis = with_pose(found, geometry)
    result = assembled(found, model, pose_diagnosis)
    if pose_diagnosis is not None and result.several.logs:
        mine, theirs = put_right(found.study.base, found.naming)
        every = mine if base.parts.held is base.parts.estimation else (*mine, *theirs)
        several = with_ground(result.several, every, base.search.logs, pose_diagnosis, geometry)
        result = replace(result, several=several)
    if geometry is not None and pose_diagnosis is None and mission is None:
        result = replace(result, warnings=(*result.warnings, NO_POSE))
    if mission is not None:
        say("the mission again with both models", 0.9)
        whole = (*estimation, *(held or ()))
        if result.geometry is not None:
            geometry = result.geometry.geometry
        result = replace(result, path=_path(mission, whole, result, geometry))
    say("done", 1.0)
    return replace(result, seconds=time.perf_counter() - started)


FEWEST = 60
"""Samples of a diagnosis: two thirds carry the base and the effects, and the held-out third must
hold the 20 that a test of errors needs."""


def _require_enough(estimation: Sequence[Record], held: Sequence[Record] | None) -> None:
    samples = sum(map(len, estimation)) + sum(map(len, held or ()))
    if samples < FEWEST:
        raise DataError(
            f"{estimation[0].name}: {samples} samples are too few to tell what is missing from "
            f"noise; record at least {FEWEST}, better some hundreds"
        )


def require_apart(estimation: Sequence[Record], held: Sequence[Record]) -> None:
    """Refuse logs that prove nothing or belong to something else.

    Raises:
        UsageError: effects are searched on one that judges.
    """
    for r in held:
        if any(shares_samples(r, e) for e in estimation):
            raise UsageError(
                f"{r.name} is both a log and a `validation` log and would prove nothing; leave "
                "`validation` away and the log is split"
            )


def _path(
    mission: Path, records: Sequence[Record], result: Diagnosis, geometry: Geometry | None
) -> dict[str, Any]:
    proof = prove_on_mission(mission, records, result.before, result.after, geometry)
    traces = []
    for t in proof.traces:
        stride = max(len(t.t) // PATH_ROWS, 1)
        rows = {
            name: np.round(getattr(t, name)[::stride, :2], 4).tolist()
            for name in ("measured", "before", "after")
        }
        traces.append({"record": t.name, **rows})
    return {**proof.facts, "traces": traces}
