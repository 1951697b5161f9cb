"""One diagnosis in the making: is there anything to explain, and which names explain it?"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.column_words import may_move
from sysid.data.record import Array
from sysid.diagnosis import findings
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.diagnosis import Trace
from sysid.diagnosis.gap import Gap, carries_an_output, measure_gap, share_closed
from sysid.diagnosis.named_effects import Dropped
from sysid.diagnosis.policies import RULE, VERDICT
from sysid.diagnosis.search.intervals import intervals_of
from sysid.diagnosis.search.named_sets import Named, Naming, Node, without_name
from sysid.diagnosis.search.naming import Progress
from sysid.diagnosis.search.slopes import slopes
from sysid.diagnosis.validation.acceptance import (
    doubtful_slots,
    drifting_level,
    least_beside,
    small_share,
    unknown_wave,
    weakest,
)
from sysid.diagnosis.validation.exchange import with_exchanged_lags
from sysid.diagnosis.validation.linear_rival import (
    LinearRival,
    linear_motion,
    linear_rival,
    worse_than_linear,
)
from sysid.diagnosis.validation.model_error import FEWEST, ResidualStructure, error_structure
from sysid.diagnosis.validation.noise import NoiseFloor, floor_of
from sysid.diagnosis.validation.uneven_delay import UnevenDelay, rows_apart, uneven_delays
from sysid.effects.base import Effect, Place
from sysid.effects.catalogue import NOT_NAMED, about
from sysid.effects.sensor import SAMPLING
from sysid.errors import DataError

STAND_IN = (
    "it leaves much that follows the command, and of what is no motion the catalogue holds little: "
    "it may stand for other physics"
)


LeastLeft = dict[tuple[bool, ...], float]
"""Least share of the gap that stayed open while effects were dropped, by the outputs that count."""


@dataclass(frozen=True, eq=False)
class Study:
    """One diagnosis in the making.

    Attributes:
        base: base and search.
        noise: measurement noise of each output.
        scales: full drive of each input.
        seed: of every bootstrap.
        doubted: the study of the model that was given, where that had absorbed so much that effects
            are added to a plainer base.
        late: outputs whose commands act unevenly late, where samples that this spoils were left
            out.
    """

    base: Base
    noise: NoiseFloor
    scales: Array
    seed: int
    doubted: "Study | None" = None
    late: tuple[UnevenDelay, ...] = ()

    @property
    def floor(self) -> Array:
        """Measurement noise of each output, (ny,)."""
        return self.noise.value

    @property
    def nothing(self) -> Naming:
        """Before anything is named."""
        node = self.base.node
        return Naming(node, node, (), (), ())

    @property
    def origin(self) -> "Study":
        """The study of the model before."""
        return self.doubted or self

    @cached_property
    def before(self) -> ResidualStructure | None:
        """What the errors of the base depend on."""
        return self.residual_structure(self.nothing, after=False)

    @property
    def doubtful(self) -> bool:
        """Whether there is anything to explain."""
        return structured(self.before) or self.before is None or not self.follows()

    def required_ratio(self) -> float:
        """What the first effect must bring the held-out error below; 0 where nothing is looked for.

        As in ``remains``: of loud errors the test may see nothing, because a command of few levels
        or frequencies hides what they depend on; then the effect must do more.
        """
        if self.doubtful:
            return self.base.search.needed
        return RULE.in_loop if self.loud(self.nothing) else 0.0

    def loud(self, naming: Naming) -> bool:
        """Whether the held-out errors of the model after are far above the noise."""
        now = naming.final.errors.mean_squares()[1]
        return bool(np.any(np.sqrt(now) > VERDICT.loud * self.noise.high))

    def searched(self, effects: Sequence[Effect], say: Progress) -> "Outcome":
        """The search for what is missing, unless there is nothing to explain."""
        naming = self.nothing
        if self.base.search.model.tracks == 1:
            effects = [e for e in effects if not e.couples]
        needed = self.required_ratio()
        if effects and needed > 0.0:
            naming = self.base.search.run(
                self.base.node,
                effects,
                lambda text, share: say(text, 0.1 + 0.6 * share),
                lambda node: self.remains(replace(self.nothing, final=node)),
                needed,
            )
        plain = self._apart(naming)
        if plain.naming.named or self.late or self.base.given is not None:
            return plain
        apart = self.apart_from_jitter()
        found = None if apart is None else apart.searched(effects, say)
        return found if found is not None and found.naming.named else plain

    def _apart(self, naming: Naming) -> "Outcome":
        """Readings that come a part of a sample late belong to both models, and are not named."""
        if SAMPLING.id not in naming.final.effects:
            return Outcome(self, without_name(naming, SAMPLING.id, naming.base))
        if self.base.given is not None:
            return Outcome(self, naming)
        base = self.base.with_sampling(naming.final)
        return Outcome(replace(self, base=base), without_name(naming, SAMPLING.id, base.node))

    def apart_from_jitter(self) -> "Study | None":
        """The study of the samples that no uneven delay of the commands spoils; None without one.

        Such delays make errors behind every change that are larger than what a dead zone leaves
        at constant speed.
        """
        late = uneven_delays(self.base, self.base.node, self.floor)
        if not late:
            return None
        base = self.base.without(*rows_apart(self.base, late, self.floor))
        return replace(self, base=base, late=late)

    def linear_words(self, naming: Naming) -> str:
        """What of loud errors is linear motion that the base has no order for; else empty."""
        if not self.loud(naming):
            return ""
        names = self.base.parts.held[0].output_names
        return self.linear_rival.words(naming, self.floor, names)

    def residual_structure(self, naming: Naming, after: bool) -> ResidualStructure | None:
        """What the errors on the held-out data still depend on; None where too few samples tell."""
        base, node = self.base, naming.final if after else naming.base
        runs = held_runs(findings.traces(base, naming), after)
        own = slopes(base.search, node, held=True) if node.free else None
        if own is None:
            own = tuple(np.zeros((*r.y.shape, 0)) for r in base.parts.held)
        if sum(len(e) for e in node.errors.held) < FEWEST:
            return None
        try:
            return error_structure(
                base.parts.held, node.errors.held, runs, self.floor, self.scales, own
            )
        except DataError:
            return None

    def remains(self, naming: Naming) -> float:
        """What one more effect must bring the held-out error below; 0 where nothing is left.

        Errors far above the noise that seem to depend on nothing may be a disturbance, or structure
        that commands of few frequencies hide from the test: then the effect must do more. Where
        something is missing for sure, errors need not be far above the noise to ask for more.
        """
        (_, old), (_, new) = (n.errors.mean_squares() for n in (naming.base, naming.final))
        lower = self.refuted(naming)
        floor = lower * self.floor
        noise = VERDICT.quiet * floor**2
        # a small share of a large gap may be far above the noise: an effect beside a large one
        minor = 0.01 * VERDICT.minor * np.maximum(old - floor**2, noise)
        if np.all(new - floor**2 < np.minimum(minor, noise)):
            return 0.0
        structure = self.residual_structure(naming, after=True)
        if structure is None or structured(structure):
            return self.base.search.needed
        above = VERDICT.audible if naming.final.effects else VERDICT.loud
        return RULE.in_loop if np.any(np.sqrt(new) > above * lower * self.noise.high) else 0.0

    def refuted(self, naming: Naming) -> float:
        """What the noise is at most of what it was taken for: no model errs less than noise.

        What makes readings look noisy (one without its sign) makes all of them so.
        """
        reached = np.sqrt(naming.final.errors.mean_squares()[1]) / self.floor
        return float(min(np.min(reached), 1.0)) if reached.min() < VERDICT.below else 1.0

    def follows(self) -> bool:
        """Whether the base follows the data at all: else its errors tell nothing."""
        y = np.concatenate([r.y for r in self.base.parts.held])
        errors = np.concatenate(self.base.node.errors.held)
        size = np.sqrt(np.nanmean(errors**2, axis=0))
        worthless = 1.0 - 0.01 * VERDICT.follows
        return bool(np.all(size < worthless * np.std(y, axis=0)))

    def gap(self, naming: Naming) -> Gap:
        """The gap on held-out data before and after."""
        gap = measure_gap(
            self.origin.base.node.errors.held,
            naming.final.errors.held,
            self.floor,
            self.base.parts.estimation[0].output_names,
            self.seed,
        )
        ends = zip(gap.channels.items(), self.noise.low, self.noise.high, self.floor, strict=True)
        channels = {
            name: replace(c, floor_interval=(c.noise_floor * a / v, c.noise_floor * b / v))
            for (name, c), a, b, v in ends
        }
        return replace(gap, channels=channels)

    def explained_by(self, naming: Naming, n: Named) -> tuple[float, float]:
        """Shares of the gap of its outputs [%]: closed by an effect beside the others, and open."""
        return share_closed(*self._errors_around(naming, n), self.floor, n.touched)

    def _errors_around(
        self, naming: Naming, n: Named
    ) -> tuple[Sequence[Array], Sequence[Array], Sequence[Array]]:
        """Held-out errors before, without an effect, and of the model after."""
        before, without, after = self.origin.base.node, n.rest, naming.final
        return before.errors.held, without.errors.held, after.errors.held

    def confirmed(self, naming: Naming) -> tuple[Naming, tuple[Dropped, ...]]:
        """The effects that stand in the final model, and those that evidence speaks against."""
        naming, gone = self.measured(naming), []
        least_left: LeastLeft = {}
        while (least := self._objection(naming, least_left)) is not None:
            gone.append(least)
            naming = self.measured(self.base.search.dropped(naming, least.id))
        while naming.named and self.stand_in(naming):
            last = min(naming.named, key=lambda n: -n.evidence.delta_bic)
            gone.append(Dropped(last.id, STAND_IN))
            naming = self.measured(self.base.search.dropped(naming, last.id))
        return naming, tuple(gone)

    def stand_in(self, naming: Naming) -> bool:
        """Whether what is named of a process may stand for physics that the catalogue has not.

        Outflow, radiation and boiling are none of its effects, and bend like a dead zone. Without
        friction and gears beside it, an effect of the actuator or sensor explains nearly all. Nor
        is the stiffness of a spring one of its effects: beside what swings long, the same is asked
        of all but what a sensor does.
        """
        moves = any(may_move(c.name, c.unit) for c in self.base.parts.estimation[0].outputs)
        by_sensor = all(about(n.id).place is Place.READING for n in naming.named)
        if moves and (by_sensor or least_damping(self.base) >= VERDICT.swings):
            return False
        left = self.residual_structure(naming, after=True)
        return structured(left) and self.gap(naming).closed_percent < VERDICT.nearly_all

    def _objection(self, naming: Naming, least_left: LeastLeft) -> Dropped | None:
        """The accepted effect that evidence speaks against most, and what speaks against it."""
        least = weakest(self.base, naming)
        if least is None and any(not linear_motion(self.base, naming, n) for n in naming.named):
            least = worse_than_linear(self.base, self.linear_rival, naming)
        return (
            least
            or drifting_level(self.base, naming)
            or unknown_wave(self.base, naming)
            or self.too_small_a_share(naming)
            or self._absorber(naming, least_left)
        )

    def too_small_a_share(self, naming: Naming) -> Dropped | None:
        """An effect that leaves more of the gap of its outputs than one of its kind may.

        One that is alone closes a quarter, one without a mechanism nearly all of what the others
        leave; where what remains has no structure, it is enough.
        """
        mine = [n for n in naming.named if n.id not in NOT_NAMED]
        for n in mine:
            needed = VERDICT.alone if len(mine) == 1 else 0.0
            needed = VERDICT.nearly_all if about(n.id).descriptive else needed
            if needed and self.unexplained(naming):
                closed, left = self.explained_by(naming, n)
                if closed < 0.01 * needed * (closed + left):
                    return Dropped(n.id, small_share(closed, left))
        return None

    def _absorber(self, naming: Naming, least_left: LeastLeft) -> Dropped | None:
        """The effect beside others that takes less than they leave, where they leave structure.

        What remains on one output speaks not against an effect that carries another one: there is
        something else on that one alone. Nor does what remains speak against an effect that closes
        some of the gap and that no other comes near: a stand-in has rivals. What an effect that is
        gone by now had taken is no part of what the others leave: else one would go after another.

        Args:
            naming: what is named.
            least_left: of the rounds before; brought up to date.
        """
        mine = [n for n in naming.named if n.id not in NOT_NAMED]
        if len(mine) < 2 or not self.unexplained(naming):
            return None
        shares = {n.id: self._share_beside(naming, n, least_left) for n in mine}
        short = [
            n
            for n in mine
            if not carries_an_output(*self._errors_around(naming, n), self.floor, n.touched)
        ]
        search, rivals = self.base.search, self.base.search.model.effects
        while least := least_beside([(n.id, *shares[n.id]) for n in short]):
            (own,) = (n for n in short if n.id == least.id)
            if shares[own.id][0] <= 0.0 or not search.unrivalled(own.rest, own.id, rivals):
                break
            short.remove(own)
        return least

    def _share_beside(self, naming: Naming, n: Named, least_left: LeastLeft) -> tuple[float, float]:
        """``explained_by``, and of what stays open on its outputs the least there ever was."""
        closed, left = self.explained_by(naming, n)
        at = tuple(n.touched.tolist())
        least_left[at] = left = min(left, least_left.get(at, left))
        return closed, left

    @cached_property
    def linear_rival(self) -> LinearRival:
        """What linear motion of a higher order explains."""
        return linear_rival(self.base)

    def measured(self, naming: Naming) -> Naming:
        """With intervals of the numbers that slopes cannot judge; estimates may move a little."""
        if not naming.named:
            return naming
        doubted = doubtful_slots(self.base, naming)
        final, intervals = intervals_of(self.base.search, naming.final, doubted)
        for node in (final, naming.final):  # a ragged likelihood may lead away from what stands
            held = {k: i.holding(float(node.q[k])) for k, i in intervals.items()}
            found = replace(naming, final=node, intervals=held)
            if weakest(self.base, found) is None:
                break
        return with_exchanged_lags(self.base, found)

    def unexplained(self, naming: Naming) -> bool:
        """Whether the model after leaves structure, and errors far above the noise."""
        return self.loud(naming) and structured(self.residual_structure(naming, after=True))

    def explains_more(self, naming: Naming, node: Node, below: float = RULE.held_out) -> bool:
        """Whether the held-out error of the model after is ``below`` that of another."""
        old, new = (n.errors.mean_squares()[1] for n in (node, naming.final))
        return bool(naming.named) and float(np.sqrt(np.mean(new / old))) < below


def poles_of(base: Base) -> Array:
    """Discrete poles of all cores of the base."""
    model = base.search.model
    names = [f"f{k + 1}" for k in range(model.order)]
    cores = [[base.node.q[model.place["core", n, i]] for n in names] for i in range(model.tracks)]
    return np.concatenate([np.roots([1.0, *f]) for f in cores])


def least_damping(base: Base) -> float:
    """The least damping ratio ζ of its poles, ln z = −ζ ω₀ Δt ± …; 1 where none swings."""
    z = poles_of(base)
    swinging = z[(np.abs(z.imag) > 0.0) & (np.abs(z) > 0.0)].astype(complex)
    s = np.log(swinging)
    return float(np.min(-s.real / np.abs(s), initial=1.0))


def noise_of(base: Base) -> NoiseFloor:
    """Measurement noise from all logs of a diagnosis and the errors that its base leaves there."""
    parts, errors = base.parts, base.node.errors
    slow = float(np.max(np.abs(poles_of(base)), initial=0.0))
    records, left = (*parts.estimation, *parts.held), [*errors.estimation, *errors.held]
    if parts.held is parts.estimation:  # blocks of the same logs: together they are whole
        records, pairs = parts.estimation, zip(errors.estimation, errors.held, strict=True)
        left = [np.where(np.isfinite(a), a, b) for a, b in pairs]
    steps = {c.output: c.step for c in parts.samples.coarse}
    rounding = np.array([steps.get(name, 0.0) for name in records[0].output_names]) / np.sqrt(12.0)
    return floor_of(records, left, slow).at_least(rounding)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a search has found.

    Attributes:
        study: where.
        naming: the effects that it accepted.
    """

    study: Study
    naming: Naming


def structured(errors: ResidualStructure | None) -> bool:
    """Whether errors depend on what is known."""
    return errors is not None and errors.p_value < VERDICT.dependent


def held_runs(traces: Sequence[Trace], after: bool) -> list[Array]:
    """Free runs of the model before or after over the held-out records."""
    return [t.after if after else t.before for t in traces if t.role == "held-out"]
