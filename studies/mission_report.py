"""``missions.md``: the identified robot in the missions of the thesis, beside their outcomes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import sysid_datasets

from sysid.data.io import read_logs
from sysid.errors import ModelError
from sysid.estimation.identify import Identification, Request, identify
from sysid.estimation.selection.comparison import Contender, compare
from sysid.report.markdown import table
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.model import Model
from sysid.structures.orders import orders_text

LOGS = ("prbs", "multilevel", "multisine")


@dataclass(frozen=True)
class Band:
    """What the identified robot must do in a mission.

    Attributes:
        mission: name of the bundled mission.
        published: outcomes of the thesis: Simulink model, Gazebo, robot.
        words: the band in words.
        time: time [s] and its tolerance.
        reach: largest distance from the goal at the end [m].
        drift: least and largest distance to the left of the line at the end [m].
        clearance: smallest distance from an obstacle's surface [m].
    """

    mission: str
    published: tuple[str, str, str]
    words: str
    time: tuple[float, float]
    reach: float = 0.1
    drift: tuple[float, float] | None = None
    clearance: float | None = None

    def holds(self, mission: Mission, result: MissionResult) -> bool:
        """Whether an outcome lies in the band."""
        x, y, _ = result.final
        centre, tolerance = self.time
        found = [
            result.outcome == "arrived",
            abs(result.time_s - centre) <= tolerance,
            float(np.hypot(x - mission.goal[0], y - mission.goal[1])) <= self.reach,
        ]
        if self.drift is not None:  # the missions with a drift run along the x axis
            found.append(self.drift[0] <= y <= self.drift[1])
        if self.clearance is not None:
            nearest = result.min_clearance_m
            found.append(nearest is not None and nearest >= self.clearance)
        return all(found)


BANDS = (
    Band(
        "goal_1m",
        ("4.9 s, (0.91, 0.028)", "5 s, (0.93, 0.00)", "5 s, (1.03, 0.07), Kpψ = 0.3"),
        "arrive in 5.2 ± 0.6 s within 0.10 m, 0.02–0.06 m to the left",
        (5.2, 0.6),
        drift=(0.02, 0.06),
    ),
    Band(
        "obstacles_6_3",
        ("34.1 s, (5.97, 2.90)", "34 s, (5.94, 2.95)", "–"),
        "arrive in 34 ± 4 s, clear by 0.10 m or more",
        (34.0, 4.0),
        clearance=0.10,
    ),
    Band("straight_5m_theta1", ("21.5 s", "–", "–"), "arrive in 21 ± 1.5 s", (21.0, 1.5)),
    Band("straight_5m_theta2", ("19.6 s", "–", "–"), "arrive sooner than with θ = 1", (19.5, 1.5)),
)

SECTORS = ((1, 1), (-1, 1), (-1, -1), (1, -1))

HEAD = """# The identified robot in the missions of the thesis

The plant is the one of the [tour](tour.md): identified from `prbs.csv` and the best by AIC,
`{plant}`. Guidance and control have the thesis's gains;
nothing was tuned to these outcomes. The picture of the second mission is
[mission.svg](mission.svg). Times in seconds, lengths in metres.

## Beside the published outcomes

"""

BAND_HEAD = """
## What the loop must do

*Off the line* is the largest distance from the straight line through start and goal, *clear* the
smallest distance from the robot's centre to the surface of an obstacle.

"""

SECTOR_HEAD = """
## Goals in the four sectors

A goal behind the robot is met by a turn on the spot before the field takes over. *Turned* is the
farthest the heading got from the start, positive to the left.

"""

LOG_HEAD = """
## Does it matter which log the plant was identified from?

The model that is ahead after `sysid fit LOG --val LOG_val`, in the four missions: time, and the
distance to the left of the line at the end (for `obstacles_6_3` the distance from the nearest
surface). The bundled robot is nonlinear, so that each log gives another linear plant.

