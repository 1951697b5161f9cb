"""ARX: linear difference equation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import arx_grid
from sysid.structures.linear.polynomial import PolynomialStructure


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

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        return arx_grid(nu, ny, samples)
