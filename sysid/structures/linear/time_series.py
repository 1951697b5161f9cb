"""AR, MA and ARMA: models of a signal without inputs (thesis 3.11–3.13; Box & Jenkins 1976)."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar

from sysid.structures.linear.armax import ARMAX
from sysid.structures.linear.arx import ARX
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits

HIGHEST = 8
"""Highest order of an AR tried without being asked: the disturbances of machines need less."""

HIGHEST_MIXED = 3
"""Highest order of MA and ARMA tried: beyond it A and C cancel each other."""

SAMPLES_EACH = 20
"""Samples an order needs behind it before it is tried."""


@dataclass(frozen=True)
class TimeSeries(PolynomialStructure):
    """What models of a signal without inputs have in common."""

    highest: ClassVar[int] = HIGHEST_MIXED

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """Every combination of orders from 1 to ``highest``, as far as the samples bear them."""
        orders = range(1, max(1, min(cls.highest, samples // SAMPLES_EACH)) + 1)
        each = product(orders, repeat=len(cls.traits.order_names))
        return tuple(dict(zip(cls.traits.order_names, values, strict=True)) for values in each)


@dataclass(frozen=True)
class AR(TimeSeries, ARX):
    """A(q) y(t) = e(t) (thesis 3.12)."""

    name: ClassVar[str] = "ar"
    traits: ClassVar[Traits] = linear_traits(
        title="AR: a signal from its own past",
        equation="A(q) y(t) = e(t)",
        when="a log without inputs: vibration, drift, a disturbance; solved directly",
        order_names=("na",),
        has_noise_model=True,
        takes_inputs=False,
        by_default=True,
    )
    letters: ClassVar[str] = "a"
    highest: ClassVar[int] = HIGHEST


@dataclass(frozen=True)
class MA(TimeSeries, ARMAX):
    """y(t) = C(q) e(t) (thesis 3.11)."""

    name: ClassVar[str] = "ma"
    traits: ClassVar[Traits] = linear_traits(
        title="MA: a moving average of white noise",
        equation="y(t) = C(q) e(t)",
        when="a log without inputs and with a memory of a few samples",
        order_names=("nc",),
        has_noise_model=True,
        takes_inputs=False,
        by_default=True,
    )
    letters: ClassVar[str] = "c"


@dataclass(frozen=True)
class ARMA(TimeSeries, ARMAX):
    """A(q) y(t) = C(q) e(t) (thesis 3.13)."""

    name: ClassVar[str] = "arma"
    traits: ClassVar[Traits] = linear_traits(
        title="ARMA: AR with moving-average noise",
        equation="A(q) y(t) = C(q) e(t)",
        when="a log without inputs, measured by a noisy sensor",
        order_names=("na", "nc"),
        has_noise_model=True,
        takes_inputs=False,
        by_default=True,
    )
    letters: ClassVar[str] = "ac"
