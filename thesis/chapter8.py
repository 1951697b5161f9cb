"""Chapter 8: both missions with the model, in Gazebo's place, and with the robot."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import sysid_datasets

from sysid.data.record import Array
from sysid.report.missions.panels import GREEN, disc
from sysid.report.panels import Curve, Panel, PanelPicture, panel
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.spec import Mission, load_mission
from thesis.entries import DRAWN, Row, Sheet, compared, line, number, place, verdict
from thesis.plants import gazebo, gazebo_by_forces, robot, simulink

FIRST, SECOND = (load_mission(sysid_datasets.path(name)) for name in ("goal_1m", "obstacles_6_3"))

REAL = Mission.model_validate(
    {
        "goal": FIRST.goal,
        "control": {"kp_yaw": 0.3},
        "navigation": {"kind": "ekf"},
        "sensors": {
            kind: {} for kind in ("encoders", "accelerometer", "magnetometer", "visual_odometry")
        },
    }
)
"""Mission 1 as the robot drove it: its gain, and the four sensors that its filter fuses (7.4.1)."""

DRIVES = 20
"""Draws of the sensors' noise: enough to tell the spread of the end to a sixth of it."""

MODEL = "the twin's tracks are ours; the thesis's logs and its model's numbers are not printed"
FORCES = (
    "planar dynamics with Gazebo's printed 1.5 kg and friction 0.1, and the motors of the bench"
)
IDEAL = "a twin with equal tracks stands for Gazebo's model; its contact is not printed"
SENSORS = (
    "a run that ends within 0.10 m of the goal ends before X = 1: the robot rolled on, or its "
    "estimate jumped (“optimization still in progress”); its log is not printed"
)
JAGGED = "the thesis's model jumps at small commands; ours errs there, too (§5.5), but smoothly"

IDENTICAL = 200.0
"""Commands closer than this look identical in a figure: a hundredth of full drive [µs]."""

FAITHFUL, V_MAX = 0.1, 0.3
"""A mean error below this share of the largest reference [m/s] is following it faithfully."""

PLACES = "the field is steep where two obstacles act: a few centimetres of way change the end"


@cache
def drives() -> tuple[MissionResult, ...]:
    """Mission 1 with the twin and its sensors, once a seed."""
    return tuple(robot(REAL, seed) for seed in range(DRIVES))


def influence(result: MissionResult, mission: Mission) -> list[tuple[float, int]]:
    """When the robot comes into the reach of each obstacle's field [s], and which one, from 1."""
    log, found = result.log, []
    for k, o in enumerate(mission.obstacles, start=1):
        inside = np.hypot(log["x"] - o.x, log["y"] - o.y) <= mission.guidance.reach
        if inside.any():
            found.append((float(log["t"][np.argmax(inside)]), k))
    return sorted(found)


def around(mission: Mission) -> list[Curve]:
    """Where the obstacles' fields act, obstacles and goal; else where the goal counts as reached.

    Where there are obstacles both axes have one scale.
    """
    if not mission.obstacles:
        return [disc(*mission.goal, mission.tolerance, GREEN)]
    reaches = [disc(o.x, o.y, mission.guidance.reach, 0) for o in mission.obstacles]
    obstacles = [disc(o.x, o.y, o.radius) for o in mission.obstacles]
    return [*reaches, disc(*mission.goal, mission.tolerance, GREEN), *obstacles]


def panels(
    result: MissionResult, mission: Mission, figures: Sequence[str], commands: bool
) -> tuple[Panel, ...]:
    """Path, position, heading, speed and references as chapter 8 draws them."""
    log = result.log
    t, degrees = log["t"], np.degrees
    path, where, heading, speed, references = figures
    found = [
        panel(f"{path}: path", "X [m]", "Y [m]", (line("path", log["x"], log["y"]),),
              bool(mission.obstacles), around(mission)),
        panel(f"{where}: position", "time [s]", "[m]",
              (line("X", t, log["x"]), line("Y", t, log["y"]))),
        panel(f"{heading}: heading and yaw rate", "time [s]", "ψ [°], ψ̇ [°/s]",
              (line("ψ̇", t, degrees(log["yaw_rate"])),
               line("ψ", t, degrees(np.unwrap(log["psi"]))))),
        panel(f"{speed}: speed", "time [s]", "V [m/s]",
              (line("V", t, log["v"]), line("V_d", t, log["v_ref"], True))),
        panel(f"{references}: references", "time [s]", "V_d [m/s], ψ_d [rad]",
              (line("V_d", t, log["v_ref"]), line("ψ_d", t, np.unwrap(log["psi_ref"])))),
    ]  # fmt: skip
    if commands:
        pwm = (line("left", t, log["pwm_l"] / 1e3), line("right", t, log["pwm_r"] / 1e3))
        found.insert(4, panel(f"{speed}: commands", "time [s]", "PWM [10³ µs]", pwm))
    return tuple(found)


