"""A plant with varying parameters: sampled by NumPy, run singly or compiled."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.robot.mission.contracts import SteppablePlant
from sysid.structures.model import Model
from sysid.structures.physics import friction_entries, ground_effects, torques
from sysid.structures.plant import Plant
from sysid.structures.special_runs import stable_each, stable_parts, traced_step

Flags = NDArray[np.bool_]

HALVINGS = 6
"""Times that the way along a direction is halved until a plant is feasible; then it is left out."""


@dataclass(frozen=True, eq=False)
class FixedPlant:
    """A plant without a covariance: the same in every run, with no numbers to draw."""

    given: SteppablePlant
    size = 0
    unknown: tuple[str, ...] = ()
    has_friction = False

    @property
    def name(self) -> str:
        return type(self.given).__name__

    @property
    def theta(self) -> Array:
        return np.zeros(0)

    def drawn(self, z: Array, friction: Array) -> Array:
        return np.zeros((len(z), 0))

    def settled(self, thetas: Array) -> Array:
        return thetas

    def feasible(self, thetas: Array) -> Flags:
        return np.ones(len(thetas), dtype=bool)

    def pulled(self, z: Array, friction: Array) -> Array:
        return self.drawn(z, friction)

    def plant(self, theta: Any) -> SteppablePlant:
        return self.given


@dataclass(frozen=True, eq=False)
class ModelPlant:
    """The plant of a fitted model, drawn from θ ~ N(θ̂, P) inside the parameters' bounds.

    A direction in which the data hold no information has no draws: it stays as estimated.

    Attributes:
        factor: of the standard errors.
    """

    model: Model
    factor: float = 1.0

    @property
    def name(self) -> str:
        return self.model.structure.name

    @property
    def theta(self) -> Array:
        """θ̂."""
        return self.model.theta

    @cached_property
    def _free(self) -> Index:
        """Entries of θ that are estimated, with a finite standard error."""
        variance = np.diag(self.model.covariance)
        free = [p.fixed is None for p in self.model.parameters]
        return np.flatnonzero(np.array(free) & np.isfinite(variance) & (variance > 0.0))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of estimated parameters without a finite standard error."""
        variance = np.diag(self.model.covariance)
        pairs = zip(self.model.parameters, variance, strict=True)
        return tuple(p.name for p, v in pairs if p.fixed is None and not np.isfinite(v))

    @cached_property
    def _root(self) -> Array:
        """L with L Lᵀ = P over the free entries, (free, size): eigenvectors of the correlation."""
        free = self._free
        P = np.nan_to_num(self.model.covariance[np.ix_(free, free)], posinf=0.0, neginf=0.0)
        error = np.sqrt(np.diag(P))
        values, vectors = np.linalg.eigh(P / np.outer(error, error))
        kept = values > 1e-12 * max(len(free), 1)  # beyond it is rounding
        return np.asarray(error[:, None] * vectors[:, kept] * np.sqrt(values[kept]))

    @property
    def size(self) -> int:
        return int(self._root.shape[1])

    @property
    def has_friction(self) -> bool:
        return bool(friction_entries(self.model.structure))

    def drawn(self, z: Array, friction: Array) -> Array:
        """θ̂ + factor·L z, the entries of dry friction times their factor."""
        thetas = np.repeat(self.theta[None], len(z), axis=0)
        change = np.zeros((len(z), len(self._free)))
        for k in range(self.size):  # not a product of matrices: one run alone gives the same bits
            change += z[:, k, None] * self._root[:, k]
        thetas[:, self._free] += self.factor * change
        entries = list(friction_entries(self.model.structure))
        thetas[:, entries] *= friction[:, None]
        return thetas

    def pulled(self, z: Array, friction: Array) -> Array:
        """Direction after direction of the covariance, each only as far as the plant is feasible.

        A direction about which the log says much is drawn in full; one that leads out of what is
        feasible is halved until it does not.
        """
        kept = np.zeros_like(z)
        for k in range(self.size):
            share = np.ones(len(z))
            for _ in range(HALVINGS):
                kept[:, k] = share * z[:, k]
                bad = ~self.feasible(self.drawn(kept, friction))
                if not bad.any():
                    break
                share[bad] *= 0.5
            else:
                kept[bad, k] = 0.0
        return self.drawn(kept, friction)

    def settled(self, thetas: Array) -> Array:
        """Path after path: one that would be unstable stays as estimated, the rest is kept.

        The poles of a path that hardly does anything are unknown, and every second draw of them
        would make a plant unstable that is not. Moved only as far as they are stable, or without
        the numerator that they were estimated with, they would make it do much.
        """
        structure, changed = self.model.structure, thetas.copy()
        for part in stable_parts(structure):
            alone = np.repeat(self.theta[None], len(thetas), axis=0)
            alone[:, part] = thetas[:, part]
            changed[np.ix_(~stable_each(structure, alone), part)] = self.theta[part]
        return changed

    def feasible(self, thetas: Array) -> Flags:
        inside = np.ones(len(thetas), dtype=bool)
        for k, p in enumerate(self.model.parameters):
            if p.fixed is None:
                inside &= (thetas[:, k] >= p.lower) & (thetas[:, k] <= p.upper)
        inside[inside] = stable_each(self.model.structure, thetas[inside])
        return inside

    @cached_property
    def _nominal(self) -> Plant:
        return self.model.plant()

    def plant(self, theta: Any) -> SteppablePlant:
        """The model's plant with another θ."""
        if isinstance(theta, np.ndarray):
            return replace(self.model, theta=theta).plant()
        structure = self.model.structure
        step = traced_step(structure, theta, self.theta)
        return replace(
            self._nominal,
            core=step,
            core_readout=_output(step),
            ground=ground_effects(structure, theta),
            torque=torques(structure, theta),
        )


def _output(step: Callable[[Any, Any], tuple[Any, Any]]) -> Callable[[Any, Any], Any]:
    """y alone: a compiler leaves out what is not asked for."""
    return lambda x, u: step(x, u)[1]


VariedPlant = FixedPlant | ModelPlant
"""A plant that many runs drive."""
