"""A model as a plant package, in the requested formats, with its closed loop where asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sysid.errors import ModelError, SysidError
from sysid.export.base import Exporter, Source
from sysid.export.registry import DEFAULT, chosen
from sysid.outside_text import name_of, visible
from sysid.plant import package
from sysid.plant.description import describe
from sysid.plant.selftest import make_selftest
from sysid.plant.storage import Files
from sysid.robot.mission.loop import Loop
from sysid.robot.mission.simulator import closed_loop, scene_of, shaper_of
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tuning.written import mission_values
from sysid.runners import floats
from sysid.structures.model import Model


def loop_of(model: Model, mission: Mission) -> Loop:
    """The loop that ``simulate`` would run."""
    robot, _ = as_robot(model.plant(), mission)
    scene, drive = scene_of(mission, robot), shaper_of(mission, robot)
    return closed_loop(mission, robot, scene, floats, drive)


@dataclass(frozen=True)
class Form:
    """What is written beside the plant, and how.

    Attributes:
        controller: the mission whose laws are written, too; None for the plant alone.
        double: whether numbers in C have 8 bytes, else 4.
    """

    controller: Mission | None = None
    double: bool = True


PLANT_ALONE = Form()

FORM = "form"
"""Where plant.json holds what its files were written with, where that is not the usual."""

_NOTHING: Mapping[str, Any] = MappingProxyType({})


def write_package(
    model: Model,
    path: str | Path,
    report: Mapping[str, Any] = _NOTHING,
    name: str = "",
    formats: Sequence[str] | None = None,
    form: Form = PLANT_ALONE,
) -> Path:
    """Write a model as a plant package: a folder, or one zip where ``path`` ends in ``.zip``.

    The package appears whole or not at all, and replaces one that is there already.

    Args:
        model, report, name, formats, form: see :func:`package_files`.

    Raises:
        UsageError: something that is no package stands at ``path``, or a format does not exist.
        ModelError: the model has no input, or cannot be written in a format that was asked for.
        DataError: the place cannot be written.
    """
    return package.write(path, package_files(model, report, name, formats, form))


def package_files(
    model: Model,
    report: Mapping[str, Any] = _NOTHING,
    name: str = "",
    formats: Sequence[str] | None = None,
    form: Form = PLANT_ALONE,
) -> Files:
    """The files of a package by name: the package itself, and a folder for each format.

    The same model and report give the same bytes.

    Args:
        report: what ``fit`` had to say (its ``validation`` or ``estimation`` figures are kept).
        name: what to call the plant; the structure's name unless given.
        formats: names of exporters. None writes the usual ones, and one of these that cannot write
            this model is left out: the model card says why.
        form: what is written beside the plant, and how.
    """
    exporters = chosen(DEFAULT if formats is None else formats)
    name = name_of(name or model.structure.name)
    if not model.inputs:
        raise ModelError(f"{name} has no input, which a plant needs; fit a structure with inputs")
    loop = None if form.controller is None else loop_of(model, form.controller)
    described = {**describe(model, report, name), **_described(form)}
    source = Source(model, name, described, make_selftest(model), loop, form.double)
    files: dict[str, bytes] = {}
    usage = ""
    for exporter in exporters:
        try:
            files |= _written(exporter, source)
            words = exporter.usage()
        except ModelError as error:
            if formats is not None:
                raise
            words = f"There is no {exporter.title}: {error}."
        usage += f"{words.rstrip()}\n\n" if words else ""
    return package.assembled(model, source.description, source.selftest, files, usage)


def form_of(described: Mapping[str, Any], where: str) -> Form:
    """The form that a package was written in."""
    raw = described.get(FORM, {})
    try:
        mission, double = raw.get("mission"), raw.get("double", True)
        return Form(None if mission is None else Mission.model_validate(mission), bool(double))
    except (ValueError, AttributeError, TypeError, SysidError):
        raise ModelError(f"{where}: plant.json is damaged ({FORM}); export it again") from None


def _described(form: Form) -> dict[str, Any]:
    """What plant.json says of a form: enough to write the same files again."""
    if form == PLANT_ALONE:
        return {}
    mission = None if form.controller is None else mission_values(form.controller)
    return {FORM: {"double": form.double, "mission": mission}}


def _written(exporter: Exporter, source: Source) -> dict[str, bytes]:
    """The files of one exporter by their names inside the package."""
    return {
        f"{exporter.name}/{file}": visible(text).encode("utf-8") if isinstance(text, str) else text
        for file, text in exporter.files(source).items()
    }
