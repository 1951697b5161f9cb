"""Free-run errors of a chain of blocks as a least-squares problem."""

from collections.abc import Iterator

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import Data
from sysid.fitting.run_errors import Masks, RunErrors
from sysid.structures.blocks.chain import BlockChain

HEAD = 400
"""Samples at the head of a record that say enough about its initial state to start from."""


class ChainErrors(RunErrors):
    """Free-run errors of a chain with exact derivatives.

    Only stable chains are admissible: an unstable one has no free run to speak of.

    Args:
        estimate_initial: whether initial states are estimated or those of rest.
        data, kept, scales: as in ``RunErrors``.
    """

    def __init__(
        self,
        chain: BlockChain,
        data: Data,
        estimate_initial: bool,
        kept: Masks | None = None,
        scales: Array | None = None,
    ) -> None:
        self.chain = chain
        super().__init__(chain.n, data, chain.n_states if estimate_initial else 0, kept, scales)

    def runs(self, p: Array) -> list[Array] | None:
        theta = p[: self.chain.n]
        if not self.chain.admissible(theta):
            return None
        pairs = zip(self.data, self.states(p), strict=True)
        return [self.chain.run(theta, u, x if self.states_each else None) for (u, _), x in pairs]

    def tangents(self, p: Array) -> Iterator[Array]:
        theta, states = p[: self.chain.n], self.states_each > 0
        for (u, _), x in zip(self.data, self.states(p), strict=True):
            yield self.chain.tangents(theta, u, x if states else None, states)[1]

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
