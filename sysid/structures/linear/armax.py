"""ARMAX: ARX with moving-average noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders, numerators
from sysid.structures.linear.polynomial import PolynomialStructure


@dataclass(frozen=True)
class ARMAX(PolynomialStructure):
    """A(q) y(t) = B(q) u(t) + C(q) e(t) (Ljung 1999, eq. 4.14; thesis 3.19)."""

    name: ClassVar[str] = "armax"
    title: ClassVar[str] = "ARMAX: ARX with moving-average noise"
    equation: ClassVar[str] = "A(q) y(t) = B(q) u(t) + C(q) e(t)"
    when: ClassVar[str] = (
        "disturbances that enter early in the process, such as load and friction changes"
    )
    order_names: ClassVar[tuple[str, ...]] = ("na", "nb", "nc", "nk")
    has_noise_model: ClassVar[bool] = True
    letters: ClassVar[str] = "abc"
    by_default: ClassVar[bool] = True
    search_cost: ClassVar[float] = 2.0

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders; the noise as long as the dynamics, or shorter."""
        return [
            {"na": n, "nb": nb, "nc": nc}
            for n in denominator_orders(nu, ny, samples)
            for nb in numerators(n)
            for nc in sorted({1, min(n, 2), n})
        ]
