"""Free-run errors of a chain of blocks as a least-squares problem."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.fitting.problem import Problem
from sysid.structures.blocks.chain import BlockChain
from sysid.structures.linear.predictor import HUGE

HEAD = 400
"""Samples at the head of a record that say enough about its initial state to start from."""

Masks = Sequence[NDArray[np.bool_]]


class ChainErrors(Problem):
    """Free-run errors (y − ŷ)/scale of a chain, all outputs together, with exact derivatives.

    Only stable chains are admissible: an unstable one has no free run to speak of.

    Args:
        chain: what is run.
        data: (u, y) of each experiment.
        estimate_initial: whether initial states are estimated or those of rest.
        kept: samples that count, by experiment; all when None. The run goes through the others,
            which is how data are held out without cutting a record.
        scales: divisor of each output's errors, so that units do not decide what matters.
    """

    def __init__(
        self,
        chain: BlockChain,
        data: Sequence[tuple[Array, Array]],
        estimate_initial: bool,
        kept: Masks | None = None,
        scales: Array | None = None,
    ) -> None:
        self.chain, self.data = chain, data
        self.index = np.arange(chain.n)
        self.states_each = chain.n_states if estimate_initial else 0
        self.n_initial = self.states_each * len(data)
        self.kept = [np.ones(len(y), dtype=bool) for _, y in data] if kept is None else list(kept)
        ny = chain.n_outputs
        self.scales: Array = output_scales([y for _, y in data]) if scales is None else scales
        self.lengths = tuple(int(k.sum()) for k in self.kept for _ in range(ny))
        self.channels = tuple(i for _ in data for i in range(ny))

    def state(self, p: Array, k: int) -> Array | None:
        """Initial state of experiment k in p."""
        at = self.chain.n + k * self.states_each
        return p[at : at + self.states_each] if self.states_each else None

    def residual(self, p: Array) -> Array:
        theta, size = p[: self.chain.n], sum(self.lengths)
        if not self.chain.admissible(theta):
            return np.full(size, HUGE)
        parts = []
        with np.errstate(all="ignore"):
            for k, ((u, y), kept) in enumerate(zip(self.data, self.kept, strict=True)):
                run = self.chain.run(theta, u, self.state(p, k))
                parts.append(((y - run)[kept] / self.scales).T.ravel())
            e = np.concatenate(parts)
        if not np.all(np.isfinite(e)) or np.max(np.abs(e), initial=0.0) > HUGE:
            return np.full(size, HUGE)
        return e

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, (M, len(p))."""
        out = np.zeros((sum(self.lengths), len(p)))
        at = 0
        for columns, block in self._blocks(p):
            out[at : at + block.shape[1], columns] = block.T
            at += block.shape[1]
        if not np.isfinite(out).all():
            out = np.nan_to_num(out, nan=0.0, posinf=HUGE, neginf=-HUGE)
        return out

    def normal_equations(self, p: Array, r: Array) -> tuple[Array, Array]:
        """JᵀJ and Jᵀr without ever holding J."""
        gram, gradient = np.zeros((len(p), len(p))), np.zeros(len(p))
        at = 0
        for columns, block in self._blocks(p):
            gram[np.ix_(columns, columns)] += block @ block.T
            gradient[columns] += block @ r[at : at + block.shape[1]]
            at += block.shape[1]
        return gram, gradient

    def _blocks(self, p: Array) -> Iterator[tuple[Index, Array]]:
        """Of each experiment and output: which entries of p count, and their rows of Jᵀ."""
        n = self.chain.n
        for k, ((u, _), kept) in enumerate(zip(self.data, self.kept, strict=True)):
            with np.errstate(all="ignore"):
                _, D = self.chain.tangents(p[:n], u, self.state(p, k), self.states_each > 0)
            first = n + k * self.states_each
            columns = np.concatenate([np.arange(n), np.arange(first, first + self.states_each)])
            for d, scale in zip(D, self.scales, strict=True):
                yield columns, (d if kept.all() else d[:, kept]) / -scale

    def state_sizes(self, p: Array) -> Array:
        """How far apart inputs held at their lowest and highest value keep each initial state."""
        sizes = []
        if self.states_each:
            theta = p[: self.chain.n]
            with np.errstate(all="ignore"):
                for u, _ in self.data:
                    low, high = (
                        self.chain.steady_state(theta, level)
                        for level in (u.min(axis=0), u.max(axis=0))
                    )
                    sizes.append(np.abs(high - low))
        sizes_of_all = np.concatenate([np.zeros(0), *sizes])
        return np.where(np.isfinite(sizes_of_all) & (sizes_of_all > 0.0), sizes_of_all, 1.0)

    def with_states(self, theta: Array) -> Array:
        """θ and, for each experiment, the state that meets the head of its samples best."""
        states = []
        if self.states_each:
            head = min(HEAD, 3 * self.chain.n_states + HEAD // 4)
            states = [
                self.chain.fitted_state(theta, u, np.where(kept[:, None], y, np.nan), head)
                for (u, y), kept in zip(self.data, self.kept, strict=True)
            ]
        return np.concatenate([theta, *states])


def output_scales(outputs: Sequence[Array]) -> Array:
    """Standard deviation of each output over all experiments, 1 where it is constant."""
    joined = np.concatenate(outputs)
    spread = joined.std(axis=0)
    return np.where(spread > 0.0, spread, 1.0)
