"""Measurements of a motor: steady-state experiments and known values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from sysid.data.record import Array


class Kind(Enum):
    """Experiments in steady state, by the columns of a file."""

    BLOCKED = "blocked rotor"
    NO_LOAD = "no load"
    STALL = "stall"
    EXTERNAL = "external load"


CONSTANTS: Mapping[str, tuple[str, str]] = {
    "R": ("Ω", "resistance of the winding"),
    "L": ("H", "inductance of the winding"),
    "Kem": ("V/(rad/s)", "back-EMF constant, motor shaft"),
    "Kc": ("Nm/A", "torque constant, motor shaft"),
    "f": ("Nm/(rad/s)", "viscous friction, motor shaft"),
    "C0": ("Nm", "dry friction, motor shaft"),
    "J": ("kg m²", "inertia of all that turns, motor shaft"),
}
"""Constants of the motor (thesis 5.2): unit and meaning."""

MEASUREMENTS: Mapping[str, str] = {"current": "A", "speed": "rad/s", "torque": "Nm"}
"""Quantities that are read at a known voltage, in SI; speed at the output shaft."""


@dataclass(frozen=True, eq=False)
class SteadyTest:
    """Measurements in steady state, one row a voltage (or load).

    Attributes:
        voltage: at the motor's leads [V], (N,).
        measurements: current [A], speed of the output shaft [rad/s], torque [Nm], (N,) each; a
            reading that was not taken is NaN.
        resolution: smallest step of each measurement, in the same units.
        motor_side: whether the torque is that of the motor's shaft, not of the output's.
    """

    name: str
    kind: Kind
    voltage: Array
    measurements: Mapping[str, Array]
    resolution: Mapping[str, float] = field(default_factory=dict)
    motor_side: bool = False

    def __len__(self) -> int:
        return len(self.voltage)

    def has(self, *quantities: str) -> bool:
        """Whether these were read in some row."""
        return all(bool(np.any(np.isfinite(self.of(q)))) for q in quantities)

    def of(self, quantity: str) -> Array:
        """A measurement, NaN in every row where the file has none, (N,)."""
        return self.measurements.get(quantity, np.full(len(self), np.nan))

    def motor_torque(self, gear: float) -> Array:
        """Torque at the motor's shaft [Nm]; 0 where none is applied, (N,)."""
        if self.kind is Kind.NO_LOAD:
            return np.zeros(len(self))
        return self.of("torque") if self.motor_side else self.of("torque") / gear

    def answers(self) -> tuple[str, ...]:
        """What was read in answer to the voltage; an external load is applied, not read."""
        applied = "torque" if self.kind is Kind.EXTERNAL else ""
        return tuple(q for q in MEASUREMENTS if q != applied and self.has(q))

    def changed(self, quantity: str, values: Array) -> "SteadyTest":
        return replace(self, measurements={**self.measurements, quantity: values})


@dataclass(frozen=True)
class KnownValue:
    """A constant that is known without a file of measurements.

    Attributes:
        name: as in ``CONSTANTS``, or ``gear``.
        value: in SI.
        std_error: its standard error; that of rounding to its last digit unless it was given.
    """

    name: str
    value: float
    std_error: float
    source: str


def rounding_error(value: float) -> float:
    """Standard error of a number that was rounded to its last printed digit: 3.1 → 0.029.

    Rounding is uniform over one unit of that digit, whose standard deviation is 1/√12 of it.
    """
    digits = f"{value:.15g}".lower()
    mantissa, _, exponent = digits.partition("e")
    decimals = len(mantissa.partition(".")[2])
    if "." not in mantissa and not exponent:
        decimals = -(len(mantissa) - len(mantissa.rstrip("0"))) if value else 0
    return float(10.0 ** (int(exponent or 0) - decimals)) / math.sqrt(12.0)


def smallest_step(values: Array) -> float:
    """The largest power of ten of which all measurements are multiples: 170, 180, 210 → 10.

    Nothing finer was read, or printed.
    """
    steps = values[np.isfinite(values) & (values != 0.0)]
    for exponent in range(6, -13, -1):
        step = 10.0**exponent
        parts = steps / step
        if len(steps) and np.all(np.abs(parts - np.round(parts)) < 1e-6 * np.abs(parts)):
            return step
    return 0.0
