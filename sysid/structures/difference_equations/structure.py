"""Base class of structures whose outputs feed back through a nonlinear equation."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from sysid.data.documents import by_field
from sysid.data.record import Array, Channel, Index, Record
from sysid.fitting.batched import OneTrial, descend_alone
from sysid.fitting.problem import Data, Problem
from sysid.structures.base import NamedStructure
from sysid.structures.difference_equations.chunks import ChunkedRuns
from sysid.structures.difference_equations.free_run import FreeRun, Limits, ranges, widened
from sysid.structures.difference_equations.probing import stays_near
from sysid.structures.orders import Orders

PULL = 1e-2
"""Weight of the prior against one sample: it decides only what the head leaves open."""

STEP = 1e-6
ROUNDS = 15
GAIN = 1e-10


def fitted_state(
    run: FreeRun, theta: Array, u: Array, y: Array, samples: int, spread: Array
) -> Array:
    """State whose free run meets the first samples of y best.

    Levenberg-Marquardt over past outputs and inputs, slopes by differences (all in one batched
    run), drawn weakly towards "everything before was like the first sample".

    Args:
        u, y: the record.
        samples: samples at its head that count.
        spread: (ny + nu,), the size of a usual change of each output and input.
    """
    n, k = run.n_states, min(samples, len(y))
    if n == 0 or k == 0:
        return np.zeros(n)
    prior = run.state(np.repeat(y[:1], run.depth, axis=0), np.repeat(u[:1], run.before, axis=0))
    size = np.where(spread > 0, spread, 1.0)
    scale = np.repeat(size, [*run.y_depth, *run.u_depth])
    head = np.repeat(u[:k, :, None], n + 1, axis=2)

    def tried(z: Array, _: Index) -> OneTrial:
        """The run at z and next to it along each coordinate, z in usual changes from the prior."""
        moved = np.column_stack([z.T, z.T + STEP * np.eye(n)])
        pasts = [run.past(prior + scale * s) for s in moved.T]
        past, before = (np.stack(parts, axis=2) for parts in zip(*pasts, strict=True))
        outputs = run.driven(theta, np.concatenate([before, head]), past)
        e = ((y[:k, :, None] - outputs) / size[: run.ny, None]).reshape(k * run.ny, n + 1)
        e = np.concatenate([e, -PULL * moved])
        return OneTrial(e[:, 0], lambda: (e[:, :1] - e[:, 1:]) / STEP)

    return prior + scale * descend_alone(tried, np.zeros(n), ROUNDS, GAIN)


@dataclass(frozen=True)
class RecursiveStructure(NamedStructure):
    """y(t) = F(past y, past and present u) + e(t), one equation an output; na, nb, nk say which.

    In free run every output is kept inside its training range widened by ``margin``: the equation
    says nothing about where it has seen no data.
    """

    orders: Orders
    output_range: Limits = ()
    input_range: Limits = ()

    runaway: ClassVar[float]
    """Range widths beyond the training range from which a probe counts as running away."""

    @property
    @abstractmethod
    def margin(self) -> float:
        """How far outside its training range an output may go, as a share of that range."""

    @abstractmethod
    def free_run(self, limits: Limits | None = None) -> FreeRun:
        """The equations prepared for runs, kept inside ``limits``; inside its own unless given."""

    @property
    def nu(self) -> int:
        return self.orders.nu

    @property
    def ny(self) -> int:
        return self.orders.ny

    def order_values(self) -> dict[str, Any]:
        return {name: self.orders.value(name) for name in self.traits.order_names}

    def settings(self) -> dict[str, Any]:
        """Every field besides the orders."""
        return {name: value for name, value in by_field(self).items() if name != "orders"}

    def with_ranges(self, records: Sequence[Record]) -> Self:
        """The structure with the lowest and highest value of each channel."""
        return replace(
            self,
            output_range=ranges([r.y for r in records]),
            input_range=ranges([r.u for r in records]),
        )

    @property
    def limits(self) -> Limits:
        """Lowest and highest value of each output in free run; infinite before a fit."""
        if not self.output_range:
            return ((-np.inf, np.inf),) * self.ny
        return widened(self.output_range, self.margin)

    def at_limits(self, run: Array) -> Array:
        """Share of the samples of a free run (N, ny) at which each output is held at a limit."""
        ends = np.array(self.limits)
        return np.asarray(np.mean((run <= ends[:, 0]) | (run >= ends[:, 1]), axis=0))

    def limit_warnings(
        self, runs: Sequence[Array], outputs: Sequence[Channel], advice: str
    ) -> tuple[str, ...]:
        """Sentences about outputs that free runs (N, ny) hold at a limit, with what to do."""
        shares = np.max([self.at_limits(run) for run in runs], axis=0, initial=0.0)
        return tuple(
            f"In free run {channel.name} is held at the limit of its range at "
            f"{100.0 * share:.2g} % of the samples of one record: {advice}."
            for channel, share in zip(outputs, shares, strict=True)
            if share > 0.0
        )

    def row_index(self, i: int) -> Index:
        """Entries of θ that belong to output ``i``."""
        return self.free_run().theta_index[i]

    # ----------------------------------------------------------------- problems

    @abstractmethod
    def one_step(self, i: int, data: Data) -> Problem:
        """The errors of output ``i`` one step ahead on (u, y) of each record."""

    def over_chunks(self, data: Data, length: int) -> ChunkedRuns:
        """The errors of all outputs in free runs over chunks of about ``length`` samples."""
        return ChunkedRuns(self.free_run(), data, length)

    def errors(self, theta: Array, u: Array, y: Array, window: int) -> Array:
        """One-step errors; they need no initial state, past errors before the record are zero."""
        out = np.full(y.shape, np.nan)
        first = self.first_sample()
        if len(y) > first:
            for i in range(self.ny):
                out[first:, i] = self.one_step(i, [(u, y)]).residual(theta[self.row_index(i)])
        return out

    def predict(self, theta: Array, u: Array, y: Array, horizon: int, window: int) -> Array:
        """k-step-ahead predictions: free runs of k steps from the measured past, everywhere."""
        if horizon == 1:
            return y - self.errors(theta, u, y, window)
        return self.free_run().predictions(theta, u, y, horizon, self.first_sample())

    def gradients(self, theta: Array, u: Array, y: Array) -> Array:
        first, slopes = self.first_sample(), np.zeros((self.ny, len(y), len(theta)))
        for i, of_output in enumerate(slopes if len(y) > first else ()):
            entries = self.row_index(i)
            of_output[first:, entries] = -self.one_step(i, [(u, y)]).jacobian(theta[entries])
        return slopes

    # ----------------------------------------------------------------- runs

    def first_sample(self) -> int:
        return self.free_run().first

    def n_states(self, theta: Array) -> int:
        """Past outputs and inputs that the equations hold."""
        return self.free_run().n_states

    def fitted_state(self, theta: Array, u: Array, y: Array, samples: int) -> Array:
        """State that meets the first ``samples`` of y best in free run, near steady state."""
        spans = [high - low or 1.0 for low, high in (*self.output_range, *self.input_range)]
        if not spans:
            spans = [float(np.ptp(s)) or 1.0 for s in (*y.T, *u.T)]
        return fitted_state(self.free_run(), theta, u, y, samples, np.array(spans) / 4.0)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        return self.free_run().simulate(theta, u, x0)

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        return self.free_run().step(theta)

    def stable(self, theta: Array) -> bool:
        """Whether the equations themselves stay near their data, without help from the limits.

        Judged by free runs from rest under inputs that fill the training range: random two-level
        inputs, fast and slow, and its two ends held. None may go further beyond the training range
        of an output than ``runaway`` times its width. With the limits every free run is bounded.
        """
        if not np.all(np.isfinite(theta)):
            return False
        if not self.output_range:
            return True
        run = self.free_run(widened(self.output_range, self.runaway))
        return stays_near(run, theta, self.input_range, self.largest_input_step())

    def largest_input_step(self) -> Sequence[float] | None:
        """Largest change of each input from one sample to the next, where it is known."""
        return None
