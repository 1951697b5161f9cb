"""``sysid localize``: a robot's path from a log of its sensors."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..options import argument, command, group, option, pairs
from ..read_as import decided, show_decisions
from .law_options import NAVIGATION, LawChoice

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Array
    from sysid.robot.mission.localize import Localization


def _columns(given: Sequence[str]) -> dict[str, str]:
    return pairs(given, "--sensor", "NAME=COLUMN, as gyro_z=imu_wz", str)


def sensor_option(help: str) -> Any:
    """The option that says which column is which measurement."""
    return option("NAME=COLUMN", help, parse=_columns, kind=list[str] | None)


def sensor_reading() -> Any:
    """The options of reading a log of sensors."""
    return group(reading.Reading, "time", "ts", "units", "map", "stamps", "latency")


@command
def localize(
    log: Path = argument("LOG", "A log of the sensors: CSV, Parquet or bag."),
    mission: Path = option("M.yaml", "Mission: sensors, navigation, vehicle, start."),
    navigation: str | None = NAVIGATION(),
    sensor: dict[str, str] | None = sensor_option(
        "Column that holds a measurement (omega_l, gyro_z, mag_x, vo_x, fix_x, …)."
    ),
    read: "ReadOptions" = sensor_reading(),
    to: Path | None = option("FILE", "CSV to write [WORKSPACE/missions/NAME_localized.csv]."),
    plot: Path | None = option("FILE", "Draw the path: .svg or .png."),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Localize a robot from a log of its sensors: its path, with the uncertainty."""
    from sysid.robot.mission.localize import localize as follow
    from sysid.robot.mission.registry import kind_of
    from sysid.robot.mission.result import write_columns
    from sysid.robot.mission.spec import load_mission

    targets.check_picture(plot)
    if to is not None:
        targets.check(to, "--to")
    target = to or Workspace(workspace).missions_dir / f"{log.stem}_localized.csv"
    if target.exists() and log.exists() and target.samefile(log):
        raise UsageError(f"--to {target} would overwrite the log; name another file")
    given = LawChoice(navigation=navigation).applied(load_mission(mission))
    with render.progress(f"Following {log.name}"):
        localization = follow(log, given, sensor or {}, read)
    targets.make_folder(target, "--to")
    facts: dict[str, Any] = {
        "navigation": kind_of("navigation", given.navigation),
        "output": write_columns(localization.columns, target),
        "used": localization.used,
        "read_as": decided([localization.log]),
        "consistency": localization.consistency,
        "errors": localization.errors,
        "end": {n: float(localization.columns[f"{n}_est"][-1]) for n in ("x", "y", "psi")},
        "warnings": [*localization.notes, *(f.text for f in localization.log.findings)],
    }
    if plot is not None:
        _draw(plot, log.stem, localization)
        facts["plot"] = plot
    render.document(facts) if json else _show(log.name, facts)


def _show(name: str, facts: dict[str, Any]) -> None:
    end, errors, figures = facts["end"], facts["errors"], facts["consistency"]
    rows = [
        ("read", ", ".join(facts["used"])),
        ("ends at x, y [m]", f"{end['x']:.3f}, {end['y']:.3f}"),
        ("final heading [rad]", f"{end['psi']:.3f}"),
    ]
    if errors:
        rows += [
            ("error of the position, rms [m]", render.number(errors["position_rms_m"], 3)),
            ("error of the position, at the end [m]", render.number(errors["position_end_m"], 3)),
            ("error of the heading, rms [rad]", render.number(errors["heading_rms_rad"], 3)),
            ("error of the heading, at the end [rad]", render.number(errors["heading_end_rad"], 3)),
        ]
    for figure, words in (
        ("nis", "innovations (NIS)"),
        ("nees", "errors of the position (NEES)"),
        ("nees_heading", "errors of the heading (NEES)"),
    ):
        if figures.get(f"{figure}_mean") is not None:
            low, high = figures[f"{figure}_bounds"]
            mean = figures[f"{figure}_mean"]
            verdict = "as they should be" if low <= mean <= high else _verdict(mean > high)
            rows.append((words, f"{mean:.3g}, bounds {low:.3g} to {high:.3g}: {verdict}"))
    show_decisions(facts["read_as"])
    render.table((name, facts["navigation"]), rows)
    for warning in facts["warnings"]:
        render.warn(f"! {warning}")
    render.say(f"Estimate: {facts['output']}")
    if "plot" in facts:
        render.say(f"Picture: {facts['plot']}")


def _verdict(large: bool) -> str:
    return "larger than believed" if large else "smaller than believed"


def _draw(path: Path, name: str, localization: "Localization") -> None:
    """The estimated path with ellipses of 95 %, and the errors beside what the filter believes."""
    import numpy as np

    from sysid.report.plots import Line, Panel, ResponsePicture, write_picture

    c, pose = localization.columns, localization.log.pose
    lines = [Line("estimate", c["x_est"], c["y_est"])]
    if pose is not None:
        lines.append(Line("true", pose[:, 0], pose[:, 1], reference=True))
    panels = [Panel("path", "x [m]", "y [m]", tuple(lines), plane=True, outlines=_ellipses(c))]
    position: list[Line] = []
    heading: list[Line] = []
    if pose is not None:
        away = np.hypot(c["x_est"] - pose[:, 0], c["y_est"] - pose[:, 1])
        turned = c["psi_est"] - pose[:, 2]
        position.append(Line("error", c["t"], away))
        heading.append(Line("error", c["t"], np.abs(np.arctan2(np.sin(turned), np.cos(turned)))))
    if "P_xx" in c:
        position.append(Line("believed, 1 σ", c["t"], np.sqrt(c["P_xx"] + c["P_yy"])))
        heading.append(Line("believed, 1 σ", c["t"], np.sqrt(c["P_psi"])))
    if position:
        panels.append(Panel("error of the position", "time [s]", "[m]", tuple(position)))
        panels.append(Panel("error of the heading", "time [s]", "[rad]", tuple(heading)))
    title = f"{name}: estimated path"
    write_picture(path, ResponsePicture(title, ", ".join(localization.used), tuple(panels)))


def _ellipses(columns: "Mapping[str, Array]") -> "tuple[tuple[Array, Array], ...]":
    """Ellipses that hold the position with 95 %, at ten instants."""
    import numpy as np

    if "P_xx" not in columns:
        return ()
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.sqrt(-2.0 * np.log(0.05)) * np.array([np.cos(angle), np.sin(angle)])
    ellipses = []
    for k in np.linspace(0, len(columns["t"]) - 1, 11).astype(int)[1:]:
        xx, xy, yy = (columns[n][k] for n in ("P_xx", "P_xy", "P_yy"))
        size, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        x, y = axes @ (np.sqrt(np.maximum(size, 0.0))[:, None] * circle)
        ellipses.append((columns["x_est"][k] + x, columns["y_est"][k] + y))
    return tuple(ellipses)
