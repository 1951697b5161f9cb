"""Pictures of missions from their results: one drive, many runs, a fan, a plan, a path."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from sysid.report.missions.outlines import tube
from sysid.report.missions.page import headline
from sysid.report.missions.panels import (
    ShownRuns,
    distribution_panels,
    ellipses,
    share_panels,
    signal_panels,
    surroundings,
    through,
    way_panels,
)
from sysid.report.missions.plan_drawing import PlanPicture
from sysid.report.panels import Curve, Panel, draw_panels, panel
from sysid.report.plots import write_picture
from sysid.robot.mission.localize import Localization
from sysid.robot.mission.measured.fan import UNITS, Comparison
from sysid.robot.mission.plan import Curves, Plan
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.spec import Mission

MEASURED, WHOLE_WAY = -1, 4
"""Colours."""


def draw_mission(path: Path, name: str, mission: Mission, result: MissionResult) -> None:
    """Draw the path among the obstacles with its references and commands."""
    panels = (*way_panels(mission, result, None), *signal_panels(result, None))
    draw_panels(path, headline(name, result), result.sentence, panels)


def draw_runs(
    path: Path, name: str, mission: Mission, result: MissionResult, runs: ShownRuns
) -> None:
    """Draw the tube of the runs and the worst ones, the distributions, and what matters."""
    way, batch = way_panels(mission, result, runs)[0], runs.batch
    panels = (way, *distribution_panels(batch), *share_panels(batch))
    draw_panels(path, f"{name}: {batch.n} runs", batch.sentence, panels)


def draw_measured(path: Path, name: str, mission: Mission, comparison: Comparison) -> None:
    """Draw the fan with the measured path over it."""
    fan, reach = comparison.fan, comparison.fan.limit * comparison.fan.scale
    turns = 2.0 * np.pi * np.round((comparison.values[:, 2] - fan.middle[:, 2]) / (2.0 * np.pi))
    measured = comparison.values - np.array([0.0, 0.0, 1.0, 0.0]) * turns[:, None]
    curves = surroundings(mission, float(fan.t[-1]))
    if (outline := tube([*fan.ways])) is not None:
        curves.append(through("90 % of the runs", outline, kind="area"))
    curves.append(through("measured", comparison.values[:, :2], colour=1))
    if comparison.leaves is not None:
        words = f"leaves at {comparison.leaves_at_s:.1f} s"
        at = comparison.values[[comparison.leaves], :2]
        curves.append(through(words, at, kind="marks", colour=5))
    panels = [Panel("way", "Way", "x [m]", "y [m]", tuple(curves), equal=True, large=True)]
    # a fan is narrow beside the way itself: poses are drawn from its middle
    zero = fan.middle * np.array([1.0, 1.0, 1.0, 0.0])
    for k, words in enumerate(("x", "y", "heading", "speed")):
        middle = (fan.middle - zero)[:, k]
        panels.append(
            Panel(
                f"fan-{words}",
                f"{words}{' − median' * (k < 3)}",
                "time [s]",
                f"[{UNITS[k]}]",
                (
                    Curve("95 %, all the way", fan.t, middle, middle - reach[:, k],
                          middle + reach[:, k], colour=WHOLE_WAY),
                    Curve("90 %", fan.t, middle, (fan.low - zero)[:, k], (fan.high - zero)[:, k]),
                    Curve("measured", fan.t, (measured - zero)[:, k], colour=MEASURED),
                ),
            )
        )  # fmt: skip
    head = (
        "stays inside the fan of its runs"
        if comparison.leaves is None
        else f"leaves at {comparison.leaves_at_s:.1f} s"
    )
    facts = f"{fan.runs} runs of {name}; measured: {comparison.name}"
    draw_panels(path, f"{comparison.name} {head}", facts, tuple(panels))


def draw_localization(path: Path, name: str, localization: Localization) -> None:
    """The estimated path with ellipses of 95 %, and the errors beside what the filter believes."""
    c, pose = localization.columns, localization.log.pose
    lines = [*ellipses(c), Curve("estimate", c["x_est"], c["y_est"])]
    position: list[Curve] = []
    heading: list[Curve] = []
    if pose is not None:
        lines.append(through("true", pose, colour=MEASURED))
        away = np.hypot(c["x_est"] - pose[:, 0], c["y_est"] - pose[:, 1])
        turned = c["psi_est"] - pose[:, 2]
        position.append(Curve("error", c["t"], away))
        heading.append(Curve("error", c["t"], np.abs(np.arctan2(np.sin(turned), np.cos(turned)))))
    if "P_xx" in c:
        position.append(Curve("believed, 1 σ", c["t"], np.sqrt(c["P_xx"] + c["P_yy"]), colour=1))
        heading.append(Curve("believed, 1 σ", c["t"], np.sqrt(c["P_psi"]), colour=1))
    panels = [Panel("path", "Path", "x [m]", "y [m]", tuple(lines), equal=True, large=True)]
    for word, curves, unit in (("position", position, "m"), ("heading", heading, "rad")):
        if curves:
            title = f"Error of the {word}"
            panels.append(Panel(word, title, "time [s]", f"[{unit}]", tuple(curves)))
    used = ", ".join(localization.used)
    draw_panels(path, f"{name}: estimated path", used, tuple(panels))


def draw_plan(path: Path, name: str, mission: Mission, route: Plan) -> None:
    """Draw the way of the references, the field they follow, and what the laws give."""

    def by_gain(title: str, across: str, up: str, of: Curves) -> Panel:
        """The quantity for each value of a gain; the mission's is the middle one."""
        lines = [
            Curve(f"{of.gain} {value:.3g}", of.distance, quantity)
            for value, quantity in zip(of.values, of.quantity, strict=True)
        ]
        return panel(title, across, up, lines)

    panels = [
        by_gain(f"{what} of {whom}", f"distance to {whom} [m]", "force", curves)
        for what, whom, curves in (
            ("attraction", "the goal", route.attraction),
            ("repulsion", "an obstacle's point", route.repulsion),
        )
        if curves is not None
    ]
    panels += [
        by_gain(f"speed reference for {c.gain}", "distance to the goal [m]", "speed [m/s]", c)
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
