"""A model of any structure split into a drive and a first-order core per track."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.documents import by_field, plain_object
from sysid.data.record import Array
from sysid.data.schema import completed
from sysid.structures.augmented.chain import at_standstill
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.registry import structure_from_json, structure_to_json


def begins_at_rest(u0: Array, y0: Array, y: Array) -> bool:
    """Whether a record begins at standstill of a machine whose zeros are physical.

    A slow mode of the model must then not begin with what is missing, a load for instance.

    Args:
        u0, y0: operating point of the model.
        y: measurements, (N, ny).
    """
    return not (np.any(u0) or np.any(y0)) and bool(len(y) and np.all(at_standstill(y)))


@dataclass(frozen=True, eq=False)
class GivenBase:
    """y_b of the model, and the drive d with which ω⁺ = −f ω + (1 + f) K d runs like y_b.

    The model must not answer within the sample: y_b(k+1) is known once u(k) is.

    Attributes:
        u0, y0: operating point around which it was identified.
        gain, pole: K and f of the core, (tracks,).
    """

    structure: Structure
    theta: Array
    u0: Array
    y0: Array
    gain: Array
    pole: Array

    @staticmethod
    def of(model: Model, gain: Array, pole: Array) -> "GivenBase":
        """The model around a core."""
        u0, y0 = model.detrend.u_offset, model.detrend.y_offset
        return GivenBase(model.structure, model.theta, u0, y0, gain, pole)

    def drive(self, run: Array) -> Array:
        """Drive (N, tracks) that makes the core run like ``run`` (N, tracks)."""
        return self._driving(run, np.vstack([run[1:], run[-1:]]))

    def _driving(self, now: Array, following: Array) -> Array:
        return (following + self.pole * now) / ((1.0 + self.pole) * self.gain)

    def n_states(self) -> int:
        return self.structure.n_states(self.theta)

    def fitted_state(self, u: Array, y: Array, samples: int) -> Array:
        """State of the model at the beginning of a record: rest, or from its first samples."""
        if begins_at_rest(self.u0, self.y0, y):
            return np.zeros(self.n_states())
        return self.structure.fitted_state(self.theta, u - self.u0, y - self.y0, samples)

    def step(self) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, drive)."""
        return self.around(self.structure.step(self.theta))

    def around(
        self, step: Callable[[Array, Array], tuple[Array, Array]]
    ) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, drive) for (x, u) → (x⁺, y) of the model."""
        rest = np.zeros(len(self.u0))

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            following, y = step(x, u - self.u0)
            y_next = step(following, rest)[1]
            return following, self._driving(y + self.y0, y_next + self.y0)

        return advance

    def to_json(self) -> dict[str, Any]:
        return plain_object(by_field(self) | {"structure": structure_to_json(self.structure)})

    @staticmethod
    def from_json(raw: Mapping[str, Any]) -> "GivenBase":
        return completed(GivenBase, raw, structure=structure_from_json(raw["structure"]))
