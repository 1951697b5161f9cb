"""``sysid export``: a model as a plant package that runs elsewhere."""

from pathlib import Path

import typer

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..options import command, option


@command
def export(
    which: str | None = reading.ids(
        "[MODEL]", "Id of the model, or its beginning [of the last diagnosis, comparison or fit]."
    ),
    model: str | None = reading.model("The same as MODEL."),
    output: Path | None = targets.target("DIR|FILE.zip", "Output path [WORKSPACE/plant]."),
    formats: str | None = option(
        "NAME[,NAME]",
        "Formats; json is the package alone [json,c; c is left out where it is impossible].",
        "-f",
        "--format",
    ),
    controller: Path | None = option(
        "MISSION", "Also write the laws of this mission (YAML): guidance, control, navigation."
    ),
    precision: str = option("double|float", "Numbers of the C code.", default="double"),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Write a model as a plant package and run its self-test."""
    from sysid.export.package import Form, write_package
    from sysid.plant.package import CARD, FILES, read_description
    from sysid.plant.selftest import TOLERANCE, selftest
    from sysid.plant.storage import MARK

    if precision not in ("double", "float"):
        raise typer.BadParameter(f"{precision!r} is not a precision; choose double or float")
    mission = None
    if controller is not None:
        from sysid.robot.mission.spec import load_mission

        mission = load_mission(controller)
    place = Workspace(workspace)
    if None not in (which, model) and which != model:
        raise UsageError(f"MODEL is {which} and --model {model}; give one of them")
    stored = place.chosen(which or model)
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
