"""What ``fit-vehicle`` makes of real robots, of a rigid body on dry friction, and of its own model.

Real logs are those of ``records.data_folder``; without them their tables are left out.
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from studies.records import data_folder
from studies.runner import ROOT, Study, by_case

sys.path.insert(0, str(ROOT / "tests"))

from skid_steer_logs import Skid, columns, wheels

from studies.skid_steer_physics import Vehicle, log_of
from sysid.data.preparation import Preparation
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Channel, Record
from sysid.report.markdown import table
from sysid.robot.calibration.logs import read_vehicle_logs
from sysid.robot.calibration.vehicle_fit import VehicleFit, fit_vehicle
from sysid.vehicle.kinematics import Geometry

STUDY = Study("vehicle", "vehicle_on_data.md", runs=20)

ROBOTS = (
    ("Husky, mixed ground", "husky_2023_longest.csv", Geometry(0.165, 0.55)),
    ("Warthog, asphalt", "warthog_asphalt_slow_2024_8_8_longest.csv", Geometry(0.30, 1.08)),
    ("Warthog, gravel", "warthog_gravel_2024_8_6_longest.csv", Geometry(0.30, 1.08)),
)
GROUNDS = (
    ("gravel, μ = 0.6", Vehicle()),
    ("snow, μ = 0.25", Vehicle(friction=0.25)),
    ("ice, μ = 0.08", Vehicle(friction=0.08, soft=0.05, fastest=10.0)),
)
MADE = {
    "plain": Skid((0.15, 0.152), 0.9, (0.12, -0.05), 0.03, 0.137, 0.061),
    "slip in turns": Skid((0.15, 0.152), 0.9, (0.12, -0.05), 0.03, 0.137, 0.137, slip_turning=0.2),
    "slip under load": Skid((0.15, 0.152), 0.9, (0.1, 0.0), 0.0, 0.1, 0.1, slip_load=0.25),
}
SHOWN = (
    *("radius_left", "radius_right", "effective_width", "marker_x", "marker_y", "heading_offset"),
    *("pose_lag", "heading_lag", "slip_turning", "slip_speed", "slip_load", "side_slip", "yaw_lag"),
    *("width_ratio", "turning_ratio"),
)

HEAD = """# The vehicle on real robots

The vehicle is fitted to the first 70 % of each log and judged on the last 30 %: mean error of
position and heading after two seconds. *Before* is wheels that roll with the lengths of the data
sheet; *plain* one radius and one width from a line through the windows; *after* what `sysid
fit-vehicle` found. A dash: not in the model.

