"""BJ: Box-Jenkins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class BJ(PolynomialStructure):
    """y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t) (Ljung 1999, eq. 4.31; thesis 3.23)."""

    name: ClassVar[str] = "bj"
    traits: ClassVar[Traits] = linear_traits(
        title="BJ: Box-Jenkins",
        equation="y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t)",
        when="coloured sensor-side disturbances that share no dynamics with the plant",
        order_names=("nb", "nc", "nd", "nf", "nk"),
        has_noise_model=True,
        stable_by_meaning=True,
        by_default=True,
        search_cost=4.0,
    )
    letters: ClassVar[str] = "bcdf"

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders, each with noise of order 1 and 2."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": n, "nc": k, "nd": k, "nf": n} for n in sizes for k in (1, 2)]
