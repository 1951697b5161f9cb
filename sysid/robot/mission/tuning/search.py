"""Search for gains by simulation: spread over the bounds first, then refined around the front."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter
from typing import cast

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.batch.figures import Driven
from sysid.robot.mission.batch.runner import BATCH_SIZE, BatchRunner, why_not_at_once
from sysid.robot.mission.batch.sampler import Numbers, run_seeds
from sysid.robot.mission.batch.setup import PlantVariant, Setup
from sysid.robot.mission.clearance import has_surfaces
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.criteria import (
    SHOWN,
    Criteria,
    Resolution,
    StepTest,
    criteria,
)
from sysid.robot.mission.tuning.front import Front, front
from sysid.robot.mission.tuning.gain_space import GainSpace, rounded
from sysid.robot.mission.tuning.linear_loops import LinearLoops
from sysid.robot.mission.tuning.tuned import SAFE, GainSet, Tuning
from sysid.structures.model import Model

Progress = Callable[[int], None]
"""Takes how many more sets were driven."""


@dataclass(frozen=True)
class SearchRule:
    """How sets are chosen.

    Attributes:
        spread: share of the sets that are spread over the bounds; the others refine.
        rounds: of refinement, each around the front so far.
        widths: standard deviation of a refined set from a member of the front, in the unit cube, in
            the first and the last round: a tenth of the decades between the bounds is what one set
            in a hundred leaves open in three dimensions.
    """

    spread: float = 0.5
    rounds: int = 2
    widths: tuple[float, float] = (0.1, 0.03)
    most: int = 100_000


RULE = SearchRule()


@dataclass(frozen=True)
class SearchOptions:
    """How much is driven.

    Attributes:
        robust: plants that each set drives: the estimated one, and others drawn from the covariance
            of its parameters.
        seed: of sets, plants and sensor noise.
    """

    trials: int = 256
    robust: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse numbers that make no search."""
        if not 8 <= self.trials <= RULE.most:
            raise UsageError(f"`trials` is {self.trials}: give a number from 8 to {RULE.most}")
        if not 1 <= self.robust <= RULE.most:
            raise UsageError(f"`robust` is {self.robust}: give a number from 1 to {RULE.most}")
        if self.seed < 0:
            raise UsageError(f"the seed is {self.seed}: give a whole number of at least 0")


class Judge:
    """Drives sets of gains with several plants, through the steps and through the mission.

    Args:
        plant: a fitted model, or a plant that is the same in every run.

    Attributes:
        plants: parameters of the plants, (M, n).
    """

    def __init__(
        self, mission: Mission, plant: Model | SteppablePlant, options: SearchOptions
    ) -> None:
        space = GainSpace.of(mission.control)
        setup = Setup.of(mission, [plant], ["parameters"], space.names)
        self.variant = setup.plant_variants[0]
        self.test = StepTest.of(mission, self.variant.robot)
        varied = self.variant.sampler.plant
        self.seeds = run_seeds(options.seed, options.robust if varied.size else 1)
        drawn = self.variant.sampler.draw(self.seeds)  # the first stands for the estimated plant
        self.plants: Array = np.concatenate([varied.theta[None], drawn.theta[1:]])
        counts = int(drawn.redrawn[1:].sum()), int(drawn.pulled[1:].sum()), len(self.seeds)
        self.notes = list(setup.notes(*counts) if options.robust > 1 else self.variant.warnings)
        steps = self.test.mission(mission)
        stepping = Setup.of(steps, [plant], ["parameters"], space.names)
        quarter = round(options.trials * (1.0 - RULE.spread) / RULE.rounds)
        batch_size = max(1, min(BATCH_SIZE, quarter * len(self.plants)))
        alone = why_not_at_once(setup) or why_not_at_once(stepping)
        if alone:
            self.notes.append(f"The runs went one after the other, in processes: {alone}.")
        self._runners = (
            BatchRunner(stepping, 0, batch_size, SHOWN, alone=bool(alone)),
            BatchRunner(setup, 0, batch_size, (), alone=bool(alone)),
        )

    def __call__(self, gains: Array) -> Criteria:
        """The worst criteria over the plants, of sets of gains (K, g)."""
        k, m = len(gains), len(self.plants)
        noise = [s % 2**31 for s in self.seeds] * k

        def driven(runner: BatchRunner) -> Driven:
            nominal = (np.repeat(np.array(v)[None], k * m, axis=0) for v in runner.variant.nominal)
            plants = np.tile(self.plants, (k, 1))
            numbers = Numbers(*nominal)._replace(theta=plants, gains=np.repeat(gains, m, axis=0))
            return runner.drive(numbers, noise, recorded=bool(runner.shown))

        with ThreadPoolExecutor(len(self._runners)) as pool:
            answers, drives = pool.map(driven, self._runners)
        return criteria(self.test, answers, drives.figures).worst(m)


