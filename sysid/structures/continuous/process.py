"""``process``: gain, time constants, damping, a zero, an integrator and a dead time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.record import Array, Channel, Index, Record
from sysid.data.unit_words import ratio
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.structures.base import refuse_options
from sysid.structures.continuous.instruments import Found
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.continuous.transfer import OPTIONS, delayed
from sysid.structures.linear.polynomial import linear_traits
from sysid.structures.traits import Traits

SHORTEST = 1e-9
"""Least time constant [s]."""

FEW = 100
"""Samples below which it is tried by default: there its few numbers err less (decision 0040)."""


def _default_orders(records: Sequence[Record]) -> tuple[Mapping[str, Any], ...]:
    """One and two time constants, where samples are few."""
    few = records[0].ny == 1 and sum(map(len, records)) < FEW
    return ({"np": 1}, {"np": 2}) if few else ()


@dataclass(frozen=True)
class Process(ContinuousStructure):
    """G(s) = K (1 + Tz s) e^{−Td s} / (s^ni Π (1 + T_k s)), or with 1 + 2 ζ Tw s + (Tw s)² for two.

    Attributes:
        np: real time constants, or with ``nw`` those besides the pair.
        nw: 1 where two poles are given by Tw and ζ.
        nz: 1 where there is a zero.
        ni: 1 where it integrates.
    """

    np: int
    nw: int
    nz: int
    ni: int

    name: ClassVar[str] = "process"
    traits: ClassVar[Traits] = linear_traits(
        title="Process model: gain, time constants, dead time",
        equation="y = K (1 + Tz s)/(s^ni (1 + T1 s) (1 + T2 s) …) e^(−Td s) u + e",
        when="step tests and slow plants; numbers for tuning a controller",
        order_names=("np",),
        order_words={
            "np": "real time constants",
            "nw": "1: a pair of poles given by Tw and ζ, besides these",
            "nz": "1: a zero",
            "ni": "1: an integrator",
        },
        options={**OPTIONS, "type": "P1D, P2DZ, P2DU, P3DIZ … instead of orders"},
        tells="gain, time constants, damping and dead time with their errors",
        search_cost=4.0,
        by_default=False,
        default_orders=_default_orders,
    )

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        """The structure with these orders, or of this type."""
        refuse_options(cls.name, options, tuple(cls.traits.options))
        given = dict(options or {})
        orders = {"np": 0, "nw": 0, "nz": 0, "ni": 0, **raw}
        waits = delayed(cls.name, given)
        if "type" in given:
            orders, waits = _of_type(given["type"])
            if raw and {k: v for k, v in orders.items() if v} != dict(raw):
                raise UsageError("`orders`: process has a type already; give one of the two")
        counts = [orders[k] for k in ("np", "nw", "nz", "ni")]
        fitting = set(orders) == {"np", "nw", "nz", "ni"} and all(
            isinstance(c, int) for c in counts
        )
        if fitting:
            p, w, z, i = counts
            fitting = p <= 3 and max(w, z, i) <= 1 and 1 <= p + 2 * w + i <= 4 and p + 2 * w + i > z
        if not fitting:
            raise UsageError(
                "`orders`: process has np (0 to 3 real time constants), nw (1: a pair with "
                "damping), nz (1: a zero) and ni (1: an integrator), with fewer zeros than poles; "
                "such as np=2 nz=1, or the option type=P2DZ"
            )
        return cls((), nu, ny, 1.0, waits, *counts)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        kinds = ("P1D", "P2D", "P2DZ", "P2DU", "P2DUZ", "P3D", "P1DI")
        return tuple({k: v for k, v in _of_type(kind)[0].items() if v} for kind in kinds)

    @classmethod
    def orders_said(cls, options: Mapping[str, str]) -> Mapping[str, Any] | None:
        orders = _of_type(options["type"])[0] if "type" in options else {}
        return {k: v for k, v in orders.items() if v} or None

    def order_values(self) -> dict[str, Any]:
        values = {"np": self.np, "nw": self.nw, "nz": self.nz, "ni": self.ni}
        return {k: v for k, v in values.items() if v}

    @property
    def degree(self) -> int:
        return self.np + 2 * self.nw + self.ni

    @property
    def zeros(self) -> int:
        return self.nz

    def path_parameters(self, u: Channel, y: Channel) -> tuple[Parameter, ...]:
        gain = ratio(y.unit, u.unit)
        table = [Parameter("K", f"{gain or '1'}/s" if self.ni else gain)]
        table += [Parameter(f"T{k + 1}", "s", SHORTEST) for k in range(self.np)]
        if self.nw:
            table += [Parameter("Tw", "s", SHORTEST), Parameter("zeta", "", 0.0)]
        table += [Parameter("Tz", "s")] * self.nz
        table += [Parameter("Td", "s", 0.0)] * self.delayed
        return tuple(table)

    def in_order(self, theta: Array, parameters: Sequence[Parameter]) -> Index:
        """T1 is the largest time constant, T2 the next, where nobody has said which is which."""
        at = np.arange(len(theta))
        each = self.n_plain // (self.inputs * self.outputs)
        for first in range(1, self.n_plain, each):
            own = slice(first, first + self.np)
            said = {(p.lower, p.upper, p.fixed) for p in parameters[own]}
            if said == {(SHORTEST, np.inf, None)}:
                at[own] = first + np.argsort(-theta[own], kind="stable")
        return at

    def path(self, p: Any) -> tuple[Any, Any, Any]:
        p = list(p)
        gain, times = p[0], p[1 : 1 + self.np]
        at = 1 + self.np
        bottom = np.ones(1)  # in rising powers of s
        for T in times:
            bottom = np.convolve(bottom, np.array([1.0, T]))
        if self.nw:
            Tw, zeta = p[at], p[at + 1]
            bottom = np.convolve(bottom, np.array([1.0, 2.0 * zeta * Tw, Tw * Tw]))
            at += 2
        top = gain * np.array([1.0, p[at]] if self.nz else [1.0])
        if self.ni:
            bottom = np.concatenate([np.zeros(1), bottom])
        delay = p[-1] if self.delayed else 0.0
        return top / bottom[-1], bottom[:-1] / bottom[-1], delay

    def path_numbers(self, found: Found) -> Array:
        roots = np.roots([1.0, *found.den[::-1]])
        roots = roots[np.argsort(np.abs(roots))]
        num = np.asarray(found.num, dtype=np.float64)
        slow = 1.0
        if self.ni:  # the slowest becomes the integrator
            slow, roots = float(abs(roots[0])), roots[1:]
        times = 1.0 / np.maximum(np.abs(roots), 1e-300)
        whole = float(found.den[0])
        gain = num[0] / whole if whole else num[0]
        numbers = [gain * slow if self.ni else gain]
        pair: list[float] = []
        if self.nw:
            k = int(np.argmax(np.abs(roots.imag)))
            j = k + 1 if k + 1 < len(roots) and roots[k + 1] == np.conj(roots[k]) else k - 1
            both = roots[[k, j]]
            size = float(np.sqrt(np.abs(np.prod(both))))
            pair = [1.0 / size, float(np.clip(-np.sum(both.real) / (2.0 * size), 0.02, 5.0))]
            times = np.delete(times, [k, j % len(roots)])
        ordered = np.sort(times)[::-1]
        # two alike have no direction of their own: a little apart they have
        numbers += [float(T) * (1.0 + 0.02 * i) for i, T in enumerate(ordered)]
        numbers += pair
        if self.nz:
            numbers.append(float(num[1] / num[0]) if num[0] else 0.0)
        if self.delayed:
            numbers.append(found.delay)
        return np.array(numbers)


def _of_type(text: str) -> tuple[dict[str, Any], bool]:
    """Orders, and whether there is a dead time, of a name such as P2DZ or P2DU."""
    kind = text.upper()
    digits, letters = kind[1:2], kind[2:]
    known = kind[:1] == "P" and digits in ("0", "1", "2", "3") and set(letters) <= set("DIZU")
    if not known or len(set(letters)) != len(letters) or ("U" in letters and digits < "2"):
        raise UsageError(
            f"`structure_options`: type={text!r} is no process model; write P, the number of "
            "poles, and of D (dead time), I (integrator), Z (zero) and U (pair with damping) those "
            "it has, such as P2DZ"
        )
    pair = "U" in letters
    orders = {
        "np": int(digits) - 2 * pair,
        "nw": int(pair),
        "nz": int("Z" in letters),
        "ni": int("I" in letters),
    }
    return orders, "D" in letters
