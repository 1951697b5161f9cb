"""ARMAX: ARX with moving-average noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders, numerators
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class ARMAX(PolynomialStructure):
    """A(q) y(t) = B(q) u(t) + C(q) e(t) (Ljung 1999, eq. 4.14; thesis 3.19)."""

    name: ClassVar[str] = "armax"
    traits: ClassVar[Traits] = linear_traits(
        title="ARMAX: ARX with moving-average noise",
        equation="A(q) y(t) = B(q) u(t) + C(q) e(t)",
        when="disturbances that enter early in the process, such as load and friction changes",
        order_names=("na", "nb", "nc", "nk"),
        has_noise_model=True,
        by_default=True,
        search_cost=2.0,
    )
    letters: ClassVar[str] = "abc"

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders; the noise as long as the dynamics, or shorter."""
        return [
            {"na": n, "nb": nb, "nc": nc}
            for n in denominator_orders(nu, ny, samples)
            for nb in numerators(n)
            for nc in sorted({1, min(n, 2), n})
        ]
