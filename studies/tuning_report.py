"""``tuning.md``: the thesis's studies of gains (6.12–6.24, 6.28) with the identified robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.mission_report import SECTORS, best_by_aic, called, identified
from sysid.report.markdown import table
from sysid.report.missions.panels import surroundings
from sysid.report.panels import Curve, PanelPicture, panel
from sysid.report.plots import write_picture
from sysid.robot.mission.control.linear import PIDTerms
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.guidance.steps import Steps
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tuning.axes import Axis, answer
from sysid.robot.mission.tuning.linear_loops import SampledLoop
from sysid.robot.mission.tuning.rules import from_edge, from_lag, lag_model
from sysid.structures.model import Model

HEAD = """# The thesis's studies of gains, with the identified robot

The plant is the one of the [missions](missions.md), `{plant}`. What is not varied has the thesis's
value: K_p 2, K_i 1.85, K_pψ 0.4, limits of the commands [0, 1] and ±0.3.

## Speed: a step to 0.25 m/s (6.12–6.14)

![speed](tuning_speed.svg)

*Rise* is from 10 to 90 % of the reference, *over* the overshoot, *left* the error at the end.

"""

YAW_HEAD = """
## Yaw: a step of 60° and its reversal (6.15)

![yaw](tuning_yaw.svg)

"""

PATH_HEAD = """
## Paths with K_pψ 0.3 and 0.6 (6.16–6.19)

![paths](tuning_paths.svg)

The goal is (1, 1) without an obstacle, and (3, 0.3) with one at (1.5, 0) on the way.

"""

SECTOR_HEAD = """
## Goals in the four sectors (6.21–6.24)

![sectors](tuning_sectors.svg)

The table of these runs stands in [missions.md](missions.md).

## References over time for θ (6.28)

The goal is 5 m ahead, K_g 0.3, h 1.

![theta](tuning_theta.svg)

"""

RULE_HEAD = """
## Gains from the plant alone

A lag with dead time is fitted to the answer of each axis around half drive; *margins* are those of
the sampled loop. A rule may leave none: Ziegler and Nichols ask for a quarter of decay from a plant
with much dead time, and this one has little beside a slow control period.

