"""AR, MA and ARMA: models of a signal without inputs (thesis 3.11–3.13; Box & Jenkins 1976)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data.record import Record
from sysid.fitting.problem import Focus
from sysid.structures.linear.armax import ARMAX
from sysid.structures.linear.arx import ARX

if TYPE_CHECKING:
    from sysid.structures.outcome import Warm

HIGHEST = 8
"""Highest order of an AR tried without being asked: the disturbances of machines need less."""

HIGHEST_MIXED = 3
"""Highest order of MA and ARMA tried: beyond it A and C cancel each other."""

SAMPLES_EACH = 20
"""Samples an order needs behind it before it is tried."""


@dataclass(frozen=True)
class AR(ARX):
    """A(q) y(t) = e(t) (thesis 3.12)."""

    name: ClassVar[str] = "ar"
    title: ClassVar[str] = "AR: a signal from its own past"
    equation: ClassVar[str] = "A(q) y(t) = e(t)"
    when: ClassVar[str] = "a log without inputs: vibration, drift, a disturbance; solved directly"
    order_names: ClassVar[tuple[str, ...]] = ("na",)
    letters: ClassVar[str] = "a"
    takes_inputs: ClassVar[bool] = False
    search_cost: ClassVar[float] = 1.0
    solved_at_once: ClassVar[bool] = False

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Orders 1 to 8, as far as the samples bear them."""
        return tuple({"na": n} for n in range(1, _bearable(HIGHEST, samples) + 1))


@dataclass(frozen=True)
class MA(ARMAX):
    """y(t) = C(q) e(t) (thesis 3.11)."""

    name: ClassVar[str] = "ma"
    title: ClassVar[str] = "MA: a moving average of white noise"
    equation: ClassVar[str] = "y(t) = C(q) e(t)"
    when: ClassVar[str] = "a log without inputs whose signal forgets within a few samples"
    order_names: ClassVar[tuple[str, ...]] = ("nc",)
    letters: ClassVar[str] = "c"
    takes_inputs: ClassVar[bool] = False
    search_cost: ClassVar[float] = 1.0

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import time_series_starts

        return time_series_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Orders 1 to 3, as far as the samples bear them."""
        return tuple({"nc": n} for n in range(1, _bearable(HIGHEST_MIXED, samples) + 1))


@dataclass(frozen=True)
class ARMA(ARMAX):
    """A(q) y(t) = C(q) e(t) (thesis 3.13)."""

    name: ClassVar[str] = "arma"
    title: ClassVar[str] = "ARMA: AR with moving-average noise"
    equation: ClassVar[str] = "A(q) y(t) = C(q) e(t)"
    when: ClassVar[str] = "a log without inputs, read through a noisy sensor"
    order_names: ClassVar[tuple[str, ...]] = ("na", "nc")
    letters: ClassVar[str] = "ac"
    takes_inputs: ClassVar[bool] = False
    search_cost: ClassVar[float] = 1.0

    def starts(self, records: Sequence[Record], focus: Focus) -> "Warm":
        """Named starting values of θ (see ``linear.starts``)."""
        from sysid.structures.linear.starts import time_series_starts

        return time_series_starts(self, records, focus)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Every pair of orders 1 to 3, as far as the samples bear them."""
        orders = range(1, _bearable(HIGHEST_MIXED, samples) + 1)
        return tuple({"na": na, "nc": nc} for na, nc in product(orders, repeat=2))


def _bearable(highest: int, samples: int) -> int:
    return max(1, min(highest, samples // SAMPLES_EACH))
