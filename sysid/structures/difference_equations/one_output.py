"""One output of several alone: the other outputs are measured and count as inputs."""

import numpy as np

from sysid.data.record import Array, Record
from sysid.structures.difference_equations.signals import Signal


class OneOutput:
    """The view of one output on data and signals.

    Args:
        output: which one.
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
        """Undo ``inward``."""
        if s.kind == "y":
            return Signal("y", self._output, s.lag)
        if s.channel < self._own_inputs:
            return s
        return Signal("y", self._others[s.channel - self._own_inputs], s.lag)
