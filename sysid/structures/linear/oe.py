"""OE: output error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import denominator_orders, numerators
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class OE(PolynomialStructure):
    """y(t) = B(q)/F(q) u(t) + e(t) (Ljung 1999, eq. 4.25; thesis 3.21)."""

    name: ClassVar[str] = "oe"
    traits: ClassVar[Traits] = linear_traits(
        title="OE: output error",
        equation="y(t) = B(q)/F(q) u(t) + e(t)",
        when="a model to simulate with: sensor noise only, e.g. encoders; no noise model",
        order_names=("nb", "nf", "nk"),
        has_noise_model=False,
        stable_by_meaning=True,
        by_default=True,
        search_cost=2.0,
    )
    letters: ClassVar[str] = "bf"

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        """Low orders, numerators about as long as denominators."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": nb, "nf": n} for n in sizes for nb in numerators(n)]
