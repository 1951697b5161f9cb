"""What navigation filters make of slip, iron and hypotheses, and whether they know it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import sysid_datasets

from studies.filter_truth import own_run
from studies.runner import Study, seeds
from sysid.data.io import read_logs
from sysid.data.record import Array
from sysid.estimation.identify import Request, identify
from sysid.report.markdown import table
from sysid.robot.mission.navigation.consistency import Consistency, consistency
from sysid.robot.mission.registry import law
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot

STUDY = Study("navigation", "navigation.md", runs=4)
WHEELS: dict[str, Any] = {"encoders": {}, "gyroscope": {}}
CAMERA = WHEELS | {"visual_odometry": {}}


class Slippery:
    """A floor that takes the same part of both tracks' speeds."""

    slides = False

    def __init__(self, slip: float) -> None:
        self.slip = slip

    def __bool__(self) -> bool:
        return self.slip > 0

    def __call__(self, left: float, right: float) -> tuple[float, float]:
        return (1.0 - self.slip) * left, (1.0 - self.slip) * right

    def start(self) -> tuple[()]:
        return ()

    def step(self, state: Any, omega: tuple[float, float], dt: float) -> tuple[Any, Any]:
        return self(*omega), state


@dataclass(frozen=True)
class OnFloor:
    """A robot on a floor of its own."""

    robot: Any
    ground: Any

    def __getattr__(self, name: str) -> Any:
        return getattr(self.robot, name)


class Runs:
    """The identified robot around four obstacles, driven with one navigation after the other."""

    def __init__(self, seeds: range) -> None:
        self.seeds = seeds
        record = read_logs([sysid_datasets.path("prbs")])
        found = identify(record, [], Request(structures=("arx",)))
        self.mission = load_mission(sysid_datasets.path("obstacles_6_3"))
        self.robot, _ = as_robot(found.assessments[0].model.plant(), self.mission)

    def driven(
        self, navigation: dict[str, Any], sensors: dict[str, Any], slip: float = 0.0
    ) -> Iterator[MissionResult]:
        """One run a seed."""
        mission = Mission.model_validate(
            {
                **{name: getattr(self.mission, name) for name in ("goal", "start", "obstacles")},
                "navigation": law("navigation", navigation),
                "sensors": sensors,
            }
        )
        plant: Any = OnFloor(self.robot, Slippery(slip))
        for seed in self.seeds:
            yield simulate(mission, plant, seed)


def path_errors(run: MissionResult, navigation: str) -> Array:
    """Distance from where the robot is to where it believes to be [m]."""
    log = run.log
    if navigation != "odometry":
        return np.hypot(log["x_est"] - log["x"], log["y_est"] - log["y"])
    gone = np.hypot(log["x"][-1] - 6.0, log["y"][-1] - 3.0)  # it believes to be at the goal
    return np.array([gone])


def slip_table(runs: Runs) -> str:
    """Slip that encoders cannot see, with and without a camera."""
    rows = []
    for slip in (0.0, 0.15, 0.3):
        for kind, sensors, words in (
            ("ekf", WHEELS, "encoders, gyroscope"),
            ("kf", CAMERA, "… and visual odometry"),
            ("ekf", CAMERA, "… and visual odometry"),
            ("ukf", CAMERA, "… and visual odometry"),
            ("finite-model", CAMERA, "… and visual odometry"),
        ):
            results = list(runs.driven({"kind": kind}, sensors, slip))
            last = [path_errors(r, kind)[-1] for r in results]
            arrived = sum(r.outcome.value == "arrived" for r in results)
            collided = sum(r.outcome.value == "collision" for r in results)
            rows.append(
                (f"{slip:g}", kind, words, f"{np.median(last):.3f}", f"{max(last):.3f}",
                 f"{arrived} / {collided}")
            )  # fmt: skip
    return table(
        ("slip", "filter", "sensors", "error at the end [m]", "largest", "arrived / collided"), rows
    )


