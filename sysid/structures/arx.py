"""ARX: linear difference equation."""

from dataclasses import dataclass
from typing import ClassVar

from sysid.structures.polynomial import PolynomialStructure


@dataclass(frozen=True)
class ARX(PolynomialStructure):
    """A(q) y(t) = B(q) u(t) + e(t) (Ljung 1999, eq. 4.7; thesis 3.17)."""

    name: ClassVar[str] = "arx"
    title: ClassVar[str] = "ARX: linear difference equation"
    equation: ClassVar[str] = "A(q) y(t) = B(q) u(t) + e(t)"
    when: ClassVar[str] = (
        "first look at any log; the noise enters where the input does; solved directly"
    )
    order_names: ClassVar[tuple[str, ...]] = ("na", "nb", "nk")
    has_noise_model: ClassVar[bool] = True
    letters: ClassVar[str] = "ab"
