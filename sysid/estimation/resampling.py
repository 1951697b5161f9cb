"""A linear model at another sample time, inputs held between samples.

k samples in one: A_k = Aᵏ, B_k = Σ_{i<k} Aⁱ B, exact for every model. Any other sample time goes
through continuous time: exp(log([A B; 0 I]) dt₂/dt₁). A process model or transfer function in s is
one at every sample time.
"""

from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model
from sysid.structures.state_space.innovations import StateSpace

SHOWN = 1e-10
"""Singular values of the Hankel matrix below this share of the largest are rounding."""

WHOLE = 1e-9
"""A ratio of sample times so near to a whole number is one."""


def in_state_space(
    model: Model, matrices: tuple[Array, Array, Array, Array], dt: float, words: str
) -> Model:
    """A model with these matrices, no noise model and no errors of its numbers.

    Raises:
        ModelError: the outputs do not show the states evenly.
    """
    A, B, C, D = matrices
    made = StateSpace((), B.shape[1], len(C), len(A), 0 if np.any(D) else 1, noise=False)
    numbers = made.theta_of((A, B, C, D, np.zeros((len(A), len(C)))))
    if numbers is None:
        raise ModelError("the outputs do not show that many states evenly; take another order")
    return replace(
        model,
        structure=made,
        theta=numbers,
        covariance=np.zeros((len(numbers), len(numbers))),
        parameters=made.parameters(model.inputs, model.outputs),
        dt=dt,
        initial_states=(),
        at_bound=(),
        null_directions=(),
        starts=(),
        warnings=(words,),
    )


def _minimal(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    """The states that inputs move and outputs show, of the Hankel matrix (Ho & Kalman 1966).

    Delays that were several states may be one now.
    """
    n, (ny, nu) = len(A), (len(C), B.shape[1])
    seen = [C]
    reach = [B]
    for _ in range(n - 1):
        seen.append(seen[-1] @ A)
        reach.append(A @ reach[-1])
    left, right = np.vstack(seen), np.hstack(reach)
    U, s, Vt = np.linalg.svd(left @ right)
    order = int(np.sum(s > SHOWN * s[0]))
    if order == n or not order:
        return A, B, C
    root = np.sqrt(s[:order])
    observe, control = U[:, :order] * root, root[:, None] * Vt[:order]
    moved = left @ A @ right
    small = (U[:, :order] / root).T @ moved @ (Vt[:order].T / root)
    return small, control[:, :nu], observe[:ny]


def resampled(model: Model, dt: float) -> Model:
    """A linear model at sample time ``dt`` [s]: the same outputs at instants that both have.

    Raises:
        ModelError: it is not linear, or has no continuous counterpart and dt is no whole multiple.
        UsageError: dt is not positive.
    """
    from scipy.linalg import expm

    structure = model.structure
    if not 0.0 < dt < np.inf:
        raise UsageError(f"`ts` must be positive, got {dt:g}")
    if isinstance(structure, ContinuousStructure):
        return replace(model, structure=replace(structure, dt=dt), dt=dt, initial_states=())
    if not isinstance(structure, LinearStructure):
        raise ModelError(f"{structure.name} is not linear; only linear models are resampled")
    ratio = dt / model.dt
    times = round(ratio)
    A, B, C, D = structure.matrices(model.theta)
    if times >= 1 and abs(ratio - times) < WHOLE * ratio:
        powers = [np.linalg.matrix_power(A, k) for k in range(times + 1)]
        A, B, C = _minimal(powers[-1], np.sum(powers[:-1], axis=0) @ B, C)
    else:
        try:
            a, b, _, _ = structure.in_continuous_time(model.theta, model.dt)
        except ModelError as error:
            raise ModelError(f"{error}; a whole multiple of {model.dt:g} s is possible") from None
        n, nu = b.shape
        whole = np.zeros((n + nu, n + nu))
        whole[:n, :n], whole[:n, n:] = a, b
        whole = expm(whole * dt)
        A, B = whole[:n, :n], whole[:n, n:]
    words = f"Resampled from {model.dt:g} s to {dt:g} s, inputs held between samples."
    return in_state_space(model, (A, B, C, D), dt, words)