def tune(
    mission: Mission,
    plant: Model | SteppablePlant,
    options: SearchOptions | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Search the gains of a mission's controller by driving.

    Half of the sets are spread over the bounds of the gains (a scrambled Sobol sequence, in the
    logarithm); the others lie around the front so far. A set is as good as its worst plant. The
    proposed one is the member of the front nearest to the point that is best in every criterion,
    each counted in parts of the distance of the front's median from it, among those with the usual
    margins where there are such.

    Args:
        mission: what to do; its controller's gains are where the search is compared with.
        plant: a fitted model, or a plant that is the same in every run.

    Raises:
        UsageError: the controller has no gains to be tuned.
        ModelError: no set of gains brings the robot to the goal, or the plant cannot drive.

    Source: Sobol (1967) as in scipy.stats.qmc; the member nearest to the ideal point: Zeleny,
    Multiple Criteria Decision Making (1982).
    """
    began, given = perf_counter(), options or SearchOptions()
    space = GainSpace.of(mission.control)
    control = cast(TunedSettings, mission.control)
    judge = Judge(mission, plant, given)
    loops = LinearLoops(mission, judge.variant.robot)
    rules = loops.rules()
    by_rule = [rounded(np.array([r.gains[name] for name in space.names])) for r in rules]
    known = np.array([space.of_controller(control), *by_rule])
    search = _Search(space, judge, loops, given, progress)
    search.explore(known)
    search.refine()
    ranked = search.front(np.arange(1, len(rules) + 1))
    if ranked is None:
        raise ModelError(_hopeless(mission, judge.variant, given))
    members = tuple(search.one(k) for k in ranked.members.tolist())
    proposed = _proposed(ranked, members)
    return Tuning(
        mission=mission.model_copy(update={"control": control.with_gains(members[proposed].gains)}),
        front=members,
        proposed=proposed,
        present=search.one(0, "present"),
        rules=tuple(search.one(k, r.name, r.axes) for k, r in enumerate(rules, 1)),
        test=judge.test,
        tried=tuple(map(search.criteria.of, np.flatnonzero(search.criteria.arrives > 0).tolist())),
        trials=len(search.gains),
        plants=len(judge.plants),
        seed=given.seed,
        seconds=perf_counter() - began,
        notes=tuple(judge.notes),
    )


@dataclass(eq=False)
class _Search:
    """The sets that were driven so far."""

    space: GainSpace
    judge: Judge
    loops: LinearLoops
    options: SearchOptions
    progress: Progress | None

    def __post_init__(self) -> None:
        """Nothing was driven yet."""
        self.gains = np.zeros((0, len(self.space.names)))
        self.criteria = Criteria(*(np.zeros(0) for _ in Criteria._fields))
        self._stable = np.zeros(0, dtype=bool)
        self._mission = self.judge.variant.sampler.mission

    def explore(self, known: Array) -> None:
        """Drive known sets and others spread over the bounds."""
        from scipy.stats import qmc

        count = round(self.options.trials * RULE.spread)
        sobol = qmc.Sobol(len(self.space.names), scramble=True, seed=self.options.seed)
        points = sobol.random_base2(max(1, (count - 1).bit_length()))[:count]
        self._drive(np.concatenate([known, self.space.values(points)]))

    def refine(self) -> None:
        """Drive sets around the front, closer and closer."""
        rng = np.random.default_rng((self.options.seed, 1))
        remaining = self.options.trials - round(self.options.trials * RULE.spread)
        shares = np.diff(np.linspace(0, remaining, RULE.rounds + 1).round().astype(int))
        for count, width in zip(
            shares.tolist(), np.geomspace(*RULE.widths, RULE.rounds), strict=True
        ):
            members = self.front()
            if members is None:
                points = rng.random((count, len(self.space.names)))
            else:
                order = members.members[np.argsort(members.distance, kind="stable")]
                parents = self.space.points(self.gains[order[np.arange(count) % len(order)]])
                points = parents + width * rng.standard_normal(parents.shape)
                # what lies outside of the unit cube comes back from its wall
                points = 1.0 - np.abs(1.0 - np.mod(points, 2.0))
            self._drive(self.space.values(points))

    def front(self, outside: Index | None = None) -> Front | None:
        """The front of the sets within the bounds; None where no mission arrives.

        Sets with an unstable loop, and those whose steps never come near their references, are
        left out where there are others.

        Args:
            outside: rows that are no candidates.
        """
        space = self.space
        fit = (self.criteria.arrives > 0) & np.all(self.gains >= space.low, axis=1)
        fit &= np.all(self.gains <= space.high, axis=1)
        if outside is not None:
            fit[outside] = False
        for wanted in (self._stable, self.criteria.answers):
            if np.any(fit & wanted):
                fit = fit & wanted
        rows = np.flatnonzero(fit)
        if not len(rows):
            return None
        values = self.criteria.objectives(has_surfaces(self._mission.scene()))[rows]
        members = front(values, Resolution().of(values, self._mission.control.period))
        return Front(rows[members.members], members.scaled)

    def one(self, k: int, name: str = "", axes: tuple[str, ...] = ()) -> GainSet:
        """A row as a set, with a name."""
        gains = self.space.named(self.gains[k])
        arrives = bool(self.criteria.arrives[k])
        return GainSet(name, gains, self.criteria.of(k), self.loops.margins(gains), arrives, axes)

    def _drive(self, gains: Array) -> None:
        criteria = self.judge(gains)
        self.gains = np.concatenate([self.gains, gains])
        both = zip(self.criteria, criteria, strict=True)
        self.criteria = Criteria(*(np.concatenate(pair) for pair in both))
        stable = [self.loops.stable(self.space.named(row)) for row in gains]
        self._stable = np.concatenate([self._stable, stable])
        if self.progress is not None:
            self.progress(len(gains))


def _proposed(members_front: Front, members: tuple[GainSet, ...]) -> int:
    """The member nearest to the best of everything, with the usual margins where one has them."""
    safe = np.array([SAFE.kept(member.margins) for member in members])
    distance = (
        np.where(safe, members_front.distance, np.inf) if safe.any() else members_front.distance
    )
    return int(np.argmin(distance))


def _hopeless(mission: Mission, variant: PlantVariant, options: SearchOptions) -> str:
    """Why there is no front: what becomes of the mission with its own gains."""
    result = simulate(mission, variant.robot)
    plants = "every plant" if options.robust > 1 else "the plant"
    head = f"none of {options.trials} sets of gains brings the robot to the goal with {plants}"
    if result.outcome == "arrived":
        return f"{head}; the present gains succeed with the estimated plant; lower `robust`"
    return f"{head}; with the present gains it ends as {result.outcome.value}. {result.sentence}"
