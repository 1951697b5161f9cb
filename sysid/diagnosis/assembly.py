"""Puts what was found together: effects, verdict, both models, gap, what to do next."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.data.checks.quality import inspect_records
from sysid.diagnosis import findings
from sysid.diagnosis.advise import experiment_between, experiment_on_ground, next_experiments
from sysid.diagnosis.augment import model_of
from sysid.diagnosis.diagnosis import OF_THE_LOG, Diagnosis, Experiment, Trace
from sysid.diagnosis.following import ASTRAY, not_followed
from sysid.diagnosis.gap import Gap, with_path
from sysid.diagnosis.named_effects import NamedEffect
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.diagnosis.search.detectable import detectable
from sysid.diagnosis.search.named_sets import Named, Naming, Node
from sysid.diagnosis.several.constancy import several_logs
from sysid.diagnosis.study import Outcome, Study, held_runs
from sysid.diagnosis.validation.acceptance import final_evidence
from sysid.diagnosis.validation.explain import described, explain
from sysid.diagnosis.validation.left_over import left_over
from sysid.diagnosis.validation.localise import Region, leading, localise
from sysid.diagnosis.validation.uneven_delay import uneven_delays
from sysid.diagnosis.verdict import Remaining, story, undecided, verdict_of
from sysid.effects.catalogue import CHANGED, NOT_NAMED, about, ground_effects
from sysid.effects.samples import DROPOUTS, QUANTISATION
from sysid.errors import SysidError
from sysid.estimation.vehicle.windows import track_channels
from sysid.structures.model import Model
from sysid.vehicle.kinematics import Geometry

FEW_WINDOWS = 40
"""Fewer windows of pose seldom prove an effect of the vehicle."""


def assembled(found: Outcome, model: Model | None, pose: PoseDiagnosis | None) -> Diagnosis:
    """Everything but the mission.

    Args:
        found: what the search has found.
        model: the one that was given.
        pose: what is missing between tracks and ground.
    """
    study = found.study
    naming, dropped = study.confirmed(found.naming)
    before, base = study.origin.before, study.base
    after = study.residual_structure(naming, after=True) if naming.named else before
    left = _where(study, naming.final)
    remaining = Remaining(after, study.gap(naming), leading(left, base.parts.held[0].output_names))
    samples = base.parts.samples
    effects = in_order(
        (
            *(_named(study, naming, n, remaining, left) for n in _proven(naming)),
            *_of_pose(pose),
            *findings.sample_effects(samples),
        )
    )
    ids = [e.id for e in effects]
    poor = _poor(study, naming)
    off = pose is not None and pose.residuals.structured
    linear = study.linear_words(naming)
    verdict = verdict_of(ids, remaining, off or poor.startswith(ASTRAY) or bool(linear))
    traces = _traces(study, naming)
    old, new = _models(study, naming, model, pose)
    gap = remaining.gap if pose is None else with_path(remaining.gap, pose.whole)
    size = left_over(base.parts.held, naming.final.errors.held, study.floor, _lengths(pose))
    told = replace(remaining, gap=gap) if pose is not None and pose.effects else remaining
    unseen = _unseen(study, naming, pose, ids)
    silent = verdict != "unexplained" and set(ids) <= set(OF_THE_LOG) and not poor
    return Diagnosis(
        verdict=verdict,
        story=poor or story(verdict, ids, told, base.on_rate),
        undecided=undecided(remaining) if silent and remaining.loud else "",
        unfollowed=poor,
        base_words=study.origin.base.words,
        plainer=base.words if study.doubted is not None else "",
        effects=effects,
        dropped=dropped,
        left_over=size if remaining.structured else None,
        minor=tuple(dict.fromkeys(id for id, _ in naming.minor)),
        candidates=(*naming.candidates, *(pose.candidates if pose is not None else ())),
        where=_where(study, study.origin.base.node),
        where_after=left,
        gap=gap,
        detectable=unseen,
        next_experiments=_next(study, naming, pose, unseen),
        before=old,
        after=new,
        residuals=tuple(
            r.verdict(name) for name, r in (("before", before), ("after", after)) if r is not None
        ),
        description="; ".join(
            text
            for text in (linear, _description(study, naming, remaining, traces, bool(effects)))
            if text
        ),
        warnings=_warnings(study, naming, pose, samples.hidden),
        traces=traces,
        geometry=pose.geometry if pose is not None else None,
        several=several_logs(study, naming),
    )


def in_order(effects: Sequence[NamedEffect]) -> tuple[NamedEffect, ...]:
    """What spoils the readings before all else: a person can check it by hand, and everything
    after it rests on them. Reading in steps spoils nothing and stays where it is."""
    spoils = [e for e in effects if e.id in OF_THE_LOG and e.id != QUANTISATION.id]
    return (*spoils, *(e for e in effects if e not in spoils))


def _proven(naming: Naming) -> tuple[Named, ...]:
    """Accepted effects, without what only differs between logs."""
    return tuple(n for n in naming.named if n.id not in NOT_NAMED)


def _named(
    study: Study, naming: Naming, n: Named, remaining: Remaining, left: Sequence[Region]
) -> NamedEffect:
    """An accepted effect, with how well its law fits."""
    names = study.base.parts.held[0].output_names
    mine = [name for name, touched in zip(names, n.touched, strict=True) if touched]
    remains = ""
    if remaining.structured and any(_open(remaining.gap, name) for name in mine):
        where = leading(left, mine)
        remains = "something else remains" + (f" where {where}" if where else "")
    evidence = final_evidence(study.base, naming, n)
    explains, _ = study.explained_by(naming, n)
    return findings.named_effect(study.base, naming, n, evidence, explains, remains)


def _lengths(pose: PoseDiagnosis | None) -> Geometry | None:
    """The vehicle's lengths where they had to be estimated."""
    return None if pose is None or pose.geometry is None else pose.geometry.geometry


