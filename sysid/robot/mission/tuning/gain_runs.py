"""Runs of one mission with many sets of gains, compiled in batches or sequential."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.robot.mission.batch.pool import PROCESSES, Job
from sysid.robot.mission.batch.runner import FAILED, BatchRunner
from sysid.robot.mission.loop import COLUMNS, Loop, LoopState, Verdict
from sysid.robot.mission.settings import TunedSettings
from sysid.robot.mission.simulator import closed_loop, simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.criteria import Driven
from sysid.runners.compiled import jax_module

RUNS_ALONE = 64
"""Runs that a process is given at a time where they go one by one: to wire the plant anew costs as
much as a few."""


class Runs(NamedTuple):
    """What differs from run to run.

    Attributes:
        gains: of the controller, (K, g).
        theta: parameters of the plant, (K, n).
        seeds: of the sensors' noise, one a run.
    """

    gains: Array
    theta: Array
    seeds: tuple[int, ...]

    def rows(self, at: Any) -> "Runs":
        return Runs(self.gains[at], self.theta[at], tuple(self.seeds[k] for k in at))

    def parts(self, size: int) -> list["Runs"]:
        """All of them, at most so many at a time, as equal as can be."""
        n = len(self.seeds)
        return [self.rows(at) for at in np.array_split(np.arange(n), -(-n // size))]


class Tally(NamedTuple):
    """What a run has come to so far; see :class:`~sysid.robot.mission.tuning.criteria.Driven`."""

    verdict: Any
    time_s: Any
    clearance: Any
    effort: Any


@dataclass(frozen=True, eq=False)
class GainRuns(BatchRunner):
    """One mission and its plant, driven with gains of all kinds.

    Attributes:
        names: of the gains, in the order of their columns.
        recorded: whether speed and yaw are wanted, sample by sample.
        alone: whether the runs go one after the other.
    """

    names: tuple[str, ...]
    recorded: bool
    alone: bool = False

    figures: ClassVar[Callable[..., Any]] = Tally

    def drive(self, runs: Runs) -> Driven:
        """All runs to their ends, side by side, or one by one on the cores that there are."""
        if not self.alone:
            return joined([self.together(part) for part in runs.parts(self.batch_size)])
        parts = runs.parts(RUNS_ALONE)
        if len(parts) == 1:
            return self.one_by_one(runs)
        return joined(list(self._job.results(parts, PROCESSES)))

    @cached_property
    def _job(self) -> Job:
        return Job(
            _one_by_one, (self.setup, self.which, self.batch_size, self.names, self.recorded)
        )

    def one_by_one(self, runs: Runs) -> Driven:
        """Run after run, in NumPy; a run that gives no numbers counts as failed."""
        return joined([self._one(runs.rows([k])) for k in range(len(runs.seeds))])

    def _one(self, run: Runs) -> Driven:
        robot = self.variant.resting(run.theta[0], 0.0)
        mission = self._with_gains(run.gains[0].tolist())
        try:
            result = simulate(mission, robot, run.seeds[0], self.variant.robot)
        except ModelError:
            nothing, row = np.full(1, np.nan), np.full((1, 1), np.nan)
            return Driven(np.array([FAILED]), nothing, nothing, nothing, np.zeros(1), row, row)
        log, clear = result.log, result.min_clearance_m
        effort = float(np.sum(log["v_cmd"] ** 2 + log["psi_cmd"] ** 2)) * robot.dt
        rows = slice(None) if self.recorded else slice(0)
        return Driven(
            np.array([Verdict[result.outcome.name]]),
            np.array([result.time_s]),
            np.array([np.inf if clear is None else clear]),
            np.array([effort]),
            np.asarray(log["t"][rows]),
            log["v"][rows, None],
            log["psi"][rows, None],
        )

    def together(self, runs: Runs) -> Driven:
        """At most ``batch_size`` of them, side by side."""
        numbers, nothing = (runs.gains, runs.theta), np.zeros((0, len(runs.seeds)))
        ended: Tally
        ended, t, shown = self.run(numbers, runs.seeds, self.recorded)
        v, psi = shown or (nothing, nothing)
        kept = t <= ended.time_s.max()
        return Driven(*ended, t[kept], v[kept], psi[kept])

    @property
    def example(self) -> tuple[Array, Array]:
        return np.ones(len(self.names)), self.variant.sampler.plant.theta

    def loop(self, numbers: tuple[Any, Any]) -> Loop:
        gains, theta = numbers
        robot, xp = self.variant.robot_of(theta, 0.0), jax_module().numpy
        mission = self._with_gains(gains)
        return closed_loop(mission, robot, self.variant.scene, xp, self.variant.shaper)

    def _with_gains(self, gains: Any) -> Mission:
        mission = self.setup.mission
        named = {name: gains[k] for k, name in enumerate(self.names)}
        control = cast(TunedSettings, mission.control).with_gains(named)
        return mission.model_copy(update={"control": control})

    def after_sample(self, loop: Loop, state: LoopState, verdict: Any) -> Tally:
        command = state.command
        effort = (command.v_cmd**2 + command.psi_cmd**2) * loop.plant.dt
        return Tally(verdict, 0.0, state.progress.clearance, effort)

    def added(self, before: Tally, seen: Tally) -> Tally:
        return seen._replace(effort=before.effort + seen.effort)

    def shown(self, figures: Tally, row: Any) -> tuple[Any, ...]:
        return tuple(row[COLUMNS.index(n)] for n in ("v", "psi")) if self.recorded else ()


def _one_by_one(given: tuple[Any, ...]) -> Callable[[Runs], Driven]:
    return GainRuns(*given).one_by_one


def joined(parts: list[Driven]) -> Driven:
    """Runs one after the other, with as many rows as the longest: others hold their last."""
    t = max((part.t for part in parts), key=len)

    def padded(rows: Array) -> Array:
        return np.pad(rows, ((0, len(t) - len(rows)), (0, 0)), "edge")

    ended = Tally(*(np.concatenate(column) for column in zip(*(p[:4] for p in parts), strict=True)))
    v = np.concatenate([padded(p.v) for p in parts], axis=1)
    psi = np.concatenate([padded(p.psi) for p in parts], axis=1)
    return Driven(*ended, t, v, psi)
