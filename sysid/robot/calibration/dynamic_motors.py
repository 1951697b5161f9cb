"""Motor parameters for the fit of a vehicle with mass: from a bench, or partly unknown."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.data.yaml_files.source import read_yaml
from sysid.errors import ModelError, UsageError
from sysid.fitting.differences import propagated
from sysid.structures.grey_box.dc_motor.structure import DCMotor
from sysid.structures.model import Model
from sysid.vehicle.motors import Bench, Motor

FIELDS = ("torque", "damping", "inertia", "friction")
"""The motors' numbers that a bench leaves uncertain."""

SHARED = 0.05
"""Inertia of a body over the motors' own up to which a model counts as one of lifted tracks:
estimates from lifted tracks scatter by some hundredths, a body on the ground adds tenths."""

SUPPLY = 7.5
"""Voltage that full drive puts on the motors [V] (thesis, §5.2), where nothing else is said."""


@dataclass(frozen=True)
class KnownMotors:
    """Motors as far as they are known before the vehicle drives.

    Attributes:
        motors: left and right; their drive counts in ``unit``.
        unit: V, µs, or empty for the unit of the log's command, whatever that is.
        spreads: standard errors of ``FIELDS`` over their values, (4,).
        complete: whether damping and inertia are known; else only the torque is.
    """

    motors: tuple[Motor, Motor]
    unit: str
    spreads: tuple[float, ...] = (0.0,) * 4
    complete: bool = True

    def counting_in(self, unit: str, largest: float) -> tuple[Motor, Motor]:
        """The motors with the drive in the unit of a log's commands.

        Args:
            unit: of the commands; none is taken for the motors' own.
            largest: of the commands: up to 1 without a unit they may be shares of full drive.
        """
        if self.unit in ("", unit) or (not unit and largest > 1.0):
            return self.motors
        scale = {("V", "µs"): SUPPLY / PWM_FULL_SCALE, ("µs", "V"): PWM_FULL_SCALE / SUPPLY}
        factor = scale.get((self.unit, unit))
        if factor is None:
            raise UsageError(
                f"the motors are driven in {self.unit} and the log's commands are in "
                f"{unit or 'no unit'}: give their unit (`units`), or the torque constant, the "
                "torque at the wheel per unit of the command"
            )
        left, right = (
            m._replace(torque=m.torque * factor, limit=m.limit / factor, offset=m.offset / factor)
            for m in self.motors
        )
        return left, right


def torque_only(per_unit: float) -> KnownMotors:
    """Motors of which a torque per unit of the command (or current) is known [Nm]."""
    if not (np.isfinite(per_unit) and per_unit > 0.0):
        raise UsageError(
            f"the torque constant is {per_unit}: give the torque at the wheel [Nm] for one unit of "
            "the command or current, above 0"
        )
    motor = Motor(per_unit, 1.0, 1.0, 0.0)
    return KnownMotors((motor, motor), "", complete=False)


def motors_of_model(model: Model) -> KnownMotors:
    """The motors of a dc-motor model that was identified with the tracks lifted, or on a bench."""
    m = model.structure
    physics = m.physics if isinstance(m, DCMotor) else None
    source = physics.torque_source(model.theta) if physics else None
    if physics is None or source is None:
        raise ModelError(
            "the model has speeds and no torque; give a dc-motor of `sysid bench motor`, or one "
            "identified with the tracks lifted and its torque_constant"
        )
    if source.body > SHARED:
        raise ModelError(
            "the motors were identified from a log driven on the ground, which already contains "
            "the vehicle's mass and friction: identify them with the tracks lifted"
        )
    left, right = source.motors[0], source.motors[-1]

    def numbers(theta: Array) -> Array:
        torque = physics.torque_source(theta)
        assert torque is not None
        return np.array([float(getattr(torque.motors[0], name)) for name in FIELDS])

    variance = np.diag(model.covariance)
    known = np.isfinite(variance) & (variance > 0.0)
    covariance = np.where(np.isfinite(model.covariance), model.covariance, 0.0)
    steps = np.where(known, 0.1 * np.sqrt(np.where(known, variance, 0.0)), 0.0)
    errors = propagated(numbers, model.theta, covariance, steps)
    return KnownMotors((left, right), model.inputs[0].unit, _over(errors, numbers(model.theta)))


def read_motors(path: Path) -> KnownMotors:
    """Motors from a YAML file of bench constants, each a number or [number, standard error].

    ``resistance``, ``back_emf``, ``torque_constant``, ``viscous``, ``inertia``, ``friction`` (on
    the motor's side of the gear) and ``gear``; what is left out is the thesis's.
    """
    source = read_yaml(path)
    values: dict[str, float] = {}
    errors: dict[str, float] = {}
    for name, entry in source.values.items():
        where = source.where((name,))
        if name not in Bench._fields:
            known = ", ".join(Bench._fields)
            raise UsageError(f"{where}: {name!r} is not a motor constant; choose from {known}")
        both = entry if isinstance(entry, list) else [entry, 0.0]
        if len(both) != 2 or not all(_number(v) and v >= 0.0 for v in both) or both[0] == 0.0:
            raise UsageError(
                f"{where}: {name} is {entry!r}: give a number above 0, or [number, standard error]"
            )
        values[name], errors[name] = float(both[0]), float(both[1])
    return motors_of_bench(Bench(**values), errors)


def motors_of_bench(bench: Bench, errors: Mapping[str, float]) -> KnownMotors:
    """Both motors of one set of bench constants and their standard errors."""
    changed = np.array([errors.get(name, 0.0) for name in Bench._fields])

    def numbers(constants: Array) -> Array:
        motor = Bench(*constants.tolist()).motor(1.0)
        return np.array([getattr(motor, name) for name in FIELDS])

    here = np.array(bench)
    error = propagated(numbers, here, np.diag(changed**2), changed)
    motor = bench.motor(1.0)
    return KnownMotors((motor, motor), "V", _over(error, numbers(here)))


def _over(errors: Array, values: Array) -> tuple[float, ...]:
    return tuple((errors / np.where(values > 0.0, values, 1.0)).tolist())


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
