"""Soils: strength and deformation of the ground."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.vehicle.kinematics import Real


class Shear(StrEnum):
    """How shear stress grows with shear displacement."""

    JANOSI = "janosi"
    """(2.28): rises to its largest value and stays there (loose sand, saturated clay, snow)."""
    HUMP = "hump"
    """(2.29): rises to a hump and falls to nothing (muskeg, a mat of vegetation)."""
    RESIDUAL = "residual"
    """(2.30): rises to a hump and falls to a residual value (compact sand, silt, loam)."""


@dataclass(frozen=True)
class Soil:
    """Ground under a track.

    A number may be an array, one value a run of a batch; what a compiled batch traces is not
    checked here, so check it before.

    Attributes:
        cohesion: c [Pa].
        friction_angle: φ, angle of internal shearing resistance [rad].
        shear_modulus: K of (2.28), K_max of (2.29) and (2.30): shear displacement [m].
        residual: K_r of (2.30), residual over largest shear stress [1].
        rolling: μr, rolling resistance over load (2.34), of the running gear alone: what compacting
            the ground takes is reckoned from n, k_c and k_phi [1].
        lateral: μl, lateral friction over load (2.35, 2.36) [1].
        n, k_c, k_phi: Bekker's p = (k_c/b + k_φ) zⁿ: exponent [1], [N/m^(n+1)], [N/m^(n+2)];
            k_phi of infinity is ground that does not give way.
        std: standard deviations of these numbers, (name, value in the unit of the number) each;
            a number that is not among them counts as exact.
    """

    cohesion: Real
    friction_angle: Real
    shear_modulus: Real
    shear: Shear = Shear.JANOSI
    residual: Real = 1.0
    rolling: Real = 0.05
    lateral: Real = 0.5
    n: Real = 1.0
    k_c: Real = 0.0
    k_phi: Real = math.inf
    std: tuple[tuple[str, float], ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("cohesion", "rolling", "lateral", "k_c"):
            _check(name, getattr(self, name), lambda v: (v >= 0.0) & (v < math.inf), "at least 0")
        for name in ("shear_modulus", "n"):
            _check(name, getattr(self, name), lambda v: (v > 0.0) & (v < math.inf), "more than 0")
        _check("k_phi", self.k_phi, lambda v: v > 0.0, "more than 0, or inf for firm ground")
        _check(
            "friction_angle",
            self.friction_angle,
            lambda v: (v >= 0.0) & (v < 0.5 * math.pi),
            "radians from 0 to below π/2",
        )
        _check(
            "residual", self.residual, lambda v: (v > 0.0) & (v <= 1.0), "a share above 0, up to 1"
        )
        listed = f"{', '.join(NUMBERS[:-1])} and {NUMBERS[-1]}"
        for name, value in self.std:
            if name not in NUMBERS:
                raise ModelError(f"the soil has no number {name}: std may name {listed}")
            _check(f"std of {name}", value, lambda v: (v >= 0.0) & (v < math.inf), "at least 0")

    @property
    def friction(self) -> float:
        """tan φ: largest shear stress over normal stress, without cohesion [1]."""
        return math.tan(self.friction_angle)


NUMBERS = (
    "cohesion",
    "friction_angle",
    "shear_modulus",
    "residual",
    "rolling",
    "lateral",
    "n",
    "k_c",
    "k_phi",
)
"""The numbers of a soil, which may have a standard deviation."""


def _check(name: str, value: Any, within: Any, wanted: str) -> None:
    """Refuse a number, or an array of numbers, that is not within its limits."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.ndarray | np.floating):
        return  # traced by a compiler: it has no value yet
    if not np.all(within(value)):
        raise ModelError(f"the soil's {name} is {value}: give {wanted}")
