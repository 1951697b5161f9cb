"""``sysid export``: a model as a plant package that runs elsewhere."""

from pathlib import Path
from typing import Annotated

import typer

from sysid.workspace.store import Workspace

from .. import reading, render, targets


def export(
    model: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Which model [best of the last comparison or fit]."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR|FILE.zip", help="Output path [WORKSPACE/plant]."),
    ] = None,
    formats: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="NAME[,NAME]",
            help="Formats; json is the package alone [json,c; c is left out where it is "
            "impossible].",
        ),
    ] = None,
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="MISSION",
            help="Also write the laws of this mission (YAML): guidance, control, navigation.",
        ),
    ] = None,
    precision: Annotated[
        str, typer.Option(metavar="double|float", help="Numbers of the C code.")
    ] = "double",
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Write a model as a plant package and run its self-test."""
    from sysid.export.package import Form, write_package
    from sysid.plant.package import CARD, FILES, read_description
    from sysid.plant.selftest import TOLERANCE, selftest
    from sysid.plant.storage import MARK

    if output is not None:
        targets.check(output, "-o")
    if precision not in ("double", "float"):
        raise typer.BadParameter(f"{precision!r} is not a precision; choose double or float")
    mission = None
    if controller is not None:
        from sysid.robot.mission.spec import load_mission

        mission = load_mission(controller)
    place = Workspace(workspace)
    stored = place.chosen(model)
    with place.locked():  # two exports to one place would each move away what the other made
        path = write_package(
            stored.model,
            output or place.plant_dir,
            stored.report,
            stored.id,
            None if formats is None else formats.split(","),
            Form(mission, precision == "double"),
        )
    error = selftest(path)
    for warning in stored.model.warnings:
        render.warn(warning)
    if json:
        test = {"max_error": error, "relative_tolerance": TOLERANCE}
        files = sorted({MARK, CARD, *read_description(path)[FILES]})
        render.document({"plant": path, "model": stored.id, "files": files, "selftest": test})
        return
    render.say(f"Exported {stored.id} to {path}")
    render.say(f"Self-test: the file read back differs by {error:.2g} at most.")
