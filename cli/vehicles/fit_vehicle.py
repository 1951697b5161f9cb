"""``sysid fit-vehicle``: radii, width, slip, lags and lever arm from logs with a pose."""

from dataclasses import dataclass
from functools import partial
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import fit_options, reading, render, targets
from ..mission_options import given_lengths
from ..options import argument, command, group, option
from ..read_as import decided, show_decisions

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.robot.calibration.dynamic_motors import KnownMotors
    from sysid.robot.calibration.square_runs import SquareResult
    from sysid.robot.calibration.vehicle_fit import VehicleFit
    from sysid.vehicle.kinematics import Geometry


_yaml = partial(targets.target, "FILE", new_folder=False, suffixes=targets.YAML)


@dataclass(frozen=True)
class Files:
    """Files beside the logs: what is written, and where squares ended; None for none."""

    output: Path | None = _yaml(
        "Write the vehicle as sections of a mission, or --mission with it (.yaml)."
    )
    mission: Path | None = option("M.yaml", "Mission to write with the fitted vehicle, by -o.")
    plot: Path | None = targets.picture("Draw paths and slip: .svg or .png.")
    returns: Path | None = option(
        "FILE",
        "Instead of logs: where squares driven both ways ended (direction, x, y).",
        advanced=True,
    )
    side: float | None = option("M", "Side of these squares.", advanced=True)

    def __post_init__(self) -> None:
        to, mission = self.output, self.mission
        if mission is not None and to is None:
            raise UsageError(f"{mission} is written again with the new vehicle: add -o FILE")
        if to is not None and mission is not None and to.exists() and to.samefile(mission):
            raise UsageError(f"-o {to} would overwrite the mission; name another file")
        if (self.returns is None) != (self.side is None):
            lacks = "--returns FILE" if self.side else "--side, the squares' side in metres"
            raise UsageError(f"squares need {lacks}, too")


@dataclass(frozen=True)
class Torque:
    """What is known of the motors, as the line says it."""

    motors: str | None = option(
        "MODEL",
        "Motors of --motion dynamic: id of a dc-motor (of `sysid bench motor`), or a "
        ".yaml with resistance, back_emf, torque_constant, viscous, inertia, friction, gear.",
        advanced=True,
    )
    torque_constant: float | None = option(
        "NM", "Torque at the wheel per unit of the command or current, if known.", advanced=True
    )
    workspace: Path = reading.WORKSPACE

    def known(self) -> "KnownMotors | None":
        """The motors; None where nothing was said."""
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


@command
def fit_vehicle(
    logs: list[Path] | None = argument(
        "LOG...", "CSV or Parquet with wheel speeds and a pose.", default=None
    ),
    geometry: str | None = option(
        "r=M,B=M",
        "Radius and distance of wheels or tracks in m, r=0.30,B=1.08; or a file written by -o. "
        "The basis of `before` [the bundled robot's].",
    ),
    motion: str = option("KIND", "What moves it: slip or dynamic.", default="slip"),
    validation: list[Path] | None = fit_options.validation(
        "Validation log; repeatable [the last 30 % of the logs]."
    ),
    files: Files = group(Files),
    drive: Torque = group(Torque),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading),
    json: bool = reading.JSON,
) -> None:
    """Find radii, width, slip and lags from logs with a pose.

    And the lever arm; with --motion dynamic mass, yaw inertia, frictions and thrust stiffness.
    Each with its standard error, and a sentence if a log does not determine it. Judged on windows
    of two seconds that were not used.
    """
    given = None if geometry is None else given_lengths(geometry)
    if files.returns is not None and files.side is not None:
        _returned(files.returns, files.side, given, logs or [], json)
        return
    _refuse_without(logs or [])
    motors = drive.known()
    from sysid.robot.calibration.logs import read_vehicle_logs
    from sysid.robot.calibration.vehicle_fit import fit_vehicle as fit

    records, findings = read_vehicle_logs(logs or [], read, steps)
    holdout, more = read_vehicle_logs(validation, read, steps) if validation else ((), ())

    with render.stages("Fitting the vehicle") as show:
        show("Fitting the vehicle", 0.0)
        fitted = fit(records, holdout, given, motion, motors)
        show("Fitting each half", 1.0 / 3.0)  # two fits more, each judged by the other half
        judged = fitted.to_json()
    document: dict[str, Any] = {"logs": [str(p) for p in logs or []], **judged}
    document["read_as"] = decided((*records, *holdout))
    document["notes"] = [*fitted.notes, *(f.text for f in (*findings, *more))]
    document |= _written(files, fitted, (logs or [])[0].stem)
    render.document(document) if json else _show(fitted, document)


