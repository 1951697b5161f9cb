"""One path from an input to an output in continuous time, and its exact discrete form.

    G(s) = (b_m sᵐ + … + b_0)/(sⁿ + a_{n−1} sⁿ⁻¹ + … + a_0) e^{−τ s},  m < n

The input is held between samples. With τ = (d + φ) dt, 0 ≤ φ < 1, a sample holds u(k−d−1) for the
first φ dt and u(k−d) for the rest (Åström & Wittenmark 1997, Computer-Controlled Systems, §2.3):

    x(k+1) = Φ x(k) + Γ₁ u(k−d−1) + Γ₀ u(k−d)
"""

from functools import lru_cache
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
    kind = np.result_type(np.asarray(num).dtype, np.asarray(den).dtype, type(delay), np.float64)
    A, B = companion(np.asarray(den, dtype=kind))
    C = np.zeros((1, len(A)), dtype=kind)
    C[0, : len(num)] = num
    # slopes are asked a little below zero, too
    d = max(int(np.floor(np.real(delay) / dt + LATE)), 0) if lag is None else lag
    late = delay - d * dt  # φ dt
    first, over_first = held(A, B, late)
    rest, over_rest = held(A, B, dt - late)
    return rest @ first, over_rest, rest @ over_first, C, d


def companion(den: Any) -> tuple[Any, Any]:
    """A (n, n) and B (n, 1) of 1/(sⁿ + a_{n−1} sⁿ⁻¹ + … + a_0), whose states are derivatives."""
    A, B = np.eye(len(den), k=1, dtype=den.dtype), np.zeros((len(den), 1), dtype=den.dtype)
    A[-1], B[-1] = -den, 1.0
    return A, B


def held(A: Any, B: Any, time: Any) -> tuple[Any, Any]:
    """e^{A t} and ∫₀ᵗ e^{A s} ds B."""
    n = len(A)
    whole = np.zeros((n + 1, n + 1), dtype=np.result_type(A.dtype, type(time)))
    whole[:n, :n], whole[:n, n:] = A, B
    power = _exponential((whole * time).tobytes(), n + 1, whole.dtype)
    return power[:n, :n], power[:n, n:]


@lru_cache(1024)
def _exponential(matrix: bytes, n: int, kind: Any) -> Any:
    """e^M of an (n, n) matrix, kept: of many paths slopes move one at a time."""
    from scipy.linalg import expm

    M = np.frombuffer(matrix, dtype=kind).reshape(n, n)
    return expm(M) if M.any() else np.eye(n, dtype=kind)
