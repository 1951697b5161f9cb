"""The motion with mass, fitted to logs with a pose."""

from collections.abc import Sequence
from dataclasses import replace
from math import atan

import numpy as np

from sysid.data.column_words import left_and_right, meaning
from sysid.data.record import Array, Record
from sysid.errors import DataError
from sysid.robot.calibration.dynamic_estimate import DynamicFit, Powered
from sysid.robot.calibration.dynamic_fit import fit_dynamics
from sysid.robot.calibration.dynamic_motors import KnownMotors
from sysid.robot.calibration.dynamic_runs import LONGEST_PART, Log, Machine
from sysid.robot.calibration.trajectory import Part, Trajectories
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.motors import Motor
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

FIRM = Soil(0.0, atan(0.7), 0.01, rolling=0.03, lateral=0.4)
"""Where a search starts: a firm floor, on which rubber grips with 0.7 of the load."""

LIGHT = 0.02
"""Inertia of motors of which none is known, over what the vehicle's mass adds (at least a part of a
step over the lag): next to nothing, so that all of it counts as mass."""

FASTEST, SLOWEST = 0.5, 5.0
"""Lags between which a search starts where no motors are known: in samples, and in seconds."""


def fit_weighed(
    parts: Sequence[Part],
    start: Geometry,
    records: Sequence[Record],
    trajectories: Trajectories,
    known: Geometry,
    motors: KnownMotors | None,
) -> DynamicFit:
    """Masses and frictions from the windows of trajectories, whose records hold the commands.

    Args:
        start: lengths near those of the vehicle as it turns.
        records: in the order of the trajectories.
    """
    logs = []
    for record, trajectory, track in zip(
        records, trajectories.each, trajectories.tracks, strict=True
    ):
        command, unit = _commands(record)
        logs.append(Log(trajectory, command, track.omega, record.dt))
    size = known.B / Geometry().B
    usual = TrackedVehicle()
    vehicle = TrackedVehicle(
        known,
        contact_length=usual.contact_length * size,
        track_width=usual.track_width * size,
        mass=usual.mass * size**3,
        yaw_inertia=usual.mass * size**3 * known.B**2 / 4.0,
    )
    spreads, torque = np.zeros(4), motors is not None
    notes: tuple[str, ...] = ()
    if motors is not None and motors.complete:
        both = motors.counting_in(unit, max(float(np.abs(log.command).max()) for log in logs))
        spreads = np.array(motors.spreads)
        if motors.unit and not unit:
            notes = (f"The commands have no unit; the motors' unit is assumed: {motors.unit}.",)
            unit = motors.unit
    else:
        per_unit = None if motors is None else motors.motors[0].torque
        vehicle, motor = _guessed(vehicle, logs, per_unit)
        both = (motor, motor)
    machine = Machine(vehicle, both, FIRM)
    complete = motors is not None and motors.complete
    powered = Powered(machine, tuple(logs), spreads, torque, complete, unit, notes)
    return fit_dynamics(parts, start, powered)


def _commands(record: Record) -> tuple[Array, str]:
    """Commands or currents of the left and of the right side, (N, 2), and their unit."""
    at = left_and_right(record.input_names)
    if at is None and record.nu == 2 and not any(meaning(n).side for n in record.input_names):
        at = (0, 1)
    if at is None:
        has = ", ".join(record.input_names) or "no input"
        raise DataError(
            f"{record.name} has no commands of both motors (it has {has}). Motion dynamic needs "
            "them, such as u_l and u_r [V], pwm_l and "
            "pwm_r, or their currents (name them with `inputs`)"
        )
    if not np.isfinite(record.u[:, at]).all():
        raise DataError(
            f"{record.name} has missing commands, and motion dynamic needs all of them; fill or "
            "split the log there (`resample`)"
        )
    return record.u[:, at], record.inputs[at[0]].unit


def _guessed(
    vehicle: TrackedVehicle, logs: Sequence[Log], per_unit: float | None
) -> tuple[TrackedVehicle, Motor]:
    """Motors of which a torque is known, or nothing, and masses that go with them.

    From ω(k+1) = a ω(k) + b u(k) of the mean speed: lag T = −dt/ln a, gain K = b/(1 − a). Without a
    torque, damping is 1 and everything comes in units of it.
    """
    dt = logs[0].dt
    rows = [(log.omega.mean(axis=1), log.command.mean(axis=1)) for log in logs]
    now = np.concatenate([np.column_stack([w[:-1], u[:-1]]) for w, u in rows])
    after = np.concatenate([w[1:] for w, _ in rows])
    good = np.isfinite(now).all(axis=1) & np.isfinite(after)
    a, b = np.linalg.lstsq(now[good], after[good], rcond=None)[0]
    a = float(np.clip(a, np.exp(-1.0 / FASTEST), np.exp(-dt / SLOWEST)))
    lag, gain = -dt / np.log(a), abs(float(b)) / (1.0 - a)
    gain = gain or float(np.nanmax(np.abs(now[:, 0])) / max(np.abs(now[:, 1]).max(), 1e-12))
    damping = 1.0 if per_unit is None else per_unit / gain
    torque = gain if per_unit is None else per_unit
    r, B = vehicle.geometry.r, vehicle.geometry.B
    carried = (1.0 - LIGHT) * lag * damping
    motor = Motor(torque, damping, max(LIGHT * lag, LONGEST_PART) * damping, 0.0)
    guess = replace(vehicle, mass=2.0 * carried / r**2, yaw_inertia=0.5 * carried * (B / r) ** 2)
    return guess, motor