def _of_pose(pose: PoseDiagnosis | None) -> tuple[NamedEffect, ...]:
    """Effects between tracks and ground; one alone with the share that it closes where it acts."""
    if pose is None or len(pose.effects) != 1:
        return () if pose is None else pose.effects
    return (replace(pose.effects[0], explains_percent=pose.gap.closed_percent),)


def _open(gap: Gap, name: str) -> bool:
    """Whether much of an output's gap is left."""
    c = gap.channels[name]
    left = c.rmse_after**2 - c.noise_floor**2
    open_ = left > (1.0 - 0.01 * VERDICT.nearly_all) * (c.rmse_before**2 - c.noise_floor**2)
    return open_ or c.rmse_after > VERDICT.loud * c.surely_noise


def _models(
    study: Study, naming: Naming, model: Model | None, pose: PoseDiagnosis | None
) -> tuple[Model, Model]:
    """The models before and after; one and the same where nothing was added."""
    base = study.base
    before = model if model is not None else model_of(base, naming.base)
    on_ground = pose is not None and bool(pose.effects)
    if not (_proven(naming) or on_ground):
        return before, before
    after = model_of(base, naming.final, naming.intervals)
    if pose is not None and on_ground:
        channels = track_channels(base.parts.estimation[0]) or (0, 1)
        after = with_ground(after, pose.ground, pose.std_errors, tracks=channels)
    return before, after


def _description(
    study: Study, naming: Naming, remaining: Remaining, traces: Sequence[Trace], named: bool
) -> str:
    """A sparse description of what no effect explains; empty where nothing is left."""
    if not remaining.structured or (named and remaining.gap.closed_percent >= VERDICT.nearly_all):
        return ""
    runs = held_runs(traces, after=True)
    errors = naming.final.errors.held
    return described(explain(study.base.parts.held, errors, runs, study.floor, study.scales))


def _poor(study: Study, naming: Naming) -> str:
    """That the model after does not follow the log, and what its checks say of why."""
    held, errors = study.base.parts.held, naming.final.errors.held
    if not not_followed(held, errors, study.floor, ()):
        return ""
    try:
        checks = inspect_records(study.base.parts.estimation)
    except SysidError:
        checks = ()
    return not_followed(held, errors, study.floor, checks)


