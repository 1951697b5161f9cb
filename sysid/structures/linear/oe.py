"""OE: output error."""

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
    by_default: ClassVar[bool] = True
    stable_by_meaning: ClassVar[bool] = True
    search_cost: ClassVar[float] = 2.0

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import output_error_starts

        return output_error_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Low orders, numerators about as long as denominators."""
        sizes = denominator_orders(nu, ny, samples)
        grid = [{"nb": nb, "nf": n} for n in sizes for nb in numerators(n)]
        return affordable(cls, grid, nu, ny, samples, delay)
