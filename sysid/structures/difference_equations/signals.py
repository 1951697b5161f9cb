"""Lagged signals: what equations are made of, which of them the orders name, one output's view."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array, Record
from sysid.structures.orders import Orders


class Signal(NamedTuple):
    """One lagged signal: kind ``y``, ``u`` or ``e`` (error), its channel, its lag in samples."""

    kind: str
    channel: int
    lag: int


def lagged_signals(orders: Orders, output: int) -> tuple[Signal, ...]:
    """The signals that the orders name for one output: its own past, that of others, inputs."""
    own_first = sorted(range(orders.ny), key=lambda j: j != output)
    past = [Signal("y", j, k) for j in own_first for k in range(1, orders.na[output][j] + 1)]
    around = [
        Signal("u", j, orders.nk[output][j] + k)
        for j, n in enumerate(orders.nb[output])
        for k in range(n)
    ]
    return (*past, *around)


def largest_lags(signals: Iterable[Signal], kind: str, channels: int) -> list[int]:
    """The largest lag of each channel of one kind, 0 where it does not occur, (channels,)."""
    largest = [0] * channels
    for s in signals:
        if s.kind == kind:
            largest[s.channel] = max(largest[s.channel], s.lag)
    return largest


class OneOutput:
    """The view of one output on data and signals.

    Args:
        nu, ny: inputs and outputs of the structure.

    Attributes:
        nu: inputs in this view: those of the structure, then the other outputs.
    """

    def __init__(self, output: int, nu: int, ny: int) -> None:
        self._output, self._own_inputs = output, nu
        self._others = [j for j in range(ny) if j != output]
        self.nu = nu + len(self._others)

    def data(self, r: Record) -> tuple[Array, Array]:
        """(u, y) of a record, y of shape (N, 1)."""
        return np.hstack([r.u, r.y[:, self._others]]), r.y[:, [self._output]]

    def inward(self, s: Signal) -> Signal:
        """A signal of the structure as this view has it."""
        if s.kind == "u":
            return s
        if s.channel == self._output:
            return Signal(s.kind, 0, s.lag)
        return Signal("u", self._own_inputs + self._others.index(s.channel), s.lag)

    def outward(self, s: Signal) -> Signal:
        if s.kind == "y":
            return Signal("y", self._output, s.lag)
        if s.channel < self._own_inputs:
            return s
        return Signal("y", self._others[s.channel - self._own_inputs], s.lag)
