"""A robot's path, estimated from a log of its sensors by the navigation of a mission."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.logs.sensor_log import SensorLog, Wanted, read_sensor_log
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import DataError
from sysid.robot.mission.contracts import NavigationInputs, Pose, Reporting, Scene
from sysid.robot.mission.navigation.consistency import POSE, mean_nees, mean_nis
from sysid.robot.mission.registry import law
from sysid.robot.mission.spec import Mission
from sysid.vehicle.kinematics import wrap_angle

MEASUREMENTS = (
    Wanted("omega_l", "rad/s", "speed", "left"),
    Wanted("omega_r", "rad/s", "speed", "right"),
    Wanted("ticks_l", ""),
    Wanted("ticks_r", ""),
    Wanted("gyro_z", "rad/s"),
    Wanted("acc_x", "m/s^2"),
    Wanted("acc_y", "m/s^2"),
    Wanted("mag_x", ""),
    Wanted("mag_y", ""),
    Wanted("vo_x", "m"),
    Wanted("vo_y", "m"),
    Wanted("vo_psi", "rad"),
    Wanted("fix_x", "m"),
    Wanted("fix_y", "m"),
)
"""What the sensors of a robot read; a magnetometer gives a direction only."""

DRIVES = (Wanted("pwm_l", "µs", "command", "left"), Wanted("pwm_r", "µs", "command", "right"))

OPPOSITE = 0.5
"""A gyroscope and wheels that are this much correlated speak of one motion: slip and noise lower
the correlation, other signs come from a sensor turned over."""

ESTIMATE = ("x_est", "y_est", "psi_est", "v_est", "yaw_rate_est")


@dataclass(frozen=True, eq=False)
class Localization:
    """The pose over time as navigation sees it.

    Attributes:
        columns: ``t``, the estimate and what the law reports, by name, (N,) each.
        consistency: ``nis_mean``, ``nis_bounds``, and where the log holds the true pose
            ``nees_mean``, ``nees_bounds`` of the position and ``nees_heading_…`` of the heading;
            empty where the law reports no covariance.
        errors: of the estimate where the log holds the true pose: ``position_rms_m``,
            ``position_end_m``, ``heading_rms_rad``, ``heading_end_rad``; empty elsewhere.
    """

    log: SensorLog
    columns: Mapping[str, Array]
    used: tuple[str, ...]
    consistency: Mapping[str, Any]
    errors: Mapping[str, float]
    notes: tuple[str, ...]


def localize(
    path: str | Path,
    mission: Mission,
    columns: Mapping[str, str] | None = None,
    options: ReadOptions | None = None,
) -> Localization:
    """Run the navigation of a mission over a log.

    The first pose is the log's own where it has one (the truth that errors are counted against),
    else the mission's start.

    Args:
        path: log with the wheel speeds and with columns of sensors.
        columns: reading → column, where the names differ; ``-column`` where its sign does.

    Raises:
        DataError: the log cannot be read, or holds no wheel speed and no sensor.
        UsageError: a column or unit named is not there.
    """
    return localize_log(read_sensors(path, columns, options), mission)


def read_sensors(
    path: str | Path,
    columns: Mapping[str, str] | None = None,
    options: ReadOptions | None = None,
) -> SensorLog:
    """The measurements and commands of a log; as for :func:`localize`."""
    return read_sensor_log(path, (*MEASUREMENTS, *DRIVES), columns, options)


def localize_log(log: SensorLog, mission: Mission) -> Localization:
    """As :func:`localize`, of a log that has been read."""
    scene, notes = scene_of(log, mission)
    navigation = mission.navigation
    state = navigation.start(scene, np)
    rows: list[tuple[float, ...]] = []
    reads = {n: v for n, v in log.measurements.items() if not n.startswith("pwm_")}
    for name in ("omega_l", "omega_r"):
        reads.setdefault(name, np.full(len(log.t), np.nan))
    drive = _drives(log)
    steps = np.diff(log.t, prepend=log.t[0])
    reporting = navigation if isinstance(navigation, Reporting) else None
    names = list(reads)
    table = np.column_stack([reads[n] for n in names]).tolist()
    for t, dt, read, command in zip(log.t.tolist(), steps.tolist(), table, drive, strict=True):
        seen = NavigationInputs(t, dict(zip(names, read, strict=True)), scene, command)
        state, body = navigation.step(state, seen, dt, np)
        row = t, *body.pose, body.speed, body.yaw_rate
        rows.append(row if reporting is None else (*row, *reporting.report(state, np)))
    added = () if reporting is None else reporting.columns
    values = np.array(rows)
    columns = {n: values[:, k] for k, n in enumerate(("t", *ESTIMATE, *added))}
    _check(columns, log)
    return Localization(
        log=log,
        columns=columns,
        used=tuple(n for n in names if np.isfinite(reads[n]).any()),
        consistency=_consistency(columns, log.pose),
        errors={} if log.pose is None else _errors(columns, log.pose),
        notes=(*notes, *_turned_over(log)),
    )


def _turned_over(log: SensorLog) -> tuple[str, ...]:
    """Whether the gyroscope says the opposite of the wheels, as one mounted upside down does."""
    if not {"gyro_z", "omega_l", "omega_r"} <= log.measurements.keys():
        return ()
    turning = log.measurements["omega_r"] - log.measurements["omega_l"]
    gyro = log.measurements["gyro_z"]
    both = np.isfinite(turning) & np.isfinite(gyro)
    if min(len(np.unique(x[both])) for x in (turning, gyro)) < 2:
        return ()
    alike = float(np.corrcoef(turning[both], gyro[both])[0, 1])
    if alike > -OPPOSITE:
        return ()
    return (
        f"gyro_z turns against the wheels (correlation {alike:.2f}), as an upside-down sensor "
        "does; put a minus before its column.",
    )


def scene_of(log: SensorLog, mission: Mission) -> tuple[Scene, tuple[str, ...]]:
    """The mission's scene with the log's clock and first pose, and what was assumed."""
    scene = mission.scene()._replace(dt=float(np.median(np.diff(log.t))))
    notes = []
    if log.pose is not None:
        first = Pose(*log.pose[0].tolist())
        if max(abs(a - b) for a, b in zip(first, scene.start, strict=True)) > 1e-9:
            x, y, psi = first
            notes.append(
                f"The estimate starts in the log's first pose ({x:.3g}, {y:.3g}, {psi:.3g})."
            )
        scene = scene._replace(start=first)
    read = {n for n in log.measurements if np.isfinite(log.measurements[n]).any()}
    kept = {k: s for k, s in scene.sensors.items() if read & set(s.names)}
    if {"omega_l", "omega_r"} <= read and "encoders" not in kept:
        kept = {"encoders": law("sensors", {"kind": "encoders"}), **kept}
        notes.append(
            "The mission lists no encoders, so default encoders are assumed for the wheel speeds."
        )
    missing = [k for k in scene.sensors if k not in kept]
    if missing:
        notes.append(f"The log has no {', '.join(missing)}; the filter runs without.")
    return scene._replace(sensors=kept), tuple(notes)


def _drives(log: SensorLog) -> list[tuple[float, float]]:
    """The command held before each row [drive]; none where the log has no commands."""
    pwm = [log.measurements[w.name] for w in DRIVES if w.name in log.measurements]
    if len(pwm) < len(DRIVES):
        return [(0.0, 0.0)] * len(log.t)
    commands = np.nan_to_num(np.column_stack(pwm)) / PWM_FULL_SCALE
    before = np.vstack([np.zeros(2), commands[:-1]])
    return [(left, right) for left, right in before.tolist()]


def _check(columns: Mapping[str, Array], log: SensorLog) -> None:
    for name in ESTIMATE[:3]:
        lost = np.flatnonzero(np.logical_not(np.isfinite(columns[name])))
        if len(lost):
            raise DataError(
                f"{log.name}: the estimate diverges at t = {log.t[lost[0]]:g} s: a measurement is "
                "missing there; fill it, or choose a filter that does not need it"
            )


def _errors(columns: Mapping[str, Array], pose: Array) -> dict[str, float]:
    known = np.isfinite(pose).all(axis=1)
    distance = np.hypot(columns["x_est"] - pose[:, 0], columns["y_est"] - pose[:, 1])[known]
    angle = wrap_angle((columns["psi_est"] - pose[:, 2])[known])
    return {
        "position_rms_m": float(np.sqrt(np.mean(distance**2))),
        "position_end_m": float(distance[-1]),
        "heading_rms_rad": float(np.sqrt(np.mean(angle**2))),
        "heading_end_rad": float(abs(angle[-1])),
    }


def _consistency(columns: Mapping[str, Array], pose: Array | None) -> dict[str, Any]:
    """NIS and NEES over the run, with the 95 % bounds in which a filter that is right keeps them.

    NIS: the innovations of a right filter are independent, so that their sum is χ² of all
        measurements.
    NEES: the error of the position, (x̂ − x)ᵀP⁻¹(x̂ − x), is χ² of 2 at each instant, that of the
    heading, (ψ̂ − ψ)²/P_ψ, of 1; but errors of one run are like each other over time: as many of
    them count as are independent.
    """
    if "nis" not in columns:
        return {}
    run = {**columns, **({} if pose is None else dict(zip(POSE, pose.T, strict=True)))}
    came = columns["nis_dof"] > 0
    read = float(columns["nis_dof"][came].mean()) if came.any() else 0.0
    facts: dict[str, Any] = {}
    for name, size, mean in (
        ("nis", read, mean_nis([run], 0.95)),
        ("nees", 2.0, mean_nees([run], POSE[:2], 0.95)),
        ("nees_heading", 1.0, mean_nees([run], POSE[2:], 0.95)),
    ):
        facts[f"{name}_mean"] = None if mean is None else size * mean.mean
        facts[f"{name}_bounds"] = None if mean is None else [size * b for b in mean.bounds]
    return facts
