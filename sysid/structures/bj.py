"""BJ: Box-Jenkins."""

from dataclasses import dataclass
from typing import ClassVar

from sysid.structures.polynomial import PolynomialStructure


@dataclass(frozen=True)
class BJ(PolynomialStructure):
    """y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t) (Ljung 1999, eq. 4.31; thesis 3.23)."""

    name: ClassVar[str] = "bj"
    title: ClassVar[str] = "BJ: Box-Jenkins"
    equation: ClassVar[str] = "y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t)"
    when: ClassVar[str] = "coloured sensor-side disturbances that share no dynamics with the plant"
    order_names: ClassVar[tuple[str, ...]] = ("nb", "nc", "nd", "nf", "nk")
    has_noise_model: ClassVar[bool] = True
    letters: ClassVar[str] = "bcdf"
