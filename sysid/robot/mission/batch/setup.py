"""A mission, its plant variants and its variation; single runs in NumPy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np

from sysid.robot.mission.batch.sampler import Numbers, Sampler
from sysid.robot.mission.batch.varied_plant import FixedPlant, ModelPlant, VariedPlant
from sysid.robot.mission.contracts import Scene, SteppablePlant
from sysid.robot.mission.loop import CommandShaper
from sysid.robot.mission.noise import generator
from sysid.robot.mission.simulator import check_robot, scene_of, shaper_of
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.robot.mission.tracks.settling import settle
from sysid.robot.mission.variation import QUANTITIES, Variation
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class PlantVariant:
    """One plant wired as a robot, and how its runs are drawn.

    Wiring and scales are those of the estimated plant in every run: they say what its numbers
    mean. Only the state at rest follows the run's own parameters.

    Attributes:
        robot: the robot of the estimated plant.
        settling_steps: samples without drive after which it is at rest; 0 where it rests as it is.
    """

    sampler: Sampler
    robot: RobotPlant
    warnings: tuple[str, ...]
    settling_steps: int

    @staticmethod
    def of(sampler: Sampler) -> "PlantVariant":
        plant, mission = sampler.plant, sampler.mission
        nominal = plant.plant(plant.theta)
        robot, warnings = as_robot(nominal, mission)
        check_robot(mission, robot)
        state = nominal.initial_state()
        fresh = np.array((state, state)) if robot.twins else state
        settling_steps = 0
        if not np.array_equal(robot.rest, fresh):
            settling_steps = len(settle(nominal, state, robot.centre).response)
        return PlantVariant(sampler, robot, warnings, settling_steps)

    @cached_property
    def scene(self) -> Scene:
        """The scene of the mission, with what control knows of the estimated plant."""
        return scene_of(self.sampler.mission, self.robot)

    @cached_property
    def shaper(self) -> CommandShaper:
        """What makes PWM of commands, by the estimated plant."""
        return shaper_of(self.sampler.mission, self.robot)

    def robot_of(self, theta: Any, slip: Any) -> RobotPlant:
        """The robot with a run's numbers, of NumPy or traced; it stands where nothing moved yet."""
        plant = self.sampler.plant.plant(theta)
        state = plant.initial_state()
        fresh = np.array((state, state)) if self.robot.twins else state
        slips = slip if self.sampler.slips else None
        return replace(self.robot, plant=plant, rest=fresh, slip=slips)

    @property
    def nominal(self) -> Numbers:
        """The numbers of a run in which nothing varies, its gains 1."""
        sampler, mission = self.sampler, self.sampler.mission
        obstacles = np.array([(o.x, o.y) for o in mission.obstacles]).reshape(-1, 2)
        placed = np.array(mission.start), obstacles, np.float64(0.0)
        return Numbers(
            sampler.plant.theta, *placed, sampler.physics.nominal, np.ones(len(sampler.gains))
        )

    def single(self, numbers: Numbers) -> tuple[Mission, RobotPlant]:
        """Mission and robot, at rest without drive, of a run with these plain numbers."""
        robot = self.robot_of(np.array(numbers.theta), float(numbers.slip))
        state = robot.initial_state()
        for _ in range(self.settling_steps):
            state, _ = robot.step(state, np.zeros(2))
        return self.sampler.varied(numbers), replace(robot, rest=state)


