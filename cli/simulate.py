"""``sysid simulate``: the exported plant in a closed-loop mission, or on the inputs of a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import ModelError

from . import reading, render
from .workspace import Workspace

if TYPE_CHECKING:
    from sysid.structures.plant import Plant

_MISSION_FILES = (".yaml", ".yml")


def simulate(
    mission: Annotated[
        Path, typer.Argument(metavar="MISSION|LOG", help="A mission (YAML), or a log to replay.")
    ],
    plant: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Plant package, folder or zip [WORKSPACE/plant]."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the result: .svg or .png.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to write the log [in WORKSPACE].")
    ] = None,
    ts: reading.SampleTime = None,
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Drive the exported plant through a mission, or replay a log's inputs through it."""
    place = Workspace(workspace)
    if plot is not None:
        _check_picture(plot)
    model = _load(place, plant)
    target = log or place.missions_dir / f"{mission.stem or 'mission'}.csv"
    if mission.suffix.lower() in _MISSION_FILES:
        facts = _drive(mission, model, target, plot)
    else:
        facts = _replay(mission, model, target, plot, ts)
    _document(facts) if json else _show(mission, facts)


def _check_picture(plot: Path) -> None:
    """Refuse a wrong suffix before anything is simulated."""
    from sysid.report.plots import picture_format

    picture_format(plot)


def _load(place: Workspace, plant: Path | None) -> "Plant":
    from sysid.plant.package import load_plant

    if plant is None and not place.plant_dir.exists():
        raise ModelError(
            f"no plant was exported to {place.plant_dir} yet; run `sysid export` first, or name "
            "one with --plant"
        )
    return load_plant(plant or place.plant_dir)


def _drive(path: Path, plant: "Plant", log: Path, plot: Path | None) -> dict[str, Any]:
    from sysid.data.files import write_atomic
    from sysid.mission.mapping import as_robot
    from sysid.mission.simulator import simulate, write_log
    from sysid.mission.spec import load_mission

    mission = load_mission(path)
    robot, notes = as_robot(plant, mission)
    with render.progress(f"Driving {path.name}"):
        result = simulate(mission, robot)
    del write_atomic
    log.parent.mkdir(parents=True, exist_ok=True)
    facts = result.summary() | {"log": write_log(result, log), "warnings": notes}
    return facts


def _replay(
    path: Path, plant: "Plant", log: Path, plot: Path | None, ts: float | None
) -> dict[str, Any]:
    return {}


def _document(facts: dict[str, Any]) -> None:
    render.document(facts)


def _show(path: Path, facts: dict[str, Any]) -> None:
    render.facts(list(facts.items()), path.name)
