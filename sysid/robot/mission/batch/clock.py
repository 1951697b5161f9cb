"""Both clocks of a mission as arrays, in blocks of samples for a compiled loop."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from sysid.data.record import Array, Index
from sysid.robot.mission.loop import Tick, ticks

BLOCK = 32
"""Samples between two looks at whether all runs have ended: a tenth of a usual mission."""

Pattern = tuple[int, int]
"""Control instants before a sample and together with it."""


@dataclass(frozen=True, eq=False)
class Block:
    """Some samples one after the other.

    Attributes:
        t, dt: of every sample [s], (BLOCK,).
        kinds: its pattern, as an index into all patterns, (BLOCK,).
        instants: its control instants, padded with zeros, (BLOCK, most) [s].
    """

    t: Array
    dt: Array
    kinds: Index
    instants: Array


class Clock:
    """The samples of a mission, in blocks, made as they are asked for and kept.

    The instants of both clocks differ from sample to sample in number, of which there are few
    kinds; a compiled loop has a branch for each.

    Args:
        dt: of the plant [s].
        period: of control [s].

    Attributes:
        patterns: in the order in which they first occur; it grows with the blocks.
    """

    def __init__(self, dt: float, period: float) -> None:
        self._ticks: Iterator[Tick] = ticks(dt, period)
        self._rows: list[list[Tick]] = []
        self.patterns: list[Pattern] = []

    def block(self, k: int) -> Block:
        while len(self._rows) <= k:
            rows = list(islice(self._ticks, BLOCK))
            self._rows.append(rows)
            for tick in rows:
                pattern = (len(tick.before), len(tick.now))
                if pattern not in self.patterns:
                    self.patterns.append(pattern)
        rows = self._rows[k]
        most = max(1, *(sum(p) for p in self.patterns))
        instants = np.zeros((len(rows), most))
        for row, tick in zip(instants, rows, strict=True):
            both = (*tick.before, *tick.now)
            row[: len(both)] = both
        return Block(
            np.array([tick.t for tick in rows]),
            np.array([tick.dt for tick in rows]),
            np.array([self.patterns.index((len(r.before), len(r.now))) for r in rows]),
            instants,
        )
