"""The page of a mission: how it ends and how surely, the way, and whether the model knows it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.plant.replay import outside_range
from sysid.report.missions.runs_drawing import bar_edges
from sysid.report.missions.scene import circle
from sysid.report.missions.shown import ShownRuns, scene_of
from sysid.report.missions.tube import tube
from sysid.report.movement import Mover, mover
from sysid.report.page import Check, Page, Section
from sysid.report.panels import Curve, Kind, Panel
from sysid.robot.mission.clearance import has_surfaces, point_clearance
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.spec import Mission
from sysid.structures.plant import Plant

TRACKS = ("pwm_l", "pwm_r")

FULL = 0.999 * PWM_FULL_SCALE
"""A command from which on the drive gives all it has [µs]."""

GREY, GREEN = -1, 2


def mission_page(
    name: str,
    mission: Mission,
    result: MissionResult,
    plant: Plant | None = None,
    runs: ShownRuns | None = None,
    *,
    warnings: Sequence[str] = (),
    commands: Sequence[str] = (),
) -> Page:
    """The page of one nominal drive and, where there are any, of the runs around it.

    Args:
        plant: what drove, for the range that it was identified on.
        warnings: what to know before believing it.
        commands: what makes it again.
    """
    known = plant if plant is not None and _is_tracks(plant) else None
    sections = [
        Section("The way", _way(mission, result, runs)),
        Section("Over time", _signals(result, known)),
        *(() if runs is None else _of_runs(runs)),
        _commands(result, known),
        Section("Warnings", text=tuple(warnings) or ("None.",)),
        Section("Where it comes from", code=tuple(commands)),
    ]
    said = result.sentence if runs is None else runs.batch.sentence
    return Page(
        f"{name}: {result.outcome.value} after {result.time_s:.1f} s",
        said,
        tuple(verdict(result, known, runs)),
        tuple(s for s in sections if s.panels or s.text or s.rows or s.code),
    )


def _is_tracks(plant: Plant) -> bool:
    """Whether its inputs are the commands of a mission's log."""
    return {c.name for c in plant.inputs} <= {*TRACKS}


def verdict(
    result: MissionResult, plant: Plant | None, runs: ShownRuns | None = None
) -> list[Check]:
    """Whether it arrives, keeps clear, and is driven where the model knows the robot."""
    well = result.outcome is Outcome.ARRIVED
    checks: list[Check] = [
        ("good" if well else "bad", f"Nominal drive: {result.sentence}"),
    ]
    if runs is not None:
        arrived = runs.batch.outcomes["arrived"]
        low, high = (100.0 * v for v in arrived.interval)
        words = f"{arrived.count} of {runs.batch.n} runs arrive (95 %: {low:.1f} to {high:.1f} %)."
        checks.append(("good" if arrived.count == runs.batch.n else "bad", words))
    if result.min_clearance_m is not None:
        near = result.min_clearance_m
        words = f"The robot's centre keeps {near:.2f} m from the nearest obstacle."
        checks.append(("good" if near > 0.0 else "bad", words))
    full = 100.0 * float(np.mean(_at_full_drive(result).any(axis=1)))
    if full > 0.0:
        checks.append(("note", f"A command is at full drive in {full:.1f} % of the time."))
    if plant is not None and len(plant.input_range):
        outside = 100.0 * float(np.mean(outside_range(plant, _u(plant, result)).any(axis=1)))
        if outside > 0.0:
            words = (
                f"In {outside:.1f} % of the time a command is outside what the plant was "
                "identified on: there it extrapolates."
            )
            checks.append(("bad", words))
        else:
            checks.append(("good", "All commands are within what the plant was identified on."))
    return checks


def _u(plant: Plant, result: MissionResult) -> Array:
    return np.column_stack([result.log[c.name] for c in plant.inputs])


def _at_full_drive(result: MissionResult) -> NDArray[np.bool_]:
    return np.asarray(np.abs(np.column_stack([result.log[n] for n in TRACKS])) >= FULL)


def _way(mission: Mission, result: MissionResult, runs: ShownRuns | None) -> tuple[Panel, ...]:
    """The plane with the tube of the runs, the clearance and the distance to the goal."""
    log, curves = result.log, _scene(mission, result.time_s)
    note = "Grey: what must not be touched. Green: the goal with its tolerance."
    if runs is not None:
        if (outline := tube(runs.paths)) is not None:
            curves.append(_through("90 % of the runs", outline, kind="area", colour=5))
            note += " The tube holds 90 % of the runs that have driven as far, across the way."
        for k, path in enumerate(runs.worst):
            curves.append(_through("" if k else "worst runs", path, colour=1))
    if "x_est" in log:
        curves.append(Curve("believed", log["x_est"], log["y_est"], colour=3))
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
    for o in scene_of(mission, result.time_s).obstacles:
        if any(o.moved):
            x, y = (at + np.array([0.0, by]) for at, by in zip((o.x, o.y), o.moved, strict=True))
            movers.append(mover(ends, x, y, np.zeros(2), _round(0.0, 0.0, o.radius), GREY))
    return tuple(movers)


