"""ARX: linear difference equation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.structures.linear.candidates import arx_grid
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class ARX(PolynomialStructure):
    """A(q) y(t) = B(q) u(t) + e(t) (Ljung 1999, eq. 4.7; thesis 3.17)."""

    name: ClassVar[str] = "arx"
    traits: ClassVar[Traits] = linear_traits(
        title="ARX: linear difference equation",
        equation="A(q) y(t) = B(q) u(t) + e(t)",
        when="first look at any log; the noise enters where the input does; solved directly",
        order_names=("na", "nb", "nk"),
        has_noise_model=True,
        by_default=True,
        search_cost=0.0,
        solved_at_once=True,
    )
    letters: ClassVar[str] = "ab"

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Mapping[str, Any]]:
        return arx_grid(nu, ny, samples)
