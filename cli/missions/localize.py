"""``sysid localize``: a robot's path from a log of its sensors."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..options import argument, command, group, option, pairs
from ..read_as import decided, show_decisions
from .law_options import NAVIGATION, LawChoice

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions


def sensor_option(help: str) -> Any:
    """The option that says which column is which measurement."""
    return option(
        "NAME=COLUMN",
        help,
        parse=partial(pairs, option="--sensor", advice="NAME=COLUMN, as gyro_z=imu_wz", read=str),
        kind=list[str] | None,
    )


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
    output: Path | None = targets.target(
        "FILE", "CSV to write [WORKSPACE/missions/NAME_localized.csv]."
    ),
    plot: Path | None = targets.picture("Draw the path: .svg or .png."),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Localize a robot from a log of its sensors, with uncertainty."""
    from sysid.robot.mission.localize import localize as follow
    from sysid.robot.mission.registry import kind_of
    from sysid.robot.mission.result import write_columns
    from sysid.robot.mission.spec import load_mission

    target = output or Workspace(workspace).missions_dir / f"{log.stem}_localized.csv"
    if target.exists() and log.exists() and target.samefile(log):
        raise UsageError(f"-o {target} would overwrite the log; name another file")
    given = LawChoice(navigation=navigation).applied(load_mission(mission))
    with render.progress(f"Following {log.name}"):
        localization = follow(log, given, sensor or {}, read)
    targets.make_folder(target, "-o")
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
        from sysid.report.missions.drives import draw_localization

        draw_localization(plot, log.stem, localization)
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
            size = "larger" if mean > high else "smaller"
            verdict = "as they should be" if low <= mean <= high else f"{size} than believed"
            rows.append((words, f"{mean:.3g}, bounds {low:.3g} to {high:.3g}: {verdict}"))
    show_decisions(facts["read_as"])
    render.table((name, facts["navigation"]), rows)
    render.cautions(facts["warnings"])
    render.files(facts, output="Estimate", plot="Picture")