@dataclass(frozen=True, eq=False)
class Setup:
    """What many runs of one mission have in common.

    Attributes:
        plants: what may drive it, one or several of a comparison.
        variation: what varies; several plants where it says so.
        gains: names of the controller's gains that each run is given.
    """

    mission: Mission
    plants: tuple[VariedPlant, ...]
    variation: Variation
    gains: tuple[str, ...] = ()

    @staticmethod
    def of(
        mission: Mission,
        plants: Sequence[Model | SteppablePlant],
        vary: Sequence[str] | None = None,
        gains: tuple[str, ...] = (),
    ) -> "Setup":
        """The setup of a mission as its file has it.

        Args:
            mission: nominal; its ``vary`` says what varies and by how much.
            plants: fitted models, or plants that are the same in every run; the first is nominal.
            vary: names of what varies instead.
            gains: of the controller, which each run is given.
        """
        variation = mission.vary if vary is None else mission.vary.of(vary)
        kept = plants if variation.models else plants[:1]
        return Setup(
            mission,
            tuple(
                ModelPlant(p, variation.parameters or 1.0)
                if isinstance(p, Model)
                else FixedPlant(p)
                for p in kept
            ),
            variation,
            gains,
        )

    def __reduce__(self) -> tuple[type["Setup"], tuple[Any, ...]]:
        """Without what was worked out from it, to be sent to another process."""
        plants = tuple(replace(p) for p in self.plants)
        return Setup, (self.mission, plants, self.variation, self.gains)

    @cached_property
    def plant_variants(self) -> tuple[PlantVariant, ...]:
        """Every plant, wired."""
        given = self.variation, self.gains
        return tuple(PlantVariant.of(Sampler(self.mission, p, *given)) for p in self.plants)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of what differs between the runs, as a user asks for them."""
        varying = [name for d in self.plant_variants for name, _ in d.sampler.varying]
        there = {name.partition(".")[0].partition("[")[0] for name in varying}
        if self.variation.noise and self.plant_variants[0].scene.sensors:
            there.add("noise")
        if len(self.plants) > 1:
            there.add("models")
        return tuple(name for name in QUANTITIES if name in there)

    def notes(self, redrawn: int, pulled: int, runs: int) -> tuple[str, ...]:
        """Sentences about what was assumed, and what was asked for and is not there."""
        sentences = list(dict.fromkeys(w for d in self.plant_variants for w in d.warnings))
        if self.variation.models and len(self.plants) == 1:
            sentences.append("Models do not vary, because there is one plant.")
        if self.variation.parameters:
            sentences += [_unknown(p) for p in self.plants if p.unknown]
            sentences += [
                f"The parameters of {p.name} do not vary, because they have no covariance; fit "
                "and export the model again."
                for p in self.plants
                if not p.size
            ]
        if redrawn:
            share = redrawn / (redrawn + runs)
            sentences.append(
                f"{100 * share:.2g} % of the draws could not be driven (an unstable plant, a "
                "parameter out of its bounds, a start or goal inside an obstacle) and were "
                "replaced; the results hold for drivable runs only."
            )
        if pulled:
            sentences.append(
                f"In {100 * pulled / runs:.2g} % of the runs some parameters of the plant stay "
                "nearer to their estimates than their standard errors say, because its log leaves "
                "them undetermined and the plant would be unstable; lower orders leave fewer."
            )
        return tuple(sentences)

    def choice(self, seed: int) -> int:
        """Which plant the run of a seed has: each is as likely as another."""
        if len(self.plants) == 1:
            return 0
        z = float(generator(seed, "models").standard_normal())
        return min(int(len(self.plants) * NormalDist().cdf(z)), len(self.plants) - 1)

    def noise_seed(self, seed: int) -> int:
        """Of a run's sensor noise; that of a single run where noise does not vary."""
        return seed if self.variation.noise else 0

    def alone(self, seed: int) -> tuple[Mission, RobotPlant, int]:
        """Mission, robot and noise seed of one run, for NumPy."""
        variant = self.plant_variants[self.choice(seed)]
        return *variant.single(variant.sampler.draw([seed]).numbers.run(0)), self.noise_seed(seed)

    def known(self, seed: int) -> RobotPlant:
        """The robot that control takes a run's for: that of the estimated plant."""
        return self.plant_variants[self.choice(seed)].robot


def _unknown(plant: VariedPlant) -> str:
    names = ", ".join(plant.unknown[:5]) + (" …" if len(plant.unknown) > 5 else "")
    return f"The data do not determine {names} of {plant.name}; every run keeps their values."
