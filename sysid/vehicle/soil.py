"""Soils: what the ground can bear and how it yields."""

import math
from dataclasses import dataclass
from enum import StrEnum

from sysid.errors import ModelError


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

    Attributes:
        cohesion: c [Pa].
        friction_angle: φ, angle of internal shearing resistance [rad].
        shear_modulus: K of (2.28), K_max of (2.29) and (2.30): shear displacement [m].
        shear: law of shear stress against shear displacement.
        residual: K_r of (2.30), residual over largest shear stress [1].
        rolling: μr, rolling resistance over load (2.34) [1].
        lateral: μl, lateral friction over load (2.35, 2.36) [1].
        n, k_c, k_phi: Bekker's p = (k_c/b + k_φ) zⁿ: exponent [1], [N/m^(n+1)], [N/m^(n+2)];
            k_phi of infinity is ground that does not give way.
        source: where the numbers are from.

    Raises:
        ModelError: a number is impossible.
    """

    cohesion: float
    friction_angle: float
    shear_modulus: float
    shear: Shear = Shear.JANOSI
    residual: float = 1.0
    rolling: float = 0.05
    lateral: float = 0.5
    n: float = 1.0
    k_c: float = 0.0
    k_phi: float = math.inf
    source: str = ""

    def __post_init__(self) -> None:
        limits = (
            ("cohesion", 0.0, math.inf),
            ("rolling", 0.0, math.inf),
            ("lateral", 0.0, math.inf),
            ("friction_angle", 0.0, 0.5 * math.pi),
            ("k_c", 0.0, math.inf),
        )
        for name, low, high in limits:
            value = getattr(self, name)
            if not low <= value < high:
                raise ModelError(f"the soil's {name} is {value}: give at least {low:g}")
        for name in ("shear_modulus", "n", "k_phi"):
            if not getattr(self, name) > 0:
                raise ModelError(f"the soil's {name} is {getattr(self, name)}: give more than 0")
        if not 0.0 < self.residual <= 1.0:
            raise ModelError(f"the soil's residual is {self.residual}: give a share in (0, 1]")

    @property
    def friction(self) -> float:
        """tan φ: largest shear stress over normal stress, without cohesion [1]."""
        return math.tan(self.friction_angle)
