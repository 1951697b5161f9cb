"""The diagnosis assembled: effects, verdict, both models, gap and next experiments."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from sysid.data.inspection import inspect_records
from sysid.diagnosis import findings
from sysid.diagnosis.advise import experiment_between, experiment_on_ground, next_experiments
from sysid.diagnosis.augment import model_of
from sysid.diagnosis.diagnosis import OF_THE_LOG, Diagnosis, Experiment, Trace
from sysid.diagnosis.following import ASTRAY, not_followed
from sysid.diagnosis.gap import Gap, with_path
from sysid.diagnosis.long_logs import InFull
from sysid.diagnosis.named_effects import NamedEffect, RejectedEffect
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.diagnosis.search.detectable import detectable
from sysid.diagnosis.search.selection import CandidateModel, SelectedEffect, Selection
from sysid.diagnosis.session import DiagnosisSession, SelectionResult, holdout_runs
from sysid.diagnosis.several.constancy import several_logs
from sysid.diagnosis.validation.acceptance import final_evidence
from sysid.diagnosis.validation.excess_error import excess_error
from sysid.diagnosis.validation.explain import described, explain
from sysid.diagnosis.validation.jitter import detect_jitter
from sysid.diagnosis.validation.localise import Region, leading, localise
from sysid.diagnosis.verdict import (
    TOO_SHORT,
    Remaining,
    story,
    too_short,
    undecided,
    verdict_of,
)
from sysid.effects.catalogue import CHANGED, NOT_NAMED, about, ground_effects
from sysid.effects.samples import DROPOUTS, QUANTISATION
from sysid.errors import SysidError
from sysid.robot.calibration.windows import track_channels
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

Judge = Callable[[DiagnosisSession, Selection], InFull]
"""Both models on all samples of long logs."""

ONLY_IN_PIECES = "over all samples of the log the errors grow with it"

FEW_WINDOWS = 40
"""Fewer windows of pose seldom prove an effect of the vehicle."""


def assemble(
    result: SelectionResult,
    model: Model | None,
    pose: PoseDiagnosis | None,
    judged: Judge | None = None,
) -> Diagnosis:
    """Everything but the mission.

    Args:
        result: what the search has found.
        model: the one that was given.
        pose: what is missing between tracks and ground.
        judged: both models on all samples of logs that were searched in pieces.
    """
    selection, rejected, whole = _confirmed(result, judged)
    session = result.session
    gap = whole.gap if whole else session.gap(selection)
    diagnosis = _assembled(session, selection, gap, model, pose)
    if not diagnosis.story.startswith(TOO_SHORT):
        diagnosis = replace(diagnosis, rejected=rejected)
    if whole is None:
        return diagnosis
    return replace(
        diagnosis,
        warnings=(whole.sentence, *diagnosis.warnings),
        traces=(*(t for t in diagnosis.traces if t.role == "estimation"), *whole.traces),
    )


def _assembled(
    session: DiagnosisSession,
    selection: Selection,
    held_out: Gap,
    model: Model | None,
    pose: PoseDiagnosis | None,
) -> Diagnosis:
    """Everything about some effects, given the gap of the outputs on held-out data."""
    before, base = session.origin.before, session.base
    after = session.residual_structure(selection, after=True) if selection.selected else before
    tests = (("before", before), ("after", after))
    regions = _where(session, selection.final)
    names = base.parts.holdout[0].output_names
    remaining = Remaining(after, held_out, leading(regions, names))
    named = (_named(session, selection, n, remaining, regions) for n in selection.effects)
    seen = findings.sample_effects(base.parts.samples)
    effects = in_order((*named, *(() if pose is None else pose.effects), *seen))
    ids = [e.id for e in effects]
    poor = _poor(session, selection)
    linear = session.linear_words(selection)
    off = (pose is not None and pose.residuals.structured) or poor.startswith(ASTRAY)
    verdict = verdict_of(ids, remaining, off or bool(linear))
    short = after is None and not selection.effects and (bool(poor) or verdict == "unexplained")
    traces = _traces(session, selection)
    old, new = _models(session, selection, model, pose)
    gap = remaining.gap if pose is None else with_path(remaining.gap, pose.whole)
    errors = selection.final.errors.holdout
    size = excess_error(base.parts.holdout, errors, session.floor, _lengths(pose))
    reported = replace(remaining, gap=gap) if pose is not None and pose.effects else remaining
    unseen = _unseen(session, selection, pose, ids)
    parts = (linear, _description(session, selection, remaining, traces, bool(effects)))
    silent = verdict != "unexplained" and set(ids) <= set(OF_THE_LOG) and not poor
    diagnosis = Diagnosis(
        verdict=verdict,
        story=poor or story(verdict, ids, reported, base.on_rate),
        undecided=undecided(remaining) if silent and remaining.above_noise else "",
        unfollowed=poor,
        base_words=session.origin.base.words,
        baseline_words=base.words if session.given is not None else "",
        effects=effects,
        excess_error=size if remaining.structured else None,
        minor=tuple(dict.fromkeys(id for id, _ in selection.minor)),
        candidates=(*selection.candidates, *(pose.candidates if pose is not None else ())),
        where=_where(session, session.origin.base.model),
        where_after=regions,
        gap=gap,
        detectable=unseen,
        next_experiments=_next(session, selection, pose, unseen),
        before=old,
        after=new,
        residuals=tuple(r.verdict(name) for name, r in tests if r is not None),
        description="; ".join(filter(None, parts)),
        warnings=_warnings(session, selection, pose, base.parts.samples.hidden),
        traces=traces,
        geometry=pose.geometry if pose is not None else None,
        several=several_logs(session, selection),
    )
    return _of_few_samples(diagnosis, too_short(remaining)) if short else diagnosis


def _of_few_samples(diagnosis: Diagnosis, sentence: str) -> Diagnosis:
    """A diagnosis that says nothing but that the log is too short: so few samples show no more."""
    plain = replace(diagnosis, minor=(), candidates=(), where=(), where_after=(), description="")
    return replace(plain, story=sentence, unfollowed=sentence, undecided="")


def _confirmed(
    result: SelectionResult, judged: Judge | None
) -> tuple[Selection, tuple[RejectedEffect, ...], InFull | None]:
    """The accepted effects, the rejected ones, and both models on all samples of long logs."""
    session = result.session
    selection, rejected = session.confirmed(result.selection)
    if judged is None:
        return selection, rejected, None
    whole = judged(session, selection)
    while selection.effects:
        rests = {n.id: judged(session, replace(selection, final=n.rest)) for n in selection.effects}
        least = min(rests, key=lambda id: rests[id].gap.after)
        if rests[least].gap.after > whole.gap.after:
            break
        rejected += (RejectedEffect(least, ONLY_IN_PIECES),)
        selection = session.measured(session.base.search.without_effect(selection, least))
        whole = judged(session, selection)
    return selection, rejected, whole


def in_order(effects: Sequence[NamedEffect]) -> tuple[NamedEffect, ...]:
    """What spoils the measurements before all else: a person can check it by hand, and everything
    after it rests on them. Reading in steps spoils nothing and stays where it is."""
    spoils = [e for e in effects if e.id in OF_THE_LOG and e.id != QUANTISATION.id]
    return (*spoils, *(e for e in effects if e not in spoils))


def _named(
    session: DiagnosisSession,
    selection: Selection,
    n: SelectedEffect,
    remaining: Remaining,
    regions: Sequence[Region],
) -> NamedEffect:
    """An accepted effect, with how well its law fits."""
    names = session.base.parts.holdout[0].output_names
    touched_outputs = [name for name, touched in zip(names, n.touched, strict=True) if touched]
    remains = ""
    if remaining.structured and any(_open(remaining.gap, name) for name in touched_outputs):
        where = leading(regions, touched_outputs)
        remains = "partly explained" + (f": errors remain where {where}" if where else "")
    evidence = final_evidence(session.base, selection, n)
    return findings.named_effect(session.base, selection, n, evidence, remains)


def _lengths(pose: PoseDiagnosis | None) -> Geometry | None:
    """The vehicle's lengths where they had to be estimated."""
    return None if pose is None or pose.geometry is None else pose.geometry.geometry


