"""Parameters of a vehicle for display: value, standard error, meaning."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array


@dataclass(frozen=True)
class VehicleNumber:
    """One quantity of a vehicle.

    Attributes:
        value, std_error: estimate and its standard error.
        identifiable: whether the log reduces the prior uncertainty enough.
        sentence: what it is; for one that is not identifiable, the manoeuvre that would determine
            it.
        in_model: whether the model that is judged holds it; else it is what it would be.
    """

    name: str
    value: float
    std_error: float
    unit: str
    identifiable: bool
    sentence: str
    in_model: bool = True


@dataclass(frozen=True, eq=False)
class Correlations:
    """How far errors of the numbers in the model go together.

    Attributes:
        matrix: (n, n), 1 on its diagonal.
    """

    names: tuple[str, ...]
    matrix: Array

    @classmethod
    def of(cls, names: Sequence[str], covariance: Array) -> "Correlations":
        """From their covariance, (n, n)."""
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return cls(tuple(names), covariance / np.outer(size, size))

    def strong(self, beyond: float = 0.9) -> tuple[tuple[str, str, float], ...]:
        """Pairs whose errors go together by more than so much."""
        n = len(self.names)
        return tuple(
            (self.names[i], self.names[j], float(self.matrix[i, j]))
            for i in range(n)
            for j in range(i)
            if abs(self.matrix[i, j]) > beyond
        )


def derived(
    of: Callable[[Array], Mapping[str, float]], q: Array, covariance: Array, steps: Array
) -> dict[str, tuple[float, float]]:
    """Quantities that follow from others: name → value and standard error, √(g C gᵀ).

    Args:
        of: the quantities as a function of the numbers.
        q, covariance: the numbers, (n,), and their covariance, (n, n).
        steps: differences that make the gradient g, (n,).
    """
    value = of(q)
    gradient = {name: np.zeros(len(q)) for name in value}
    for k, h in enumerate(steps):
        up, down = q.copy(), q.copy()
        up[k] += h
        down[k] -= h
        above, below = of(up), of(down)
        for name in value:
            gradient[name][k] = (above[name] - below[name]) / (2.0 * h)
    return {
        name: (value[name], max(float(g @ covariance @ g), 0.0) ** 0.5)
        for name, g in gradient.items()
    }
