"""BJ: Box-Jenkins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data.record import Record
from sysid.fitting.problem import Focus
from sysid.structures.linear.candidates import affordable, denominator_orders
from sysid.structures.linear.polynomial import PolynomialStructure

if TYPE_CHECKING:
    from sysid.structures.outcome import Warm


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

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import output_error_starts

        return output_error_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Low orders, each with noise of order 1 and 2."""
        sizes = denominator_orders(nu, ny, samples)
        grid = [{"nb": n, "nc": k, "nd": k, "nf": n} for n in sizes for k in (1, 2)]
        return affordable(cls, grid, nu, ny, samples, delay)