def picture(
    title: str, result: MissionResult, mission: Mission, figures: Sequence[str], commands: bool
) -> PanelPicture:
    """The panels of one run."""
    x, y, _ = result.final
    words = f"{result.outcome} after {result.time_s:.1f} s at {place(x, y)}"
    return PanelPicture(title, words, panels(result, mission, figures, commands))


def first_simulink() -> Sheet:
    """8.1–8.5."""
    result = simulink(FIRST)
    log = result.log
    peak = float(log["t"][np.argmax(log["y"])])
    apart = np.abs(log["pwm_r"] - log["pwm_l"])
    early = float(apart[log["t"] < 1.0].max())
    rows = (
        compared("8.1", "largest distance from the line [m]", 0.04, result.max_deviation_m, ".2f",
                 MODEL),
        compared("8.1", "time [s]", 4.9, result.time_s, ".1f",
                 f"at the reference itself the way takes {least_time(FIRST):.1f} s; the rest is "
                 "the lag of the speed, and the thesis's robot gained it faster"),
        compared("8.2", "X at the end [m]", 0.91, result.final.x, ".2f", MODEL),
        compared("8.2", "Y at the end [m]", 0.028, result.final.y, ".3f", MODEL),
        compared("8.2", "time of the largest Y [s]", 4.0, peak, ".1f",
                 "“approximately”; the maximum is flat"),
        Row("8.3", "yaw rate after the error grows [°/s]", "slightly negative",
            f"down to {number(float(np.degrees(log['yaw_rate'].min())), '.0f')}",
            verdict(log["yaw_rate"].min() < 0), MODEL),
        Row("8.4", "commands of both tracks in the first seconds", "identical",
            f"up to {number(early, '.0f')} µs apart in the first second, "
            f"{number(float(apart.max()), '.0f')} in all",
            verdict(early < IDENTICAL),
            "the twin's tracks differ by 16 % at once, so the yaw answers"),
        Row("8.4", "jagged speed where PWM is below 5000 µs", "yes", _weak(result),
            verdict(_reversals(result) > 1), JAGGED),
        Row("8.5", "reference of the heading in the first seconds", "that of the robot, 0°",
            f"{number(float(np.degrees(np.abs(log['psi_ref'][log['t'] < 1])).max()), '.1f')}° "
            "in the first second", verdict(np.abs(log["psi_ref"][log["t"] < 1]).max() < 0.02),
            MODEL),
    )  # fmt: skip
    figures = ("8.1", "8.2", "8.3", "8.4", "8.5")
    return Sheet(
        rows,
        "chapter8/mission1_model.svg",
        picture("Mission 1 with the identified model", result, FIRST, figures, True),
    )


def second_simulink() -> Sheet:
    """8.6–8.10."""
    result = simulink(SECOND)
    log, (x, y, _) = result.log, result.final
    met = influence(result, SECOND)
    rows = (
        Row("8.6", "obstacles that act", "3 and 4; 1 and 2 not", _met(met),
            verdict({k for _, k in met} == {3, 4}), MODEL),
        compared("8.6", "first obstacle acts after [s]", 15.0, met[0][0], ".0f",
                 "“about”"),
        compared("8.7", "time [s]", 34.1, result.time_s, ".1f", PLACES),
        Row("8.7", "end [m]", "(5.97, 2.90)", place(x, y),
            f"{number(float(np.hypot(x - 5.97, y - 2.90)), '.2f')} m", PLACES),
        Row("8.8", "heading follows its reference", "less rapidly than the speed",
            f"mean error {number(_mean_angle(result), '.1f')}°", verdict(_mean_angle(result) > 5.0),
            MODEL),
        _faithful("8.9", result, MODEL),
        Row("8.9", "“lively” speed at the end, where PWM is below 5000 µs", "yes", _weak(result),
            verdict(_reversals(result) > 1), JAGGED),
        compared("8.10", "reference of the heading at the start [°]", 27.0,
                 float(np.degrees(log["psi_ref"][0])), ".0f", "atan2(3, 6) = 26.6°"),
    )  # fmt: skip
    figures = ("8.6", "8.7", "8.8", "8.9", "8.10")
    return Sheet(
        rows,
        "chapter8/mission2_model.svg",
        picture("Mission 2 with the identified model", result, SECOND, figures, True),
    )


