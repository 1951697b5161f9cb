"""Hammerstein–Wiener: a static before and a static after a linear block."""

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
from sysid.structures.orders import Orders, spread

if TYPE_CHECKING:
    from sysid.structures.outcome import Fitter

FORMS = ("both", "hammerstein", "wiener")


@dataclass(frozen=True)
class HammersteinWiener(BlockStructure):
    """y_i(t) = y0_i + g_i(Σ_j B_ij(q)/F_ij(q) [f_j(u_j(t)) − f_j(0)]) + e_i(t).

    One static f_j an input and g_i an output around a linear block of any order (Bai 1998,
    Automatica 34; Schoukens & Tiels 2017, Automatica 85). A gain can be moved from one block to
    the next, so where a static has a gain of its own the fit holds: of f_j two points (or the
    largest coefficient), and with g_i the largest coefficient of the row's B.

    Attributes:
        orders: nb, nf, nk of the linear block.
        requested: what the user left open, None in a fitted model. An open structure stands for all
            that the fit may choose from.
        choose_orders: whether the orders are open too.
    """

    name: ClassVar[str] = "hammerstein-wiener"
    title: ClassVar[str] = "Hammerstein-Wiener: a static before and after a linear block"
    equation: ClassVar[str] = "y(t) = g(B(q)/F(q) f(u(t))) + e(t)"
    when: ClassVar[str] = (
        "dead zone, saturation or a curved gain at the actuator, a curved or sign-less sensor"
    )
    order_names: ClassVar[tuple[str, ...]] = ("nb", "nf", "nk")
    options: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "input": "static before the linear block, e.g. dead-zone, saturation, piecewise:8, "
            "polynomial:3, or stages joined by commas; input[NAME]=… for one channel; auto "
            "(default) chooses on held-out data",
            "output": "static after it, e.g. abs,polynomial:3; output[NAME]=… for one channel; "
            "auto (default) chooses on held-out data",
            "form": "both (default), hammerstein (no output static) or wiener (no input static)",
        }
    )

    orders: Orders
    inputs: tuple[Static, ...]
    outputs: tuple[Static, ...]
    requested: tuple[RequestedStatics, RequestedStatics] | None = None
    choose_orders: bool = False

    def fitter(self) -> "Fitter":
        """From the best linear approximation; what is open is chosen on held-out samples."""
        from sysid.structures.blocks.hammerstein_wiener_fit import fit

        return fit

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> "HammersteinWiener":
        """The structure with these orders; without nb and nf the fit chooses them.

        Raises:
            UsageError: an order, option or static cannot be read.
        """
        given = dict(options or {})
        refuse_options(cls.name, option_names(given), tuple(cls.options))
        form = given.pop("form", "both").lower()
        if form not in FORMS:
            raise UsageError(
                f"`structure_options['form']`: choose one of {', '.join(FORMS)}, not {form!r}"
            )
        requested = [requested_statics("input", given), requested_statics("output", given)]
        closed = {"hammerstein": 1, "wiener": 0}.get(form)
        if closed is not None and requested[closed].common is None:
            requested[closed] = replace(requested[closed], common=IDENTITY)
        choose = not {"nb", "nf"} & set(raw)
        full = {"nb": 1, "nf": 1, **raw} if choose else raw
        return cls(
            spread(full, "bf", nu, ny, cls.name),
            (requested[0].common or IDENTITY,) * nu,
            (requested[1].common or IDENTITY,) * ny,
            (requested[0], requested[1]),
            choose,
        )

    @cached_property
    def chain(self) -> BlockChain:
        o = self.orders
        return BlockChain(
            (
                StaticLayer(self.inputs),
                LinearLayer(o.nb, o.nf, o.nk),
                StaticLayer(self.outputs, last=True),
            ),
            o.nu,
        )

    @property
    def layer_names(self) -> tuple[str, ...]:
        return ("input", "", "output")

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names and units of θ; of an open structure those it has before anything is chosen."""
        return super(HammersteinWiener, self.resolved(inputs, outputs)).parameters(inputs, outputs)

    def resolved(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> "HammersteinWiener":
        """The structure with the statics asked for at the channels they were asked for.

        Raises:
            UsageError: an option names a channel that does not exist.
        """
        if self.requested is None:
            return self
        return replace(
            self,
            inputs=self.requested[0].of_channels(inputs, IDENTITY),
            outputs=self.requested[1].of_channels(outputs, IDENTITY),
        )

    def with_chain(self, chain: BlockChain) -> "HammersteinWiener":
        before, _, after = chain.layers
        assert isinstance(before, StaticLayer)
        assert isinstance(after, StaticLayer)
        return replace(self, inputs=before.statics, outputs=after.statics)

    def order_values(self) -> dict[str, Any]:
        names = ("nk",) if self.choose_orders else self.order_names
        return {name: self.orders.value(name) for name in names}

    def settings(self) -> dict[str, Any]:
        return {"input": self.inputs, "output": self.outputs}

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> "HammersteinWiener":
        plain = cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))
        structure = replace(
            plain,
            inputs=tuple(map(Static.from_json, raw["settings"]["input"])),
            outputs=tuple(map(Static.from_json, raw["settings"]["output"])),
            requested=None,
            choose_orders=False,
        )
        if (len(structure.inputs), len(structure.outputs)) != (plain.nu, plain.ny):
            raise ValueError("its statics do not fit its channels")
        return structure
