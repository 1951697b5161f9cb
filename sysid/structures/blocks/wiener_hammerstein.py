"""Wiener–Hammerstein: a static between two linear blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data.record import Channel
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.structures.base import refuse_options
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import IDENTITY, Static
from sysid.structures.blocks.static.options import RequestedStatics, option_names, requested_statics
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.orders import ORDER_WORDS, Matrix, Orders, spread

if TYPE_CHECKING:
    from sysid.structures.outcome import Fitter


@dataclass(frozen=True)
class WienerHammerstein(BlockStructure):
    """y_i(t) = y0_i + Σ_j B_ij(q)/F_ij(q) [f_j(v_j(t)) − f_j(0)] + e_i(t), v_j = B1_j/F1_j u_j.

    A first linear block for each input, a static behind it, then a linear block from all inputs
    to all outputs (Schoukens & Tiels 2017, Automatica 85). Two gains can be moved between the
    blocks; the fit holds the largest coefficient of each B1_j and, of a static with a gain of
    its own, two points (or the largest coefficient).

    Attributes:
        first: nb1, nf1, nk1 of the first block, one an input.
        orders: nb, nf, nk of the second.
        statics: one an input.
        requested: what the user left open, None in a fitted model.
        choose_orders: whether the orders are open too.
    """

    name: ClassVar[str] = "wiener-hammerstein"
    title: ClassVar[str] = "Wiener-Hammerstein: a static between two linear blocks"
    equation: ClassVar[str] = "y(t) = B(q)/F(q) f(B1(q)/F1(q) u(t)) + e(t)"
    when: ClassVar[str] = (
        "a lag before the nonlinearity and one after it: driver, then dead zone, then motor"
    )
    order_names: ClassVar[tuple[str, ...]] = ("nb1", "nf1", "nb", "nf", "nk")
    order_words: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            **ORDER_WORDS,
            "nb1": "input coefficients of the first block",
            "nf1": "order of the first block's denominator",
        }
    )
    options: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "static": "static between the blocks, e.g. dead-zone, saturation-upper, piecewise:8, "
            "spline:12, polynomial:3, or stages joined by commas; static[NAME]=… for one input; "
            "auto (default) grows a spline as far as held-out data pay for it"
        }
    )

    first: Orders
    orders: Orders
    statics: tuple[Static, ...]
    requested: RequestedStatics | None = None
    choose_orders: bool = False

    def fitter(self) -> "Fitter":
        """From the best linear approximation, its poles dealt out to both sides."""
        from sysid.structures.blocks.wiener_hammerstein_fit import fit

        return fit

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "WienerHammerstein":
        """The structure with these orders; without any but nk the fit chooses them.

        nb1, nf1 belong to the first blocks (one an input; the current sample is their first lag)
        and nb, nf, nk to the second.

        Raises:
            UsageError: an order, option or static cannot be read.
        """
        refuse_options(cls.name, option_names(options), tuple(cls.options))
        requested = requested_statics("static", options or {})
        known = {*cls.order_names}
        for name in raw:
            if name not in known:
                raise UsageError(
                    f"`orders`: {cls.name} has no order {name!r}; its orders are "
                    f"{' '.join(cls.order_names)}"
                )
        choose = not set(raw) - {"nk"}
        full = {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, **raw} if choose else dict(raw)
        for name in cls.order_names[:-1]:
            if name not in full:
                raise UsageError(
                    f"`orders`: {cls.name} needs {name}; give all of nb1 nf1 nb nf (nk is 1 "
                    "unless given)"
                )
        second: dict[str, Any] = {k: full[k] for k in ("nb", "nf", "nk") if k in full}
        rows = [_per_input(full[k], k, nu) for k in ("nb1", "nf1")]
        if not all(rows[0]):
            raise UsageError(f"`orders`: {cls.name} needs nb1 of at least 1 for every input")
        first = Orders(
            na=_diagonal([0] * nu),
            nb=_diagonal(rows[0]),
            nc=(0,) * nu,
            nd=(0,) * nu,
            nf=_diagonal(rows[1]),
            nk=_diagonal([0] * nu),
        )
        return cls(
            first,
            spread(second, "bf", nu, ny, cls.name),
            (requested.common or IDENTITY,) * nu,
            requested,
            choose,
        )

    @cached_property
    def chain(self) -> BlockChain:
        a, b = self.first, self.orders
        return BlockChain(
            (
                LinearLayer(a.nb, a.nf, a.nk),
                StaticLayer(self.statics),
                LinearLayer(b.nb, b.nf, b.nk),
                StaticLayer((IDENTITY,) * b.ny, last=True),
            ),
            b.nu,
        )

    @property
    def layer_names(self) -> tuple[str, ...]:
        return ("first", "static", "", "output")

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names and units of θ; of an open structure those it has before anything is chosen."""
        return super(WienerHammerstein, self.resolved(inputs)).parameters(inputs, outputs)

    def resolved(self, inputs: Sequence[Channel]) -> "WienerHammerstein":
        """The structure with the statics asked for at the inputs they were asked for.

        Raises:
            UsageError: an option names a channel that does not exist.
        """
        if self.requested is None:
            return self
        return replace(self, statics=self.requested.of_channels(inputs, IDENTITY))

    def with_chain(self, chain: BlockChain) -> "WienerHammerstein":
        layer = chain.layers[1]
        assert isinstance(layer, StaticLayer)
        return replace(self, statics=layer.statics)

    def order_values(self) -> dict[str, Any]:
        second = {n: self.orders.value(n) for n in ("nb", "nf", "nk")}
        if self.choose_orders:
            return {"nk": second["nk"]}
        rows = {
            n: [getattr(self.first, n[:2])[j][j] for j in range(self.nu)] for n in ("nb1", "nf1")
        }
        return {**{k: v[0] if len(set(v)) == 1 else v for k, v in rows.items()}, **second}

    def settings(self) -> dict[str, Any]:
        return {"static": self.statics}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "WienerHammerstein":
        plain = cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))
        statics = tuple(map(Static.from_json, raw["settings"]["static"]))
        if len(statics) != plain.nu:
            raise ValueError("its statics do not fit its channels")
        return replace(plain, statics=statics, requested=None, choose_orders=False)


def _diagonal(values: Sequence[int]) -> Matrix:
    return tuple(
        tuple(v if i == j else 0 for j in range(len(values))) for i, v in enumerate(values)
    )


def _per_input(value: Any, name: str, nu: int) -> list[int]:
    """One order an input from a number, a list or a row."""
    flat = [value] * nu if isinstance(value, int) else list(value)
    if len(flat) == 1 and isinstance(flat[0], list | tuple):
        flat = list(flat[0])
    whole = all(isinstance(v, int) and not isinstance(v, bool) and 0 <= v <= 200 for v in flat)
    if len(flat) != nu or not whole:
        raise UsageError(
            f"`orders`: {name} must be a whole number from 0 to 200, or {nu} of them, got {value!r}"
        )
    return [int(v) for v in flat]
