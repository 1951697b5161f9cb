"""The page of a mission, as ``sysid simulate`` and ``sysid report MISSION.yaml`` write it."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.store import Workspace

from .many_runs import Repeats, batch_of, candidates, ride

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sysid.plant.package import Package
    from sysid.report.missions.panels import ShownRuns
    from sysid.robot.mission.result import MissionResult
    from sysid.robot.mission.spec import Mission

REPORTED_RUNS = 200
"""Runs that a report drives: enough for the tube's 5 % and for what matters."""


def report_mission(path: Path, place: Workspace, package: "Package") -> str:
    """The page of a mission, which is driven for it once and many times."""
    from sysid.robot.mission.simulator import simulate
    from sysid.robot.mission.spec import load_mission

    mission, how = load_mission(path), Repeats(runs=REPORTED_RUNS)
    models = candidates(place, package, mission, how)
    single = ride(mission, package, models, Repeats())
    result = simulate(mission, single.robot, single.noise_seed, single.known)
    setup, batch = batch_of(path, mission, models, how)
    from sysid.report.missions.panels import shown_runs

    runs = shown_runs(setup, batch)
    warnings = [*package.notes, *single.warnings, *batch.notes]
    return page_text(path, mission, package, result, runs, warnings)


def page_text(
    path: Path,
    mission: "Mission",
    package: "Package",
    result: "MissionResult",
    runs: "ShownRuns | None" = None,
    warnings: "list[str] | tuple[str, ...]" = (),
    options: "Mapping[str, Any] | None" = None,
) -> str:
    """The page as text."""
    from sysid.report.missions.page import mission_page

    words = ["sysid", "simulate", str(path)]
    for name, value in (options or {}).items():
        if value is not None:
            words += [f"--{name}", *([] if value is True else [str(value)])]
    line = shlex.join(words)
    page = mission_page(
        path.stem, mission, result, package.plant(), runs, warnings=warnings, commands=(line,)
    )
    return page.html()