def _returned(
    returns: Path, side: float, geometry: "Geometry | None", logs: list[Path], json: bool
) -> None:
    """Report the errors that the returns of squares determine, without a log."""
    from sysid.robot.calibration.square_runs import read_returns, square_result
    from sysid.vehicle.kinematics import Geometry

    if logs:
        raise UsageError("--returns replaces a LOG; give one of them")
    squares = square_result(read_returns(returns, side, geometry or Geometry()))
    render.document({"squares": squares}) if json else _show_squares(squares)


def _refuse_without(logs: list[Path]) -> None:
    """Refuse numbers without a file, with the list of what is missing."""
    from sysid.robot.calibration.logs import NEEDED

    if not logs:
        raise UsageError(f"fit-vehicle needs a LOG: {NEEDED}")
    for log in logs:
        if not log.exists():
            raise UsageError(f"{log}: file not found; this command needs {NEEDED}")


def _written(files: Files, fitted: "VehicleFit", name: str) -> dict[str, Any]:
    from sysid.robot.mission.tuning.written import write_sections, write_vehicle

    document: dict[str, Any] = {}
    if files.output is not None:
        document["output"] = (
            write_sections(files.output, fitted.mission)
            if files.mission is None
            else write_vehicle(files.mission, files.output, fitted.mission)
        )
    if files.plot is not None:
        from sysid.report.vehicles import draw_vehicle_fit

        draw_vehicle_fit(files.plot, name, fitted)
        document["plot"] = files.plot
    return document


def _show(fitted: "VehicleFit", document: dict[str, Any]) -> None:
    show_decisions(document["read_as"])
    identifiable = [n for n in fitted.numbers if n.identifiable]
    render.table(
        ("quantity", "value", "± 95 %", "unit", "what it is"),
        [
            (n.name, _digits(n.value, n.std_error), render.reach(n.std_error), n.unit, n.sentence)
            for n in identifiable
        ],
    )
    for n in fitted.numbers:
        if not n.identifiable:
            render.say(f"{n.name}: {n.sentence}")
    for a, b, r in fitted.correlations.strong():
        render.say(f"Errors of {a} and {b} are correlated ({r:.2f}).")
    _show_errors(fitted)
    if fitted.squares is not None:
        _show_squares(fitted.squares)
    render.cautions(document["notes"])
    acting = fitted.acting
    render.say(f"As a vehicle without slip: r = {acting.r:.4g} m, B = {acting.B:.4g} m.")
    render.files(document, output="Vehicle", plot="Picture")


def _show_squares(squares: "SquareResult") -> None:
    """Print what squares driven both ways say."""
    rows = []
    for name, centre, count in zip(("cw", "ccw"), squares.centres, squares.runs, strict=True):
        if centre is not None:
            rows.append((name, count, float(centre[0]), float(centre[1])))
    render.table(("squares", "runs", "missed x [m]", "missed y [m]"), rows)
    before, after = squares.worst
    render.say(squares.sentence)
    if after is not None:
        render.say(f"Farthest centre of the returns: {before:.3g} m, corrected {after:.3g} m.")


def _show_errors(fitted: "VehicleFit") -> None:
    steps = (fitted.before, fitted.plain, fitted.after)
    first, last = fitted.drift
    rows: list[tuple[object, ...]] = [
        ("path after two seconds [m]", *(e.path for e in steps)),
        ("heading after two seconds [rad]", *(e.heading for e in steps)),
    ]
    if first.per_metre is not None:
        rows.append(("drift for each metre [m]", first.per_metre, None, last.per_metre))
    if first.per_turn is not None:
        rows.append(("drift for each turn [rad]", first.per_turn, None, last.per_turn))
    for k, fold in enumerate(fitted.folds):
        half = ("second half by the first", "first half by the second")[k]
        rows.append((f"{half}: path [m]", fold.before.path, None, fold.after.path))
        rows.append((f"{half}: heading [rad]", fold.before.heading, None, fold.after.heading))
    windows = f"{fitted.windows[1]} held-out windows; fitted on {fitted.windows[0]}"
    render.table(
        ("mean error", "before", "plain", "after"),
        rows,
        "Paths that were not used",
        f"{windows}; {fitted.before_sentence}; plain: radius and width by linear regression.",
    )


def _digits(value: float, error: float) -> str:
    """A value to the second digit of its standard error."""
    if not (isfinite(error) and error > 0.0):
        return f"{value:.4g}"
    return f"{value:.{min(max(1 - floor(log10(error)), 0), 6)}f}"
