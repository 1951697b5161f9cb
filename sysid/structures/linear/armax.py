"""ARMAX: ARX with moving-average noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data.record import Record
from sysid.fitting.problem import Focus
from sysid.structures.linear.candidates import affordable, denominator_orders, numerators
from sysid.structures.linear.polynomial import PolynomialStructure

if TYPE_CHECKING:
    from sysid.structures.outcome import Warm


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

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import armax_starts

        return armax_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Low orders; the noise as long as the dynamics, or shorter."""
        grid = [
            {"na": n, "nb": nb, "nc": nc}
            for n in denominator_orders(nu, ny, samples)
            for nb in numerators(n)
            for nc in sorted({1, min(n, 2), n})
        ]
        return affordable(cls, grid, nu, ny, samples, delay)
