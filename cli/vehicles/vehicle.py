"""``sysid vehicle``: mobility and kinematics of a described vehicle."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .. import reading, render, targets
from ..options import argument, command, numbers, option, pairs

if TYPE_CHECKING:
    from sysid.vehicle.wheels.vehicle import Vehicle


@command
def vehicle(
    file: Path = argument("FILE", "A vehicle (YAML), a mission or a URDF."),
    angles: str | None = option(
        "NAME=RAD,…", "Steering angles [rad] instead of the file's, by wheel."
    ),
    twist: str | None = option(
        "VX,VY,WZ", "Wanted motion [m/s, m/s, rad/s]: speeds and angles of the wheels for it."
    ),
    speeds: str | None = option(
        "NAME=RAD/S,…",
        "Speeds of wheels [rad/s], by name or in the file's order; gives the motion.",
    ),
    plot: Path | None = targets.picture("Draw wheels, axles and centre: .svg or .png."),
    urdf: Path | None = targets.target(
        "FILE", "Write the vehicle as a URDF.", "--urdf", new_folder=False
    ),
    mjcf: Path | None = targets.target(
        "FILE", "Write the vehicle as a MuJoCo model.", "--mjcf", new_folder=False
    ),
    json: bool = reading.JSON,
) -> None:
    """Show a vehicle's mobility, turn motion into wheel speeds."""
    from sysid.vehicle.wheels.description import load_vehicle
    from sysid.vehicle.wheels.summary import forward_document, inverse_document, summary

    loaded = load_vehicle(file)
    at = _by_name(angles, "--angles", [w.name for w in loaded.wheels if w.kind == "steerable"])
    facts = summary(loaded, at)
    if twist is not None:
        wanted = numbers(twist, "--twist", "numbers such as 0.2,0,0.5")
        facts["inverse"] = inverse_document(loaded, loaded.inverse(wanted, at))
    if speeds is not None:
        wheel_speeds = _by_name(
            speeds, "--speeds", [w.name for w in loaded.wheels if w.kind != "caster"]
        )
        facts["forward"] = forward_document(loaded, loaded.forward(wheel_speeds or {}, at))
    if plot is not None:
        from sysid.report.vehicle_drawing import draw_vehicle

        draw_vehicle(plot, loaded, facts)
        facts["plot"] = plot
    _write(loaded, facts, {"urdf": urdf, "mjcf": mjcf})
    if json:
        render.document(facts)
    else:
        from .vehicle_report import show

        show(facts)


def _write(loaded: "Vehicle", facts: dict[str, Any], files: Mapping[str, Path | None]) -> None:
    """The files that were asked for, and their places among the facts."""
    from sysid.data.files import write_atomic
    from sysid.vehicle.wheels.mjcf_writing import mjcf_text
    from sysid.vehicle.wheels.urdf_writing import urdf_text

    text = {"urdf": urdf_text, "mjcf": mjcf_text}
    for kind, path in files.items():
        if path is not None:
            write_atomic(path, text[kind](loaded))
            facts[kind] = path


def _by_name(text: str | None, option: str, in_order: Sequence[str]) -> Mapping[str, float] | None:
    """``a=1,b=2``, or ``1,2`` for the names in their order."""
    if text is None:
        return None
    if "=" not in text:
        values = numbers(text, option, "numbers separated by commas")
        if len(values) != len(in_order):
            raise UsageError(
                f"{option} {text} has {len(values)} numbers for {len(in_order)} wheels "
                f"({', '.join(in_order) or 'none'}): name them, as in {option} NAME=VALUE"
            )
        return dict(zip(in_order, values, strict=True))
    return pairs([text], option, "NAME=VALUE once for each wheel", float)
