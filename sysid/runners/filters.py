"""The step of rational filters B(q)/F(q), on numbers of any kind."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from sysid.runners.single import Step


class Filter(NamedTuple):
    """y_i = Σ_j B_j(q)/F(q) u_j, all polynomials of one length, F[0] = 1.

    Attributes:
        output: i, to which it is added.
        inputs: (j, B_j) of each input.
        F: common denominator.
    """

    output: int
    inputs: Sequence[tuple[int, Sequence[Any]]]
    F: Sequence[Any]


def filter_step(filters: Sequence[Filter], n_outputs: int) -> Step:
    """One sample of filters side by side, their states in a row.

    Transposed direct form II: w = x₁ + Σ_j b₀ u_j, x_k⁺ = x_{k+1} + Σ_j b_k u_j − f_k w.
    """

    def step(xp: Any, x: Any, u: Any) -> tuple[list[Any], list[Any]]:
        out: list[Any] = [0.0] * n_outputs
        after: list[Any] = []
        for i, inputs, F in filters:
            at, order = len(after), len(F) - 1
            driven = [(u[j], B) for j, B in inputs]
            w = sum((B[0] * s for s, B in driven), x[at] if order else 0.0)
            for k in range(1, order + 1):
                kept = x[at + k] if k < order else 0.0
                after.append(sum((B[k] * s for s, B in driven), kept) - F[k] * w)
            out[i] = out[i] + w
        return after, out

    return step
