"""Slopes by central differences, and the standard errors that follow from them."""

from collections.abc import Callable

import numpy as np

from sysid.data.record import Array


def slopes(
    of: Callable[[Array], Array], p: Array, steps: Array, lower: Array | None = None
) -> Array:
    """∂f/∂p, (m, n); a column whose step is 0 stays zero.

    Args:
        of: p (n,) → (m,).
        steps: to either side, (n,).
        lower: least values, below which no step goes, (n,).
    """
    columns: dict[int, Array] = {}
    for k in np.flatnonzero(steps).tolist():
        up, down = p.copy(), p.copy()
        up[k] += steps[k]
        down[k] -= steps[k] if lower is None else min(steps[k], down[k] - lower[k])
        columns[k] = (of(up) - of(down)) / (up[k] - down[k])
    rows = len(next(iter(columns.values()))) if columns else len(of(p))
    J = np.zeros((rows, len(p)))
    for k, column in columns.items():
        J[:, k] = column
    return J


def propagated(of: Callable[[Array], Array], p: Array, covariance: Array, steps: Array) -> Array:
    """Standard errors √(g C gᵀ) of numbers that follow from p, (m,)."""
    g = slopes(of, p, steps)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ik,kl,il->i", g, covariance, g), 0.0)))