"""


@dataclass(frozen=True, eq=False)
class Study:
    """One picture and the rows of its table.

    Attributes:
        picture: what is drawn.
        headers, rows: of the table, as text; none where another report has it.
        align: of its columns.
    """

    picture: PanelPicture
    headers: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    align: str = ""

    def written(self, file: Path) -> str:
        """The table; the picture goes into the file."""
        write_picture(file, self.picture)
        return table(self.headers, self.rows, self.align) if self.headers else ""


def write(folder: Path) -> Mapping[str, str]:
    """The tables; the pictures go into the folder."""
    model = best_by_aic(identified("prbs"))
    text = HEAD.format(plant=called(model)) + speed(model).written(folder / "tuning_speed.svg")
    text += YAW_HEAD + yaw(model).written(folder / "tuning_yaw.svg")
    text += PATH_HEAD + paths(model).written(folder / "tuning_paths.svg")
    text += sectors(model).written(folder / "tuning_sectors.svg")
    text += SECTOR_HEAD + references(model).written(folder / "tuning_theta.svg")
    text += RULE_HEAD + _rules(model)
    return {"tuning.md": text}


def _run(model: Model, mission: Mission) -> MissionResult:
    return simulate(mission, as_robot(model.plant(), mission)[0])


def _followed(model: Model, steps: Steps, control: SpeedPIYawP) -> MissionResult:
    """A run on references over time."""
    far = (1e3, 0.0)
    return _run(model, Mission(goal=far, guidance=steps, control=control, timeout=steps.until + 1))


def _answer(t: np.ndarray, y: np.ndarray, target: float) -> tuple[float, float, float]:
    """Rise time [s], overshoot [%] and error at the end [%]."""
    share = y / target

    def reached(level: float) -> float:
        beyond = share >= level
        return float(t[np.argmax(beyond)]) if beyond.any() else np.nan

    over, left = max(0.0, share.max() - 1), 1 - share[-10:].mean()
    return reached(0.9) - reached(0.1), 100 * over, 100 * left


STUDIES: Sequence[tuple[str, int, Sequence[tuple[float, float]]]] = (
    ("6.12: K_p alone", 0, ((1, 0), (2, 0), (4, 0), (8, 0))),
    ("6.13: K_p with K_i = 0.5", 0, ((0.5, 0.5), (1, 0.5), (2, 0.5), (4, 0.5))),
    ("6.14: K_i with K_p = 2", 1, ((2, 0.5), (2, 1), (2, 1.85), (2, 4))),
)
"""Title, which of the two gains is varied, and the pairs (K_p, K_i)."""


def speed(model: Model) -> Study:
    """A step of the speed for gains of its controller (6.12–6.14)."""
    steps = Steps(speed=((0.0, 0.25),), until=8.0)
    panels, rows = [], []
    for title, varied, pairs in STUDIES:
        lines = []
        for kp, ki in pairs:
            control = SpeedPIYawP(kp_speed=float(kp), ki_speed=float(ki))
            log = _followed(model, steps, control).log
            name = f"{('K_p', 'K_i')[varied]} {(kp, ki)[varied]:g}"
            lines.append(Curve(name, log["t"], log["v"]))
            rise, *shares = _answer(log["t"], log["v"], 0.25)
            percents = (f"{share:.1f} %" for share in shares)
            rows.append([title[:4], f"{kp:g}", f"{ki:g}", _seconds(rise), *percents])
        reference = Curve("reference", log["t"], np.full_like(log["t"], 0.25), colour=-1)
        panels.append(panel(title, "time [s]", "V [m/s]", (*lines, reference)))
    picture = PanelPicture("Speed step to 0.25 m/s", f"plant: {called(model)}", tuple(panels))
    return Study(picture, ["figure", "K_p", "K_i", "rise [s]", "over", "left"], rows, "lrrrrr")


def _seconds(value: float) -> str:
    return "never" if np.isnan(value) else f"{value:.1f}"


def yaw(model: Model) -> Study:
    """A step of the heading and its reversal for gains of the yaw (6.15)."""
    size = np.radians(60.0)  # the reversal stays below a half turn, whose sense is open
    headings = ((0.0, 0.0), (1.0, size), (9.0, -size))
    steps = Steps(speed=((0.0, 0.1),), yaw=headings, until=20.0)
    lines, rows = [], []
    for gain in (0.2, 0.3, 0.4, 0.6, 1.0):
        log = _followed(model, steps, SpeedPIYawP(kp_yaw=gain, psi_cmd_max=1.0)).log
        t, psi = log["t"], np.degrees(np.unwrap(log["psi"]))
        lines.append(Curve(f"K_pψ {gain:g}", t, psi))
        first, second = t < 9.0, t >= 9.0
        rise, over, _ = _answer(t[first] - 1.0, psi[first], 60.0)
        beyond = max(0.0, float(np.max(-psi[second] - 60.0))) / 120
        rows.append([f"{gain:g}", _seconds(rise), f"{over:.1f} %", f"{100 * beyond:.1f} %"])
    reference = Curve("reference", t, np.degrees(log["psi_ref"]), colour=-1)
    steps_of_yaw = panel("6.15: step and reversal", "time [s]", "ψ [°]", (*lines, reference))
    picture = PanelPicture("Yaw step and reversal", "at 0.1 m/s", (steps_of_yaw,), columns=1)
    return Study(picture, ["K_pψ", "rise [s]", "over, step", "over, reversal"], rows, "rrrr")


AROUND = Mission.model_validate({"goal": (3, 0.3), "obstacles": [(1.5, 0.0)]})


def paths(model: Model) -> Study:
    """Two goals for two gains of the yaw, one with an obstacle on the way (6.16–6.19)."""
    cases = (
        ("without an obstacle", Mission(goal=(1.0, 1.0)), "6.16", "6.17"),
        ("with an obstacle", AROUND, "6.18", "6.19"),
    )
    panels, rows = [], []
    for words, mission, plane, angle in cases:
        ways, angles = [], []
        for gain in (0.3, 0.6):
            result = _run(model, mission.model_copy(update={"control": SpeedPIYawP(kp_yaw=gain)}))
            log = result.log
            ways.append(Curve(f"K_pψ {gain:g}", log["x"], log["y"]))
            angles.append(Curve(f"K_pψ {gain:g}", log["t"], np.degrees(np.unwrap(log["psi"]))))
            clear = "–" if result.min_clearance_m is None else f"{result.min_clearance_m:.2f}"
            ended = f"{result.outcome}, {result.time_s:.1f} s"
            rows.append([words, f"{gain:g}", ended, f"{result.path_length_m:.2f}", clear])
        title = f"{plane}: path {words}"
        panels.append(panel(title, "x [m]", "y [m]", ways, True, surroundings(mission)))
        panels.append(panel(f"{angle}: heading", "time [s]", "ψ [°]", tuple(angles)))
    picture = PanelPicture("Paths for two gains of the yaw", "", tuple(panels), columns=2)
    return Study(picture, ["case", "K_pψ", "outcome", "path [m]", "clear [m]"], rows, "lrlrr")


def sectors(model: Model) -> Study:
    """A goal in each of the four sectors around the start (6.21–6.24)."""
    panels = []
    for (x, y), figure in zip(SECTORS, ("6.21", "6.22", "6.23", "6.24"), strict=True):
        mission = Mission(goal=(float(x), float(y)))
        log = _run(model, mission).log
        around = surroundings(mission)
        path = Curve("path", log["x"], log["y"])
        panels.append(panel(f"{figure}: goal ({x}, {y})", "x [m]", "y [m]", (path,), True, around))
    title = "Goals in the four sectors"
    return Study(PanelPicture(title, "start in (0, 0, 0)", tuple(panels), columns=4))


def references(model: Model) -> Study:
    """Five metres straight ahead for θ of the reference of speed (6.28)."""
    panels, rows = [], []
    for theta in (1.0, 2.0, 3.0):
        field = PotentialField(theta=theta, Kg=0.3, h=1.0)
        result = _run(model, Mission(goal=(5.0, 0.0), guidance=field))
        log = result.log
        lines = (Curve("V", log["t"], log["v"]), Curve("V_d", log["t"], log["v_ref"], colour=-1))
        panels.append(panel(f"6.28: θ = {theta:g}", "time [s]", "speed [m/s]", lines))
        x, y, _ = result.final
        ended = f"{result.outcome}, {result.time_s:.1f} s"
        rows.append([f"{theta:g}", ended, f"({x:.2f}, {y:.2f})"])
    picture = PanelPicture("References of speed on a straight way", "goal (5, 0)", tuple(panels))
    return Study(picture, ["θ", "outcome", "ends at"], rows, "rll")


_RULES = {
    "ziegler-nichols": "Ziegler–Nichols",
    "cohen-coon": "Cohen–Coon",
    "lambda": "λ",
    "simc": "SIMC",
}


def _rules(model: Model) -> str:
    mission = Mission(goal=(1.0, 0.0))
    robot, _ = as_robot(model.plant(), mission)
    period, rows = mission.control.period, []
    for axis in Axis:
        seen = answer(robot, mission.vehicle.geometry, axis)
        lag, loop = lag_model(seen, period), SampledLoop.of(seen, period)
        sets = {_RULES[name]: kinds for name, kinds in from_lag(axis, lag).items()}
        edge = loop.edge()
        if edge is not None:
            sets["Ziegler–Nichols, edge of stability"] = from_edge(*edge)
        by_speed, by_yaw = {"pi": PIDTerms(2.0, 1.85)}, {"p": PIDTerms(0.4)}
        sets["the thesis"] = by_speed if axis is Axis.SPEED else by_yaw
        for rule, kinds in sets.items():
            for kind, gains in kinds.items():
                m = loop.margins(gains)
                margins = (_times(m.gain), _degrees(m.phase_deg)) if m.stable else ("unstable", "–")
                numbers = (f"{v:.3g}" if v else "–" for v in (gains.kp, gains.ki, gains.kd))
                rows.append([axis.value, rule, kind, *numbers, *margins])
    headers = ["axis", "rule", "kind", "kp", "ki", "kd", "gain margin", "phase margin"]
    return table(headers, rows, "lllrrrrr")


def _times(value: float) -> str:
    return "none needed" if np.isinf(value) else f"× {value:.2g}"


def _degrees(value: float) -> str:
    return "gain below 1" if np.isinf(value) else f"{value:.0f}°"
