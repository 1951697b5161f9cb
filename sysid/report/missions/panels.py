"""What is shown of missions: the plane, signals over time, the estimate, distributions of runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report.missions.outlines import circle, ellipse, tube
from sysid.report.movement import Mover, mover
from sysid.report.panels import Curve, Kind, Panel, Panels
from sysid.robot.mission.clearance import has_surfaces, point_clearance
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.spec import Mission
from sysid.structures.plant import Plant

if TYPE_CHECKING:  # one drive waits for no pool of many
    from sysid.robot.mission.batch.setup import Setup
    from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns

TRACKS = ("pwm_l", "pwm_r")

GREY, GREEN = -1, 2

BARS = 40
"""Of a histogram at most."""

ESTIMATES = 10
"""Instants at which the ellipse of an estimate is drawn."""


SHOWN = 100
"""Paths in a picture: enough for a fan."""


@dataclass(frozen=True, eq=False)
class ShownRuns:
    """Many runs of a mission, and the ways of some.

    Attributes:
        paths, worst: X, Y of the first runs and of the worst ones, (n, 2) each [m].
    """

    batch: "MissionRuns"
    paths: Sequence[Array]
    worst: Sequence[Array]


def shown_runs(setup: "Setup", batch: "MissionRuns") -> ShownRuns:
    """The first runs and the worst ones, which are driven again for their paths."""
    from sysid.robot.mission.monte_carlo.runs import paths_of

    usual = batch.seeds[:SHOWN]
    paths = paths_of(setup, [*usual, *(w.seed for w in batch.worst)])
    return ShownRuns(batch, paths[: len(usual)], paths[len(usual) :])


def way_panels(mission: Mission, result: MissionResult, runs: ShownRuns | None) -> Panels:
    """The plane with the tube of the runs, the clearance and the distance to the goal."""
    log, curves = result.log, surroundings(mission, result.time_s)
    note = "Grey: what must not be touched. Green: the goal with its tolerance."
    if runs is not None:
        if (outline := tube(runs.paths)) is not None:
            curves.append(through("90 % of the runs", outline, kind="area", colour=5))
            note += " The tube holds 90 % of the runs that have driven as far, across the way."
        for k, path in enumerate(runs.worst):
            curves.append(through("" if k else "worst runs", path, colour=1))
    if "x_est" in log:
        curves.append(Curve("believed", log["x_est"], log["y_est"], colour=3))
        curves += ellipses(log, colour=3)
    curves.append(Curve("path", log["x"], log["y"]))
    t = log["t"]
    gap = np.hypot(log["x"] - mission.goal[0], log["y"] - mission.goal[1])
    wide = max(
        float(np.ptp(np.concatenate(v))) for v in ([c.x for c in curves], [c.y for c in curves])
    )
    panels = [
        Panel("way", "Way", "x [m]", "y [m]", tuple(curves), equal=True, note=note, large=True,
              movers=_movers(mission, result, wide)),
        Panel("goal", "Distance to the goal", "time [s]", "[m]", (Curve("", t, gap),),
              rules=(mission.tolerance,)),
    ]  # fmt: skip
    scene = mission.scene()
    if has_surfaces(scene):
        clear = np.asarray(point_clearance(scene, log["x"], log["y"], t, np))
        panels.append(Panel("clearance", "Clearance of the centre", "time [s]", "[m]",
                            (Curve("", t, clear),), rules=(0.0,)))  # fmt: skip
    return tuple(panels)


def _movers(mission: Mission, result: MissionResult, wide: float) -> tuple[Mover, ...]:
    """The robot as an arrowhead, and the obstacles that move."""
    t, x, y, psi = (result.log[n] for n in ("t", "x", "y", "psi"))
    head = wide * np.array([[0.028, 0.0], [-0.018, 0.016], [-0.010, 0.0], [-0.018, -0.016]])
    movers = [mover(t, x, y, np.unwrap(psi), head)]
    ends = np.array([t[0], t[-1]])
    for o in mission.obstacles:
        if any(o.velocity):
            x, y = (at + v * (ends - t[0]) for at, v in zip((o.x, o.y), o.velocity, strict=True))
            movers.append(mover(ends, x, y, np.zeros(2), _round(0.0, 0.0, o.radius), GREY))
    return tuple(movers)


def surroundings(mission: Mission, seconds: float = 0.0) -> list[Curve]:
    """What a mission has in the plane, obstacles at the beginning and after some seconds."""
    curves = [through("", np.array(p), kind="area", colour=GREY) for p in mission.polygons]
    curves += [through("", np.array(wall), colour=GREY) for wall in mission.walls]
    for o in mission.obstacles:
        curves.append(disc(o.x, o.y, o.radius))
        if any(o.velocity):
            vx, vy = o.velocity
            end = _round(o.x + vx * seconds, o.y + vy * seconds, o.radius)
            curves.append(through("", end, colour=GREY))
    if mission.path:
        course = np.array((mission.start[:2], *mission.path, mission.goal))
        curves.append(through("line to follow", course, colour=1))
    if mission.waypoints:
        curves.append(through("waypoints", np.array(mission.waypoints), kind="marks", colour=1))
    return [*curves, disc(*mission.goal, mission.tolerance, GREEN)]


def disc(x: float, y: float, radius: float, colour: int = GREY) -> Curve:
    """A filled circle of the plane [m]."""
    return through("", _round(x, y, radius), kind="area", colour=colour)


def through(label: str, points: Array, kind: Kind = "line", colour: int = 0) -> Curve:
    """A curve through points, (n, 2)."""
    return Curve(label, points[:, 0], points[:, 1], kind=kind, colour=colour)


def _round(x: float, y: float, radius: float) -> Array:
    """A circle that can be seen even where it is a point."""
    return np.column_stack(circle(x, y, max(radius, 0.02)))


def ellipses(columns: Mapping[str, Array], colour: int = 0) -> list[Curve]:
    """Ellipses that hold the estimated position with 95 %, where a log has its covariance."""
    if "P_xx" not in columns:
        return []
    at = np.linspace(0, len(columns["t"]) - 1, ESTIMATES + 1).astype(int)[1:]
    centres = np.column_stack([columns["x_est"], columns["y_est"]])[at]
    covariances = np.column_stack([columns[n] for n in ("P_xx", "P_xy", "P_yy")])[at]
    outlines = [ellipse(c, p) for c, p in zip(centres, covariances, strict=True)]
    words = "95 % of its error"
    return [
        through("" if k else words, o, kind="area", colour=colour) for k, o in enumerate(outlines)
    ]


def signal_panels(result: MissionResult, plant: Plant | None) -> Panels:
    """Speed, heading and commands, each beside what was asked for or is known."""
    log = result.log
    t, heading = log["t"], np.unwrap(log["psi"])
    asked = heading + np.remainder(log["psi_ref"] - heading + np.pi, 2.0 * np.pi) - np.pi
    rules = tuple(dict.fromkeys(v for ends in plant.input_range for v in ends)) if plant else ()
    note = "Lines: the range that the plant was identified on." if rules else ""
    return (
        Panel("speed", "Speed", "time [s]", "[m/s]",
              (Curve("reference", t, log["v_ref"], colour=1), Curve("speed", t, log["v"]))),
        Panel("heading", "Heading", "time [s]", "[rad]",
              (Curve("reference", t, asked, colour=1), Curve("heading", t, heading))),
        Panel("commands", "Commands", "time [s]", "[µs]",
              tuple(Curve(n, t, log[n], kind="steps", colour=k) for k, n in enumerate(TRACKS)),
              rules=rules, note=note),
    )  # fmt: skip


def distribution_panels(batch: "MissionRuns") -> Panels:
    """Time of arrival, clearance and distance to the goal over all runs."""
    figures = (
        ("time", "Time of arrival", "s", batch.time_s),
        ("clear", "Smallest clearance", "m", batch.min_clearance_m),
        ("off", "Off the goal at the end", "m", batch.final_error_m),
    )
    return tuple(_distribution(*f) for f in figures if len(f[3]))


def _distribution(name: str, title: str, unit: str, values: Array) -> Panel:
    """A histogram, with 5 %, 50 % and 95 % in words."""
    known = values[np.isfinite(values)]
    counts, edges = np.histogram(known, bins=bar_edges(known))
    x = np.repeat(edges, 2)
    y = np.concatenate([[0.0], np.repeat(counts, 2), [0.0]]).astype(np.float64)
    low, middle, high = np.quantile(known, (0.05, 0.5, 0.95))
    note = f"Median {middle:.4g}; 90 % of the runs from {low:.4g} to {high:.4g} {unit}."
    return Panel(
        f"runs-{name}", title, f"[{unit}]", "runs", (Curve("", x, y, kind="area"),), note=note
    )


def bar_edges(values: Array) -> Array:
    """Edges of bars as wide as what the values are rounded to, or narrower than their spread."""
    known = np.unique(np.round(values, 9))
    step = float(np.min(np.diff(known), initial=np.inf))
    low, high = float(known[0]), float(known[-1])
    if len(known) == 1:
        return np.array([low - 0.5, low + 0.5])
    if (high - low) / step <= BARS:
        return np.arange(low - 0.5 * step, high + step, step)
    return np.linspace(low, high, BARS + 1)


def share_panels(batch: "MissionRuns") -> Panels:
    """What the variance of time and of the distance to the goal comes from; none of few runs."""
    rest = "noise, and interactions" if "noise" in batch.vary else "interactions"
    panels = []
    for title, shares in (
        ("Variance of the time of arrival", batch.time_drivers),
        ("Variance of the distance to the goal at the end", batch.error_drivers),
    ):
        if shares is not None:
            ranked: Sequence[tuple[str, float]] = [
                *((d.name, d.share_of_variance) for d in shares.ranked),
                (rest, shares.remainder),
            ]
            names, values = zip(*ranked, strict=True)
            bar = Curve("", np.arange(float(len(names))), 100.0 * np.array(values), kind="stems")
            name = title.replace(" ", "-")
            panels.append(Panel(name, title, "share [%]", "", (bar,), names=names))
    return tuple(panels)
