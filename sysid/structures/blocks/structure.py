"""Base class of Hammerstein–Wiener and Wiener–Hammerstein models."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel
from sysid.fitting.problem import Parameter
from sysid.structures.base import NamedStructure
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.layers import LinearLayer, StaticLayer
from sysid.structures.blocks.static.functions import IDENTITY, Static
from sysid.structures.blocks.static.kinds import Stage, spline_knots
from sysid.structures.blocks.static.options import RequestedStatics
from sysid.structures.linear.polynomial import _text, pole_words
from sysid.structures.motion import poles
from sysid.structures.orders import Orders, orders_text
from sysid.structures.special_runs import stable_each
from sysid.structures.traits import Traits

# the edges of a static are values of the command itself
block_traits = partial(
    Traits,
    tells="static curves (dead zone, saturation), and the poles between them",
    stable_by_meaning=True,
    from_zero=True,
)


@dataclass(frozen=True)
class BlockStructure(NamedStructure):
    """Base of the block-oriented structures: everything follows from the chain of blocks.

    Attributes:
        linear_blocks: nb, nf, nk of each, the main one last.
        statics: at each of the ``places``, one a channel.
        requested: what the user left open at each place, None in a fitted model. An open structure
            stands for all that the fit may choose from.
        choose_orders: whether the orders are open too.
    """

    layer_names: ClassVar[tuple[str, ...]]
    """What each layer is called in parameter names; empty for the main linear block."""
    places: ClassVar[Mapping[str, int]]
    """The layer of the statics that each option asks for."""

    linear_blocks: tuple[Orders, ...]
    statics: tuple[tuple[Static, ...], ...]
    requested: tuple[RequestedStatics, ...] | None = None
    choose_orders: bool = False

    @classmethod
    def candidate_orders(
        cls, nu: int, ny: int, samples: int, delay: Any
    ) -> tuple[Mapping[str, Any], ...]:
        """The delay alone: the fit itself chooses orders together with the statics."""
        return ({"nk": delay},)

    @property
    @abstractmethod
    def chain(self) -> BlockChain:
        """The blocks, in the order in which a signal passes them."""

    @property
    def orders(self) -> Orders:
        """nb, nf, nk of the main linear block."""
        return self.linear_blocks[-1]

    def is_open(self, place: int) -> bool:
        """Whether a static at this place is left to choose."""
        return self.requested is not None and self.requested[place].open

    def resolved(self, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> Self:
        """Settled, with the statics asked for at the channels they were asked for."""
        statics = self.statics
        if self.requested is not None:
            statics = tuple(
                requested.of_channels(outputs if place == "output" else inputs, IDENTITY)
                for place, requested in zip(self.places, self.requested, strict=True)
            )
        return replace(self, statics=statics, requested=None, choose_orders=False)

    def with_chain(self, chain: BlockChain) -> Self:
        """This structure with the statics of another chain of the same layers."""
        layers = (chain.layers[k] for k in self.places.values())
        statics = tuple(layer.statics for layer in layers if isinstance(layer, StaticLayer))
        return replace(self, statics=statics)

    @property
    def words(self) -> str:
        """Orders and statics in a line."""
        kinds = [" ".join(dict.fromkeys(s.text for s in statics)) for statics in self.statics]
        at = (f"{place} {texts}" for place, texts in zip(self.places, kinds, strict=True))
        return ", ".join([orders_text(self.order_values()), *at])

    @property
    def nu(self) -> int:
        return self.chain.nu

    @property
    def ny(self) -> int:
        return self.chain.n_outputs

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Names (``input.d_high``, ``b1[omega_l,pwm_r]``, ``output.y3`` …) and units of θ.

        Of an open structure those it has before anything is chosen.
        """
        parameters: list[Parameter] = []
        single = self.nu == 1 and self.ny == 1
        layers = self.resolved(inputs, outputs).chain.layers
        for name, layer in zip(self.layer_names, layers, strict=True):
            if isinstance(layer, LinearLayer):
                parameters += self._linear_parameters(name, layer, inputs, outputs)
                continue
            channels = outputs if layer.last else inputs
            for k, (static, channel) in enumerate(zip(layer.statics, channels, strict=True)):
                tag = "" if single else f"[{channel.name}]"
                parameters += [
                    Parameter(f"{name}.{n}{tag}", self._unit(name, n, channel))
                    for n in static.names
                ]
                if layer.has_y0(k):
                    parameters.append(Parameter(f"y0{tag}", channel.unit))
        return tuple(parameters)

    def _linear_parameters(
        self,
        name: str,
        layer: LinearLayer,
        inputs: Sequence[Channel],
        outputs: Sequence[Channel],
    ) -> list[Parameter]:
        prefix = f"{name}." if name else ""
        rows = inputs if name else outputs
        parameters = []
        for i, j in layer.pairs:
            tag = f"[{inputs[j].name}]" if name else f"[{rows[i].name},{inputs[j].name}]"
            tag = "" if self.nu == 1 and self.ny == 1 else tag
            first = layer.nk[i][j]
            parameters += [
                Parameter(f"{prefix}b{k}{tag}") for k in range(first, first + layer.nb[i][j])
            ]
            parameters += [Parameter(f"{prefix}f{k}{tag}") for k in range(1, layer.nf[i][j] + 1)]
        return parameters

    @staticmethod
    def _unit(layer: str, name: str, channel: Channel) -> str:
        """Limits of an input static are inputs, values of an output static are outputs."""
        if layer == "input":
            return channel.unit if name[0] in "cdsx" else ""
        return channel.unit if layer == "output" and name[0] == "y" else ""

    def settings(self) -> dict[str, Any]:
        return dict(zip(self.places, self.statics, strict=True))

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        plain = cls.from_orders(raw["orders"], int(raw["nu"]), int(raw["ny"]))
        at = [raw["settings"][place] for place in cls.places]
        statics = tuple(tuple(Static.from_json(r) for r in row) for row in at)
        if [len(row) for row in statics] != [len(row) for row in plain.statics]:
            raise ValueError("its statics do not fit its channels")
        return replace(plain, statics=statics, requested=None, choose_orders=False)

    def n_states(self, theta: Array) -> int:
        return self.chain.n_states

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        return self.chain.fitted_state(theta, u, y, samples)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.chain.run(theta, u, x0)

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        return self.chain.step(theta)

    def stable(self, theta: Array) -> bool:
        """Whether all poles lie inside the unit circle.

        The statics grow no faster than a polynomial and nothing feeds back through them, so that
        bounded inputs then give bounded outputs.
        """
        return self.chain.admissible(theta)

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        if not len(u):
            return np.zeros((self.ny, 0, self.chain.n))
        with np.errstate(all="ignore"):
            _, D = self.chain.tangents(theta, u, None, states=False)
        return np.ascontiguousarray(D.swapaxes(1, 2))

    def equations(
        self, theta: Array, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[str, ...]:
        """One line a block and channel, with five significant digits."""
        lines: list[str] = []
        letters = iter("vwz")
        names = [c.name for c in inputs]
        for k, layer in enumerate(self.chain.layers):
            p = theta[self.chain.place(k)]
            if isinstance(layer, StaticLayer):
                if all(s.is_identity for s in layer.statics) and not layer.last:
                    continue
                new = (
                    [c.name for c in outputs]
                    if layer.last
                    else _fresh(next(letters), len(layer.statics))
                )
                for c, static in enumerate(layer.statics):
                    part = p[layer.edges[c] : layer.edges[c + 1]]
                    text = _static_text(static, part[: static.n], names[c])
                    if layer.has_y0(c):
                        text += f" {'-' if part[-1] < 0 else '+'} {abs(part[-1]):.5g}"
                    elif not layer.last:
                        zero = layer.statics[c].value(np.zeros(1), part)[0]
                        text += f" - ({zero:.5g})" if abs(zero) > 0 else ""
                    lines.append(f"{new[c]} = {text}")
            else:
                new = _fresh(next(letters), layer.n_outputs)
                terms: dict[int, list[str]] = {}
                for i, j, _, _, B, F in layer.entries(p):
                    bottom = f"/{_text(F)}" if len(F) > 1 else ""
                    terms.setdefault(i, []).append(f"{_text(B)}{bottom}·{names[j]}")
                lines += [f"{new[i]} = {' + '.join(terms.get(i, ['0']))}" for i in range(len(new))]
            names = new
        return tuple(lines)

    def properties(self, theta: Array, dt: float) -> dict[str, Any]:
        """Poles of each linear block, and what each static does at a few points."""
        blocks: list[dict[str, Any]] = []
        for k, (name, layer) in enumerate(zip(self.layer_names, self.chain.layers, strict=True)):
            p = theta[self.chain.place(k)]
            if isinstance(layer, LinearLayer):
                blocks += [
                    {
                        "block": name or "linear",
                        "output": i,
                        "input": j,
                        "poles": [pole_words(complex(z), dt) for z in np.roots(F)],
                        "zeros": [
                            {"re": float(z.real), "im": float(z.imag)}
                            for z in np.roots(np.trim_zeros(B))
                        ],
                        "static_gain": float(B.sum() / F.sum()) if F.sum() else None,
                    }
                    for i, j, _, _, B, F in layer.entries(p)
                ]
        z_plane = [pole_words(complex(z), dt) for z in poles(self, theta)]
        return {"stable": self.stable(theta), "poles": z_plane, "blocks": blocks}


def _static_text(static: Static, p: Array, argument: str) -> str:
    """The static with its numbers, e.g. ``dead-zone(u; d_low=-0.1, d_high=0.2)``."""
    for stage, part in zip(static.stages, static.slices(), strict=True):
        argument = _stage_text(stage, p[part], argument)
    return argument


def _stage_text(stage: Stage, p: Array, argument: str) -> str:
    if stage.kind == "abs":
        return f"|{argument} {'+' if p[0] < 0 else '-'} {abs(p[0]):.5g}|"
    if stage.kind in ("piecewise", "spline"):
        x = p[: stage.size] if stage.kind == "piecewise" else spline_knots(stage)
        points = " ".join(f"({a:.5g}, {b:.5g})" for a, b in zip(x, p[-stage.size :], strict=True))
        return f"{stage.kind}({argument}; {points})"
    numbers = ", ".join(f"{n}={v:.5g}" for n, v in zip(stage.names, p, strict=True))
    return f"{stage.kind}({argument}; {numbers})"


def _fresh(letter: str, n: int) -> list[str]:
    return [letter] if n == 1 else [f"{letter}{k + 1}" for k in range(n)]


@poles.register
def _(s: BlockStructure, theta: Array) -> NDArray[np.complex128]:
    roots = [np.roots(F) for F in s.chain.denominators(theta)]
    return np.concatenate([np.zeros(0), *roots]).astype(np.complex128)


@stable_each.register
def _(s: BlockStructure, thetas: Array) -> NDArray[np.bool_]:
    return s.chain.admissible_each(thetas)
