"""Layers of block-oriented models: a static for each channel, or a matrix of transfer functions."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.structures.blocks.static.functions import Static
from sysid.structures.orders import Matrix


@dataclass(frozen=True)
class StaticLayer:
    """A static for each channel.

    Attributes:
        statics: one a channel.
        last: whether y0 is added; otherwise the value at 0 is taken off.
    """

    statics: tuple[Static, ...]
    last: bool = False

    def has_y0(self, k: int) -> bool:
        """Whether channel k has an offset of its own besides what its static can add."""
        return self.last and not self.statics[k].has_offset

    @cached_property
    def edges(self) -> tuple[int, ...]:
        """Where the parameters of each channel begin and end."""
        sizes = [s.n + self.has_y0(k) for k, s in enumerate(self.statics)]
        return tuple(np.cumsum([0, *sizes]).tolist())

    @property
    def n(self) -> int:
        return self.edges[-1]

    n_states = 0

    def offset(self, k: int, p: Array) -> Any:
        """What channel k adds to its static: y0, or what brings it through the origin."""
        xp: Any = p.__array_namespace__()
        static = self.statics[k]
        if self.last:
            return p[static.n] if self.has_y0(k) else xp.zeros(())
        return -static.value(xp.zeros(1), p[: static.n], xp)[0]

    def value(self, k: int, x: Array, p: Array) -> Array:
        """The output of channel k for its input x; p are the channel's parameters."""
        out: Array = self.statics[k].value(x, p) + self.offset(k, p)
        return out

    def values(self, signals: Array, p: Array) -> Array:
        """The outputs of all channels for their inputs, (channels, N)."""
        edges = enumerate(pairwise(self.edges))
        return np.array([self.value(c, signals[c], p[a:b]) for c, (a, b) in edges])

    def evaluated(self, k: int, x: Array, p: Array) -> tuple[Array, Array | None, Array]:
        """(value, slope or None where it is 1, partial derivatives) of channel k."""
        static = self.statics[k]
        if static.is_identity:
            return self.value(k, x, p), None, np.ones((int(self.last), len(x)))
        value, slope, partials = static.evaluated(x, p[: static.n])
        if not self.last:
            zero, _, at_zero = static.evaluated(np.zeros(1), p[: static.n])
            return value - zero, slope, partials - at_zero
        if self.has_y0(k):
            return value + p[static.n], slope, np.concatenate([partials, np.ones((1, len(x)))])
        return value, slope, partials


@dataclass(frozen=True)
class LinearLayer:
    """A matrix of transfer functions; entry (i, j) exists where nb[i][j] > 0.

    Each entry has its own state, that of the transposed direct form II.
    """

    nb: Matrix
    nf: Matrix
    nk: Matrix

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """(output, input) of every entry."""
        return tuple((i, j) for i, row in enumerate(self.nb) for j, n in enumerate(row) if n)

    @cached_property
    def edges(self) -> tuple[int, ...]:
        """Where the coefficients [b…, f…] of each entry begin and end."""
        sizes = [self.nb[i][j] + self.nf[i][j] for i, j in self.pairs]
        return tuple(np.cumsum([0, *sizes]).tolist())

    @property
    def n(self) -> int:
        return self.edges[-1]

    @cached_property
    def orders(self) -> tuple[int, ...]:
        """Number of states of each entry."""
        return tuple(max(self.nf[i][j], self.nk[i][j] + self.nb[i][j] - 1) for i, j in self.pairs)

    @property
    def n_states(self) -> int:
        return sum(self.orders)

    def entries(self, p: Array) -> Iterator[tuple[int, int, int, slice, Array, Array]]:
        """(output, input, number of states, place in p, B, F) of every entry."""
        for q, (i, j) in enumerate(self.pairs):
            s = slice(self.edges[q], self.edges[q + 1])
            nb, part = self.nb[i][j], p[s]
            B = np.concatenate([np.zeros(self.nk[i][j]), part[:nb]])
            yield i, j, self.orders[q], s, B, np.concatenate([[1.0], part[nb:]])

    @property
    def n_outputs(self) -> int:
        return len(self.nb)


Layer = StaticLayer | LinearLayer
