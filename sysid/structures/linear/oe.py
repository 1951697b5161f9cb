"""OE: output error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders, numerators
from sysid.structures.linear.polynomial import PolynomialStructure


@dataclass(frozen=True)
class OE(PolynomialStructure):
    """y(t) = B(q)/F(q) u(t) + e(t) (Ljung 1999, eq. 4.25; thesis 3.21)."""

    name: ClassVar[str] = "oe"
    title: ClassVar[str] = "OE: output error"
    equation: ClassVar[str] = "y(t) = B(q)/F(q) u(t) + e(t)"
    when: ClassVar[str] = (
        "a model to simulate with: sensor noise only, e.g. encoders; no noise model"
    )
    order_names: ClassVar[tuple[str, ...]] = ("nb", "nf", "nk")
    has_noise_model: ClassVar[bool] = False
    letters: ClassVar[str] = "bf"
    by_default: ClassVar[bool] = True
    stable_by_meaning: ClassVar[bool] = True
    search_cost: ClassVar[float] = 2.0

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders, numerators about as long as denominators."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": nb, "nf": n} for n in sizes for nb in numerators(n)]