def least_time(mission: Mission) -> float:
    """Time of a straight way without obstacles at the reference of speed itself [s]."""
    way = float(np.hypot(*mission.goal))
    x = np.linspace(0.0, way - mission.tolerance, 2001)
    speed = mission.guidance.speed(x, 0.0 * x, (way, 0.0), ())
    return float(np.trapezoid(1.0 / speed, x))


def _weak(result: MissionResult) -> str:
    """How often the speed turns near the end, and for which part of a drive a command is small."""
    log = result.log
    small = np.minimum(np.abs(log["pwm_l"]), np.abs(log["pwm_r"]))[:-1] < 5000
    share = number(100 * float(small.mean()), ".0f")
    return (
        f"{_reversals(result)} turns of the speed in the last 2 s; below in {share} % of the time"
    )


def _reversals(result: MissionResult) -> int:
    """How often the speed turns from rising to falling or back in the last two seconds."""
    log = result.log
    rising = np.sign(np.diff(log["v"][log["t"] > log["t"][-1] - 2.0]))
    return int(np.count_nonzero(np.diff(rising[rising != 0])))


def _faithful(figure: str, result: MissionResult, why: str) -> Row:
    """How closely the speed follows its reference, once it has been gained."""
    log = result.log
    error = float(np.abs(log["v"] - log["v_ref"])[log["t"] > 2.0].mean())
    return Row(figure, "speed follows its reference", "faithfully",
               f"mean error {number(1e3 * error, '.0f')} mm/s after 2 s",
               verdict(error < FAITHFUL * V_MAX), why)  # fmt: skip


def _met(met: Sequence[tuple[float, int]]) -> str:
    return ", ".join(f"{k} at {t:.1f} s" for t, k in met)


def _mean_angle(result: MissionResult) -> float:
    """Mean size of the error of the heading [°]."""
    error = result.log["psi_ref"] - result.log["psi"]
    return float(np.degrees(np.abs(np.arctan2(np.sin(error), np.cos(error))).mean()))


def first_gazebo() -> Sheet:
    """8.12–8.16."""
    result, forces = gazebo(FIRST), gazebo_by_forces(FIRST)
    log = result.log
    rows = (
        Row("8.12", "path", "straight", f"{number(result.max_deviation_m, '.3f')} m off the line",
            verdict(result.max_deviation_m < 0.005), "equal tracks"),
        compared("8.12", "time [s]", 5.0, result.time_s, ".1f", "“about”; " + IDEAL),
        compared("8.12", "time by forces [s]", 5.0, forces.time_s, ".1f", "“about”; " + FORCES),
        compared("8.13", "X at the end by forces [m]", 0.93, forces.final.x, ".2f", FORCES),
        compared("8.13", "X at the end [m]", 0.93, result.final.x, ".2f",
                 "the run ends at the first sample within 0.10 m; Gazebo's rolled on a little"),
        compared("8.13", "Y at the end [m]", 0.0, result.final.y, ".2f"),
        Row("8.14", "heading", DRAWN, f"{number(float(np.degrees(log['psi'][-1])), '.1f')}°", "–",
            "equal tracks"),
        Row("8.15", "a small impulse near the goal", "yes", _weak(result),
            verdict(_reversals(result) > 1), "Gazebo's contact, whose solver we do not have"),
        _faithful("8.16", result, IDEAL),
    )  # fmt: skip
    figures = ("8.12", "8.13", "8.14", "8.15", "8.16")
    return Sheet(
        rows,
        "chapter8/mission1_equal_tracks.svg",
        picture("Mission 1 with equal tracks, in Gazebo's place", result, FIRST, figures, False),
    )


