"""ARX, ARMAX, OE, BJ, and without inputs AR, MA, ARMA: which polynomials each has."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, ClassVar

from sysid.data.record import Channel
from sysid.structures.linear.polynomial import PolynomialStructure, linear_traits
from sysid.structures.traits import Traits

HIGHEST = 8
"""Highest order of an AR tried without being asked: the disturbances of machines need less."""

HIGHEST_MIXED = 3
"""Highest order of MA and ARMA tried: beyond it A and C cancel each other."""

SAMPLES_EACH = 20
"""Samples an order needs behind it before it is tried."""

EQUATIONS_EACH = 10
"""Samples that stand behind every coefficient of an output."""

Orders = Mapping[str, Any]


def denominator_orders(nu: int, ny: int, samples: int) -> range:
    """1 … 4 of a single pair, fewer of several or of a short record."""
    return range(1, _largest(nu, ny, samples) + 1)


def numerators(n: int) -> list[int]:
    """Numbers of numerator coefficients that go with a denominator of order n."""
    return sorted({max(n - 1, 1), n, n + 1} if n < 3 else {n - 1, n})


def _largest(nu: int, ny: int, samples: int) -> int:
    by_size = 4 if nu * ny == 1 else 3 if nu * ny <= 4 else 2
    least = 2 if nu * ny == 1 else 1  # a step response of 60 samples shows whether it overshoots
    return max(least, min(by_size, samples // (40 * (nu + 1))))


@dataclass(frozen=True)
class Driven(PolynomialStructure):
    """What models of an answer to inputs have in common."""

    @classmethod
    @abstractmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Orders]:
        """Orders that are tried, without delay, whether or not the samples bear them."""

    @classmethod
    def candidate_orders(cls, nu: int, ny: int, samples: int, delay: Any) -> tuple[Orders, ...]:
        """The orders of the grid that the data bear, delayed."""
        inputs = [Channel(f"u{k}") for k in range(nu)]
        outputs = [Channel(f"y{k}") for k in range(ny)]

        def bears(orders: Orders) -> bool:
            structure = cls.from_orders(orders, nu, ny)
            each = len(structure.parameters(inputs, outputs)) / ny
            return samples >= EQUATIONS_EACH * each + structure.first_sample()

        delayed = [{**o, "nk": delay} for o in cls.order_grid(nu, ny, samples)]
        # a record that bears no order at all still gets the lowest one: the fit itself will refuse
        lowest = dict.fromkeys(cls.traits.order_names, 1)
        return tuple(filter(bears, delayed)) or (lowest,)


@dataclass(frozen=True)
class ARX(Driven):
    """A(q) y(t) = B(q) u(t) + e(t) (Ljung 1999, eq. 4.7; thesis 3.17)."""

    letters: ClassVar[str] = "ab"
    name: ClassVar[str] = "arx"
    traits: ClassVar[Traits] = linear_traits(
        title="ARX: linear difference equation",
        equation="A(q) y(t) = B(q) u(t) + e(t)",
        when="first look at any log; the noise enters where the input does; solved directly",
        order_names=("na", "nb", "nk"),
        has_noise_model=True,
        search_cost=0.0,
        solved_at_once=True,
    )

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Orders]:
        """Every pair up to two more than the others get: it costs next to nothing."""
        orders = range(1, _largest(nu, ny, samples) + 3)
        return [{"na": na, "nb": nb} for na, nb in product(orders, repeat=2)]


@dataclass(frozen=True)
class ARMAX(Driven):
    """A(q) y(t) = B(q) u(t) + C(q) e(t) (Ljung 1999, eq. 4.14; thesis 3.19)."""

    letters: ClassVar[str] = "abc"
    name: ClassVar[str] = "armax"
    traits: ClassVar[Traits] = linear_traits(
        title="ARMAX: ARX with moving-average noise",
        equation="A(q) y(t) = B(q) u(t) + C(q) e(t)",
        when="disturbances that enter early in the process, such as load and friction changes",
        order_names=("na", "nb", "nc", "nk"),
        has_noise_model=True,
        search_cost=2.0,
    )

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Orders]:
        """Low orders; the noise as long as the dynamics, or shorter."""
        return [
            {"na": n, "nb": nb, "nc": nc}
            for n in denominator_orders(nu, ny, samples)
            for nb in numerators(n)
            for nc in sorted({1, min(n, 2), n})
        ]


@dataclass(frozen=True)
class OE(Driven):
    """y(t) = B(q)/F(q) u(t) + e(t) (Ljung 1999, eq. 4.25; thesis 3.21)."""

    letters: ClassVar[str] = "bf"
    name: ClassVar[str] = "oe"
    traits: ClassVar[Traits] = linear_traits(
        title="OE: output error",
        equation="y(t) = B(q)/F(q) u(t) + e(t)",
        when="a model to simulate with: sensor noise only, e.g. encoders; no noise model",
        order_names=("nb", "nf", "nk"),
        stable_by_meaning=True,
        search_cost=2.0,
    )

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Orders]:
        """Low orders, numerators about as long as denominators."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": nb, "nf": n} for n in sizes for nb in numerators(n)]


