"""``tf``: transfer functions in s with dead time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.record import Array, Channel, Record
from sysid.data.unit_words import ratio
from sysid.errors import UsageError
from sysid.fitting.problem import Focus, Initial, Parameter, Problem
from sysid.structures.base import refuse_options
from sysid.structures.continuous.instruments import Found, derivatives
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.linear.polynomial import linear_traits
from sysid.structures.state_space.structure import RealizedErrors
from sysid.structures.traits import Traits

MOST = 10
"""Most poles that are accepted."""

OPTIONS = {"delay": "none: no dead time"}


@dataclass(frozen=True)
class ContinuousTransfer(ContinuousStructure):
    """G(s) = (b_nz s^nz + … + b0)/(s^np + … + a0) e^{−Td s}, one of each input to each output.

    Attributes:
        np, nz: poles and zeros of a path, nz < np.
    """

    np: int
    nz: int

    name: ClassVar[str] = "tf"
    traits: ClassVar[Traits] = linear_traits(
        title="Transfer function in s with dead time",
        equation="y = (b_nz s^nz + … + b0)/(s^np + … + a0) e^(−Td s) u + e",
        when="a plant in seconds, whatever the sample time; fast-sampled logs",
        order_names=("np", "nz"),
        order_words={"np": "poles of each path", "nz": "zeros of each path, fewer than np"},
        options=OPTIONS,
        search_cost=4.0,
        by_default=False,
    )

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        refuse_options(cls.name, options, tuple(cls.traits.options))
        poles, zeros = raw.get("np"), raw.get("nz", 0)
        fitting = isinstance(poles, int) and isinstance(zeros, int) and set(raw) <= {"np", "nz"}
        if not fitting or not 1 <= poles <= MOST or not 0 <= zeros < poles:  # type: ignore[operator]
            raise UsageError(
                f"`orders`: tf needs np, its poles from 1 to {MOST}, and fewer zeros nz (0 unless "
                "given); such as np=2 nz=1"
            )
        assert isinstance(poles, int)
        return cls((), nu, ny, 1.0, delayed(cls.name, options), poles, zeros)

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        pairs = ((1, 0), (2, 0), (2, 1), (3, 1), (3, 2))
        return tuple({"np": p, "nz": z} for p, z in pairs)

    def order_values(self) -> dict[str, Any]:
        return {"np": self.np, "nz": self.nz}

    @property
    def degree(self) -> int:
        return self.np

    @property
    def zeros(self) -> int:
        return self.nz

    def path_parameters(self, u: Channel, y: Channel) -> tuple[Parameter, ...]:
        gain = ratio(y.unit, u.unit)
        table = [Parameter(f"b{k}", _per(gain, self.np - k)) for k in range(self.nz + 1)]
        table += [Parameter(f"a{k}", _per("", self.np - k)) for k in range(self.np)]
        return (*table, Parameter("Td", "s", 0.0)) if self.delayed else tuple(table)

    def path(self, p: Any) -> tuple[Any, Any, Any]:
        m, n = self.nz + 1, self.np
        return p[:m], p[m : m + n], p[m + n] if self.delayed else 0.0

    def path_numbers(self, found: Found) -> Array:
        delay = [found.delay] if self.delayed else []
        return np.concatenate([found.num, found.den, delay])

    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        data = [(r.u, r.y) for r in records]
        states = initial is not Initial.ZERO
        return (TransferErrors(self, data, states, ahead=False, stable=stable),)


class TransferErrors(RealizedErrors):
    """Errors of free runs, with what refined instrumental variables ask of them."""

    def regressors(self, p: Array) -> Array:
        """The Jacobian with y − Σ(other inputs) = x + ε for x in ∂ε/∂a_k = s^k/A(s) x."""
        s, out = self.structure, self.jacobian(p)
        assert isinstance(s, ContinuousTransfer)
        paths = s.paths(p[: self.n_theta])
        each, before = s.n_plain // len(paths), s.nz + 1
        stops = np.cumsum(self.lengths)
        for i, stop, e in zip(
            self.channels, stops, np.split(self.residual(p), stops[:-1]), strict=True
        ):
            for k in range(i * s.inputs, (i + 1) * s.inputs):
                a = slice(k * each + before, k * each + before + s.np)
                out[stop - len(e) : stop, a] += derivatives(e, paths[k][1], s.dt)[0]
        return out


def delayed(name: str, options: Mapping[str, str] | None) -> bool:
    """Whether paths have a dead time."""
    said = (options or {}).get("delay", "free")
    if said not in ("free", "none"):
        raise UsageError(f"`structure_options`: {name} knows delay=free and delay=none, not {said}")
    return said == "free"


def _per(unit: str, power: int) -> str:
    """A unit over seconds to a power."""
    seconds = "s" if power == 1 else "s^" + str(power)
    return f"{unit or '1'}/{seconds}" if power else unit