def second_gazebo() -> Sheet:
    """8.18–8.22."""
    result, forces = gazebo(SECOND), gazebo_by_forces(SECOND)
    log, (x, y, _), (x_f, y_f, _) = result.log, result.final, forces.final
    met = influence(result, SECOND)
    rows = (
        Row("8.18", "obstacles that act", "2, then the following ones", _met(met),
            verdict(met[0][1] == 2 and len(met) > 1), IDEAL),
        compared("8.19", "time [s]", 34.0, result.time_s, ".1f", PLACES),
        Row("8.19", "end [m]", "(5.94, 2.95)", place(x, y),
            f"{number(float(np.hypot(x - 5.94, y - 2.95)), '.2f')} m", PLACES),
        compared("8.19", "time by forces [s]", 34.0, forces.time_s, ".1f", FORCES),
        Row("8.19", "end by forces [m]", "(5.94, 2.95)", place(x_f, y_f),
            f"{number(float(np.hypot(x_f - 5.94, y_f - 2.95)), '.2f')} m", FORCES),
        Row("8.20", "heading follows its reference", DRAWN,
            f"mean error {number(_mean_angle(result), '.1f')}°", "–", IDEAL),
        Row("8.21", "smallest speed before the end [m/s]", DRAWN,
            number(float(log["v"][50:-20].min()), ".2f"), "–", IDEAL),
        Row("8.22", "reference of the heading where obstacle 2 acts", "rises by about 30°",
            f"rises by {number(_rise(result, met), '.0f')}°",
            verdict(15.0 < _rise(result, met) < 45.0),
            "depends on how closely the path passes the obstacle"),
    )  # fmt: skip
    figures = ("8.18", "8.19", "8.20", "8.21", "8.22")
    return Sheet(
        rows,
        "chapter8/mission2_equal_tracks.svg",
        picture("Mission 2 with equal tracks, in Gazebo's place", result, SECOND, figures, False),
    )


def _rise(result: MissionResult, met: Sequence[tuple[float, int]]) -> float:
    """How far the reference of the heading rises within 4 s of the first influence [°]."""
    log, start = result.log, met[0][0]
    before = int(np.searchsorted(log["t"], start)) - 1
    after = (log["t"] >= start) & (log["t"] <= start + 4.0)
    return float(np.degrees(log["psi_ref"][after].max() - log["psi_ref"][before]))


def real_robot() -> Sheet:
    """8.23–8.25."""
    runs = drives()
    believed = np.array([[r.log["x_est"][-1], r.log["y_est"][-1]] for r in runs])
    times = np.array([r.time_s for r in runs])
    truly = np.array([[r.final.x, r.final.y] for r in runs])
    log = runs[0].log
    t = log["t"]
    rows = (
        Row("8.23", "end as the filter believes it [m]", "(1.03, 0.07)",
            f"{place(*believed.mean(axis=0))} ± {place(*believed.std(axis=0, ddof=1))}",
            place(*(believed.mean(axis=0) - (1.03, 0.07))), SENSORS),
        Row("8.23", "true end [m]", "not measured", place(*truly.mean(axis=0)), "–",
            f"{DRIVES} draws of the sensors' noise"),
        compared("8.24", "time [s]", 5.0, float(times.mean()), ".1f", "“about”"),
        Row("8.25", "heading at the end [°]", DRAWN,
            number(float(np.degrees(np.mean([r.final.psi for r in runs]))), ".0f"), "–",
            "K_pψ 0.3 lets the stronger track turn the robot longer than 0.4"),
    )  # fmt: skip
    found = (
        panel("8.23: path", "X [m]", "Y [m]",
              (line("believed", log["x_est"], log["y_est"]),
               line("true", log["x"], log["y"], True)),
              around=around(REAL)),
        panel("8.24: position", "time [s]", "[m]",
              (line("X believed", t, log["x_est"]), line("Y believed", t, log["y_est"]))),
        panel("8.25: heading", "time [s]", "ψ [°]",
              (line("believed", t, np.degrees(log["psi_est"])),
               line("true", t, np.degrees(log["psi"]), True))),
    )  # fmt: skip
    words = "the twin with encoders, accelerometer, magnetometer and visual odometry, one draw"
    return Sheet(
        rows,
        "chapter8/mission1_robot.svg",
        PanelPicture("Mission 1 with the robot's sensors and filter", words, found),
    )


