"""How well ``fit-vehicle --motion dynamic`` weighs vehicles that it has never seen, and says so.

Vehicles and floors are drawn by chance, driven by ``tracks_on_ground`` (an integration of its own,
finer than the product's), read at 20 Hz by noisy, rounded sensors, and fitted with the motors'
numbers known.
"""

import numpy as np
from numpy.typing import NDArray
from sysid_datasets.multibody import random_schedule

from studies.runner import Study, seeds
from studies.tracks_on_ground import G, Truth, drawn, simulate
from sysid.data.record import Channel, Record
from sysid.report.markdown import table
from sysid.robot.calibration.dynamic_motion import fit_weighed
from sysid.robot.calibration.dynamic_motors import motors_of_bench
from sysid.robot.calibration.judged import whole
from sysid.robot.calibration.trajectory import trajectories_of
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.motors import Bench

STUDY = Study("dynamic_fit", "dynamic_fit.md", runs=30, first=100)

SECONDS, DT, VOLTS = 45.0, 0.05, 7.0
SPEED, PLACE, HEADING = 0.05, 0.001, 0.002
"""Standard deviations of the readings [rad/s, m, rad]."""
TICK = 0.05
"""Speeds are rounded to this [rad/s]."""


def truths(vehicle: Truth) -> dict[str, float]:
    """What a fit should find."""
    weight = vehicle.mass * G
    return {
        "mass": vehicle.mass,
        "yaw_inertia": vehicle.yaw_inertia,
        "rolling_resistance": vehicle.rolling * weight,
        "turning_resistance": 0.25 * vehicle.lateral * weight * vehicle.L,
        "thrust_stiffness": vehicle.thrust_stiffness,
        "rolling_friction": vehicle.rolling,
        "turning_friction": vehicle.lateral,
        "centre_of_mass": 0.0,
    }


def main() -> None:
    """Draw, drive, fit, and write the table; all vehicles drive side by side."""
    asked = STUDY.asked(__doc__)
    chances = [np.random.default_rng(k) for k in seeds(asked)]
    vehicles = [drawn(c) for c in chances]
    volts = np.array([random_schedule(SECONDS, DT, c, VOLTS) for c in chances])
    speeds, poses = simulate(vehicles, volts, DT)
    rows: dict[str, list[tuple[float, float, float, bool]]] = {n: [] for n in truths(vehicles[0])}
    for k, vehicle in enumerate(vehicles):
        noise = chances[k].standard_normal((len(volts[k]), 5))
        record = Record(
            volts[k],
            np.round((speeds[k] + SPEED * noise[:, :2]) / TICK) * TICK,
            DT,
            (Channel("u_l", "V"), Channel("u_r", "V")),
            (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
            poses[k] + noise[:, 2:] * np.array([PLACE, PLACE, HEADING]),
            name=f"run {k}",
        )
        trajectories = trajectories_of([record], Geometry())
        found = fit_weighed(
            whole(trajectories.each),
            Geometry(),
            [record],
            trajectories,
            Geometry(),
            motors_of_bench(Bench(), {}),
        )
        numbers = {n.name: n for n in found.numbers()}
        for name, true in truths(vehicle).items():
            n = numbers[name]
            rows[name].append((true, n.value, n.std_error, n.identifiable))
        print(k, {n: f"{v[-1][1]:.4g} of {v[-1][0]:.4g}" for n, v in rows.items()}, flush=True)
    STUDY.write(asked, report(asked.runs, {n: np.array(v, float) for n, v in rows.items()}))


def report(runs: int, rows: dict[str, NDArray[np.float64]]) -> str:
    """The page."""
    lines = []
    for name, values in rows.items():
        true, found, error, told = values.T
        size = np.where(true == 0.0, 1.0, np.abs(true))
        z = (found - true) / error
        lines.append(
            (
                name,
                f"{np.median(np.abs(found - true) / size):.2g}",
                f"{np.median(error / size):.2g}",
                f"{np.sqrt(np.mean(z**2)):.2f}",
                f"{100 * np.mean(np.abs(z) < 1.96):.0f}",
                f"{100 * np.mean(told):.0f}",
            )
        )
    heads = ("quantity", "error", "standard error", "rms z", "within 95 %", "told %")
    return (
        "# Vehicles weighed by their drives\n\n"
        f"`sysid fit-vehicle --motion dynamic` on {runs} vehicles and floors drawn by chance\n"
        "(1 to 4 kg, thrust stiffness over a decade), simulated by\n"
        "`studies/tracks_on_ground.py` in steps of 25 µs and read at 20 Hz for\n"
        f"{SECONDS:g} s each: speeds ± {SPEED} rad/s in steps of {TICK}, pose ± 1 mm and 2 mrad.\n"
        "The motors are known. Medians of errors over the truth (of the centre of mass in\n"
        "metres); a right standard error has an rms z of 1 and holds 95 % of the truths.\n"
        "\n" + table(heads, lines) + "\n"
    )


if __name__ == "__main__":
    main()
