"""Pictures of missions from their results: one drive, many runs, a fan, a plan, a path."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from sysid.data.record import Array
from sysid.report.fan_drawing import FanPanel, FanPicture
from sysid.report.mission_drawing import MissionPicture
from sysid.report.missions.localization_drawing import PoseEstimate, ellipse
from sysid.report.missions.plan_drawing import CurvePanel, PlanPicture
from sysid.report.missions.response_drawing import Line, Panel, ResponsePicture
from sysid.report.missions.runs_drawing import RunsPicture
from sysid.report.missions.shown import ShownRuns, scene_of
from sysid.report.plots import write_picture
from sysid.robot.mission.localize import Localization
from sysid.robot.mission.measured.fan import QUANTITIES, UNITS, Comparison
from sysid.robot.mission.plan import Curves, Plan
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.spec import Mission


def draw_mission(path: Path, name: str, mission: Mission, result: MissionResult) -> None:
    """Draw the path among the obstacles with its references and commands."""
    log = result.log
    pose = np.column_stack([log["x"], log["y"], log["psi"]])
    picture = replace(
        drive_picture(mission, name, log["t"], pose, log["v"]),
        outcome=result.outcome.value,
        pwm=np.column_stack([log["pwm_l"], log["pwm_r"]]),
        speed_reference=log["v_ref"],
        heading_reference=log["psi_ref"],
        min_clearance=result.min_clearance_m,
        estimate=_estimate(log),
    )
    write_picture(path, picture)


def drive_picture(
    mission: Mission, name: str, t: Array, pose: Array, speed: Array
) -> MissionPicture:
    """A drive (t [s], x, y [m], ψ [rad], speed [m/s]) among what its mission has in the plane."""
    scene = scene_of(mission, float(t[-1]))
    return MissionPicture(name, "", t, pose, speed, np.zeros((len(t), 2)), scene)


def _estimate(log: Mapping[str, Array]) -> PoseEstimate | None:
    """What navigation believed, where it is in the log."""
    shown = ("x_est", "y_est", "P_xx", "P_xy", "P_yy")
    if not all(name in log for name in shown):
        return None
    columns = np.column_stack([log[name] for name in shown])
    return PoseEstimate(columns[:, :2], columns[:, 2:])


def draw_measured(path: Path, name: str, mission: Mission, comparison: Comparison) -> None:
    """Draw the fan with the measured path over it."""
    fan, reach = comparison.fan, comparison.fan.limit * comparison.fan.scale
    turns = 2.0 * np.pi * np.round((comparison.values[:, 2] - fan.middle[:, 2]) / (2.0 * np.pi))
    measured = comparison.values - np.array([0.0, 0.0, 1.0, 0.0]) * turns[:, None]
    # a fan is narrow beside the way itself: poses are drawn from its middle
    zero = fan.middle * np.array([1.0, 1.0, 1.0, 0.0])
    panels = tuple(
        FanPanel(
            f"{words}{' − median' * (k < 3)} [{UNITS[k]}]",
            (fan.low - zero)[:, k],
            (fan.high - zero)[:, k],
            (fan.middle - zero - reach)[:, k],
            (fan.middle - zero + reach)[:, k],
            (measured - zero)[:, k],
        )
        for k, words in enumerate(("x", "y", "heading", "speed"))
    )
    head = (
        "stays inside" if comparison.leaves is None else f"leaves at {comparison.leaves_at_s:.1f} s"
    )
    drive = drive_picture(
        mission,
        name,
        fan.t,
        comparison.values[:, :3],
        comparison.values[:, QUANTITIES.index("speed")],
    )
    facts = f"{fan.runs} runs of {name}; measured: {comparison.name}"
    tail = "the fan of its runs" if comparison.leaves is None else ""
    title = f"{comparison.name} {head} {tail}".strip()
    write_picture(path, FanPicture(drive, fan.ways, fan.t, panels, comparison.leaves, title, facts))


def draw_runs(plot: Path, name: str, mission: Mission, runs: ShownRuns) -> None:
    """Draw the paths of some runs over the distributions of all."""
    batch, shares = runs.batch, runs.batch.time_drivers
    write_picture(
        plot,
        RunsPicture(
            title=f"{name}: {batch.n} runs",
            subtitle=batch.sentence,
            paths=tuple(runs.paths),
            worst=tuple(runs.worst),
            scene=replace(scene_of(mission), influence=0.0),
            times=batch.time_s,
            clearances=batch.min_clearance_m,
            drivers=tuple((d.name, d.share_of_variance) for d in shares.ranked) if shares else (),
        ),
    )


def draw_localization(path: Path, name: str, localization: Localization) -> None:
    """The estimated path with ellipses of 95 %, and the errors beside what the filter believes."""
    c, pose = localization.columns, localization.log.pose
    lines = [Line("estimate", c["x_est"], c["y_est"])]
    if pose is not None:
        lines.append(Line("true", pose[:, 0], pose[:, 1], reference=True))
    panels = [Panel("path", "x [m]", "y [m]", tuple(lines), plane=True, outlines=_ellipses(c))]
    position: list[Line] = []
    heading: list[Line] = []
    if pose is not None:
        away = np.hypot(c["x_est"] - pose[:, 0], c["y_est"] - pose[:, 1])
        turned = c["psi_est"] - pose[:, 2]
        position.append(Line("error", c["t"], away))
        heading.append(Line("error", c["t"], np.abs(np.arctan2(np.sin(turned), np.cos(turned)))))
    if "P_xx" in c:
        position.append(Line("believed, 1 σ", c["t"], np.sqrt(c["P_xx"] + c["P_yy"])))
        heading.append(Line("believed, 1 σ", c["t"], np.sqrt(c["P_psi"])))
    if position:
        panels.append(Panel("error of the position", "time [s]", "[m]", tuple(position)))
        panels.append(Panel("error of the heading", "time [s]", "[rad]", tuple(heading)))
    title = f"{name}: estimated path"
    write_picture(path, ResponsePicture(title, ", ".join(localization.used), tuple(panels)))


def _ellipses(columns: Mapping[str, Array]) -> tuple[tuple[Array, Array], ...]:
    """Ellipses that hold the position with 95 %, at ten instants."""
    if "P_xx" not in columns:
        return ()
    at = np.linspace(0, len(columns["t"]) - 1, 11).astype(int)[1:]
    centres = np.column_stack([columns["x_est"], columns["y_est"]])[at]
    covariances = np.column_stack([columns[n] for n in ("P_xx", "P_xy", "P_yy")])[at]
    outlines = (ellipse(c, p, 49) for c, p in zip(centres, covariances, strict=True))
    return tuple((x, y) for x, y in outlines)


def draw_plan(path: Path, name: str, mission: Mission, route: Plan) -> None:
    """Draw the way of the references, the field they follow, and what the laws give."""

    def panel(title: str, across: str, up: str, curves: Curves) -> CurvePanel:
        return CurvePanel(
            title, across, up, curves.gain, curves.values, curves.distance, curves.quantity
        )

    panels = [
        panel(f"{what} of {whom}", f"distance to {whom} [m]", "force", curves)
        for what, whom, curves in (
            ("attraction", "the goal", route.attraction),
            ("repulsion", "an obstacle's point", route.repulsion),
        )
        if curves is not None
    ]
    panels += [
        panel(f"speed reference for {c.gain}", "distance to the goal [m]", "speed [m/s]", c)
        for c in route.speeds
    ]
    facts = [f"{route.length_m:.2f} m of way"]
    if route.time_s is not None:
        facts.append(f"{route.time_s:.1f} s at the references")
    if route.min_clearance_m is not None:
        facts.append(f"{route.min_clearance_m:.2f} m clear of the nearest obstacle")
    scene = mission.scene()
    picture = PlanPicture(
        title=f"{name}: the references {'lead to the goal' if route.arrives else 'end elsewhere'}",
        subtitle=", ".join(facts),
        x=route.x,
        y=route.y,
        psi=route.psi,
        potential=route.potential,
        way=route.way,
        goal=mission.goal,
        tolerance=mission.tolerance,
        discs=tuple((o.x, o.y, o.radius) for o in scene.obstacles),
        walls=tuple((*a, *b) for w in scene.walls for a, b in pairwise(w.points)),
        ends=route.ends,
        panels=tuple(panels),
    )
    write_picture(path, picture)