"""


def write(_folder: Path) -> Mapping[str, str]:
    """The tables."""
    found = {log: identified(log) for log in LOGS}
    best = best_by_aic(found["prbs"])
    results = {b.mission: run(best, _mission(b)) for b in BANDS}
    text = HEAD.format(plant=called(best)) + _published_table(results)
    text += BAND_HEAD + _band_table(results)
    text += SECTOR_HEAD + _sector_table(best)
    text += LOG_HEAD + _log_table({log: f.assessments[0].model for log, f in found.items()})
    return {"missions.md": text}


def run(model: Model, mission: Mission) -> MissionResult:
    """A mission with the plant of a model."""
    robot, _ = as_robot(model.plant(), mission)
    return simulate(mission, robot)


@cache
def identified(log: str) -> Identification:
    """What ``sysid fit LOG --val LOG_val`` finds; several reports start from it."""
    estimation = read_logs([sysid_datasets.path(log)])
    validation = read_logs([sysid_datasets.path(f"{log}_val")])
    return identify(estimation, validation, Request(jobs=2))


def best_by_aic(found: Identification) -> Model:
    contenders = [
        Contender(a.model.structure.name, a.model, found.estimation, a.to_json())
        for a in found.assessments
    ]
    return compare(contenders, "aic", None).best.contender.model


def called(model: Model) -> str:
    return f"{model.structure.name} {orders_text(model.structure.order_values())}"


def _mission(band: Band) -> Mission:
    return load_mission(sysid_datasets.path(band.mission))


def _published_table(results: Mapping[str, MissionResult]) -> str:
    rows = []
    for band in BANDS:
        result = results[band.mission]
        x, y, _ = result.final
        ours = f"{result.time_s:.1f} s, ({x:.2f}, {y:.3f})"
        rows.append([f"`{band.mission}`", ours, *band.published])
    return table(["mission", "ours", "Simulink", "Gazebo", "robot"], rows)


def _band_table(results: Mapping[str, MissionResult]) -> str:
    rows = []
    for band in BANDS:
        result = results[band.mission]
        inside = band.holds(_mission(band), result)
        if band.mission == "straight_5m_theta2":
            inside = inside and result.time_s < results["straight_5m_theta1"].time_s
        nearest = result.min_clearance_m
        rows.append(
            [
                f"`{band.mission}`",
                band.words,
                str(result.outcome),
                f"{result.time_s:.1f}",
                f"{result.final[1]:.3f}",
                f"{result.max_deviation_m:.3f}",
                "–" if nearest is None else f"{nearest:.3f}",
                _yes(inside),
            ]
        )
    headers = ["mission", "should", "outcome", "time", "y", "off the line", "clear", "does"]
    return table(headers, rows, "lllrrrrl")


def _sector_table(model: Model) -> str:
    rows = []
    for x, y in SECTORS:
        result = run(model, Mission(goal=(float(x), float(y))))
        heading = np.degrees(np.unwrap(result.log["psi"]))
        turned = heading[np.argmax(np.abs(heading))]
        right_way = np.sign(turned) == np.sign(y) and abs(turned) < 180.0
        rows.append(
            [
                f"({x}, {y})".replace("-", "−"),
                f"{result.outcome}, {result.time_s:.1f} s",
                f"({result.final[0]:.2f}, {result.final[1]:.2f})".replace("-", "−"),
                f"{turned:+.0f}°".replace("-", "−"),
                _yes(result.outcome == "arrived" and bool(right_way)),
            ]
        )
    headers = ["goal", "outcome", "ends at", "turned", "arrived, turning the short way"]
    return table(headers, rows, "llrrl")


def _log_table(models: Mapping[str, Model]) -> str:
    rows = []
    for log, model in models.items():
        cells = []
        for band in BANDS:
            mission = _mission(band)
            try:
                result = run(model, mission)
            except ModelError:  # e.g. a log whose best model integrates: its plant is refused
                cells.append("refused")
                continue
            nearest = result.min_clearance_m
            what = result.final[1] if nearest is None else nearest
            inside = "" if band.holds(mission, result) else " (outside the band)"
            cells.append(f"{result.time_s:.1f} s, {what:.3f} m{inside}")
        rows.append([f"`{log}.csv`", called(model), *cells])
    return table(["log", "plant", *(f"`{b.mission}`" for b in BANDS)], rows)


def _yes(holds: bool) -> str:
    return "yes" if holds else "NO"