def _open(gap: Gap, name: str) -> bool:
    """Whether much of an output's gap is left."""
    c = gap.channels[name]
    remaining = c.rmse_after**2 - c.noise_floor**2
    open_ = remaining > (1.0 - 0.01 * VERDICT.nearly_all) * (c.rmse_before**2 - c.noise_floor**2)
    return open_ or c.rmse_after > VERDICT.residual_to_noise * c.surely_noise


def _models(
    session: DiagnosisSession, selection: Selection, model: Model | None, pose: PoseDiagnosis | None
) -> tuple[Model, Model]:
    """The original and augmented models; one and the same where nothing was added."""
    base = session.base
    before = model if model is not None else model_of(base, selection.base)
    on_ground = pose is not None and bool(pose.effects)
    if not (selection.effects or on_ground):
        return before, before
    after = model_of(base, selection.final, selection.intervals)
    if pose is not None and on_ground:
        channels = track_channels(base.parts.estimation[0]) or (0, 1)
        after = with_ground(after, pose.ground, pose.std_errors, tracks=channels)
    return before, after


def _description(
    session: DiagnosisSession,
    selection: Selection,
    remaining: Remaining,
    traces: Sequence[Trace],
    named: bool,
) -> str:
    """A sparse description of what no effect explains; empty where nothing is left."""
    if not remaining.structured or (named and remaining.gap.closed_percent >= VERDICT.nearly_all):
        return ""
    runs = holdout_runs(traces, after=True)
    errors = selection.final.errors.holdout
    return described(
        explain(session.base.parts.holdout, errors, runs, session.floor, session.scales)
    )


