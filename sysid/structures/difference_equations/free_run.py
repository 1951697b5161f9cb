"""Free runs of difference equations: where the past lies in a state, and what all such runs share.

ŷ_i(t) = clip(F_i(past ŷ, past and present u)): the equations differ, the state does not. It stacks
y_j(t−1) … y_j(t−depth_j) output after output, then the inputs likewise.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array, Index, Record
from sysid.structures.difference_equations.signals import Signal, largest_lags
from sysid.structures.difference_equations.single_values import Limits

WORK = 2_000_000
"""Numbers held at a time by k-step predictions."""


class FreeRun(ABC):
    """Equations of all outputs, prepared for runs one by one and for many runs at once.

    Args:
        used: signals that occur in the equations.
        nu: number of inputs.
        limits: bounds of each output.

    Attributes:
        y_depth, u_depth: past samples of each output and input in the state.
        depth, before: past outputs (at least one) and inputs that a run needs.
        first: first sample whose signals lie inside the record.
        theta_index: entries of θ that belong to each output; θ stacks them.
        n_theta: length of θ.
    """

    theta_index: list[Index]
    n_theta: int

    def __init__(self, used: Iterable[Signal], nu: int, limits: Limits) -> None:
        used = tuple(used)
        self.nu, self.ny, self.limits = nu, len(limits), limits
        self.y_depth = largest_lags(used, "y", self.ny)
        self.u_depth = largest_lags(used, "u", nu)
        self.depth = max(*self.y_depth, 1)
        self.before = max([0, *self.u_depth])
        self.first = max(self.before, *self.y_depth)
        self.feeds_back = any(self.y_depth)
        starts = np.cumsum([0, *self.y_depth, *self.u_depth]).tolist()
        self._y_at, self._u_at = starts[: self.ny], starts[self.ny : -1]
        self.n_states = int(starts[-1])

    # ----------------------------------------------------------------- states

    def past(self, x0: Array | None) -> tuple[Array, Array]:
        """State → past outputs (depth, ny) and inputs (before, nu), oldest first."""
        y, u = np.zeros((self.depth, self.ny)), np.zeros((self.before, self.nu))
        if x0 is not None:
            edges = pairwise(np.cumsum([0, *self.y_depth, *self.u_depth]).tolist())
            for k, (a, b) in enumerate(edges):
                past, j = (y, k) if k < self.ny else (u, k - self.ny)
                past[len(past) - (b - a) :, j] = x0[a:b][::-1]
        return y, u

    def state(self, y: Array, u: Array) -> Array:
        """Past outputs and inputs, oldest first and at least as long as needed → state."""
        parts = [
            s[len(s) - n :, j][::-1]
            for s, depths in ((y, self.y_depth), (u, self.u_depth))
            for j, n in enumerate(depths)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def place(self, s: Signal) -> int:
        """Index of a signal in the list of the state followed by the inputs of now."""
        if s.kind == "y":
            return int(self._y_at[s.channel]) + s.lag - 1
        return self.n_states + s.channel if s.lag == 0 else int(self._u_at[s.channel]) + s.lag - 1

    def shift(self) -> Index:
        """Where every entry of x⁺ stands in (x, y, u): one place along, the newest in u and y."""
        n = self.n_states
        source = np.arange(-1, n - 1)
        newest = ((self._y_at, self.y_depth, n), (self._u_at, self.u_depth, n + self.ny))
        for at, depths, first in newest:
            for j, (a, depth) in enumerate(zip(at, depths, strict=True)):
                if depth:
                    source[a] = first + j
        return source

    # ----------------------------------------------------------------- one run

    @abstractmethod
    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run for inputs (N, nu) from a state, (N, ny)."""

    def measured(self, theta: Array, records: Sequence[Record]) -> list[Array]:
        """Free runs of the records from their first measured samples, without these."""
        n = self.first
        return [
            self.simulate(theta, r.u[n:], self.state(r.y[:n], r.u[:n]))
            for r in records
            if len(r) > n
        ]

    @abstractmethod
    def stepper(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y), everything looked up beforehand."""

    # ----------------------------------------------------------------- many runs at once

    @property
    @abstractmethod
    def width(self) -> int:
        """Numbers that one run holds a sample."""

    @abstractmethod
    def input_products(self, u: Array) -> Array:
        """What of inputs (before + L, nu, B) can be known before the runs."""

    @abstractmethod
    def weights(self, theta: Array, products: Array) -> Any:
        """The same with the parameters."""

    @abstractmethod
    def runs(self, weights: Any, past: Array) -> Array:
        """All runs at once from past outputs (depth, ny, B): (depth + L, ny, B), past included."""

    def driven(self, theta: Array, u: Array, past: Array) -> Array:
        """All runs for inputs (before + L, nu, B) from past outputs (depth, ny, B), (L, ny, B)."""
        return self.runs(self.weights(theta, self.input_products(u)), past)[self.depth :]

    def predictions(
        self, theta: Array, u: Array, y: Array, horizon: int, first: int, unknown: int = 0
    ) -> Array:
        """k-step-ahead predictions, (N, ny): runs of ``horizon`` steps started at every sample.

        Args:
            u, y: the record.
            horizon: steps of a run.
            first: first sample at which a run may start; predictions before its end are NaN.
            unknown: so many inputs at the end of u are known up to each start and zero after.
        """
        out = np.full(y.shape, np.nan)
        starts = np.arange(first, len(y) - horizon + 1)
        each = max(WORK // (horizon * self.width), 1)
        for at in range(0, len(starts), each):
            s = starts[at : at + each]
            # what lies before the record counts as zero
            around = np.arange(-self.before, horizon)[:, None] + s
            inputs = np.where(around[:, :, None] < 0, 0.0, u[np.maximum(around, 0)])
            inputs = inputs.transpose(0, 2, 1)
            inputs[self.before :, self.nu - unknown :] = 0.0
            back = np.arange(-self.depth, 0)[:, None] + s
            past = y[np.maximum(back, 0)].transpose(0, 2, 1)
            out[s + horizon - 1] = self.driven(theta, inputs, past)[-1].T
        return out


def widened(ranges: Limits, margin: float) -> Limits:
    """Each range with ``margin`` times its width added on either side."""
    return tuple(
        (low - margin * (high - low), high + margin * (high - low)) for low, high in ranges
    )


def ranges(signals: Sequence[Array]) -> Limits:
    """Lowest and highest value of each column over all arrays (N, n)."""
    stacked = np.concatenate(signals)
    return tuple(zip(stacked.min(axis=0).tolist(), stacked.max(axis=0).tolist(), strict=True))
