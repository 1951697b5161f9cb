"""The run of a linear model whose θ is traced by a compiler, and stability of many θ at once."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.runners.filters import Filter, filter_step
from sysid.runners.single import on_arrays
from sysid.structures.linear.polynomials import Coefficients, Matrix, Polynomials

if TYPE_CHECKING:
    from sysid.structures.linear.polynomial import PolynomialStructure


def traced_step(
    structure: "PolynomialStructure", theta: Any, like: Array
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """(x, u) → (x⁺, y) of a traced θ, in the states that ``like`` has.

    Args:
        theta: traced, (n,).
        like: numbers with the same groups and orders, (n,).
    """
    numerators, denominators = _transfer(structure, theta)
    filters = []
    for g in structure.transfer(like).groups:
        i, n = g.output, g.order + 1
        inputs = [(j, _sized(numerators[i][j], n)) for j in g.inputs]
        filters.append(Filter(i, inputs, _sized(denominators[i][g.inputs[0]], n)))
    return on_arrays(filter_step(filters, structure.ny))


def stable_each(structure: "PolynomialStructure", thetas: Array) -> NDArray[np.bool_]:
    """Whether all poles lie inside the unit circle, for each row of θ; (K,) of bool.

    The Schur-Cohn recursion, on the denominators of all rows at once.
    """
    _, denominators = _transfer(structure, np.moveaxis(thetas, -1, 0))
    stable: NDArray[np.bool_] = np.all(np.isfinite(thetas), axis=1)
    for row in denominators:
        for den in row:
            stable &= all_roots_inside([np.broadcast_to(c, stable.shape) for c in den])
    return stable


def all_roots_inside(c: Coefficients) -> NDArray[np.bool_]:
    """Whether c₀ + c₁q⁻¹ + … has all roots inside the unit circle, c₀ = 1; (K,) of bool."""
    inside = np.ones(c[0].shape, dtype=bool)
    while len(c) > 1:
        k = c[-1]
        inside &= np.abs(k) < 1.0
        k = np.where(inside, k, 0.0)
        c = [(x - k * y) / (1.0 - k * k) for x, y in zip(c[:-1], c[:0:-1], strict=True)]
    return inside


def _transfer(structure: "PolynomialStructure", theta: Any) -> tuple[Matrix, Matrix]:
    """Numerators and denominators of G(q) by [output][input]; θ counts along its first axis."""
    layouts = [structure.layout(i) for i in range(structure.ny)]
    return Polynomials.of(layouts, theta).rational(structure.orders.coupled)


def _sized(p: Coefficients, size: int) -> Coefficients:
    """Cut or padded to so many coefficients; what is cut is zero in every θ of the structure."""
    return [*p[:size], *([0.0] * (size - len(p)))]