def _traces(study: Study, naming: Naming) -> tuple[Trace, ...]:
    traces = findings.traces(study.base, naming)
    if study.doubted is None:
        return traces
    theirs = findings.traces(study.doubted.base, study.doubted.nothing)
    return tuple(replace(t, before=o.before) for t, o in zip(traces, theirs, strict=True))


def _where(study: Study, node: Node) -> tuple[Region, ...]:
    return localise(study.base.parts.held, node.errors.held, study.floor, study.scales, study.seed)


def _unseen(
    study: Study, naming: Naming, pose: PoseDiagnosis | None, named: Sequence[str]
) -> dict[str, float | None]:
    single = study.base.parts.estimation[0].ny == 1
    offered = [e for e in study.base.search.model.effects if e.id not in NOT_NAMED]
    rest = [e.id for e in offered if e.id not in named and not (single and e.couples)]
    rest += [e.id for e in (QUANTISATION, DROPOUTS) if e.id not in named]
    if study.base.level:
        rest = [id for id in rest if not about(id).level]
    found = detectable(study.base.search, naming.final, rest)
    if pose is not None:
        found |= {k: v for k, v in pose.detectable.items() if k not in named}
    elif not single:
        found |= dict.fromkeys(e.id for e in ground_effects())
    return found


def _next(
    study: Study, naming: Naming, pose: PoseDiagnosis | None, unseen: dict[str, float | None]
) -> tuple[Experiment, ...]:
    base, first = study.base, study.base.parts.estimation[0]
    found = [
        experiment_between(base.search, n.rivals, study.floor, base.scales, base.delay)
        for n in _proven(naming)
        if len(n.rivals) > 1 and CHANGED.id not in n.rivals
    ]
    found += [
        experiment_on_ground((e.id, *e.indistinguishable), first, study.scales)
        for e in (pose.effects if pose is not None else ())
        if e.indistinguishable
    ]
    vehicle = {e.id for e in ground_effects()}
    blind = [id for id, size in unseen.items() if size is None and id not in vehicle]
    more = next_experiments(first, study.scales, blind) if first.is_robot_log or blind else ()
    return (*found, *more)


def _warnings(
    study: Study,
    naming: Naming,
    pose: PoseDiagnosis | None,
    hidden: int,
) -> tuple[str, ...]:
    found = list(findings.absorbed(study.base, naming))
    if study.doubted is not None:
        found.append(
            "The model before has absorbed a part of what is missing: effects added "
            "to it explain less. They stand on the plainest base instead; with them its "
            "held-out error is the smaller one."
        )
    if study.base.in_loop:
        found.append(
            "The log was recorded in closed loop: the command answers disturbances, which can "
            "look like an effect. The held-out error must therefore fall below 70 %."
        )
    flat = findings.two_levels(study.base.parts.estimation, study.scales)
    if flat:
        found.append(
            f"{', '.join(flat)} has only two levels: a dead zone, a saturation or any other "
            "static curve is not identifiable from this log, because each looks like "
            "another gain."
        )
    late = study.late or uneven_delays(study.base, naming.final, study.floor)
    found += [u.sentence for u in late]
    if study.late:
        found.append(
            "Samples behind changes of the command that such delays spoil are left out of the "
            "search and of every figure: what is named was seen between them."
        )
    found += findings.indistinct_edges(study.base, naming, study.base.parts.estimation)
    if hidden:
        found.append(f"{hidden} lost or repeated readings are left out of every figure.")
    if pose is not None and not pose.effects and sum(pose.windows) < FEW_WINDOWS:
        found.append(
            f"The pose gives only {sum(pose.windows)} windows of motion to judge slip and "
            "radii by; name a second log with `validation` or drive longer."
        )
    if pose is not None and pose.residuals.loud:
        found.append(pose.residuals.sentence)
    return (*found, *(pose.warnings if pose is not None else ()))