def _poor(session: DiagnosisSession, selection: Selection) -> str:
    """That the augmented model does not follow the log, and what its checks say of why."""
    holdout, errors = session.base.parts.holdout, selection.final.errors.holdout
    if not not_followed(holdout, errors, session.floor, ()):
        return ""
    try:
        checks = inspect_records(session.base.parts.facts)
    except SysidError:
        checks = ()
    return not_followed(holdout, errors, session.floor, checks)


def _traces(session: DiagnosisSession, selection: Selection) -> tuple[Trace, ...]:
    traces = findings.traces(session.base, selection)
    if session.given is None:
        return traces
    original_traces = findings.traces(session.given.base, session.given.nothing)
    return tuple(replace(t, before=o.before) for t, o in zip(traces, original_traces, strict=True))


def _where(session: DiagnosisSession, candidate: CandidateModel) -> tuple[Region, ...]:
    return localise(
        session.base.parts.holdout,
        candidate.errors.holdout,
        session.floor,
        session.scales,
        session.seed,
    )


def _unseen(
    session: DiagnosisSession,
    selection: Selection,
    pose: PoseDiagnosis | None,
    named: Sequence[str],
) -> dict[str, float | None]:
    single = session.base.parts.estimation[0].ny == 1
    offered = [e for e in session.base.search.model.effects if e.id not in NOT_NAMED]
    rest = [e.id for e in offered if e.id not in named and not (single and e.couples)]
    rest += [e.id for e in (QUANTISATION, DROPOUTS) if e.id not in named]
    if session.base.level:
        rest = [id for id in rest if not about(id).level]
    smallest = detectable(session.base.search, selection.final, rest)
    if pose is not None:
        smallest |= {k: v for k, v in pose.detectable.items() if k not in named}
    elif not single:
        smallest |= dict.fromkeys(e.id for e in ground_effects())
    return smallest


def _next(
    session: DiagnosisSession,
    selection: Selection,
    pose: PoseDiagnosis | None,
    unseen: dict[str, float | None],
) -> tuple[Experiment, ...]:
    base, first = session.base, session.base.parts.estimation[0]
    experiments = [
        experiment_between(base.search, n.rivals, session.floor, base.scales, base.delay)
        for n in selection.effects
        if len(n.rivals) > 1 and CHANGED.id not in n.rivals
    ]
    experiments += [
        experiment_on_ground((e.id, *e.indistinguishable), first, session.scales)
        for e in (pose.effects if pose is not None else ())
        if e.indistinguishable
    ]
    vehicle = {e.id for e in ground_effects()}
    blind = [id for id, size in unseen.items() if size is None and id not in vehicle]
    more = next_experiments(first, session.scales, blind) if first.is_robot_log or blind else ()
    return (*experiments, *more)


def _warnings(
    session: DiagnosisSession, selection: Selection, pose: PoseDiagnosis | None, hidden: int
) -> tuple[str, ...]:
    warnings = list(findings.absorbed(session.base, selection))
    if session.given is not None:
        warnings.append(
            "The original model has absorbed part of what is missing. The effects are added to the "
            "baseline instead, whose held-out error is then smaller."
        )
    if session.base.in_loop:
        warnings.append(
            "The log was recorded in closed loop: the command responds to disturbances, which "
            "can look like an effect. Each effect must reduce the held-out error to below 70 %."
        )
    flat = findings.two_levels(session.base.parts.estimation, session.scales)
    if flat:
        warnings.append(
            f"{', '.join(flat)} has only two levels: a dead zone, a saturation or any other "
            "static curve is not identifiable from this log, because each looks like "
            "another gain."
        )
    late = session.jitter or detect_jitter(session.base, selection.final, session.floor)
    warnings += [u.sentence for u in late]
    if session.jitter:
        warnings.append(
            "Samples that this jitter spoils are excluded from the search and from every figure."
        )
    warnings += findings.indistinct_edges(session.base, selection, session.base.parts.estimation)
    if hidden:
        warnings.append(f"{hidden} lost or repeated measurements are excluded from every figure.")
    if pose is not None and not pose.effects and sum(pose.windows) < FEW_WINDOWS:
        warnings.append(
            f"The pose gives only {sum(pose.windows)} windows of motion to judge slip and "
            "radii. Give a second log with `validation`, or drive longer."
        )
    if pose is not None and pose.residuals.above_noise:
        warnings.append(pose.residuals.sentence)
    return (*warnings, *(pose.warnings if pose is not None else ()))
