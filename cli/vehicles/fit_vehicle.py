"""``sysid fit-vehicle``: radii, width, slip, lags and lever arm from logs with a pose."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..mission_options import given_lengths
from ..read_as import decided
from .fit_vehicle_picture import drawn
from .fit_vehicle_report import show, show_squares

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.robot.calibration.dynamic_motors import KnownMotors
    from sysid.robot.calibration.vehicle_fit import VehicleFit
    from sysid.vehicle.kinematics import Geometry


@dataclass(frozen=True)
class Squares:
    """A table of where squares ended, and their side [m]."""

    returns: Path
    side: float


@dataclass(frozen=True)
class Files:
    """Files beside the logs: what is written, and where squares ended; None for none."""

    section: Path | None
    mission: Path | None
    to: Path | None
    plot: Path | None
    squares: Squares | None = None


def files(
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Write the vehicle as sections of a mission (.yaml).",
        ),
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option("--mission", metavar="M.yaml", help="Mission to write again with --to."),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="FILE", help="Write the mission with the fitted vehicle."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw paths and slip: .svg or .png.")
    ] = None,
    returns: Annotated[
        Path | None,
        typer.Option(
            "--returns",
            metavar="FILE",
            help="Instead of logs: where squares driven both ways ended (direction, x, y).",
        ),
    ] = None,
    side: Annotated[
        float | None,
        typer.Option("--side", metavar="M", help="Side of these squares [m]."),
    ] = None,
) -> Files:
    """Where the results go, and where squares come from.

    Raises:
        UsageError: a place cannot be written to, or one of two options that go together is missing.
    """
    targets.check_picture(plot)
    for path, option in ((output, "-o"), (to, "--to")):
        if path is not None:
            if path.suffix not in (".yaml", ".yml"):
                raise UsageError(f"{option} {path}: a file with a vehicle ends in .yaml")
            targets.check(path, option, new_folder=False)
    if (to is None) != (mission is None):
        lacks = "--mission M.yaml to write it from" if mission is None else "--to FILE to write to"
        raise UsageError(f"a mission with the new vehicle needs {lacks}, too")
    if to is not None and mission is not None and to.exists() and to.samefile(mission):
        raise UsageError(f"--to {to} would overwrite the mission; name another file")
    if (returns is None) != (side is None):
        lacks = "--side, the squares' side in metres" if side is None else "--returns FILE"
        raise UsageError(f"squares need {lacks}, too")
    runs = None if returns is None or side is None else Squares(returns, side)
    return Files(output, mission, to, plot, runs)


@dataclass(frozen=True)
class Torque:
    """What is known of the motors, as the line says it."""

    motors: str | None
    torque_constant: float | None
    workspace: Path

    def known(self) -> "KnownMotors | None":
        """The motors; None where nothing was said.

        Raises:
            UsageError: both options are given, or one cannot be read.
        """
        from sysid.robot.calibration.dynamic_motors import (
            motors_of_model,
            read_motors,
            torque_only,
        )

        if self.motors is not None and self.torque_constant is not None:
            raise UsageError(
                "--motors and --torque-constant have the same meaning; give one of them"
            )
        if self.torque_constant is not None:
            return torque_only(self.torque_constant)
        if self.motors is None:
            return None
        if Path(self.motors).suffix in (".yaml", ".yml"):
            return read_motors(Path(self.motors))
        return motors_of_model(Workspace(self.workspace).load(self.motors).model)


def torque(
    motors: Annotated[
        str | None,
        typer.Option(
            "--motors",
            metavar="MODEL",
            help="Motors of --motion dynamic: id of a dc-motor (of `sysid bench motor`), or a "
            ".yaml with resistance, back_emf, torque_constant, viscous, inertia, friction, gear.",
        ),
    ] = None,
    torque_constant: Annotated[
        float | None,
        typer.Option(
            "--torque-constant",
            metavar="NM",
            help="Torque at the wheel per unit of the command or current, if known.",
        ),
    ] = None,
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
) -> Torque:
    """What drives a vehicle that has mass."""
    return Torque(motors, torque_constant, workspace)


@reading.composed(files=files, drive=torque, steps=reading.preparation, read=reading.read_options)
def fit_vehicle(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="LOG...", help="CSV or Parquet with wheel speeds and a pose."),
    ] = None,
    geometry: Annotated[
        str | None,
        typer.Option(
            "--geometry",
            metavar="r=M,B=M",
            help="Wheel or sprocket radius and distance of wheels or tracks [m], r=0.30,B=1.08, "
            "or a file written by -o [the bundled robot's]; the basis of `before`.",
        ),
    ] = None,
    motion: Annotated[
        str, typer.Option("--motion", metavar="KIND", help="What moves it: slip or dynamic.")
    ] = "slip",
    validation: Annotated[
        list[Path] | None,
        typer.Option(
            "--val",
            metavar="LOG",
            help="Validation log; repeat for more [the last 30 % of the logs].",
        ),
    ] = None,
    *,
    files: Files,
    drive: Torque,
    steps: "Preparation",
    read: "ReadOptions",
    json: reading.Json = False,
) -> None:
    """Find radii, width, slip, lags and lever arm of a vehicle from logs that hold its pose.

    With --motion dynamic its mass, yaw inertia, frictions and thrust stiffness. Each with its
    standard error, and a sentence if a log does not determine it. Judged on windows of two seconds
    that were not used.
    """
    given = None if geometry is None else given_lengths(geometry)
    if files.squares is not None:
        _returned(files.squares, given, logs or [], json)
        return
    _refuse_without(logs or [])
    motors = drive.known()
    from sysid.robot.calibration.logs import read_vehicle_logs
    from sysid.robot.calibration.vehicle_fit import fit_vehicle as fit

    records, findings = read_vehicle_logs(logs or [], read, steps)
    holdout, more = read_vehicle_logs(validation, read, steps) if validation else ((), ())

    with render.progress("Fitting the vehicle"):
        fitted = fit(records, holdout, given, motion, motors)
        judged = fitted.to_json()
    document: dict[str, Any] = {"logs": [str(p) for p in logs or []], **judged}
    document["read_as"] = decided((*records, *holdout))
    document["notes"] = [*fitted.notes, *(f.text for f in (*findings, *more))]
    document |= _written(files, fitted, (logs or [])[0].stem)
    render.document(document) if json else show(fitted, document)


def _returned(given: Squares, geometry: "Geometry | None", logs: list[Path], json: bool) -> None:
    """Report the errors that the returns of squares determine, without a log.

    Raises:
        UsageError: there are logs, too.
    """
    from sysid.robot.calibration.square_runs import read_returns, square_result
    from sysid.vehicle.kinematics import Geometry

    if logs:
        raise UsageError("--returns replaces a LOG; give one of them")
    squares = square_result(read_returns(given.returns, given.side, geometry or Geometry()))
    render.document({"squares": squares.to_json()}) if json else show_squares(squares)


def _refuse_without(logs: list[Path]) -> None:
    """Refuse numbers without a file, with the list of what is missing.

    Raises:
        UsageError: there is no log, or what stands for one is no file.
    """
    from sysid.robot.calibration.logs import NEEDED

    if not logs:
        raise UsageError(f"fit-vehicle needs a LOG: {NEEDED}")
    for log in logs:
        if not log.exists():
            raise UsageError(f"{log}: file not found; this command needs {NEEDED}")


def _written(files: Files, fitted: "VehicleFit", name: str) -> dict[str, Any]:
    """What was written, by kind."""
    from sysid.robot.mission.tuning.written import write_sections, write_vehicle

    document: dict[str, Any] = {}
    if files.section is not None:
        document["output"] = write_sections(files.section, fitted.mission)
    if files.mission is not None and files.to is not None:
        document["to"] = write_vehicle(files.mission, files.to, fitted.mission)
    if files.plot is not None:
        drawn(files.plot, name, fitted)
        document["plot"] = files.plot
    return document
