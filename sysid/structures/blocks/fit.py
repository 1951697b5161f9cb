"""Fits of chains of blocks: descents on the samples that are not held out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.fitting.holdout import error_margin
from sysid.fitting.marquardt import Conditions, loss, marquardt
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.blocks.errors import ChainErrors, output_scales
from sysid.structures.blocks.layers import StaticLayer

Mask = NDArray[np.bool_]

ROUGH_TOLERANCE = 1e-4
"""Relative gain of a step below which a descent that only ranks candidates ends."""


FELT_STATE = 0.1
"""Share of the errors that the whole range of an initial state is taken to change at least: one
that changes less says nothing, and its step shall be small."""

HEAD = 400
"""Samples at the head of a record that say enough about its initial state to start from."""


@dataclass(frozen=True, eq=False)
class ChainData:
    """Experiments with the samples that are fitted and those that choose.

    Attributes:
        data: (u, y) of each experiment.
        kept: samples to fit on.
        holdout: samples to choose on.
        scales: standard deviation of each output.
    """

    data: tuple[tuple[Array, Array], ...]
    kept: tuple[Mask, ...]
    holdout: tuple[Mask, ...]
    scales: Array

    @staticmethod
    def of(records: Sequence[Record], holdout: Sequence[Mask] | None = None) -> "ChainData":
        """All samples of the records are fitted, except those held out and outliers."""
        data = tuple((np.asarray(r.u), np.asarray(r.y)) for r in records)
        none = (
            tuple(np.zeros(len(y), dtype=bool) for _, y in data)
            if holdout is None
            else tuple(holdout)
        )
        kept = tuple(~m & r.counted for m, r in zip(none, records, strict=True))
        held_out = tuple(m & r.counted for m, r in zip(none, records, strict=True))
        return ChainData(data, kept, held_out, output_scales([y for _, y in data]))

    def problem(self, chain: BlockChain, kept: Sequence[Mask] | None = None) -> ChainErrors:
        """The free-run errors of a chain, initial states estimated."""
        return ChainErrors(chain, self.data, True, self.kept if kept is None else kept, self.scales)

    def holdout_error(self, chain: BlockChain, p: Array) -> float:
        """Root mean square of the held-out errors relative to the outputs' spread."""
        e = self.problem(chain, self.holdout).residual(p)
        size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
        return size if size < 1e6 else float("inf")

    def holdout_margin(self, chain: BlockChain, p: Array) -> float:
        """Fraction by which that error is uncertain: one standard error."""
        problem = self.problem(chain, self.holdout)
        parts = np.split(problem.residual(p), np.cumsum(problem.lengths)[:-1])
        masks = [mask for mask in self.holdout for _ in self.scales]
        series = [np.zeros(len(mask)) for mask in masks]
        for whole, mask, part in zip(series, masks, parts, strict=True):
            whole[mask] = part
        return error_margin(series)

    def with_states(self, chain: BlockChain, theta: Array) -> Array:
        """θ and, for each experiment, the state that meets the head of its fitted samples best."""
        head = min(HEAD, 3 * chain.n_states + HEAD // 4)
        states = [
            chain.fitted_state(theta, u, np.where(kept[:, None], y, np.nan), head)
            for (u, y), kept in zip(self.data, self.kept, strict=True)
        ]
        return np.concatenate([theta, *states])

    @property
    def samples(self) -> int:
        """Samples that are fitted."""
        return sum(int(k.sum()) for k in self.kept)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A chain with parameters and initial states, and how well it does.

    Attributes:
        p: θ and the initial states of each experiment.
        cost: ½ Σ (ε/scale)² of the fitted samples.
        holdout_error: relative error of the held-out samples, NaN without any.
        evaluations: residual evaluations spent.
    """

    chain: BlockChain
    p: Array
    cost: float
    holdout_error: float
    evaluations: int

    @property
    def theta(self) -> Array:
        """The parameters without initial states."""
        return self.p[: self.chain.n]


def descend(
    chain: BlockChain,
    p0: Array,
    data: ChainData,
    *,
    evaluations: int,
    fixed_entries: Sequence[int] = (),
    tolerance: float = ROUGH_TOLERANCE,
    problem: ChainErrors | None = None,
) -> Fitted:
    """Levenberg-Marquardt on the fitted samples from p0 (θ, or θ and initial states).

    The normal equations are summed experiment by experiment, so that 10⁵ samples of 40 parameters
    cost 50 ms a step. Their condition is that of J squared, which the damping bears; the last
    search works on J itself. An initial state that is felt next to nothing, within a dead zone or
    where a sensor saturates, would run away with every step, and no other entry could move: it
    counts as if it were felt a little.
    """
    problem = data.problem(chain) if problem is None else problem
    missing = len(p0) < chain.n + problem.n_initial
    p = data.with_states(chain, p0) if missing else p0.copy()
    free = np.ones(len(p), dtype=bool)
    free[list(fixed_entries)] = False
    sizes = np.concatenate([np.full(chain.n, np.inf), problem.state_sizes(p)])[free]

    def full(x: Array) -> Array:
        out = p.copy()
        out[free] = x
        return out

    def normal(x: Array, r: Array) -> tuple[Array, Array]:
        gram, slope = problem.normal_equations(full(x), r)
        return gram[np.ix_(free, free)], slope[free]

    conditions = Conditions(tolerance, evaluations, least_scale=FELT_STATE / sizes)
    x, spent, _ = marquardt(lambda x: problem.residual(full(x)), p[free], None, conditions, normal)
    p = full(x)
    holdout_error = (
        data.holdout_error(chain, p) if any(m.any() for m in data.holdout) else float("nan")
    )
    return Fitted(chain, p, loss(problem.residual(p)), holdout_error, spent)


def abscissae(chain: BlockChain) -> list[int]:
    """Entries of θ that are abscissae of piecewise-linear statics, all but none."""
    points = []
    for k, layer in enumerate(chain.layers):
        if not isinstance(layer, StaticLayer):
            continue
        for static, at in zip(layer.statics, layer.edges[:-1], strict=True):
            for stage, part in zip(static.stages, static.slices(), strict=True):
                if stage.kind == "piecewise":
                    first = chain.edges[k] + at + part.start
                    points += list(range(first, first + stage.size))
    return points


def outer_abscissae(chain: BlockChain) -> list[int]:
    """Those at either end: only the slope of an outer segment is seen, not where it ends."""
    every = abscissae(chain)
    return [k for k in every if k - 1 not in every or k + 1 not in every]
