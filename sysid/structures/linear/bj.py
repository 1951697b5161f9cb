"""BJ: Box-Jenkins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders
from sysid.structures.linear.polynomial import PolynomialStructure


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
    by_default: ClassVar[bool] = True
    stable_by_meaning: ClassVar[bool] = True
    search_cost: ClassVar[float] = 4.0

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders, each with noise of order 1 and 2."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": n, "nc": k, "nd": k, "nf": n} for n in sizes for k in (1, 2)]
