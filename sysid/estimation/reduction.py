"""Balanced truncation: a linear model of fewer states, with a bound on what that changes.

With the Gramians P = A P Aᵀ + B Bᵀ and Q = Aᵀ Q A + Cᵀ C of a stable model the Hankel singular
values are σ = √eig(P Q). Kept states r leave |G − G_r| ≤ 2 Σ_{k>r} σ_k at every frequency (Enns
1984; Glover 1984; of discrete models Al-Saggaf & Franklin 1987).

With a noise model the innovations count as further inputs, B_+ = [B diag(s), K Λ^{1/2}], s the
inputs' spread in the log: states that carry the disturbance stay, too. The bound then holds for
[G diag(s), (H − I) Λ^{1/2}], and over the smallest s for G.
"""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.estimation.resampling import filtered, in_state_space, innovations_form
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model

Disturbance = tuple[Array, Array, Array]
"""A, K, C."""

TINY = 1e-12
"""Singular values below this share of the largest belong to states that nothing shows."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A model of fewer states.

    Attributes:
        model: in state space, without errors of its numbers.
        singular: Hankel singular values of the whole model, falling.
        bound: largest |G − G_r| at any frequency, as the singular values have it.
        reached: the largest one at 500 frequencies.
    """

    model: Model
    singular: Array
    bound: float
    reached: float


def reduced(model: Model, order: int) -> Reduction:
    """A linear model truncated to ``order`` states."""
    from scipy.linalg import solve_discrete_lyapunov

    structure = model.structure
    if not isinstance(structure, LinearStructure):
        raise ModelError(f"{structure.name} is not linear; only linear models are reduced")
    A, B, C, D, K = innovations_form(model)
    if len(A) and np.max(np.abs(np.linalg.eigvals(A))) >= 1.0 - 1e-9:
        raise ModelError("a model with a pole on or outside the unit circle is not reduced")
    ny = len(C)
    if not ny <= order < len(A):
        raise UsageError(
            f"the model has {len(A)} states and {ny} outputs; the order must be {ny} to "
            f"{len(A) - 1}, got {order}"
        )
    moving, smallest = B, 1.0
    if np.any(K):
        spread = _spread(model)
        moving = np.hstack([B * spread, K @ _root(model.noise_covariance)])
        smallest = float(np.min(spread, initial=np.inf))
    P = _root(np.asarray(solve_discrete_lyapunov(A, moving @ moving.T)))
    Q = _root(np.asarray(solve_discrete_lyapunov(A.T, C.T @ C)))
    U, s, Vt = np.linalg.svd(Q.T @ P)
    kept = min(order, int(np.sum(s > TINY * s[0])))
    if kept < order:
        raise UsageError(f"only {kept} of its {len(A)} states show at all; take that order")
    scale = 1.0 / np.sqrt(s[:order])
    left, right = (U[:, :order] * scale).T @ Q.T, P @ Vt[:order].T * scale
    noise, small_A, small_C = model.noise_covariance, left @ A @ right, C @ right
    gain = left @ K
    if np.any(K):
        if np.max(np.abs(np.linalg.eigvals(small_A - gain @ small_C))) >= 1.0:
            gain, _ = filtered(small_A, small_C, gain @ noise @ gain.T, gain @ noise, noise)
        noise = _one_step((A, K, C), (small_A, gain, small_C), noise)
    small = (small_A, left @ B, small_C, D, gain)
    words = f"Reduced from {len(A)} states of {structure.name} by balanced truncation."
    fewer = in_state_space(model, small, model.dt, noise, words)
    w = np.geomspace(1e-4, 1.0, 500) * np.pi / model.dt
    change = np.linalg.norm(model.bode(w)[1] - fewer.bode(w)[1], 2, axis=(1, 2))
    return Reduction(fewer, s, float(2.0 * np.sum(s[order:]) / smallest), float(change.max()))


def _spread(model: Model) -> Array:
    """Of the inputs in their log, as of a uniform distribution, (nu,)."""
    ranges = model.ranges[: len(model.inputs)]
    if not len(ranges):
        return np.ones(len(model.inputs))
    return np.asarray(np.maximum(np.ptp(ranges, axis=1) / np.sqrt(12.0), 1e-300))


def _one_step(whole: Disturbance, small: Disturbance, noise: Array) -> Array:
    """Covariance of the small model's errors one step ahead in the whole one's disturbance."""
    from scipy.linalg import solve_discrete_lyapunov

    (A, K, C), (a, k, c) = whole, small
    both = np.block([[A, np.zeros((len(A), len(a)))], [k @ C, a - k @ c]])
    enters, seen = np.vstack([K, k]), np.hstack([C, -c])
    spread = solve_discrete_lyapunov(both, enters @ noise @ enters.T)
    return np.asarray(seen @ spread @ seen.T + noise)


def _root(gramian: Array) -> Array:
    """A square root of a Gramian, which rounding may have made slightly indefinite."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
