"""ARMAX: ARX with moving-average noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from sysid.data.record import Record
from sysid.fitting.problem import Focus
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

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import armax_starts

        return armax_starts(self, records, focus)
