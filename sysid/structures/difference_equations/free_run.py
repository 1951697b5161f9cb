"""Free runs of difference equations, all made from one function: that of the known signals.

ŷ_i(t) = clip(F_i(past ŷ, past and present u)). A family gives F (``equations``) over an array
namespace and a sequence of known values; steps, single runs on plain numbers, and many runs side by
side follow from it. The state stacks y_j(t−1) … y_j(t−depth_j) output after output, then the inputs
likewise.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index, Record
from sysid.runners import floats
from sysid.runners.single import kept_inside, on_arrays
from sysid.structures.difference_equations.signals import Signal, largest_lags

Limits = tuple[tuple[float, float], ...]
"""Lowest and highest value of each output in free run."""

Place = Callable[[Signal], int]
"""Where a signal stands in a sequence of known values."""

OfInputs = Callable[[Any], Sequence[Any]]
"""Known values → what follows from the inputs among them, each a number or an array."""

OfOutputs = Callable[[Any, Any], Sequence[Any]]
"""(known values, what followed from inputs) → the outputs before they are limited."""

WORK = 2_000_000
"""Numbers held at a time by k-step predictions."""

BLOCK = 50_000
"""Samples, those of all runs counted, for which what follows from inputs is held at a time."""


@dataclass(frozen=True, eq=False)
class Chunks:
    """Stretches of data side by side, zero where one has ended.

    Attributes:
        u: inputs with what came before them, (before + L, nu, B).
        past: outputs before each stretch, (depth, ny, B).
        y: measured outputs, (L, ny, B).
        inside: which samples belong to each stretch, (L, B).
    """

    u: Array
    past: Array
    y: Array
    inside: NDArray[np.bool_]


class FreeRun(ABC):
    """Equations of all outputs, prepared for runs one by one and for many runs at once.

    Args:
        used: signals that occur in the equations.
        limits: bounds of each output.

    Attributes:
        y_depth, u_depth: past samples of each output and input in the state.
        depth, before: past outputs (at least one) and inputs that a run needs.
        first: first sample whose signals lie inside the record.
        theta_index: entries of θ that belong to each output; θ stacks them.
        n_theta: length of θ.
        inputs: lagged inputs that occur.
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
        self.inputs = sorted({s for s in used if s.kind == "u"})
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

    # ----------------------------------------------------------------- the equations

    @abstractmethod
    def parts(self, xp: Any, theta: Any, place: Place) -> tuple[OfInputs, OfOutputs]:
        """F in two parts: what holds no past output, which runs compute beforehand, and the rest.

        Args:
            theta: (n_theta,), or (n_theta, …) where each run has its own.
            place: where each signal will stand.
        """

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y)."""
        source, n = self.shift().tolist(), self.n_states
        lows, highs = zip(*self.limits, strict=True)

        def prepared(xp: Any) -> tuple[OfInputs, OfOutputs, Callable[[Any, Any, Any], Any]]:
            return *self.parts(xp, theta, self.place), kept_inside(xp)

        plain = prepared(floats) if isinstance(theta, np.ndarray) else None

        def advance(xp: Any, x: Any, u: Any) -> tuple[list[Any], list[Any]]:
            known = [*x, *u]
            of_inputs, of_outputs, keep = plain if xp is floats and plain else prepared(xp)
            y = list(map(keep, of_outputs(known, of_inputs(known)), lows, highs))
            pool = [*known[:n], *y, *known[n:]]
            return [pool[k] for k in source], y

        return on_arrays(advance)

    def along(self, s: Signal) -> int:
        """``place`` along a run: among all its past outputs, from their end, or the inputs used."""
        return s.channel - s.lag * self.ny if s.kind == "y" else self.inputs.index(s)

    def lagged_inputs(self, u: Any, start: int, stop: int) -> list[Any]:
        """The inputs used at samples of a run, of inputs (before + L, nu, …), (stop − start, …)."""
        first = [self.before - s.lag for s in self.inputs]
        return [u[k + start : k + stop, s.channel] for k, s in zip(first, self.inputs, strict=True)]

    def outputs(self, xp: Any, theta: Array, u: Array, past: Array) -> Iterator[Sequence[Any]]:
        """y of one sample after the other.

        Args:
            xp: ``floats`` for one run, NumPy for runs side by side.
            u: inputs (before + L, nu, …).
            past: outputs (depth, ny, …).
        """
        of_inputs, of_outputs = self.parts(xp, theta, self.along)
        runs = np.broadcast_shapes(u.shape[2:], theta.shape[1:])
        known = list(past.reshape(-1, *past.shape[2:])) if runs else past.ravel().tolist()
        needed, length = len(known), len(u) - self.before
        keep, (lows, highs) = kept_inside(xp), zip(*self.limits, strict=True)
        block = max(BLOCK // int(np.prod(runs, dtype=int)), 1)
        with np.errstate(over="ignore", invalid="ignore"):
            for start in range(0, length, block):
                stop = min(start + block, length)
                columns = of_inputs(self.lagged_inputs(u, start, stop))
                rows = np.empty((stop - start, len(columns), *runs))
                for k, column in enumerate(columns):
                    rows[:, k] = column
                for row in rows if runs else rows.tolist():
                    y = list(map(keep, of_outputs(known, row), lows, highs))
                    yield y
                    known += y
                del known[: len(known) - needed]

    # ----------------------------------------------------------------- runs

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run for inputs (N, nu) from a state, (N, ny)."""
        past, before = self.past(x0)
        run = list(self.outputs(floats, theta, np.concatenate([before, u]), past))
        return np.array(run, dtype=np.float64).reshape(len(u), self.ny)

    def measured(self, theta: Array, records: Sequence[Record]) -> list[Array]:
        """Free runs of the records from their first measured samples, without these."""
        n = self.first
        return [
            self.simulate(theta, r.u[n:], self.state(r.y[:n], r.u[:n]))
            for r in records
            if len(r) > n
        ]

    def driven(self, theta: Array, u: Array, past: Array) -> Array:
        """All runs for inputs (before + L, nu, B) from past outputs (depth, ny, B), (L, ny, B)."""
        out = np.empty((len(u) - self.before, self.ny, u.shape[2]))
        for into, y in zip(out, self.outputs(np, theta, u, past), strict=True):
            for i, value in enumerate(y):
                into[i] = value
        return out

    def outputs_over(self, theta: Array, chunks: Chunks) -> Array:
        """ŷ (L, ny, B) of stretches of data."""
        return self.driven(theta, chunks.u, chunks.past)

    @abstractmethod
    def slopes_over(self, theta: Array, chunks: Chunks, outputs: Array) -> Array:
        """∂ŷ/∂θ (L, ny, B, n_theta) along these runs; zero where they are at their limits."""

    @property
    def width(self) -> int:
        """Numbers that one run holds a sample."""
        return self.nu + self.ny

    def predictions(
        self, theta: Array, u: Array, y: Array, horizon: int, first: int, unknown: int = 0
    ) -> Array:
        """k-step-ahead predictions, (N, ny): runs of ``horizon`` steps started at every sample.

        Args:
            u, y: the record.
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
