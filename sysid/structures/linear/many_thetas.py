"""The free run of a linear model whose θ is traced by a compiler, and stability of many θ at once.

A polynomial in q⁻¹ is a list of coefficients here, each a number, an array with an entry for every
θ, or what a compiler traces: products need no array functions.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array

if TYPE_CHECKING:
    from sysid.structures.linear.polynomial import PolynomialStructure

Coefficients = list[Any]


def traced_step(
    structure: "PolynomialStructure", theta: Any, like: Array
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """(x, u) → (x⁺, y) of a traced θ, in the states that ``like`` has.

    Transposed direct form II, group after group: w = x₁ + Σ b₀ u, x⁺ = (x₂ … x_n, 0) − a w + Σ b u.

    Args:
        theta: traced, (n,).
        like: numbers with the same groups and orders, (n,).
    """
    xp: Any = theta.__array_namespace__()
    numerators, denominators = _transfer(structure, theta)
    groups = []
    for g in structure.transfer(like).groups:
        size, i = g.order + 1, g.output
        den = xp.stack(_sized(denominators[i][g.inputs[0]], size))
        nums = [(j, xp.stack(_sized(numerators[i][j], size))) for j in g.inputs]
        groups.append((i, g.order, den, nums))

    def advance(x: Any, u: Any) -> tuple[Any, Any]:
        y: list[Any] = [xp.zeros(())] * structure.ny
        parts, at = [xp.zeros(0)], 0
        for i, order, den, nums in groups:
            w = sum((num[0] * u[j] for j, num in nums), x[at] if order else 0.0)
            if order:
                moved = xp.concatenate([x[at + 1 : at + order], xp.zeros(1)]) - den[1:] * w
                parts.append(sum((num[1:] * u[j] for j, num in nums), moved))
            y[i] = y[i] + w
            at += order
        return xp.concatenate(parts), xp.stack(y)

    return advance


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


def _transfer(
    structure: "PolynomialStructure", theta: Any
) -> tuple[list[list[Coefficients]], list[list[Coefficients]]]:
    """Numerators and denominators of G(q) by [output][input]; θ counts along its first axis."""
    A, B, F = _polynomials(structure, theta)
    ny, nu = structure.ny, structure.nu
    if not structure.orders.coupled:
        return B, [[_times(A[i][i], F[i][j]) for j in range(nu)] for i in range(ny)]
    det, adj = _determinant(A), _adjugate(A)
    num = [
        [_sum([_times(adj[i][k], B[k][j]) for k in range(ny)]) for j in range(nu)]
        for i in range(ny)
    ]
    return num, [[det] * nu for _ in range(ny)]


def _polynomials(structure: "PolynomialStructure", theta: Any) -> Any:
    A: Any = [[[]] * structure.ny for _ in range(structure.ny)]
    B: Any = [[[]] * structure.nu for _ in range(structure.ny)]
    F: Any = [[[1.0]] * structure.nu for _ in range(structure.ny)]
    for i in range(structure.ny):
        lay, index = structure.layout(i), structure.row_index(i)
        part = [theta[int(k)] for k in index]
        a, b, _, _, f = lay.slices()
        for j in range(structure.ny):
            A[i][j] = [1.0 if i == j else 0.0, *part[a[j]]]
        for j in range(structure.nu):
            B[i][j] = [0.0] * lay.nk[j] + part[b[j]] if lay.nb[j] else []
            F[i][j] = [1.0, *part[f[j]]]
    return A, B, F


def _times(p: Coefficients, q: Coefficients) -> Coefficients:
    product: Coefficients = [0.0] * max(len(p) + len(q) - 1, 0)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            product[i + j] = product[i + j] + a * b
    return product if p and q else []


def _sum(terms: list[Coefficients]) -> Coefficients:
    size = max(map(len, terms))
    return [sum((t[k] for t in terms if k < len(t)), 0.0) for k in range(size)]


def _minor(A: list[list[Coefficients]], row: int, column: int) -> list[list[Coefficients]]:
    return [[p for c, p in enumerate(r) if c != column] for k, r in enumerate(A) if k != row]


def _determinant(A: list[list[Coefficients]]) -> Coefficients:
    if len(A) == 1:
        return A[0][0]
    terms = [_times(p, _determinant(_minor(A, 0, j))) for j, p in enumerate(A[0])]
    return _sum([[-c for c in t] if j % 2 else t for j, t in enumerate(terms)])


def _adjugate(A: list[list[Coefficients]]) -> list[list[Coefficients]]:
    n = len(A)
    if n == 1:
        return [[[1.0]]]
    return [
        [[(-1.0) ** (i + j) * c for c in _determinant(_minor(A, j, i))] for j in range(n)]
        for i in range(n)
    ]


def _sized(p: Coefficients, size: int) -> Coefficients:
    """Cut or padded to so many coefficients; what is cut is zero in every θ of the structure."""
    return [*p[:size], *([0.0] * (size - len(p)))]
