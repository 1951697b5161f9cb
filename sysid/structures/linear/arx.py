"""ARX: linear difference equation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data.record import Record
from sysid.fitting.problem import Focus
from sysid.structures.linear.candidates import affordable, arx_grid
from sysid.structures.linear.polynomial import PolynomialStructure

if TYPE_CHECKING:
    from sysid.structures.outcome import Fitter, Warm


@dataclass(frozen=True)
class ARX(PolynomialStructure):
    """A(q) y(t) = B(q) u(t) + e(t) (Ljung 1999, eq. 4.7; thesis 3.17)."""

    name: ClassVar[str] = "arx"
    title: ClassVar[str] = "ARX: linear difference equation"
    equation: ClassVar[str] = "A(q) y(t) = B(q) u(t) + e(t)"
    when: ClassVar[str] = (
        "first look at any log; the noise enters where the input does; solved directly"
    )
    order_names: ClassVar[tuple[str, ...]] = ("na", "nb", "nk")
    has_noise_model: ClassVar[bool] = True
    letters: ClassVar[str] = "ab"
    by_default: ClassVar[bool] = True
    search_cost: ClassVar[float] = 0.0
    solved_at_once: ClassVar[bool] = True

    def fitter(self) -> "Fitter":
        """By linear algebra where the problem is linear."""
        from sysid.structures.linear.closed_form import fit

        return fit

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import arx_starts

        return arx_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Every pair of low orders."""
        return affordable(cls, arx_grid(nu, ny, samples), nu, ny, samples, delay)
