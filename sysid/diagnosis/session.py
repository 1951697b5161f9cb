"""One diagnosis session: whether errors need an explanation, and which effects explain them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.base_model import Base, shows_motion
from sysid.diagnosis.gap import Gap, measure_gap
from sysid.diagnosis.policies import RULE, VERDICT
from sysid.diagnosis.search.forward_selection import Progress
from sysid.diagnosis.search.selection import (
    CandidateModel,
    Selection,
    moved_to_base,
)
from sysid.diagnosis.shapes.fitted import FittedShape
from sysid.diagnosis.shapes.grading import FoundShape, proven, shapes_around
from sysid.diagnosis.validation.model_error import (
    MIN_SAMPLES,
    ResidualStructure,
    error_structure,
    structured,
)
from sysid.diagnosis.validation.noise import NoiseFloor, floor_of
from sysid.diagnosis.validation.runs_away import without_free_run
from sysid.effects.base import Effect
from sysid.effects.sensor import SAMPLING
from sysid.errors import DataError


@dataclass(frozen=True, eq=False)
class DiagnosisSession:
    """One diagnosis in progress."""

    base: Base
    noise: NoiseFloor
    scales: Array
    seed: int
    _shapes: dict[CandidateModel, tuple[FittedShape, ...]] = field(default_factory=dict, repr=False)

    @property
    def floor(self) -> Array:
        """Measurement noise of each output, (ny,)."""
        return self.noise.value

    def noise_with(self, candidate: CandidateModel) -> NoiseFloor:
        """The noise, where the errors of a model that misses less show it to be lower."""
        return self.noise.or_less(noise_of(self.base, candidate))

    @property
    def nothing(self) -> Selection:
        """Before anything is named."""
        candidate = self.base.model
        return Selection(candidate, candidate, (), (), ())

    @cached_property
    def before(self) -> ResidualStructure | None:
        """What the errors of the base depend on."""
        return self.residual_structure(self.base.model)

    @property
    def needs_explanation(self) -> bool:
        """Whether there is anything to explain."""
        return structured(self.before) or self.before is None or not self.follows()

    def required_ratio(self) -> float:
        """What the first effect must bring the held-out error below; 0 where nothing is looked for.

        As in ``remains``: of errors far above the noise the test may see nothing, because a command
        of few levels or frequencies hides what they depend on; then the effect must do more.
        """
        if self.needs_explanation:
            return self.base.search.needed
        return RULE.in_loop if self.far_above_noise(self.base.model) else 0.0

    def far_above_noise(self, candidate: CandidateModel) -> bool:
        """Whether the held-out errors of a model are far above the noise."""
        now = candidate.errors.mean_squares()[1]
        return bool(np.any(np.sqrt(now) > VERDICT.residual_to_noise * self.noise.high))

    def searched(self, effects: Sequence[Effect], say: Progress) -> "SelectionResult":
        """The search for what is missing, unless there is nothing to explain."""
        selection = self.nothing
        if self.base.search.model.tracks == 1:
            effects = [e for e in effects if not e.couples]
        needed = self.required_ratio()
        if effects and needed > 0.0:
            selection = self.base.search.run(
                self.base.model,
                effects,
                lambda text, share: say(text, 0.06 + 0.46 * share),
                self.remains,
                needed,
            )
        quieter = replace(self, noise=self.noise_with(selection.final), _shapes={})
        return (quieter if selection.selected else self)._apart(selection)

    def _apart(self, selection: Selection) -> "SelectionResult":
        """A sampling lag belongs to both models and is not reported as an effect."""
        if SAMPLING.id not in selection.final.effects:
            return SelectionResult(self, moved_to_base(selection, SAMPLING.id, selection.base))
        if self.base.given is not None:
            return SelectionResult(self, selection)
        base = self.base.with_sampling(selection.final)
        return SelectionResult(
            replace(self, base=base), moved_to_base(selection, SAMPLING.id, base.model)
        )

    def residual_structure(self, candidate: CandidateModel) -> ResidualStructure | None:
        """What errors on the held-out data still depend on; None with too few samples."""
        base = self.base
        records, errors = base.parts.holdout, candidate.errors.holdout
        if sum(map(len, errors)) < MIN_SAMPLES:
            return None
        gradients = base.search.slopes(candidate, holdout=True)
        runs = base.search.simulated(candidate, holdout=True)
        try:
            return error_structure(records, errors, runs, self.floor, self.scales, gradients)
        except DataError:
            return None

    def remains(self, candidate: CandidateModel) -> float:
        """What one more effect must bring the held-out error below; 0 where nothing is left.

        Errors far above the noise that seem to depend on nothing may be a disturbance, or structure
        that commands of few frequencies hide from the test: then the effect must do more. Where
        something is missing for sure, errors need not be far above the noise to ask for more.
        """
        old, new = (n.errors.mean_squares()[1] for n in (self.base.model, candidate))
        floor = self.noise_with(candidate).value
        noise = VERDICT.residual_power_to_noise * floor**2
        # a small share of a large gap may be far above the noise: an effect beside a large one
        minor = 0.01 * VERDICT.min_share * np.maximum(old - floor**2, noise)
        if np.all(new - floor**2 < np.minimum(minor, noise)):
            return 0.0
        structure = self.residual_structure(candidate)
        if structure is None or structured(structure):
            return self.base.search.needed
        later = bool(candidate.effects)
        above = VERDICT.residual_to_noise_later if later else VERDICT.residual_to_noise
        return RULE.in_loop if np.any(np.sqrt(new) > above * self.noise.high) else 0.0

    def follows(self) -> bool:
        """Whether the base follows the data at all: else its errors say nothing."""
        y = np.concatenate([r.y for r in self.base.parts.holdout])
        errors = np.concatenate(self.base.model.errors.holdout)
        size = np.sqrt(np.nanmean(errors**2, axis=0))
        worthless = 1.0 - 0.01 * VERDICT.min_fit
        return bool(np.all(size < worthless * np.std(y, axis=0)))

    def gap(self, selection: Selection) -> Gap:
        """The gap on held-out data before and after."""
        before, after = self.base.model, selection.final
        return self.gap_of(before.errors.holdout, after.errors.holdout)

    def gap_of(self, before: Sequence[Array], after: Sequence[Array]) -> Gap:
        """The gap of errors before and after, (N, ny) a record."""
        gap = measure_gap(
            before,
            after,
            self.floor,
            np.nanstd(np.concatenate([r.y for r in self.base.parts.holdout]), axis=0),
            self.base.parts.estimation[0].output_names,
            self.seed,
        )
        ends = zip(gap.channels.items(), self.noise.low, self.noise.high, self.floor, strict=True)
        channels = {
            name: replace(c, floor_interval=(c.noise_floor * a / v, c.noise_floor * b / v))
            for (name, c), a, b, v in ends
        }
        return replace(gap, channels=channels)

    @property
    def moves(self) -> bool:
        """Whether an output may be of something that turns or moves."""
        return shows_motion(self.base.parts.estimation[0])

    def shapes(self, candidate: CandidateModel) -> tuple[FittedShape, ...]:
        """Every shape without physics around a candidate model, most evidence first."""
        if candidate not in self._shapes:
            found = shapes_around(self.base.search, candidate, self.floor, self.moves)
            self._shapes[candidate] = found
        return self._shapes[candidate]

    def proven_shapes(
        self, candidate: CandidateModel, left: ResidualStructure
    ) -> tuple[FoundShape, ...]:
        """The proven shape of each output around a candidate model, beside what its errors show."""
        by_name = {o.output: o.share for o in left.outputs}
        names = self.base.parts.holdout[0].output_names
        shapes = [s for s in self.shapes(candidate) if not self.without_free_run[s.index]]
        of_signals = [by_name.get(name, 0.0) for name in names]
        return proven(shapes, of_signals, self.base.parts.facts.drifts.tolist())

    @cached_property
    def without_free_run(self) -> NDArray[np.bool_]:
        """Outputs that only feedback keeps from running away, or that alone move their input: no
        free run says anything of these, (ny,)."""
        alone = without_free_run(self.base.parts.facts) if self.base.in_loop else ()
        return np.array([n in alone for n in self.base.parts.estimation[0].output_names])

    def explains_more(self, selection: Selection, candidate: CandidateModel) -> bool:
        """Whether the held-out error of the augmented model is clearly below that of another."""
        old, new = (n.errors.mean_squares()[1] for n in (candidate, selection.final))
        return bool(selection.selected) and float(np.sqrt(np.mean(new / old))) < RULE.held_out


def noise_of(base: Base, candidate: CandidateModel | None = None) -> NoiseFloor:
    """Measurement noise from all logs of a diagnosis and the errors that a model, or its base,
    leaves there."""
    parts, errors = base.parts, (candidate or base.model).errors
    if parts.holdout_facts is parts.facts:  # blocks of the same logs: together they are whole
        pairs = zip(errors.estimation, errors.holdout, strict=True)
        residuals = [np.where(np.isfinite(a), a, b) for a, b in pairs]
    else:
        residuals = [*errors.estimation, *errors.holdout]
    steps = {c.output: c.step for c in parts.samples.coarse}
    rounding = np.array([steps.get(name, 0.0) for name in parts.estimation[0].output_names])
    rounding /= np.sqrt(12.0)
    return floor_of(parts.whole, residuals).at_least(rounding)


@dataclass(frozen=True, eq=False)
class SelectionResult:
    """What a search has found."""

    session: DiagnosisSession
    selection: Selection
