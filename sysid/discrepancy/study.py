"""One diagnosis in the making: what structure the errors have, what may be named, what is said."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.checks.quality import inspect_records
from sysid.data.record import Array
from sysid.discrepancy import findings
from sysid.discrepancy.advise import experiment_between, next_experiments
from sysid.discrepancy.augment import model_of
from sysid.discrepancy.base_model import Base, may_lack_sign
from sysid.discrepancy.diagnosis import OF_THE_LOG, Diagnosis, Experiment, Trace
from sysid.discrepancy.following import ASTRAY, not_followed
from sysid.discrepancy.policies import RULE
from sysid.discrepancy.pose.diagnosis import PoseDiagnosis
from sysid.discrepancy.pose.ground_model import with_ground
from sysid.discrepancy.pose.windows import track_channels
from sysid.discrepancy.proof.explain import described, explain
from sysid.discrepancy.proof.localise import Region, localise
from sysid.discrepancy.proof.model_error import FEWEST, ResidualStructure, structure_left
from sysid.discrepancy.proof.verify import Gap, measure_gap
from sysid.discrepancy.samples import inspect_samples
from sysid.discrepancy.search.detectable import detectable
from sysid.discrepancy.search.intervals import intervals_of
from sysid.discrepancy.search.named_sets import Naming, Node
from sysid.discrepancy.search.naming import Progress
from sysid.discrepancy.search.slopes import slopes
from sysid.effects.base import Effect, StartsFrom
from sysid.effects.catalogue import CHANGED, about, chain_effects, ground_effects
from sysid.effects.samples import DROPOUTS, QUANTISATION
from sysid.errors import DataError, SysidError
from sysid.structures.model import Model

DEPENDENT = 1e-3
"""p-value of the model-error model below which errors count as structured."""

MOST_OF_THE_GAP = 80.0
"""Names that together close less of the gap [%] and leave structure are not the cause: the verdict
is unexplained."""

LIKELY = 0.05
"""p-value below which loud errors are worth a search."""

CHANCE = 0.05
"""Names that close less and whose gain may be chance go even where no structure is left."""

MINOR = 1.0
"""An effect that would close less of the gap [%] is too small to matter."""

SLIGHT = 0.15
"""Structure that holds less of the errors beyond the noise is no missing effect."""

WORTHLESS = 0.6
"""A base whose errors exceed this share of the outputs' spread follows nothing."""

FEW_WINDOWS = 40
"""Fewer windows of pose seldom prove an effect of the vehicle."""

LOUD = 1.5
"""Errors beyond this multiple of the noise of the readings are mentioned."""

LONG_ENOUGH = 800
"""Samples whose held-out part, three blocks of 80, is left with twice as many samples as terms of
the model of the errors: whitening takes 20 of each block, the terms are some 40."""

CERTAIN = 1e-6
"""Structure as sure as this is missing something, however little of it is foretold."""