def _scene(mission: Mission, seconds: float) -> list[Curve]:
    scene = scene_of(mission, seconds)
    curves = [_through("", area, kind="area", colour=GREY) for area in scene.polygons]
    curves += [_through("", wall, colour=GREY) for wall in scene.walls]
    for o in scene.obstacles:
        curves.append(_through("", _round(o.x, o.y, o.radius), kind="area", colour=GREY))
        if any(o.moved):
            end = _round(o.x + o.moved[0], o.y + o.moved[1], o.radius)
            curves.append(_through("", end, colour=GREY))
    if scene.course is not None:
        curves.append(_through("line to follow", scene.course, colour=1))
    if scene.waypoints is not None:
        curves.append(_through("waypoints", scene.waypoints, kind="marks", colour=1))
    goal = _round(*scene.goal, scene.tolerance)
    return [*curves, _through("", goal, kind="area", colour=GREEN)]


def _through(label: str, points: Array, kind: Kind = "line", colour: int = 0) -> Curve:
    return Curve(label, points[:, 0], points[:, 1], kind=kind, colour=colour)


def _round(x: float, y: float, radius: float) -> Array:
    """A circle that can be seen even where it is a point."""
    return np.column_stack(circle(x, y, max(radius, 0.02)))


def _signals(result: MissionResult, plant: Plant | None) -> tuple[Panel, ...]:
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


def _commands(result: MissionResult, plant: Plant | None) -> Section:
    """How far each command goes, and how long beyond what is known."""
    full = _at_full_drive(result).mean(axis=0)
    ranges = (
        dict(zip([c.name for c in plant.inputs], plant.input_range, strict=False)) if plant else {}
    )
    outside = (
        dict(zip(ranges, outside_range(plant, _u(plant, result)).mean(axis=0), strict=False))
        if plant is not None
        else {}
    )
    rows = []
    for k, name in enumerate(TRACKS):
        u = result.log[name]
        low, high = ranges.get(name, (np.nan, np.nan))
        rows.append((
            name,
            f"{u.min():.0f} to {u.max():.0f}",
            f"{low:.0f} to {high:.0f}" if name in ranges else "not known",
            f"{100.0 * outside[name]:.1f} %" if name in outside else "–",
            f"{100.0 * full[k]:.1f} %",
        ))  # fmt: skip
    heads = ("command", "in the mission [µs]", "identified on [µs]", "time outside",
             "time at full drive")  # fmt: skip
    return Section("Saturation and extrapolation", heads=heads, rows=tuple(rows))


def _of_runs(runs: ShownRuns) -> list[Section]:
    batch = runs.batch
    rows = tuple(
        (name, str(o.count), f"{100 * o.share:.3g} %",
         "{:.3g} to {:.3g} %".format(*(100 * v for v in o.interval)))
        for name, o in batch.outcomes.items()
    )  # fmt: skip
    figures = (
        ("time", "Time of arrival", "s", batch.time_s),
        ("clear", "Smallest clearance", "m", batch.min_clearance_m),
        ("off", "Off the goal at the end", "m", batch.final_error_m),
    )
    panels = tuple(_distribution(*f) for f in figures if len(f[3]))
    drivers = [
        (title, shares)
        for title, shares in (
            ("Variance of the time of arrival", batch.time_drivers),
            ("Variance of the distance to the goal at the end", batch.error_drivers),
        )
        if shares is not None
    ]
    rest = "noise, and interactions" if "noise" in batch.vary else "interactions"
    matters = []
    for title, shares in drivers:
        ranked = [(d.name, d.share_of_variance) for d in shares.ranked]
        names, values = zip(*ranked, (rest, shares.remainder), strict=True)
        x, y = np.arange(float(len(names))), 100.0 * np.array(values)
        bar = Curve("", x, y, kind="stems")
        matters.append(Panel(title.replace(" ", "-"), title, "share [%]", "", (bar,), names=names))
    worst = tuple(
        (str(w.seed), w.outcome, "–" if w.time_s is None else f"{w.time_s:.1f}")
        for w in batch.worst
    )
    return [
        Section(f"{batch.n} runs", panels,
                heads=("outcome", "runs", "share", "95 % interval"), rows=rows),
        Section("What matters", tuple(matters),
                ("Sobol's first-order shares, by regression on what was drawn.",))
        if matters
        else Section("What matters", text=("Too few runs to say it.",)),
        Section("Worst runs", heads=("seed", "outcome", "time [s]"), rows=worst),
    ]  # fmt: skip


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
