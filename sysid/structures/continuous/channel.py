"""One path from an input to an output in continuous time, and its exact discrete form.

    G(s) = (b_m sᵐ + … + b_0)/(sⁿ + a_{n−1} sⁿ⁻¹ + … + a_0) e^{−τ s},  m < n

The input is held between samples. With τ = (d + φ) dt, 0 ≤ φ < 1, a sample holds u(k−d−1) for the
first φ dt and u(k−d) for the rest (Åström & Wittenmark 1997, Computer-Controlled Systems, §2.3):

    x(k+1) = Φ x(k) + Γ₁ u(k−d−1) + Γ₀ u(k−d)
"""

from typing import Any

import numpy as np

LATE = 1e-9
"""A share of a sample that is rounding."""


def discretised(
    num: Any, den: Any, delay: Any, dt: float, lag: int | None = None
) -> tuple[Any, Any, Any, Any, int]:
    """(Φ, Γ₀, Γ₁, C, d) of a path; numbers may be complex.

    Args:
        num: b_0 … b_m.
        den: a_0 … a_{n−1}.
        delay: τ [s].
        lag: d where it is held: the formulas go on smoothly beyond 0 ≤ φ < 1.
    """
    n = len(den)
    kind = np.result_type(np.asarray(num).dtype, np.asarray(den).dtype, type(delay), np.float64)
    A = np.eye(n, k=1).astype(kind)
    A[-1] = -np.asarray(den)
    B, C = np.zeros((n, 1), dtype=kind), np.zeros((1, n), dtype=kind)
    B[-1, 0] = 1.0
    C[0, : len(num)] = num
    # slopes are asked a little below zero, too
    d = max(int(np.floor(np.real(delay) / dt + LATE)), 0) if lag is None else lag
    late = delay - d * dt  # φ dt
    first, over_first = held(A, B, late)
    rest, over_rest = held(A, B, dt - late)
    return rest @ first, over_rest, rest @ over_first, C, d


def held(A: Any, B: Any, time: Any) -> tuple[Any, Any]:
    """e^{A t} and ∫₀ᵗ e^{A s} ds B."""
    from scipy.linalg import expm

    n = len(A)
    whole = np.zeros((n + 1, n + 1), dtype=np.result_type(A.dtype, type(time)))
    whole[:n, :n], whole[:n, n:] = A, B
    power = expm(whole * time)
    return power[:n, :n], power[:n, n:]
