"""Parameters of a vehicle for display: value, standard error, meaning."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.fitting.differences import propagated

STRONG = 0.9
"""Correlation of two errors beyond which it is said."""


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
    def of(
        cls, names: Sequence[str], covariance: Array, shown: Mapping[str, str]
    ) -> "Correlations":
        """From their covariance, (n, n); numbers that the log says nothing about are left out.

        Args:
            shown: number of the model → the quantity shown in its place, which is over it.
        """
        keep = np.flatnonzero(np.isfinite(np.diag(covariance))).tolist()
        sign = np.array([-1.0 if names[k] in shown else 1.0 for k in keep])
        size = np.sqrt(np.maximum(np.diag(covariance)[keep], 1e-300)) * sign
        matrix = covariance[np.ix_(keep, keep)] / np.outer(size, size)
        return cls(tuple(shown.get(names[k], names[k]) for k in keep), matrix)

    def strong(self) -> tuple[tuple[str, str, float], ...]:
        n = len(self.names)
        return tuple(
            (self.names[i], self.names[j], float(self.matrix[i, j]))
            for i in range(n)
            for j in range(i)
            if abs(self.matrix[i, j]) > STRONG
        )


def derived(
    of: Callable[[Array], Mapping[str, float]], q: Array, covariance: Array, steps: Array
) -> dict[str, tuple[float, float]]:
    """Quantities that follow from others: name → value and standard error, √(g C gᵀ).

    Args:
        q, covariance: the numbers, (n,), and their covariance, (n, n).
        steps: differences that make the gradient g, (n,).
    """
    value = of(q)
    errors = propagated(lambda p: np.array(list(of(p).values())), q, covariance, steps)
    return {n: (v, float(e)) for (n, v), e in zip(value.items(), errors, strict=True)}


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def undetermined(what: str, shown_by: str, how: str = "") -> str:
    """What a log does not determine, and the manoeuvre that would.

    Args:
        how: how well it does, behind what it is.
    """
    return f"The log does not determine {what}{how}; {shown_by} would."