def comparisons() -> Sheet:
    """8.26–8.30."""
    one, two = simulink(FIRST), gazebo(FIRST)
    three, four = simulink(SECOND), gazebo(SECOND)
    real, a, b = drives()[0].log, three.log, four.log
    shared = min(len(one.log["t"]), len(real["t"]))
    apart = float(np.abs(one.log["x"][:shared] - real["x_est"][:shared]).max())
    n = min(len(a["t"]), len(b["t"]))
    same = _apart_from(a["v_ref"][:n], b["v_ref"][:n], 0.01)
    turn = _apart_from(a["psi_ref"][:n], b["psi_ref"][:n], np.radians(5.0))
    times = {k: t for t, k in influence(four, SECOND)}
    model = {k: t for t, k in influence(three, SECOND)}
    ends = float(np.hypot(three.final.x - four.final.x, three.final.y - four.final.y))
    rows = (
        Row("8.26", "which paths lead to the left", "Simulink and robot, not Gazebo",
            f"{number(one.final.y, '.3f')}, {number(drives()[0].final.y, '.3f')} and "
            f"{number(two.final.y, '.3f')} m",
            verdict(min(one.final.y, drives()[0].final.y) > 0.01 > abs(two.final.y)),
            "the tracks' asymmetry"),
        Row("8.27", "X of model and robot", "very close",
            f"at most {number(100 * apart, '.0f')} cm apart", verdict(apart < 0.05), MODEL),
        compared("8.28", "ends apart [m]", float(np.hypot(5.97 - 5.94, 2.90 - 2.95)), ends, ".2f",
                 PLACES),
        compared("8.29", "references of speed identical for [s]", 6.0, float(a["t"][same]), ".1f",
                 f"until obstacle 2 acts: the straight way comes within 0.7 m of it after "
                 f"{_until_reach(SECOND, 1):.1f} m, which takes 9 s at 0.28 m/s"),
        compared("8.29", "Gazebo: next obstacle acts after [s]", 17.0, times[3], ".0f", IDEAL),
        compared("8.29", "Gazebo: the last one after [s]", 26.0, times[4], ".0f", IDEAL),
        compared("8.29", "Simulink: its second one after [s]", 27.0, model[4], ".0f", MODEL),
        compared("8.30", "references of heading within 5° for [s]", 6.0, float(a["t"][turn]), ".1f",
                 "as the speed"),
        compared("8.30", "reference of the heading in this time [°]", 27.0,
                 float(np.degrees(a["psi_ref"][: same].mean())), ".0f", MODEL),
    )  # fmt: skip
    found = (
        panel("8.26: mission 1", "X [m]", "Y [m]",
              (line("model", one.log["x"], one.log["y"]),
               line("equal tracks", two.log["x"], two.log["y"]),
               line("by forces", *_path(gazebo_by_forces(FIRST))),
               line("robot, believed", real["x_est"], real["y_est"])), around=around(FIRST)),
        panel("8.27: X", "time [s]", "X [m]",
              (line("model", one.log["t"], one.log["x"]),
               line("robot, believed", real["t"], real["x_est"]))),
        panel("8.28: mission 2", "X [m]", "Y [m]",
              (line("model", a["x"], a["y"]), line("equal tracks", b["x"], b["y"]),
               line("by forces", *_path(gazebo_by_forces(SECOND)))), True, around(SECOND)),
        panel("8.29: reference of speed", "time [s]", "V_d [m/s]",
              (line("model", a["t"], a["v_ref"]), line("equal tracks", b["t"], b["v_ref"]))),
        panel("8.30: reference of heading", "time [s]", "ψ_d [°]",
              (line("model", a["t"], np.degrees(a["psi_ref"])),
               line("equal tracks", b["t"], np.degrees(b["psi_ref"])))),
    )  # fmt: skip
    return Sheet(
        rows,
        "chapter8/comparisons.svg",
        PanelPicture("The robots side by side", "", found),
    )


def _path(result: MissionResult) -> tuple[Array, Array]:
    return result.log["x"], result.log["y"]


def _until_reach(mission: Mission, k: int) -> float:
    """Way along the straight line to the goal until an obstacle's field acts [m]."""
    o, (gx, gy) = mission.obstacles[k], mission.goal
    along = (o.x * gx + o.y * gy) / np.hypot(gx, gy)
    aside = (o.y * gx - o.x * gy) / np.hypot(gx, gy)
    return float(along - np.sqrt(mission.guidance.reach**2 - aside**2))


def _apart_from(a: Array, b: Array, limit: float) -> int:
    """The first sample at which two signals are further apart than a limit."""
    return int(np.argmax(np.abs(a - b) > limit))


SHEETS = (
    first_simulink,
    second_simulink,
    first_gazebo,
    second_gazebo,
    real_robot,
    comparisons,
)
