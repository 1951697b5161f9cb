"""The entry of a diagnosis: localise, select effects, augment the model, validate it."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.data.checks.dynamics_checks import (
    WITHOUT_DRIFT,
    change_sentence,
    drift_sentences,
)
from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.data.same_kind import require_same_kind
from sysid.diagnosis.assembly import assemble
from sysid.diagnosis.base_model import fit_baseline, full_drive, given_base
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.first_order import or_a_sample_later, or_on_first_order
from sysid.diagnosis.long_logs import searched_on
from sysid.diagnosis.neutral import as_logged, counted_from, neutral_commands
from sysid.diagnosis.pose.correct_sensor import correct_sensor, resolve_ties_by_pose
from sysid.diagnosis.search.forward_selection import Progress
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.diagnosis.several.constancy import with_ground
from sysid.diagnosis.validation.runs_away import RUNS_AWAY, of_answers, running_away, without
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, chain_effects
from sysid.effects.measured import Measured, within
from sysid.errors import DataError, UsageError
from sysid.estimation.identify import shares_samples
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

NO_POSE = (
    "The geometry was not used: the log holds no pose (columns x, y, psi) with the speeds of a "
    "left and a right track, or too little of it."
)


def diagnose(
    estimation: Sequence[Record],
    holdout: Sequence[Record] | None = None,
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
        holdout: validation logs; None holds out blocks of the estimation logs.
        model: the model that disagrees, taken as it is; None fits the baseline.
        mission: the mission that the logs drove: both models drive it again, and its geometry,
            where it gives one, is the vehicle's.
        geometry: the vehicle's lengths; None takes the mission's, and where that gives none those
            of the bundled robot, unless the pose contradicts them: then they are estimated.
        measured: what a bench measured of battery and bridge, by key of ``vehicle.supply``: effects
            that these are parameters of are looked for near them.
        progress: called with what is being done and how far it is.
        seed: of every bootstrap.

    Raises:
        DataError: the logs cannot serve.
        ModelError: the model cannot be run on them.
        UsageError: a validation log is also an estimation log.
    """
    started = time.perf_counter()
    _require_enough(estimation, holdout)
    require_apart(estimation, holdout or ())
    logs = (*estimation, *(holdout or ()))
    require_same_kind(logs[1:], logs[0])
    say = progress or (lambda text, share: None)
    if geometry is None and mission is not None:
        from sysid.robot.mission.spec import load_mission

        geometry = load_mission(mission).vehicle.given_geometry
    neutral, known = np.zeros(logs[0].nu), True
    if model is None:
        neutral, known = neutral_commands(estimation)
    if neutral.any():
        estimation = counted_from(neutral, estimation)
        holdout = counted_from(neutral, holdout) if holdout else None
    alone = () if model is not None else running_away(LogFacts.of(estimation))
    if alone and len(alone) < logs[0].ny and logs[0].nu == 1:
        estimation = without(alone, estimation)
        holdout = without(alone, holdout) if holdout else None
    effects = within(chain_effects(), measured or {})
    diagnosis = _searched(estimation, holdout, model, geometry, effects, not known, say, seed)
    if alone:
        warnings = (f"{' and '.join(alone)} {RUNS_AWAY}", *diagnosis.warnings)
        diagnosis = replace(diagnosis, warnings=warnings)
    if neutral.any():
        diagnosis = as_logged(diagnosis, neutral)
    if geometry is not None and diagnosis.geometry is None and mission is None:
        diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, NO_POSE))
    if mission is not None:
        from sysid.diagnosis.validation.mission import prove_on_mission

        say("driving the mission with both models", 0.9)
        if diagnosis.geometry is not None:
            geometry = diagnosis.geometry.geometry
        path = prove_on_mission(mission, logs, diagnosis.before, diagnosis.after, geometry)
        diagnosis = replace(diagnosis, path=path)
    say("done", 1.0)
    return replace(diagnosis, seconds=time.perf_counter() - started)


def _searched(
    estimation: Sequence[Record],
    holdout: Sequence[Record] | None,
    model: Model | None,
    geometry: Geometry | None,
    effects: Sequence[Effect],
    offset: bool,
    say: Progress,
    seed: int,
) -> Diagnosis:
    """Everything but the mission.

    Args:
        offset: whether the baseline has one in any case.
    """
    say("original model", 0.02)
    searched = searched_on(estimation, holdout, model is not None)
    facts, holdout_facts = searched.facts, searched.holdout_facts
    if model is None:
        base = fit_baseline(facts, holdout_facts, effects, offset=offset)
    else:
        base = given_base(model, facts, holdout_facts, effects)
    session = DiagnosisSession(base, noise_of(base), full_drive(facts.records), seed)
    say("testing the residuals", 0.06)
    elsewhere = model is not None and not model.fitted_to(facts.records)
    candidates = base.search.model.effects
    result = session.searched((*candidates, CHANGED) if elsewhere else candidates, say)
    if model is None:
        result = or_a_sample_later(result, facts, holdout_facts)
        result = or_on_first_order(result, facts, holdout_facts, say)
    say("validation", 0.52)
    result, pose_diagnosis = resolve_ties_by_pose(result, geometry)
    diagnosis = assemble(result, model, pose_diagnosis, searched)
    if pose_diagnosis is not None and diagnosis.several.logs:
        corrected, corrected_holdout = correct_sensor(result.session.base, result.selection)
        every = (
            corrected
            if base.parts.holdout is base.parts.estimation
            else (*corrected, *corrected_holdout)
        )
        several = with_ground(diagnosis.several, every, base.search.logs, pose_diagnosis, geometry)
        diagnosis = replace(diagnosis, several=several)
    drifts = drift_sentences(estimation[0], facts.changes, facts.drifts).values()
    changes = [
        *(change_sentence(c, estimation[0]) for c in facts.changes),
        *(f"{drift} {WITHOUT_DRIFT}" for drift in drifts),
    ]
    warnings = (*(() if model is not None else of_answers(facts)), *diagnosis.warnings)
    return replace(diagnosis, changes=tuple(changes), warnings=warnings)


MIN_SAMPLES = 60
"""Samples of a diagnosis: two thirds carry the base and the effects, and the held-out third must
hold the 20 that a test of errors needs."""


def _require_enough(estimation: Sequence[Record], holdout: Sequence[Record] | None) -> None:
    samples = sum(map(len, estimation)) + sum(map(len, holdout or ()))
    if samples < MIN_SAMPLES:
        raise DataError(
            f"{estimation[0].name}: {samples} samples are too few for a diagnosis; "
            f"record at least {MIN_SAMPLES}, better some hundreds"
        )


def require_apart(estimation: Sequence[Record], holdout: Sequence[Record]) -> None:
    """Refuse validation logs that equal an estimation log."""
    for r in holdout:
        if any(shares_samples(r, e) for e in estimation):
            raise UsageError(
                f"{r.name} is both a log and a `validation` log: the validation log must differ "
                "from the estimation log; omit `validation` to split the log"
            )
