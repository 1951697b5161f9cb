"""``sysid simulate``: the exported plant in a closed-loop mission, or on the inputs of a log."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import ModelError, UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..mission_options import accept_changes as changes_accepted
from ..options import argument, command, group, option
from ..read_as import decided, show_decisions
from .guided import facts_of, guide_over_ros
from .law_options import LawChoice
from .many_runs import Repeats, candidates, drive_many, ride, show_files, show_many
from .measured import lay_over, show_measured
from .page import page_text
from .ros_options import OverRos

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.plant.package import Package
    from sysid.robot.mission.result import MissionResult
    from sysid.structures.plant import Plant

_MISSION_FILES = (".yaml", ".yml")


@command
def simulate(
    mission: Path = argument("MISSION|LOG", "A mission (YAML), or a log to replay."),
    plant: Path | None = option("PATH", "Plant package, folder or zip [WORKSPACE/plant]."),
    plot: Path | None = targets.picture("Draw the result: .svg or .png."),
    output: Path | None = targets.target("FILE", "CSV to write [WORKSPACE/missions/NAME.csv]."),
    bag: Path | None = targets.target(
        "FILE", "Also write a recording of ROS: .bag (ROS 1), .mcap, or a folder (ROS 2).", "--bag"
    ),
    accept_changes: bool = changes_accepted(),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    laws: LawChoice = group(LawChoice),
    how: Repeats = group(Repeats),
    over: OverRos = group(OverRos),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Drive the exported plant through a mission, or replay a log.

    With --runs every run has numbers of its own: plant parameters within their standard errors,
    sensor noise, start pose, obstacles, friction. The result gives outcomes with their
    probabilities. With --ros it guides a robot that publishes /clock and /odom, such as `sysid
    node`.
    """

    from sysid.data.reading.read_options import ReadOptions

    place = Workspace(workspace)
    drives = mission.suffix.lower() in _MISSION_FILES
    package = load_plant(place, plant, accept_changes)
    if drives and how.measured is None and read != ReadOptions():
        raise UsageError(f"{mission} is a mission; omit the options that read a log")
    if not drives:
        laws.refuse_for_log(mission)
        how.refuse(f"{mission} is a log to replay; omit {{}}")
        over.refuse_for_log(mission)
    if bag is not None and not (drives and how.runs is None):
        raise UsageError(f"--bag {bag} records one drive of a mission; omit --bag")
    kind = "_replay" if not drives else "" if how.runs is None else "_runs"
    name = f"{mission.stem}{kind}.csv"
    target = output or place.missions_dir / name
    if target.exists() and mission.exists() and target.samefile(mission):
        raise UsageError(f"-o {target} would overwrite the input; name another file")
    if over.ros:
        facts = _guided(mission, place, package, (target, plot, bag), laws, how, over)
    elif drives:
        facts = _driven(mission, place, package, (target, plot, bag), laws, how, read)
    else:
        facts = _replay(mission, package.plant(), target, plot, read)
    facts["warnings"] = [*package.notes, *facts["warnings"]]
    if json:
        render.document(facts)
        return
    show_decisions(facts.get("read_as", ()))
    if "measured" in facts:
        show_measured(facts["measured"])
    if "runs" in facts:
        show_many(mission, facts, how)
    else:
        show_drive(mission.name, facts)


def load_plant(place: Workspace, plant: Path | None, accept_changes: bool) -> "Package":
    """The named plant package, or the one of the workspace."""
    if plant is None and not place.plant_dir.exists():
        raise ModelError(
            f"no plant was exported to {place.plant_dir} yet; run `sysid export` first, or name "
            "one with --plant"
        )
    from sysid.plant.package import read_package

    return read_package(plant or place.plant_dir, accept_changes)