@dataclass(frozen=True, eq=False)
class Study:
    """One diagnosis in the making.

    Attributes:
        base: base and search.
        floor: measurement noise of each output.
        scales: full drive of each input.
        seed: of every bootstrap.
        doubted: the study of the model that was given, where that had absorbed so much that effects
            are added to a plainer base.
    """

    base: Base
    floor: Array
    scales: Array
    seed: int
    doubted: "Study | None" = None

    @property
    def nothing(self) -> Naming:
        """Before anything is named."""
        node = self.base.node
        return Naming(node, node, (), (), ())

    def before(self) -> ResidualStructure | None:
        """What the errors of the model before depend on."""
        study = self.doubted or self
        return study.residual_structure(study.nothing, after=False)

    def doubtful(self, before: ResidualStructure | None) -> bool:
        """Whether there is anything to explain."""
        return before is None or before.p_value < DEPENDENT or not self.follows()

    def required_ratio(self, before: ResidualStructure | None) -> float:
        """What the first effect must bring the held-out error below; 0 where nothing is looked for.

        As in ``remains``: loud errors whose structure is likely, not sure, ask for more.
        """
        if self.doubtful(before):
            return self.base.search.needed
        now = self.base.node.errors.mean_squares()[1]
        loud = np.any(np.sqrt(now) > LOUD * self.floor)
        return RULE.in_loop if loud and before and before.p_value < LIKELY else 0.0

    def searched(
        self, effects: Sequence[Effect], before: ResidualStructure | None, say: Progress
    ) -> "Outcome":
        """The search for what is missing, unless there is nothing to explain."""
        naming = self.nothing
        if self.base.search.model.tracks == 1:
            effects = [e for e in effects if not e.couples]
        needed = self.required_ratio(before)
        if effects and needed > 0.0:
            naming = self.base.search.run(
                self.base.node,
                effects,
                lambda text, share: say(text, 0.1 + 0.6 * share),
                lambda node: self.remains(replace(self.nothing, final=node)),
                needed,
            )
        kept = self.without_insufficient(naming)
        return Outcome(self, kept, before, naming is not kept)

    def residual_structure(self, naming: Naming, after: bool) -> ResidualStructure | None:
        """What the errors on the held-out data still depend on; None where too few samples tell."""
        base, node = self.base, naming.final if after else naming.base
        runs = self._runs(findings.traces(base, naming), after)
        own = slopes(base.search, node, held=True) if node.free else None
        if own is None:
            own = tuple(np.zeros((*r.y.shape, 0)) for r in base.parts.held)
        if sum(len(e) for e in node.errors.held) < FEWEST:
            return None
        try:
            return structure_left(
                base.parts.held, node.errors.held, runs, self.floor, self.scales, own
            )
        except DataError:
            return None

    def remains(self, naming: Naming) -> float:
        """What one more effect must bring the held-out error below; 0 where nothing is left.

        Errors far above the noise that seem to depend on nothing may be a disturbance, or structure
        that commands of few frequencies hide from the test: then the effect must do more.
        """
        (_, old), (_, new) = (n.errors.mean_squares() for n in (naming.base, naming.final))
        gap = old - self.floor**2
        if np.all(new - self.floor**2 < 0.01 * MINOR * np.maximum(gap, 0.3 * self.floor**2)):
            return 0.0
        structure = self.residual_structure(naming, after=True)
        if structure is None or structure.p_value < DEPENDENT:
            return self.base.search.needed
        return RULE.in_loop if np.any(np.sqrt(new) > LOUD * self.floor) else 0.0

    def follows(self) -> bool:
        """Whether the base follows the data at all: else its errors tell nothing."""
        y = np.concatenate([r.y for r in self.base.parts.held])
        errors = np.concatenate(self.base.node.errors.held)
        size = np.sqrt(np.nanmean(errors**2, axis=0))
        return bool(np.all(size < WORTHLESS * np.std(y, axis=0)))

    @staticmethod
    def _runs(traces: Sequence[Trace], after: bool) -> list[Array]:
        return [t.after if after else t.before for t in traces if t.role == "held-out"]

    def gap(self, naming: Naming, served: NDArray[np.bool_] | None = None) -> Gap:
        """The gap on held-out data before and after, of the outputs ``served``."""
        at = np.arange(len(self.floor)) if served is None else np.flatnonzero(served)
        names = self.base.parts.estimation[0].output_names
        old = self.doubted.base.node if self.doubted is not None else naming.base
        return measure_gap(
            [e[:, at] for e in old.errors.held],
            [e[:, at] for e in naming.final.errors.held],
            self.floor[at],
            [names[i] for i in at],
            self.seed,
        )

    def without_insufficient(self, naming: Naming) -> Naming:
        """No names where all of them together leave most of the gap: they are not the cause.

        A sensor without a sign is seen in the readings; what remains beside it does not refute it.
        """
        signless = any(about(n.id).starts_from is StartsFrom.SIGNS for n in naming.named)
        if not naming.named or (signless and may_lack_sign(self.base.parts.estimation)):
            return naming
        served = np.any([n.touched for n in naming.named], axis=0)
        closed = self.gap(naming, served).closed_percent
        if closed >= MOST_OF_THE_GAP:
            return naming
        structure = self.residual_structure(naming, after=True)
        if structure is not None and structure.p_value >= DEPENDENT and _sure(naming):
            return naming
        minor = (*((n.id, n.evidence) for n in naming.named), *naming.minor)
        return replace(naming, final=naming.base, named=(), minor=minor)

    def measured(self, naming: Naming) -> Naming:
        """With intervals of the numbers that slopes cannot judge; estimates may move a little."""
        if not naming.named:
            return naming
        final, intervals = intervals_of(self.base.search, naming.final)
        return replace(naming, final=final, intervals=intervals)

    def unexplained(self, naming: Naming) -> bool:
        """Whether the model after leaves structure, and errors far above the noise."""
        new = naming.final.errors.mean_squares()[1]
        if np.all(np.sqrt(new) <= LOUD * self.floor):
            return False
        structure = self.residual_structure(naming, after=True)
        return structure is not None and structure.p_value < DEPENDENT

    def explains_more(self, naming: Naming, node: Node, below: float = RULE.held_out) -> bool:
        """Whether the held-out error of the model after is ``below`` that of another."""
        old, new = (n.errors.mean_squares()[1] for n in (node, naming.final))
        return bool(naming.named) and float(np.sqrt(np.mean(new / old))) < below

    def result(
        self,
        model: Model | None,
        found: "Outcome",
        pose: PoseDiagnosis | None,
    ) -> Diagnosis:
        """Everything but the mission.

        Args:
            model: the one that was given.
            found: what the search has found.
            pose: what is missing between tracks and ground.
        """
        naming, left_before = self.measured(found.naming), found.before
        left_after = self.residual_structure(naming, after=True) if naming.named else left_before
        base, first = self.base, self.base.parts.estimation[0]
        samples = inspect_samples(base.parts.estimation)
        effects = (
            *(findings.named_effect(base, naming, n) for n in naming.named),
            *(pose.effects if pose is not None else ()),
            *findings.sample_effects(samples),
        )
        traces = self._traces(naming)
        gap = self.gap(naming)
        structured = left_after is not None and left_after.p_value < DEPENDENT
        slight = (
            left_after is not None
            and left_after.share < SLIGHT
            and not (left_after.p_value < CERTAIN and _loud(gap))
        )
        description = ""
        if structured and (not effects or gap.closed_percent < 90.0):
            runs = self._runs(traces, after=True)
            description = described(
                explain(base.parts.held, naming.final.errors.held, runs, self.floor, self.scales)
            )
        poor = self._poor(naming)
        verdict = "no-missing-effect"
        off = pose is not None and pose.left.structured
        astray = poor.startswith(ASTRAY)
        if effects or found.withdrawn or off or astray or (structured and not slight):
            # what is a matter of the log explains no structured error
            explained = [e for e in effects if e.id not in OF_THE_LOG or not structured or slight]
            verdict = "effects-found" if explained else "unexplained"
        before = model if model is not None else model_of(base, naming.base)
        after = model_of(base, naming.final, naming.intervals) if naming.named else before
        if pose is not None and pose.effects:
            after = model_of(base, naming.final, naming.intervals)
            channels = track_channels(first) or (0, 1)
            after = with_ground(after, pose.ground, pose.std_errors, tracks=channels)
            gap = gap if naming.named else pose.gap
        unseen = self._unseen(naming, pose, [e.id for e in effects])
        named = [e.id for e in effects if e.id not in OF_THE_LOG]
        silent = verdict != "unexplained" and not named and not poor and bool(_loud(gap))
        return Diagnosis(
            verdict=verdict,
            story=poor or _story(verdict, [e.id for e in effects], gap, left_after, base.on_rate),
            undecided=_undecided(gap, left_after, structured) if silent else "",
            unfollowed=poor,
            base_words=base.words if self.doubted is None else self.doubted.base.words,
            plainer=base.words if self.doubted is not None else "",
            effects=effects,
            minor=tuple(dict.fromkeys(id for id, _ in naming.minor)),
            candidates=(
                *naming.candidates,
                *(pose.candidates if pose is not None else ()),
            ),
            where=self._where(naming, after=False),
            where_after=self._where(naming, after=True),
            gap=gap,
            detectable=unseen,
            next_experiments=self._next(naming, unseen),
            before=before,
            after=after,
            residuals=tuple(
                r.verdict(name)
                for name, r in (("before", left_before), ("after", left_after))
                if r is not None
            ),
            description=description,
            warnings=self._warnings(naming, pose, samples.hidden, unseen),
            traces=traces,
            geometry=pose.geometry if pose is not None else None,
        )

    def _poor(self, naming: Naming) -> str:
        """That the model after does not follow the log, and what its checks say of why."""
        errors = naming.final.errors.held
        if not not_followed(self.base.parts.held, errors, self.floor, ()):
            return ""
        try:
            checks = inspect_records(self.base.parts.estimation)
        except SysidError:
            checks = ()
        return not_followed(self.base.parts.held, errors, self.floor, checks)

    def _traces(self, naming: Naming) -> tuple[Trace, ...]:
        traces = findings.traces(self.base, naming)
        if self.doubted is None:
            return traces
        theirs = findings.traces(self.doubted.base, self.doubted.nothing)
        return tuple(replace(t, before=o.before) for t, o in zip(traces, theirs, strict=True))

    def _where(self, naming: Naming, after: bool) -> tuple[Region, ...]:
        old = self.doubted.base.node if self.doubted is not None else naming.base
        node = naming.final if after else old
        return localise(self.base.parts.held, node.errors.held, self.floor, self.scales, self.seed)

    def _unseen(
        self, naming: Naming, pose: PoseDiagnosis | None, named: Sequence[str]
    ) -> dict[str, float | None]:
        single = self.base.parts.estimation[0].ny == 1
        rest = [e.id for e in chain_effects() if e.id not in named and not (single and e.couples)]
        rest += [e.id for e in (QUANTISATION, DROPOUTS) if e.id not in named]
        if self.base.level:
            rest = [id for id in rest if not about(id).level]
        found = detectable(self.base.search, naming.final, rest)
        if pose is not None:
            found |= {k: v for k, v in pose.detectable.items() if k not in named}
        elif not single:
            found |= dict.fromkeys(e.id for e in ground_effects())
        return found

    def _next(self, naming: Naming, unseen: dict[str, float | None]) -> tuple[Experiment, ...]:
        base, first = self.base, self.base.parts.estimation[0]
        found = [
            experiment_between(base.search, n.rivals, self.floor, base.scales, base.delay)
            for n in naming.named
            if len(n.rivals) > 1 and CHANGED.id not in n.rivals
        ]
        vehicle = {e.id for e in ground_effects()}
        blind = [id for id, size in unseen.items() if size is None and id not in vehicle]
        more = next_experiments(first, self.scales, blind) if first.is_robot_log or blind else ()
        return (*found, *more)

    def _warnings(
        self,
        naming: Naming,
        pose: PoseDiagnosis | None,
        hidden: int,
        unseen: dict[str, float | None],
    ) -> tuple[str, ...]:
        found = list(findings.absorbed(self.base, naming))
        if self.doubted is not None:
            found.append(
                "The model that was doubted has absorbed a part of what is missing: effects added "
                "to it explain less. They stand on the plainest base instead; with them its "
                "held-out error is the smaller one."
            )
        if self.base.in_loop:
            found.append(
                "The log was recorded in closed loop: the command answers disturbances, which can "
                "look like an effect. The held-out error must therefore fall below 70 %."
            )
        flat = findings.two_levels(self.base.parts.estimation, self.scales)
        if flat:
            found.append(
                f"{', '.join(flat)} has only two levels: a dead zone, a saturation or any other "
                "static curve is not identifiable from this log, because each looks like "
                "another gain."
            )
        found += findings.indistinct_edges(self.base, naming, self.base.parts.estimation)
        if hidden:
            found.append(f"{hidden} lost or repeated readings are left out of every figure.")
        if pose is not None and not pose.effects and sum(pose.windows) < FEW_WINDOWS:
            found.append(
                f"The pose gives only {sum(pose.windows)} windows of motion to judge slip and "
                "radii by; name a second log with --val or drive longer."
            )
        if pose is not None and pose.left.loud:
            found.append(pose.left.sentence)
        return (*found, *(pose.warnings if pose is not None else ()))


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a search has found.

    Attributes:
        study: where.
        naming: the effects that are kept.
        before: what the errors of the base depend on.
        withdrawn: whether effects were found and dropped again, because they leave most of the gap.
    """

    study: Study
    naming: Naming
    before: ResidualStructure | None
    withdrawn: bool


def _sure(naming: Naming) -> bool:
    return all(n.evidence.p_value < CHANCE for n in naming.named)


def _loud(gap: Gap) -> dict[str, float]:
    """Outputs whose errors after are far above the noise, and how far."""
    return {
        name: c.rmse_after / c.noise_floor
        for name, c in gap.channels.items()
        if c.rmse_after > LOUD * c.noise_floor > 0.0
    }


ON_A_RATE = (
    " Effects were looked for on the rate of the output, which integrates its input. Play in a "
    "gear (backlash) is looked for on a speed, and differences of a position may be too coarse to "
    "show it: record the speed as well."
)


def _story(
    verdict: str,
    ids: Sequence[str],
    gap: Gap,
    structure: ResidualStructure | None,
    on_rate: bool = False,
) -> str:
    structured = structure is not None and structure.p_value < DEPENDENT
    loud = ", ".join(f"{name} {ratio:.1f} times" for name, ratio in _loud(gap).items())
    missing = [id for id in ids if id not in OF_THE_LOG]
    if verdict == "effects-found" and missing:
        text = f"Missing: {', '.join(missing)}."
        if structured and (gap.closed_percent < 90.0 or loud):
            rest = 100.0 - gap.closed_percent
            share = "Less than 1 %" if rest < 1.0 else f"{rest:.0f} %"
            text += f" {share} of the error beyond the noise is left"
            text += f" (errors: {loud} the noise)" if loud else ""
            text += " and still follows inputs and outputs: something else is missing, too."
        elif loud:
            text += (
                f" The errors that remain ({loud} the noise) depend on nothing known: a "
                "disturbance acts that no channel records, or the commands are too simple to tell."
            )
        return text
    if verdict == "unexplained":
        return (
            "The errors depend on what is known, so something is missing, but most of it is "
            "unexplained by every effect of the catalogue." + ON_A_RATE * on_rate
        )
    if loud:
        return _undecided(gap, structure, structured)
    if structure is not None and structured:
        return (
            "Nothing of the catalogue is missing: what is known predicts only "
            f"{100.0 * structure.share:.0f} % of the errors beyond the noise."
        )
    return "Nothing is missing that this log could show: the errors look like noise."


def _undecided(gap: Gap, structure: ResidualStructure | None, structured: bool) -> str:
    """Why nothing is named where errors are far above the noise of the readings."""
    loud = ", ".join(f"{name} {ratio:.1f} times" for name, ratio in _loud(gap).items())
    if structure is None:
        return (
            f"The log is too short to tell what is missing: the errors ({loud} the noise of the "
            f"readings) cannot be tested on so few held-out samples; record at least {LONG_ENOUGH} "
            "samples, or name a second log of the same system to judge by."
        )
    begin = "No effect is shown, but the errors are not noise: "
    if structured:
        return begin + (
            f"what is known predicts only {100.0 * structure.share:.0f} % of them. The rest "
            f"({loud} the noise of the readings) no channel records."
        )
    return begin + (
        f"they are larger than that of the readings ({loud}), yet depend on no command and no "
        "speed. A load or a disturbance acts that no channel records, or the log is too short or "
        "its commands too simple to tell."
    )
