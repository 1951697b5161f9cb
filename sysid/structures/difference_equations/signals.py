"""Lagged signals: what terms and expressions are made of, and which of them the orders name."""

from collections.abc import Iterable
from typing import NamedTuple

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