"""


def main() -> None:
    """Run every part and write the page."""
    asked = STUDY.asked(__doc__)
    text = HEAD + _real() + _physics() + _coverage(by_case(one, list(MADE), asked))
    STUDY.write(asked, text)


def _errors(name: str, f: VehicleFit) -> list[str]:
    before, after = f.drift
    return [
        name,
        f"{f.before.path:.3f}, {f.plain.path:.3f}, {f.after.path:.3f}",
        f"{100 * (1 - f.after.path / f.before.path):.0f} %",
        f"{f.before.heading:.3f}, {f.plain.heading:.3f}, {f.after.heading:.3f}",
        f"{100 * (1 - f.after.heading / f.before.heading):.0f} %",
        f"{before.per_metre:.2f} → {after.per_metre:.2f}",
        f"{before.per_turn:.2f} → {after.per_turn:.2f}",
    ]


HEADINGS = (
    "log",
    "position [m]: before, plain, after",
    "less",
    "heading [rad]: before, plain, after",
    "less",
    "drift [m/m]",
    "drift [rad/turn]",
)


def _numbers(fits: dict[str, VehicleFit]) -> str:
    rows = []
    for name in SHOWN:
        cells = []
        for f in fits.values():
            n = next((n for n in f.numbers if n.name == name), None)
            shown = n is not None and n.in_model
            cells.append(f"{n.value:.4g} ± {n.std_error:.2g}" if n is not None and shown else "–")
        rows.append([name, *cells])
    return table(["quantity", *fits], rows)


def _real() -> str:
    folder = data_folder()
    if folder is None:
        return "## Real logs\n\nNot there when this page was made.\n\n"
    fits = {}
    for name, file, geometry in ROBOTS:
        records, _ = read_vehicle_logs([folder / "drive" / file], ReadOptions(), Preparation())
        fits[name] = fit_vehicle(records, geometry=geometry)
    folds = [
        [name, *(f"{f.before.path:.3f} → {f.after.path:.3f} m, "
                 f"{f.before.heading:.3f} → {f.after.heading:.3f} rad" for f in fit.folds)]
        for name, fit in fits.items()
    ]  # fmt: skip
    return (
        "## Real logs\n\nLidar poses of norlab-ulaval/DRIVE, which come every 0.1 to 0.8 s.\n\n"
        + table(list(HEADINGS), [_errors(n, f) for n, f in fits.items()])
        + "\n\n"
        + _numbers(fits)
        + "\n\nHalves that judge each other:\n\n"
        + table(["log", "second half by the first", "first half by the second"], folds)
        + "\n\n"
    )


def _physics() -> str:
    fits = {
        name: fit_vehicle([log_of(v, name)], geometry=Geometry(v.radius, 2.0 * v.half_width))
        for name, v in GROUNDS
    }
    return (
        "## A rigid body on dry friction\n\nFour wheels that slide (`studies/"
        "skid_steer_physics.py`), a pose that is 0.3 s late and comes every 0.25 s, its point "
        "0.2 m ahead of the centre. It holds no number of the model but these and the radius.\n\n"
        + table(list(HEADINGS), [_errors(n, f) for n, f in fits.items()])
        + "\n\n"
        + _numbers(fits)
        + "\n\nOn ice the body cannot follow its wheels: that is no lag of the pose but looks like "
        "one, and `pose_lag` says so.\n\n"
    )


def one(name: str, seed: int) -> dict[str, Any]:
    """(found − true)/standard error by name, and whether just the terms that act were taken."""
    skid = MADE[name]
    truth = _truth(skid)
    found = fit_vehicle([_made(skid, seed)], geometry=Geometry(0.15, 0.6))
    away = {
        n.name: (n.value - truth[n.name]) / n.std_error for n in found.numbers if n.name in truth
    }
    wanted = {k for k in ("slip_turning", "slip_load") if truth[k]}
    taken = {n.name for n in found.numbers if n.in_model and n.name in SHOWN[8:13]}
    return {"away": away, "kept": taken == wanted}


def _coverage(found: dict[str, list[dict[str, Any]]]) -> str:
    rows = [_row(name, runs) for name, runs in found.items()]
    return (
        "## Standard errors\n\nMade logs of 90 s whose truth is known: how often the truth lies "
        "outside 1.96 standard errors (5 % if they are right), over all 13 numbers and for the "
        "worst of them, and how often just the optional terms that act were taken.\n\n"
        + table(["made with", "outside", "worst", "right terms"], rows)
    )


def _row(name: str, runs: Sequence[dict[str, Any]]) -> list[str]:
    outside = {k: np.mean([abs(r["away"][k]) > 1.96 for r in runs]) for k in runs[0]["away"]}
    worst = max(outside, key=lambda k: float(outside[k]))
    return [
        name,
        f"{100 * np.mean(list(outside.values())):.1f} %",
        f"{worst} ({100 * outside[worst]:.0f} %)",
        f"{sum(r['kept'] for r in runs)} of {len(runs)}",
    ]


def _made(skid: Skid, seed: int) -> Record:
    c = columns(skid, wheels(90.0, seed), seed=seed)
    speeds = np.column_stack([c["omega_l"], c["omega_r"]])
    return Record(
        speeds,
        speeds,
        0.05,
        (Channel("u_l", "rad/s"), Channel("u_r", "rad/s")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        np.column_stack([c["x"], c["y"], c["psi"]]),
        name="made",
    )


def _truth(skid: Skid) -> dict[str, float]:
    return {
        "radius_left": skid.radii[0],
        "radius_right": skid.radii[1],
        "effective_width": skid.width,
        "marker_x": skid.marker[0],
        "marker_y": skid.marker[1],
        "heading_offset": skid.offset,
        "pose_lag": skid.lag,
        "heading_lag": skid.heading_lag,
        "slip_turning": skid.slip_turning,
        "slip_speed": 0.0,
        "slip_load": skid.slip_load,
        "side_slip": 0.0,
        "yaw_lag": 0.0,
    }


if __name__ == "__main__":
    main()
