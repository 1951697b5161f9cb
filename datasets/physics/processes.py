"""Slow processes that are no drives: a heater and two tanks, by their balances and RK4."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
RADIATION = 5.67e-8
"""Stefan and Boltzmann's constant [W/(m² K⁴)]."""


@dataclass(frozen=True)
class Heater:
    """A plate that is heated electrically, its thermometer in a sheath."""

    watts: float = 60.0
    capacity: float = 250.0
    """[J/K]."""
    loss: float = 0.9
    """To the air [W/K]."""
    radiating: float = 0.0
    """Area that radiates [m²]."""
    sheath: float = 0.0
    """Time constant of the thermometer [s]."""
    late: float = 0.0
    """Transport of the command's effect [s]."""
    fuse: float = 1.0
    """Largest share of the power."""
    air: float = 20.0
    """[°C]."""
    volts: float = 24.0
    """Full command: the power is in proportion to the command, by a chopper."""

    def run(self, command: Array, dt: float) -> Array:
        """Temperature read [°C] at each row, the command (0 … 1) held; shape (N, 1)."""
        sheath, area = self.sheath, self.radiating
        air = self.air + 273.15

        def rates(x: Array, u: float) -> Array:
            hot = x[0] + air
            out = self.loss * x[0] + area * RADIATION * (hot**4 - air**4)
            follows = (x[0] - x[1]) / sheath if sheath > 0.0 else 0.0
            return np.array([(self.watts * min(u, self.fuse) - out) / self.capacity, follows])

        made = _run(rates, _late(command[:, 0], self.late, dt), dt, np.zeros(2))
        return made[:, [1 if sheath > 0.0 else 0]] + self.air


@dataclass(frozen=True)
class Tanks:
    """Two tanks one above the other: a pump fills the first, each drains by its own level."""

    area: float = 0.015
    """Of each [m²]."""
    hole: float = 3e-5
    """[m²]."""
    pump: float = 5e-5
    """At full command [m³/s]."""
    volts: float = 12.0
    """Full command."""

    def run(self, command: Array, dt: float) -> Array:
        """Level of the lower tank [cm]; shape (N, 1)."""

        def rates(x: Array, u: float) -> Array:
            out = self.hole * np.sqrt(2.0 * GRAVITY * np.maximum(x, 0.0))
            return np.array([self.pump * u - out[0], out[0] - out[1]]) / self.area

        return 100.0 * _run(rates, command[:, 0], dt, np.zeros(2))[:, [1]]


Process = Heater | Tanks


def _late(command: Array, late: float, dt: float) -> Array:
    """The command as it acts, evaluated at rows: a transport of whole and partial rows."""
    rows = np.arange(len(command)) - late / dt
    return np.where(rows < 0.0, 0.0, command[np.maximum(np.floor(rows + 1e-9), 0).astype(int)])


def _run(rates: Callable[[Array, float], Array], command: Array, dt: float, x: Array) -> Array:
    """RK4 with four steps a row."""
    parts = 4
    h, out = dt / parts, np.empty((len(command), len(x)))
    for k, u in enumerate(command):
        out[k] = x
        for _ in range(parts):
            k1 = rates(x, u)
            k2 = rates(x + 0.5 * h * k1, u)
            k3 = rates(x + 0.5 * h * k2, u)
            k4 = rates(x + h * k3, u)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out
