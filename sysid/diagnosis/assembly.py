"""The diagnosis assembled: effects, verdict, both models, gap and next experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.inspection import inspect_records
from sysid.diagnosis import findings
from sysid.diagnosis.advise import (
    experiment_between,
    experiment_on_ground,
    next_experiments,
    stretch_of,
)
from sysid.diagnosis.augment import model_of
from sysid.diagnosis.diagnosis import (
    OF_THE_LOG,
    Diagnosis,
    Experiment,
    NamedEffect,
    RejectedEffect,
    Trace,
)
from sysid.diagnosis.gap import ChannelGap, Gap, with_path
from sysid.diagnosis.isolability import isolability_of
from sysid.diagnosis.long_logs import InFull, Searched
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.diagnosis.rules.final_model import final_evidence, measured
from sysid.diagnosis.rules.ledger import confirmed
from sysid.diagnosis.search.detectable import detectable
from sysid.diagnosis.search.selection import CandidateModel, SelectedEffect, Selection
from sysid.diagnosis.session import DiagnosisSession, SelectionResult
from sysid.diagnosis.several.constancy import several_logs
from sysid.diagnosis.shapes.grading import FoundShape, curves_of
from sysid.diagnosis.validation.excess_error import ExcessError, excess_error
from sysid.diagnosis.validation.explain import described, explain
from sysid.diagnosis.validation.jitter import detect_jitter
from sysid.diagnosis.validation.localise import Region, leading, localise
from sysid.diagnosis.verdict import (
    ASTRAY,
    TOO_SHORT,
    Remaining,
    not_followed,
    story,
    too_short,
    undecided,
    verdict_of,
)
from sysid.effects.catalogue import CHANGED, NOT_NAMED, ground_effects
from sysid.effects.samples import DROPOUTS, QUANTISATION
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import residual_tests
from sysid.robot.calibration.windows import track_channels
from sysid.structures.model import Model

ONLY_IN_PIECES = "over all samples of the log the errors grow with it"

FEW_WINDOWS = 40
"""Fewer windows of pose seldom prove an effect of the vehicle."""


def assemble(
    result: SelectionResult,
    model: Model | None,
    pose: PoseDiagnosis | None,
    searched: Searched,
) -> Diagnosis:
    """Everything but the mission."""
    selection, rejected, whole = _confirmed(result, searched)
    session = result.session
    gap = whole.gap if whole else session.gap(selection)
    diagnosis = _Assembly(session, selection, gap, model, pose).diagnosis()
    if not diagnosis.story.startswith(TOO_SHORT):
        diagnosis = replace(diagnosis, rejected=rejected)
    if whole is None:
        return diagnosis
    return replace(
        diagnosis,
        warnings=(whole.sentence, *diagnosis.warnings),
        traces=(*(t for t in diagnosis.traces if t.role == "estimation"), *whole.traces),
    )


def _confirmed(
    result: SelectionResult, searched: Searched
) -> tuple[Selection, tuple[RejectedEffect, ...], InFull | None]:
    """The accepted effects, the rejected ones, and both models on all samples of long logs."""
    session = result.session
    selection, rejected = confirmed(session, result.selection)
    if not searched.whole:
        return selection, rejected, None
    whole = searched.judged(session, selection)
    while selection.effects:
        rests = {
            n.id: searched.judged(session, replace(selection, final=n.rest))
            for n in selection.effects
        }
        least = min(rests, key=lambda id: rests[id].gap.after)
        if rests[least].gap.after > whole.gap.after:
            break
        rejected += (RejectedEffect(least, ONLY_IN_PIECES, "only-in-pieces"),)
        selection = measured(session.base, session.base.search.without_effect(selection, least))
        whole = searched.judged(session, selection)
    return selection, rejected, whole


def in_order(effects: Sequence[NamedEffect]) -> tuple[NamedEffect, ...]:
    """What spoils the measurements before all else: a person can check it by hand, and everything
    after it rests on them. Reading in steps spoils nothing and stays where it is."""
    spoils = [e for e in effects if e.id in OF_THE_LOG and e.id != QUANTISATION.id]
    return (*spoils, *(e for e in effects if e not in spoils))


@dataclass(frozen=True, eq=False)
class _Assembly:
    """A session with its accepted effects, the gap of the outputs, a given model and the pose."""

    session: DiagnosisSession
    selection: Selection
    gap: Gap
    model: Model | None
    pose: PoseDiagnosis | None

    def diagnosis(self) -> Diagnosis:
        """Everything about these effects."""
        session, selection, pose, base = self.session, self.selection, self.pose, self.session.base
        regions, remaining = self.regions, self.remaining
        on_ground = () if pose is None else pose.effects
        seen = findings.sample_effects(base.parts.samples)
        effects = in_order((*map(self.named, selection.effects), *on_ground, *seen))
        ids = [e.id for e in effects]
        poor = self.poor()
        off = (pose is not None and pose.residuals.structured) or poor.startswith(ASTRAY)
        verdict = verdict_of(ids, remaining, off, self.shapes)
        gap = remaining.gap if pose is None else with_path(remaining.gap, pose.gap)
        left = replace(remaining, gap=gap) if on_ground else remaining
        told = story(verdict, ids, left, base.on_rate, self.shapes)
        traces, unseen = self.traces(), self.unseen(ids)
        silent = (
            verdict not in ("unexplained", "shape-found")
            and set(ids) <= set(OF_THE_LOG)
            and not poor
        )
        old, new = self.models()
        left_by = (("before", session.before), ("after", remaining.structure))
        tested = new is not old and not remaining.structured
        diagnosis = Diagnosis(
            verdict=verdict,
            story=poor or told,
            undecided=undecided(remaining) if silent and remaining.above_noise else "",
            unfollowed=poor,
            base_words=base.words,
            effects=effects,
            excess_error=self.excess_error() if remaining.structured else None,
            tests=residual_tests(new, base.parts.estimation) if tested else None,
            shapes=self.shapes,
            curves=self.curves(),
            minor=tuple(dict.fromkeys(id for id, _ in selection.minor)),
            candidates=(*selection.candidates, *(pose.candidates if pose is not None else ())),
            where=self.where(base.model),
            where_after=regions,
            gap=gap,
            detectable=unseen,
            next_experiments=self.next_experiments(unseen),
            before=old,
            after=new,
            residuals=tuple(r.verdict(name) for name, r in left_by if r is not None),
            description=self.description(bool(effects)),
            warnings=self.warnings(),
            traces=traces,
            geometry=pose.geometry if pose is not None else None,
            several=several_logs(session, selection),
            isolability=isolability_of(base),
        )
        nothing = remaining.structure is None and not selection.effects
        unsaid = poor or told.startswith(TOO_SHORT) or verdict in ("unexplained", "shape-found")
        if not nothing or not unsaid:
            return diagnosis
        # so few samples show no more than that the log is too short
        sentence = too_short(remaining)
        plain = replace(diagnosis, minor=(), candidates=(), where=(), where_after=())
        return replace(plain, description="", story=sentence, unfollowed=sentence, undecided="")

    @cached_property
    def shapes(self) -> tuple[FoundShape, ...]:
        """Proven shapes of what the augmented model leaves."""
        left = self.remaining.structure
        if left is None:  # too few samples to test what remains
            return ()
        return self.session.proven_shapes(self.selection.final, left)

    def curves(self) -> tuple[FoundShape, ...]:
        """The curve at the place of each named effect, without its law."""
        named = self.selection.effects
        each = (curves_of(self.session.shapes(n.rest), n) for n in named)
        return tuple(curve for curves in each for curve in curves)

    @cached_property
    def regions(self) -> tuple[Region, ...]:
        """Where the augmented model errs."""
        return self.where(self.selection.final)

    @cached_property
    def remaining(self) -> Remaining:
        """What remains in its errors."""
        after = self.session.before
        if self.selection.selected:
            after = self.session.residual_structure(self.selection.final)
        names = self.session.base.parts.holdout[0].output_names
        return Remaining(after, self.gap, leading(self.regions, names))

    def where(self, candidate: CandidateModel) -> tuple[Region, ...]:
        """Regimes of the errors of a model on held-out data."""
        s, errors = self.session, candidate.errors.holdout
        return localise(s.base.parts.holdout, errors, s.floor, s.scales, s.seed)

    def named(self, n: SelectedEffect) -> NamedEffect:
        """An accepted effect, with how well its law fits."""
        base, remains = self.session.base, ""
        names = np.array(base.parts.holdout[0].output_names)[n.touched].tolist()
        if self.remaining.structured and any(_open(self.gap.channels[name]) for name in names):
            where = leading(self.regions, names)
            remains = "partly explained" + (f": errors remain where {where}" if where else "")
        evidence = final_evidence(base, self.selection, n)
        return findings.named_effect(base, self.selection, n, evidence, remains)

    def excess_error(self) -> ExcessError:
        """Size of the errors beyond the noise."""
        estimated = None if self.pose is None else self.pose.geometry
        lengths = None if estimated is None else estimated.geometry
        records, errors = self.session.base.parts.holdout, self.selection.final.errors.holdout
        return excess_error(records, errors, self.session.floor, lengths)

    def models(self) -> tuple[Model, Model]:
        """The original and augmented models; one and the same where nothing was added."""
        base, pose, selection = self.session.base, self.pose, self.selection
        before = self.model if self.model is not None else model_of(base, selection.base)
        ground = pose if pose is not None and pose.effects else None
        if not (selection.effects or ground):
            return before, before
        after = model_of(base, selection.final, selection.intervals)
        if ground is not None:
            channels = track_channels(base.parts.estimation[0]) or (0, 1)
            after = with_ground(after, ground.ground, ground.std_errors, tracks=channels)
        return before, after

    def description(self, named: bool) -> str:
        """A sparse description of what no effect explains; empty where nothing is left."""
        session, remaining = self.session, self.remaining
        nearly_all = named and remaining.gap.closed_percent >= VERDICT.nearly_all
        if not remaining.structured or nearly_all:
            return ""
        records, final = session.base.parts.holdout, self.selection.final
        runs = session.base.search.simulated(final, holdout=True)
        return described(
            explain(records, final.errors.holdout, runs, session.floor, session.scales)
        )

    def poor(self) -> str:
        """That the augmented model does not follow the log, with proven shapes neither, and what
        its checks say of why."""
        parts = self.session.base.parts
        shown = {s.output: s.share for s in self.shapes}
        names = parts.holdout[0].output_names
        left = np.sqrt([1.0 - shown.get(name, 0.0) for name in names])
        errors = [left * e for e in self.selection.final.errors.holdout]
        if not not_followed(parts.holdout, errors, self.session.floor, ()):
            return ""
        try:
            checks = inspect_records(parts.facts)
        except SysidError:
            checks = ()
        return not_followed(parts.holdout, errors, self.session.floor, checks)

    def traces(self) -> tuple[Trace, ...]:
        """Records with the runs of the original and the augmented model."""
        return findings.traces(self.session.base, self.selection)

    def unseen(self, named: Sequence[str]) -> dict[str, float | None]:
        """Sizes that effects which were not found would have needed."""
        base, pose = self.session.base, self.pose
        single = base.parts.estimation[0].ny == 1
        offered = [e for e in base.search.model.effects if e.id not in NOT_NAMED]
        rest = [
            e
            for e in offered
            if not (single and e.couples) and not (base.search.level and e.hints.level)
        ]
        ids = [e.id for e in (*rest, QUANTISATION, DROPOUTS) if e.id not in named]
        smallest = detectable(base.search, self.selection.final, ids)
        if pose is not None:
            smallest |= {k: v for k, v in pose.detectable.items() if k not in named}
        elif not single:
            smallest |= dict.fromkeys(e.id for e in ground_effects())
        return smallest

    def next_experiments(self, unseen: Mapping[str, float | None]) -> tuple[Experiment, ...]:
        """Runs that distinguish ties, and that show what this log cannot."""
        session, base = self.session, self.session.base
        first = base.parts.estimation[0]
        experiments = [
            experiment_between(base.search, n.rivals, session.floor)
            for n in self.selection.effects
            if len(n.rivals) > 1 and CHANGED.id not in n.rivals
        ]
        experiments += [
            experiment_on_ground((e.id, *e.indistinguishable), first, session.scales)
            for e in (self.pose.effects if self.pose is not None else ())
            if e.indistinguishable
        ]
        vehicle = {e.id for e in ground_effects()}
        blind = [id for id, size in unseen.items() if size is None and id not in vehicle]
        stretch = stretch_of(base.search, base.model)
        return (*experiments, *next_experiments(first, session.scales, blind, stretch))

    def warnings(self) -> tuple[str, ...]:
        """What a reader should know beside the effects."""
        session, selection, pose = self.session, self.selection, self.pose
        base, records = session.base, session.base.parts.estimation
        said = list(findings.absorbed(base, selection))
        if self.model is not None and self.model.fitted_to(records):
            said.append(
                "The given model was fitted to this log and may have absorbed what is missing from "
                "it. Without `model` effects are added to a baseline that has not."
            )
        if base.in_loop:
            said.append(
                "The log was recorded in closed loop: the command responds to disturbances, which "
                "can look like an effect. Each effect must reduce the held-out error to below 70 %."
            )
        if flat := findings.two_levels(records, session.scales):
            said.append(
                f"{', '.join(flat)} has only two levels: a dead zone, a saturation or any other "
                "static curve is not identifiable from this log, because each looks like another "
                "gain."
            )
        said += [u.sentence for u in detect_jitter(base, selection.final, session.floor)]
        said += findings.indistinct_edges(base, selection, records)
        if hidden := base.parts.samples.hidden:
            said.append(f"{hidden} lost or repeated measurements are excluded from every figure.")
        if pose is None:
            return tuple(said)
        if not pose.effects and sum(pose.windows) < FEW_WINDOWS:
            said.append(
                f"The pose gives only {sum(pose.windows)} windows of motion to judge slip and "
                "radii. Give a second log with `validation`, or drive longer."
            )
        if pose.residuals.above_noise:
            said.append(pose.residuals.sentence)
        return (*said, *pose.warnings)


def _open(c: ChannelGap) -> bool:
    """Whether much of an output's gap is left."""
    remaining = c.rmse_after**2 - c.noise_floor**2
    open_ = remaining > (1.0 - 0.01 * VERDICT.nearly_all) * (c.rmse_before**2 - c.noise_floor**2)
    return open_ or c.rmse_after > VERDICT.residual_to_noise * c.surely_noise
