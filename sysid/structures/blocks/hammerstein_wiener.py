"""Hammerstein–Wiener: a static before and a static after a linear block."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from sysid.structures.base import refuse_options
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import IDENTITY
from sysid.structures.blocks.static.options import option_names, requested_statics
from sysid.structures.blocks.structure import BlockStructure, block_traits
from sysid.structures.options import choice
from sysid.structures.orders import spread
from sysid.structures.traits import Traits

FORMS = ("both", "hammerstein", "wiener")


OPTIONS: Mapping[str, str] = {
    "input": "static before the linear block, e.g. dead-zone, saturation, piecewise:8, "
    "polynomial:3, or stages joined by commas; input[NAME]=… for one channel; auto "
    "(default) chooses on held-out data",
    "output": "static after it, e.g. abs,polynomial:3; output[NAME]=… for one channel; "
    "auto (default) chooses on held-out data",
    "form": "both (default), hammerstein (no output static) or wiener (no input static)",
}


@dataclass(frozen=True)
class HammersteinWiener(BlockStructure):
    """y_i(t) = y0_i + g_i(Σ_j B_ij(q)/F_ij(q) [f_j(u_j(t)) − f_j(0)]) + e_i(t).

    One static f_j an input and g_i an output around a linear block of any order (Bai 1998,
    Automatica 34; Schoukens & Tiels 2017, Automatica 85). A gain can be moved from one block to
    the next, so where a static has a gain of its own the fit holds: of f_j two points (or the
    largest coefficient), and with g_i the largest coefficient of the row's B.
    """

    name: ClassVar[str] = "hammerstein-wiener"
    traits: ClassVar[Traits] = block_traits(
        title="Hammerstein-Wiener: a static before and after a linear block",
        equation="y(t) = g(B(q)/F(q) f(u(t))) + e(t)",
        when="dead zone, saturation or a curved gain at the actuator, a curved or sign-less sensor",
        order_names=("nb", "nf", "nk"),
        options=OPTIONS,
    )

    layer_names: ClassVar[tuple[str, ...]] = ("input", "", "output")
    places: ClassVar[Mapping[str, int]] = {"input": 0, "output": 2}

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "HammersteinWiener":
        """The structure with these orders; without nb and nf the fit chooses them."""
        given = dict(options or {})
        refuse_options(cls.name, option_names(given), tuple(cls.traits.options))
        form = choice(given, "form", FORMS)
        requested = [requested_statics("input", given), requested_statics("output", given)]
        closed = {"hammerstein": 1, "wiener": 0}.get(form)
        if closed is not None and requested[closed].common is None:
            requested[closed] = replace(requested[closed], common=IDENTITY)
        choose = not {"nb", "nf"} & set(raw)
        full = {"nb": 1, "nf": 1, **raw} if choose else raw
        statics = ((requested[0].common or IDENTITY,) * nu, (requested[1].common or IDENTITY,) * ny)
        orders = spread(full, "bf", nu, ny, cls.name)
        return cls((orders,), statics, tuple(requested), choose)

    @cached_property
    def chain(self) -> BlockChain:
        o = self.orders
        return BlockChain(
            (
                StaticLayer(self.statics[0]),
                LinearLayer(o.nb, o.nf, o.nk),
                StaticLayer(self.statics[1], last=True),
            ),
            o.nu,
        )

    def order_values(self) -> dict[str, Any]:
        names = ("nk",) if self.choose_orders else self.traits.order_names
        return {name: self.orders.value(name) for name in names}