@dataclass(frozen=True)
class BJ(Driven):
    """y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t) (Ljung 1999, eq. 4.31; thesis 3.23)."""

    letters: ClassVar[str] = "bcdf"
    name: ClassVar[str] = "bj"
    traits: ClassVar[Traits] = linear_traits(
        title="BJ: Box-Jenkins",
        equation="y(t) = B(q)/F(q) u(t) + C(q)/D(q) e(t)",
        when="coloured sensor-side disturbances that share no dynamics with the plant",
        order_names=("nb", "nc", "nd", "nf", "nk"),
        has_noise_model=True,
        stable_by_meaning=True,
        search_cost=4.0,
    )

    @classmethod
    def order_grid(cls, nu: int, ny: int, samples: int) -> Sequence[Orders]:
        """Low orders, each with noise of order 1 and 2."""
        sizes = denominator_orders(nu, ny, samples)
        return [{"nb": n, "nc": k, "nd": k, "nf": n} for n in sizes for k in (1, 2)]


# ---------------------------- models of a signal without inputs (thesis 3.11–3.13; Box & Jenkins)


@dataclass(frozen=True)
class TimeSeries(PolynomialStructure):
    """What models of a signal without inputs have in common."""

    highest: ClassVar[int] = HIGHEST_MIXED

    @classmethod
    def candidate_orders(cls, nu: int, ny: int, samples: int, delay: Any) -> tuple[Orders, ...]:
        """Every combination of orders from 1 to ``highest``, as far as the samples bear them."""
        names = cls.traits.order_names
        orders = range(1, max(1, min(cls.highest, samples // SAMPLES_EACH)) + 1)
        each = product(orders, repeat=len(names))
        return tuple(dict(zip(names, values, strict=True)) for values in each)


time_series_traits = partial(linear_traits, has_noise_model=True, takes_inputs=False)


@dataclass(frozen=True)
class AR(TimeSeries, ARX):
    """A(q) y(t) = e(t) (thesis 3.12)."""

    letters: ClassVar[str] = "a"
    highest: ClassVar[int] = HIGHEST
    name: ClassVar[str] = "ar"
    traits: ClassVar[Traits] = time_series_traits(
        title="AR: a signal from its own past",
        equation="A(q) y(t) = e(t)",
        when="a log without inputs: vibration, drift, a disturbance; solved directly",
        order_names=("na",),
    )


@dataclass(frozen=True)
class MA(TimeSeries):
    """y(t) = C(q) e(t) (thesis 3.11)."""

    letters: ClassVar[str] = "c"
    name: ClassVar[str] = "ma"
    traits: ClassVar[Traits] = time_series_traits(
        title="MA: a moving average of white noise",
        equation="y(t) = C(q) e(t)",
        when="a log without inputs and with a memory of a few samples",
        order_names=("nc",),
    )


@dataclass(frozen=True)
class ARMA(TimeSeries):
    """A(q) y(t) = C(q) e(t) (thesis 3.13)."""

    letters: ClassVar[str] = "ac"
    name: ClassVar[str] = "arma"
    traits: ClassVar[Traits] = time_series_traits(
        title="ARMA: AR with moving-average noise",
        equation="A(q) y(t) = C(q) e(t)",
        when="a log without inputs, measured by a noisy sensor",
        order_names=("na", "nc"),
    )
