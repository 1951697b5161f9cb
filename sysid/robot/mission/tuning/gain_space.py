"""The search space of gains: names, bounds, and the unit cube that they map to."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.robot.mission.contracts import Controller
from sysid.robot.mission.settings import TunedSettings

SPAN = 1e3
"""Where a gain may be 0, its smallest other value is this many times below its largest: a smaller
one does nothing within a mission."""

ZERO = 0.1
"""Share of the cube that stands for 0 where a gain may be 0: one set in ten goes without it."""

DIGITS = 3
"""Digits of a gain: the displayed, written and simulated gain are equal, and none of the criteria
sees a thousandth of a gain."""


@dataclass(frozen=True, eq=False)
class GainSpace:
    """Sets of gains as points of a unit cube, equal distances for equal factors.

    Attributes:
        names: of the gains, as the controller calls them.
        low, high: bounds, (g,).
    """

    names: tuple[str, ...]
    low: Array
    high: Array

    @classmethod
    def of(cls, control: Controller) -> "GainSpace":
        """The gains of a controller."""
        gains: Mapping[str, tuple[float, float]] = (
            control.gains if isinstance(control, TunedSettings) else {}
        )
        if not gains:
            raise UsageError(
                f"the controller {type(control).__name__} marks none of its keys as a gain to be "
                "tuned: choose another kind of controller, or mark its keys with Search(low, high)"
            )
        bounds = np.array(list(gains.values()), dtype=np.float64)
        return cls(tuple(gains), bounds[:, 0], bounds[:, 1])

    def values(self, points: Array) -> Array:
        """Gains (K, g) of points (K, g) of the cube.

        Between their bounds gains are spread in the logarithm; a lower bound of 0 takes the share
        :data:`ZERO` of the cube.
        """
        free = self.low == 0.0
        share = np.where(free, (points - ZERO) / (1.0 - ZERO), points)
        lowest = np.where(free, self.high / SPAN, self.low)
        gains = lowest * (self.high / lowest) ** np.maximum(share, 0.0)
        kept = np.clip(rounded(gains), self.low, self.high)
        return np.asarray(np.where(free & (points < ZERO), 0.0, kept))

    def points(self, values: Array) -> Array:
        """Points (K, g) of gains (K, g); gains outside their bounds count as on them."""
        free = self.low == 0.0
        lowest = np.where(free, self.high / SPAN, self.low)
        share = np.log(np.maximum(values, lowest) / lowest) / np.log(self.high / lowest)
        inside = np.clip(np.where(free, ZERO + (1.0 - ZERO) * share, share), 0.0, 1.0)
        return np.asarray(np.where(free & (values < lowest), 0.5 * ZERO, inside))

    def named(self, values: Array) -> dict[str, float]:
        """One set, by name."""
        return dict(zip(self.names, (float(v) for v in values), strict=True))

    def of_controller(self, control: TunedSettings) -> Array:
        """The gains that a controller has, (g,)."""
        return np.array([gain_of(control, name) for name in self.names], dtype=np.float64)


def gain_of(control: object, name: str) -> float:
    """One gain of a controller: ``kp_yaw``, or ``yaw.kp`` of the law of an axis."""
    value: object = control
    for part in name.split("."):
        value = getattr(value, part)
    return float(value)  # type: ignore[arg-type]


def rounded(values: Array) -> Array:
    """Numbers with :data:`DIGITS` digits."""
    return np.array([float(f"{v:.{DIGITS}g}") for v in values.ravel()]).reshape(values.shape)
