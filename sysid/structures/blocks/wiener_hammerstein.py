"""Wiener–Hammerstein: a static between two linear blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

from sysid.errors import UsageError
from sysid.structures.base import refuse_options
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import IDENTITY
from sysid.structures.blocks.static.options import option_names, requested_statics
from sysid.structures.blocks.structure import BlockStructure, block_traits
from sysid.structures.orders import ORDER_WORDS, Matrix, Orders, require_names, spread, vector
from sysid.structures.traits import Traits

OPTIONS: Mapping[str, str] = {
    "static": "static between the blocks, e.g. dead-zone, saturation-upper, piecewise:8, "
    "spline:12, polynomial:3, or stages joined by commas; static[NAME]=… for one input; "
    "auto (default) grows a spline as far as held-out data pay for it"
}


@dataclass(frozen=True)
class WienerHammerstein(BlockStructure):
    """y_i(t) = y0_i + Σ_j B_ij(q)/F_ij(q) [f_j(v_j(t)) − f_j(0)] + e_i(t), v_j = B1_j/F1_j u_j.

    A first linear block for each input, a static behind it, then a linear block from all inputs
    to all outputs (Schoukens & Tiels 2017, Automatica 85). Two gains can be moved between the
    blocks; the fit holds the largest coefficient of each B1_j and, of a static with a gain of
    its own, two points (or the largest coefficient). Of the first block nb1, nf1 are one an input.
    """

    name: ClassVar[str] = "wiener-hammerstein"
    traits: ClassVar[Traits] = block_traits(
        title="Wiener-Hammerstein: a static between two linear blocks",
        equation="y(t) = B(q)/F(q) f(B1(q)/F1(q) u(t)) + e(t)",
        when="a lag before the nonlinearity and one after it: driver, then dead zone, then motor",
        order_names=("nb1", "nf1", "nb", "nf", "nk"),
        order_words=MappingProxyType(
            {
                **ORDER_WORDS,
                "nb1": "input coefficients of the first block",
                "nf1": "order of the first block's denominator",
            }
        ),
        options=OPTIONS,
    )

    layer_names: ClassVar[tuple[str, ...]] = ("first", "static", "", "output")
    places: ClassVar[Mapping[str, int]] = {"static": 1}

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "WienerHammerstein":
        """The structure with these orders; without any but nk the fit chooses them.

        nb1, nf1 belong to the first blocks (one an input; the current sample is their first lag)
        and nb, nf, nk to the second.
        """
        refuse_options(cls.name, option_names(options), tuple(cls.traits.options))
        requested = requested_statics("static", options or {})
        choose = not set(raw) - {"nk"}
        full = {"nb1": 1, "nf1": 1, "nb": 1, "nf": 1, **raw} if choose else dict(raw)
        require_names(full, cls.traits.order_names[:-1], cls.name)
        second: dict[str, Any] = {k: full[k] for k in ("nb", "nf", "nk") if k in full}
        rows = [vector(k, full[k], nu) for k in ("nb1", "nf1")]
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
        statics = ((requested.common or IDENTITY,) * nu,)
        return cls((first, spread(second, "bf", nu, ny, cls.name)), statics, (requested,), choose)

    @cached_property
    def chain(self) -> BlockChain:
        a, b = self.linear_blocks
        return BlockChain(
            (
                LinearLayer(a.nb, a.nf, a.nk),
                StaticLayer(self.statics[0]),
                LinearLayer(b.nb, b.nf, b.nk),
                StaticLayer((IDENTITY,) * b.ny, last=True),
            ),
            b.nu,
        )

    def order_values(self) -> dict[str, Any]:
        second = {n: self.orders.value(n) for n in ("nb", "nf", "nk")}
        if self.choose_orders:
            return {"nk": second["nk"]}
        rows = {
            n: [getattr(self.linear_blocks[0], n[:2])[j][j] for j in range(self.nu)]
            for n in ("nb1", "nf1")
        }
        return {**{k: v[0] if len(set(v)) == 1 else v for k, v in rows.items()}, **second}


def _diagonal(values: Sequence[int]) -> Matrix:
    return tuple(
        tuple(v if i == j else 0 for j in range(len(values))) for i, v in enumerate(values)
    )