def _driven(
    path: Path,
    place: Workspace,
    package: "Package",
    files: tuple[Path, Path | None, Path | None],
    laws: LawChoice,
    how: Repeats,
    read: "ReadOptions",
) -> dict[str, Any]:
    """Once, or many times, and beside a measured drive; log, picture and bag to write are given."""
    from sysid.data.files import write_atomic
    from sysid.robot.mission.simulator import simulate as drive
    from sysid.robot.mission.spec import load_mission

    mission = laws.applied(load_mission(path))
    models = candidates(place, package, mission, how)
    if how.measured is not None:
        comparison, measured, warnings = lay_over(how.measured, mission, models, how, read)
        single = Repeats()
    else:
        single = how if how.runs is None else Repeats()
    log, plot, bag = files
    drawn = plot if how.measured is None else None
    given = ride(mission, package, models, single)
    runs = None
    with render.progress(f"Driving {path.name}"):
        result = drive(given.mission, given.robot, given.noise_seed, given.known)
    if how.runs is None:
        facts = facts_of(path, given.mission, result, (log, drawn, bag), given.seed)
        facts["warnings"] = [*given.warnings, *_outside(package.plant(), result)]
    else:
        facts, runs = drive_many(path, mission, models, log, how)
        if drawn is not None:
            from sysid.report.missions.drives import draw_runs

            draw_runs(drawn, path.stem, mission, result, runs)
            facts["plot"] = drawn
    facts["page"] = place.missions_dir / f"{path.stem}{'' if runs is None else '_runs'}.html"
    vary = None if how.vary is None else ",".join(how.vary)
    options = {
        "runs": how.runs,
        "seed": how.seed,
        "vary": vary,
        "plant": _named(package, place),
        **asdict(laws),
    }
    said = [*package.notes, *facts["warnings"]]
    text = page_text(path, given.mission, package, result, runs, said, options)
    write_atomic(facts["page"], text)
    if how.measured is not None:
        facts |= {"measured": measured, "warnings": [*facts["warnings"], *warnings]}
        if plot is not None:
            from sysid.report.missions.drives import draw_measured

            draw_measured(plot, path.stem, mission, comparison)
            facts["plot"] = plot
    return facts


def _named(package: "Package", place: Workspace) -> str | None:
    """The plant of a line that drives again; None for the workspace's own."""
    return None if package.where == str(place.plant_dir) else package.where


def _outside(plant: "Plant", result: "MissionResult") -> tuple[str, ...]:
    """Sentences for commands beyond what the plant was identified on."""
    import numpy as np

    from sysid.plant.replay import outside_domain

    named = [c.name for c in plant.inputs]
    if not set(named) <= result.log.keys():  # the plant's inputs are not the robot's own PWM
        return ()
    return outside_domain(plant, np.column_stack([result.log[n] for n in named]))


def _guided(
    path: Path,
    place: Workspace,
    package: "Package",
    files: tuple[Path, Path | None, Path | None],
    laws: LawChoice,
    how: Repeats,
    over: OverRos,
) -> dict[str, Any]:
    """Once, with the robot at the other end of ROS."""
    from sysid.data.files import write_atomic
    from sysid.robot.mission.spec import load_mission

    how.refuse("{} does not apply with --ros; the other node drives the robot")
    mission = laws.applied(load_mission(path))
    result, notes = guide_over_ros(path, mission, package, over)
    facts = facts_of(path, mission, result, files, 0) | {"warnings": list(notes)}
    facts["page"] = place.missions_dir / f"{path.stem}.html"
    options = {"ros": True, "plant": _named(package, place), **asdict(laws)}
    text = page_text(path, mission, package, result, None, notes, options)
    write_atomic(facts["page"], text)
    return facts


def _replay(
    path: Path, plant: "Plant", log: Path, plot: Path | None, read: "ReadOptions"
) -> dict[str, Any]:
    from sysid.plant.replay import read_for, replay, write_replay
    from sysid.report.data_panels import draw_replay

    result = replay(plant, read_for(plant, path, read))
    facts = result.summary() | {"log": write_replay(result, log)}
    facts["read_as"] = decided([result.record])
    if plot is not None:
        draw_replay(plot, result)
        facts["plot"] = plot
    return facts


def show_drive(name: str, facts: dict[str, Any]) -> None:
    """A table of what a mission or a replay came to, warnings, and what was written."""
    if "outcome" in facts:
        final = facts["final"]
        rows = [
            ("outcome", facts["outcome"]),
            ("time [s]", render.number(facts["time_s"], 4)),
            ("final x, y [m]", f"{final['x']:.3f}, {final['y']:.3f}"),
            ("final heading [rad]", f"{final['psi']:.3f}"),
            ("off the goal [m]", render.number(facts["off_goal_m"], 3)),
            ("… as the robot believes", render.number(facts["believed"]["off_goal_m"], 3)),
            ("path driven [m]", render.number(facts["path_length_m"], 4)),
            ("nearest obstacle [m]", render.number(facts["min_clearance_m"], 3)),
            ("off the straight line [m]", render.number(facts["max_deviation_m"], 3)),
        ]
        render.table((name, ""), rows)
        render.say(facts["sentence"])
    else:
        fits = facts["fit_percent"]
        render.table(
            ("output", "fit [%]", "RMSE"),
            [(n, fits[n], facts["rmse"][n]) for n in fits],
            title=f"The plant on {name}, {facts['horizon']} from {facts['initial_state']}",
        )
    show_files(facts)
