"""Runs of one mission and one plant with everything drawn that varies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError, SysidError
from sysid.robot.mission.batch.runner import FAILED, BatchRunner
from sysid.robot.mission.batch.sampler import Numbers, Samples
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.clearance import off_line
from sysid.robot.mission.contracts import Scene
from sysid.robot.mission.loop import Loop, LoopState, Verdict
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import closed_loop
from sysid.runners.compiled import jax_module

OUTCOMES = ("arrived", "missed", "collision", "stuck", "timeout", "failed")
"""In the order of the report."""


class Figures(NamedTuple):
    """What runs came to, one entry each.

    Attributes:
        verdict: of :class:`sysid.robot.mission.loop.Verdict`, or ``FAILED``.
        time_s: when it ended [s].
        x, y, psi: where [m, rad].
        path_length_m, min_clearance_m, max_deviation_m: see
            :class:`sysid.robot.mission.result.MissionResult`; the clearance is infinite without
            obstacles.
    """

    verdict: Index
    time_s: Array
    x: Array
    y: Array
    psi: Array
    path_length_m: Array
    min_clearance_m: Array
    max_deviation_m: Array

    def final_error_m(self, goal: tuple[float, float]) -> Array:
        """Distance from where the runs ended to the goal [m]."""
        return np.hypot(self.x - goal[0], self.y - goal[1])

    def outcome(self, k: int) -> str:
        """The outcome of one run, as a word."""
        verdict = int(self.verdict[k])
        return "failed" if verdict == FAILED else Verdict(verdict).name.lower()


def figures_of(result: MissionResult) -> tuple[float, ...]:
    """One run's figures, in the order of :class:`Figures`."""
    clearance = result.min_clearance_m
    return (
        float(Verdict[result.outcome.name]),
        result.time_s,
        *result.final,
        result.path_length_m,
        np.inf if clearance is None else clearance,
        result.max_deviation_m,
    )


NOTHING = (float(FAILED), *(np.nan,) * (len(Figures._fields) - 1))
"""The figures of a run that failed."""


def stacked(rows: Sequence[Sequence[float]]) -> Figures:
    """Figures of runs from rows, one a run."""
    table = np.array(rows, dtype=np.float64).reshape(-1, len(Figures._fields))
    return Figures(table[:, 0].astype(np.intp), *table[:, 1:].T)


def joined(parts: Sequence[Figures], order: Index) -> Figures:
    """Parts one after the other, then in the order of these places."""
    verdict, *numbers = (np.concatenate(columns)[order] for columns in zip(*parts, strict=True))
    return Figures(verdict.astype(np.intp), *(n.astype(np.float64) for n in numbers))


@dataclass(frozen=True, eq=False)
class VariedRuns(BatchRunner):
    """Runs with parameters, start, obstacles, slip and physics of their own."""

    figures: ClassVar[Callable[..., Any]] = Figures

    def of(self, samples: Samples) -> Figures:
        """Run samples, at most ``batch_size`` of them, to their ends."""
        figures: Figures = self.run(samples.numbers, self._noise_seeds(samples))[0]
        return figures

    def paths(self, samples: Samples) -> tuple[Figures, Array, Array]:
        """Run them, and keep the instants, (T,) [s], and X, Y [m], ψ [rad], (T, 3, runs)."""
        return self.run(samples.numbers, self._noise_seeds(samples), recorded=True)

    def _noise_seeds(self, samples: Samples) -> list[int]:
        return [self.setup.noise_seed(s) for s in samples.seeds]

    @property
    def example(self) -> Numbers:
        mission, plant = self.setup.mission, self.variant.sampler.plant
        obstacles = np.array([(o.x, o.y) for o in mission.obstacles]).reshape(-1, 2)
        physics = self.variant.sampler.physics.nominal
        return Numbers(plant.theta, np.array(mission.start), obstacles, np.float64(0.0), physics)

    def loop(self, numbers: Numbers) -> Loop:
        variant, xp = self.variant, jax_module().numpy
        robot = variant.robot_of(numbers.theta, numbers.slip)
        return closed_loop(self.setup.mission, robot, self._scene(numbers), xp, variant.shaper)

    def _scene(self, numbers: Numbers) -> Scene:
        there = self.variant.sampler.varied(numbers).scene()
        return self.variant.scene._replace(
            start=there.start, obstacles=there.obstacles, car=there.car, floor=there.floor
        )

    def after_sample(self, loop: Loop, state: LoopState, verdict: Any) -> Figures:
        pose, progress, scene = state.body.pose, state.progress, loop.scene
        aside = off_line(pose.x, pose.y, scene.start, scene.goal, loop.xp)
        driven = progress.path_length, progress.clearance
        return Figures(verdict, 0.0, *pose, *driven, aside)  # type: ignore[arg-type]

    def added(self, before: Figures, seen: Figures) -> Figures:
        farthest = jax_module().numpy.maximum(before.max_deviation_m, seen.max_deviation_m)
        return seen._replace(max_deviation_m=farthest)

    def shown(self, figures: Figures, row: Any) -> Any:
        return jax_module().numpy.stack([figures.x, figures.y, figures.psi])


def figures_alone(setup: Setup, seed: int) -> tuple[float, ...]:
    """Figures of one run, driven alone in NumPy; those of a failed run where it cannot end."""
    try:
        return figures_of(setup.simulated(seed))
    except ModelError:
        return NOTHING


def why_not_at_once(setup: Setup) -> str:
    """What keeps the runs of a setup from going side by side; empty for nothing.

    A law or a plant that takes its numbers for Python's, by ``if``, ``float`` or a function of
    NumPy, can be run and not traced.
    """
    for which in range(len(setup.plants)):
        try:
            VariedRuns(setup, which, 1).check()
        except SysidError as error:
            return str(error)
        except Exception as error:  # whatever a law of another package raises on traced numbers
            first = str(error).strip().partition("\n")[0]
            return f"{_culprit(setup, which, error)} cannot be compiled ({first})"
    return ""


def _culprit(setup: Setup, which: int, error: BaseException) -> str:
    """The part whose method was running when it failed."""
    mission, variant = setup.mission, setup.plant_variants[which]
    parts = {
        type(getattr(mission, role)): f"the law of {role}"
        for role in ("guidance", "control", "navigation", "motion")
    }
    parts |= {type(s): f"the sensor {name}" for name, s in variant.scene.sensors.items()}
    plant = f"the plant {setup.plants[which].name}"
    parts |= {type(variant.robot): plant, type(setup.plants[which]): plant}
    culprit, place = "the loop of the mission", error.__traceback__
    while place is not None:
        culprit = parts.get(type(place.tb_frame.f_locals.get("self")), culprit)
        place = place.tb_next
    return culprit