def iron_table(runs: Runs) -> str:
    """A magnetometer that passes iron, with and without the gate."""
    rows = []
    sensors = WHEELS | {"magnetometer": {"iron": [[3.2, 2.4, 4.0]]}}
    for gate in (1.0, 0.9999):
        results = list(runs.driven({"kind": "ekf", "gate": gate}, sensors))
        turned = [np.abs(r.log["psi_est"] - r.log["psi"]).max() for r in results]
        last = [path_errors(r, "ekf")[-1] for r in results]
        rejected = [r.log["rejected"].sum() for r in results]
        rows.append(
            (f"{gate:g}", f"{np.median(turned):.3f}", f"{np.median(last):.3f}",
             f"{np.median(rejected):.0f}")
        )  # fmt: skip
    return table(("gate", "largest error of ψ [rad]", "error at the end [m]", "rejected"), rows)


def shown(found: Consistency) -> tuple[str, ...]:
    """Means, bounds and verdicts in words."""
    cells = []
    for one in (found.nis, found.nees):
        if one is not None:
            low, high = one.bounds
            cells += [f"{one.mean:.3f}", f"{low:.3f}–{high:.3f}", one.verdict]
    return tuple(cells)


def consistency_table(runs: Runs) -> str:
    """Errors and innovations of filters with right and with wrong noise."""
    quiet = {"speed": 0.02, "yaw_rate": 0.2, "slip": 0.0}
    rows = []
    fixes = CAMERA | {"position_fixes": {"latency": 0.2}}
    for kind in ("kf", "ekf", "ukf"):
        right = law("navigation", {"kind": kind, "gate": 1.0, "q": quiet})
        mission = Mission.model_validate(
            {"goal": (1.0, 0.0), "navigation": right, "sensors": fixes}
        )
        for words, keys in (
            ("right", {}),
            ("fixes believed ten times too exact", {"r": {"fix_x": 1e-6, "fix_y": 1e-6}}),
        ):
            believed = right.model_copy(update=keys)
            found = consistency(
                [own_run(believed, mission.scene(), 20, seed, right) for seed in range(100)]
            )
            rows.append((kind, words, *shown(found)))
    for kind in ("kf", "ekf"):
        logs = [r.log for r in runs.driven({"kind": kind}, CAMERA)]
        rows.append((kind, f"the robot, {len(runs.seeds)} missions", *shown(consistency(logs))))
    return table(("filter", "noise", "NIS", "bounds", "", "NEES", "bounds", ""), rows)


def hypotheses_table(runs: Runs) -> str:
    """Probabilities of slip where the floor takes more and more."""
    rows = []
    for slip in (0.0, 0.1, 0.2, 0.3):
        p = [r.log["p_slip"] for r in runs.driven({"kind": "finite-model"}, CAMERA, slip)]
        first = [int(np.argmax(one > 0.9)) if (one > 0.9).any() else -1 for one in p]
        when = f"{0.1 * np.median(first):.1f}" if min(first) >= 0 else "–"
        mean = np.mean([one.mean() for one in p])
        rows.append((f"{slip:g}", f"{1 - mean:.3f}", f"{mean:.3f}", when))
    return table(("slip", "p(grip), mean", "p(slip 0.3), mean", "p(slip) > 0.9 after [s]"), rows)


def page(runs: Runs) -> str:
    """The whole report."""
    return f"""# What navigation filters make of it

The robot identified from `prbs.csv` in the mission `obstacles_6_3`, {len(runs.seeds)} seeds each,
sensors with their default figures where nothing else is said. What the filters are is in
[navigation.md](../docs/navigation.md).

## Slip that encoders cannot see

Both tracks lose a part of their speed on the floor. The error is the distance from the true
position to the estimate.

{slip_table(runs)}

## A magnetometer near iron

Encoders, gyroscope and magnetometer; a piece of iron near (3.2, 2.4), beside the way. `gate:
1` takes every reading.

{iron_table(runs)}

## Does a filter know how wrong it is?

Per degree of freedom, 1 is right; bounds of 99 %. In the first rows truth and readings of 100
runs of 20 samples are drawn from the model of
the filter in its first row, with encoders, gyroscope, visual odometry and position fixes that
come 0.2 s late.

{consistency_table(runs)}

The linear filter takes its heading for known: over runs as short as these that does not show, in
missions its NEES is nearly twice that of the extended filter. In missions speeds are no random
walks, and the errors of ticks cancel from reading to reading: innovations are smaller than
believed.

## Which hypothesis holds?

`finite-model` with its default hypotheses, grip and a slip of 0.3.

{hypotheses_table(runs)}
"""


if __name__ == "__main__":
    asked = STUDY.asked(__doc__)
    STUDY.write(asked, page(Runs(seeds(asked))))
