"""Other values that the parameters of a fitted model may have, by their covariance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.record import Array, Index
from sysid.structures.model import Model

DRAWS = 200
"""Draws of which the share of unstable ones is taken: it is known to 1.5 % where it is 5 %."""


@dataclass(frozen=True, eq=False)
class ParameterDraws:
    """θ ~ N(θ̂, P); a direction in which the data hold no information stays as estimated."""

    model: Model

    @cached_property
    def free(self) -> Index:
        """Entries of θ that are estimated, with a finite standard error."""
        variance = np.diag(self.model.covariance)
        free = [p.fixed is None for p in self.model.parameters]
        return np.flatnonzero(np.array(free) & np.isfinite(variance) & (variance > 0.0))

    @cached_property
    def root(self) -> Array:
        """L with L Lᵀ = P over the free entries, (free, size): eigenvectors of the correlation."""
        free = self.free
        P = np.nan_to_num(self.model.covariance[np.ix_(free, free)], posinf=0.0, neginf=0.0)
        error = np.sqrt(np.diag(P))
        values, vectors = np.linalg.eigh(P / np.outer(error, error))
        kept = values > 1e-12 * max(len(free), 1)  # beyond it is rounding
        return np.asarray(error[:, None] * vectors[:, kept] * np.sqrt(values[kept]))

    @property
    def size(self) -> int:
        """Rank of the covariance."""
        return int(self.root.shape[1])

    def drawn(self, z: Array, factor: float = 1.0) -> Array:
        """θ̂ + factor·L z, (K, n), of standard normal numbers (K, size)."""
        thetas = np.repeat(self.model.theta[None], len(z), axis=0)
        change = np.zeros((len(z), len(self.free)))
        for k in range(self.size):  # not a product of matrices: one run alone gives the same bits
            change += z[:, k, None] * self.root[:, k]
        thetas[:, self.free] += factor * change
        return thetas


def unstable_share(model: Model) -> float:
    """Share of the models within the standard errors whose free run does not settle.

    Of a linear structure: others take a long run for each.
    """
    if not model.structure.linear or not model.stable:
        return 0.0
    draws = ParameterDraws(model)
    z = np.random.default_rng(0).standard_normal((DRAWS, draws.size))
    return 1.0 - float(np.mean(model.structure.stable_each(draws.drawn(z))))
