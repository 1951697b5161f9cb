"""OE: output error."""

from dataclasses import dataclass
from typing import ClassVar

from sysid.structures.polynomial import PolynomialStructure


@dataclass(frozen=True)
class OE(PolynomialStructure):
    """y(t) = B(q)/F(q) u(t) + e(t) (Ljung 1999, eq. 4.25; thesis 3.21)."""

    name: ClassVar[str] = "oe"
    title: ClassVar[str] = "OE: output error"
    equation: ClassVar[str] = "y(t) = B(q)/F(q) u(t) + e(t)"
    when: ClassVar[str] = (
        "a model to simulate with: sensor noise only, e.g. encoders; no noise model to hide behind"
    )
    order_names: ClassVar[tuple[str, ...]] = ("nb", "nf", "nk")
    has_noise_model: ClassVar[bool] = False
    letters: ClassVar[str] = "bf"
