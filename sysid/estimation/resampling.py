"""A linear model at another sample time, inputs held between samples.

k samples in one: A_k = Aᵏ, B_k = Σ_{i<k} Aⁱ B, exact for every model. Any other sample time goes
through continuous time: exp(log([A B; 0 I]) dt₂/dt₁). A process model or transfer function in s is
one at every sample time.

Of a noise model k samples in one are k innovations that move the states and one that is seen. The
Kalman filter of the slow samples (Anderson & Moore 1979, Optimal Filtering, §9.2) makes of them

    Q = Σ_{i<k} Aⁱ K Λ Kᵀ Aⁱᵀ,  S = A^{k−1} K Λ,  R = Λ   →   K_k, Λ_k

At another sample time nothing is known of the noise between samples: no K is left.
"""

from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.forecast import innovation_responses
from sysid.structures.continuous.structure import ContinuousStructure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model
from sysid.structures.state_space.innovations import StateSpace

SHOWN = 1e-10
"""Singular values of the Hankel matrix below this share of the largest are rounding."""

NOISE_STATES = 60
"""Rows of the Hankel matrix of a noise model: more than the states that polynomials have."""

WHOLE = 1e-9
"""A ratio of sample times so near to a whole number is one."""


Matrices = tuple[Array, Array, Array, Array, Array]
"""A, B, C, D, K."""


def innovations_form(model: Model) -> Matrices:
    """Matrices of x⁺ = A x + B u + K e, y = C x + D u + e; K is 0 without a noise model.

    A polynomial H is realised beside G from its responses, and states that both share count once.
    """
    structure = model.structure
    assert isinstance(structure, LinearStructure)
    A, B, C, D = structure.matrices(model.theta)
    ny = len(C)
    if not structure.traits.has_noise_model:
        return A, B, C, D, np.zeros((len(A), ny))
    if isinstance(structure, StateSpace):
        K = structure.realization(model.theta).K
        return A, B, C, D, np.zeros((len(A), ny)) if K is None else np.asarray(K)
    most = NOISE_STATES // ny
    h = innovation_responses(model, model.theta, 2 * most + 1)[1:]
    at = np.add.outer(np.arange(most), np.arange(most))
    now, after = (_blocks(h[at + k]) for k in (0, 1))
    a, k, c = _of_hankel(now, after, ny, ny)
    n, m = len(A), len(a)
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[n:, n:] = A, a
    inputs = np.zeros((n + m, B.shape[1] + ny))
    inputs[:n, : B.shape[1]], inputs[n:, B.shape[1] :] = B, k
    A, both, C = _minimal(whole, inputs, np.hstack([C, c]))
    return A, both[:, : B.shape[1]], C, D, both[:, B.shape[1] :]


def _blocks(h: Array) -> Array:
    """(r, s, ny, m) as a matrix of blocks, (r ny, s m)."""
    r, s, ny, m = h.shape
    return h.transpose(0, 2, 1, 3).reshape(r * ny, s * m)


def in_state_space(model: Model, matrices: Matrices, dt: float, noise: Array, words: str) -> Model:
    """A model with these matrices, and no errors of its numbers.

    Args:
        noise: covariance of the innovations, (ny, ny).
    """
    A, B, C, D, K = matrices
    made = StateSpace((), B.shape[1], len(C), len(A), 0 if np.any(D) else 1, bool(np.any(K)))
    numbers = made.theta_of(matrices)
    if numbers is None:
        raise ModelError("the outputs do not show that many states evenly; take another order")
    return replace(
        model,
        structure=made,
        theta=numbers,
        covariance=np.zeros((len(numbers), len(numbers))),
        parameters=made.parameters(model.inputs, model.outputs),
        dt=dt,
        noise_covariance=noise,
        initial_states=(),
        at_bound=(),
        null_directions=(),
        starts=(),
        warnings=(words,),
    )


def _minimal(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    """The states that inputs move and outputs show, of the Hankel matrix.

    Delays that were several states may be one now.
    """
    seen, reach = [C], [B]
    for _ in range(len(A) - 1):
        seen.append(seen[-1] @ A)
        reach.append(A @ reach[-1])
    left, right = np.vstack(seen), np.hstack(reach)
    small = _of_hankel(left @ right, left @ A @ right, len(C), B.shape[1])
    return small if 0 < len(small[0]) < len(A) else (A, B, C)


def _of_hankel(now: Array, after: Array, ny: int, nu: int) -> tuple[Array, Array, Array]:
    """(A, B, C) of responses and of those one sample later (Ho & Kalman 1966)."""
    U, s, Vt = np.linalg.svd(now)
    order = int(np.sum(s > SHOWN * max(s[0], 1e-300)))
    root = np.sqrt(s[:order])
    observe, control = U[:, :order] * root, root[:, None] * Vt[:order]
    A = (U[:, :order] / root).T @ after @ (Vt[:order].T / root)
    return A, control[:, :nu], observe[:ny]


def filtered(A: Array, C: Array, Q: Array, S: Array, R: Array) -> tuple[Array, Array]:
    """K and Λ of x⁺ = A x + w, y = C x + v, with covariances Q of w, R of v, and S = E w vᵀ."""
    from scipy.linalg import solve_discrete_are

    try:
        P = solve_discrete_are(A.T, C.T, Q, R, s=S)
    except np.linalg.LinAlgError:
        raise ModelError("its noise model has a zero on the unit circle; fit oe or tf") from None
    innovation = C @ P @ C.T + R
    gain = np.linalg.solve(innovation, (A @ P @ C.T + S).T).T
    return np.asarray(gain), np.asarray(innovation)


def resampled(model: Model, dt: float) -> Model:
    """A linear model at sample time ``dt`` [s]: the same outputs at instants that both have."""
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
    A, B, C, D, K = innovations_form(model)
    noise = model.noise_covariance
    words = f"Resampled from {model.dt:g} s to {dt:g} s, inputs held between samples."
    if times >= 1 and abs(ratio - times) < WHOLE * ratio:
        powers = [np.linalg.matrix_power(A, k) for k in range(times + 1)]
        nu, over = B.shape[1], np.sum(powers[:-1], axis=0)
        if np.any(K):
            Q = sum(p @ K @ noise @ K.T @ p.T for p in powers[:-1])
            K, noise = filtered(powers[-1], C, Q, powers[-2] @ K @ noise, noise)
        A, both, C = _minimal(powers[-1], np.hstack([over @ B, K]), C)
        return in_state_space(model, (A, both[:, :nu], C, D, both[:, nu:]), dt, noise, words)
    try:
        a, b, C, D = structure.in_continuous_time(model.theta, model.dt)
    except ModelError as error:
        raise ModelError(f"{error}; a whole multiple of {model.dt:g} s is possible") from None
    n, nu = b.shape
    whole = np.zeros((n + nu, n + nu))
    whole[:n, :n], whole[:n, n:] = a, b
    whole = expm(whole * dt)
    if np.any(K):
        words += (
            f" Its noise model is gone: it lasts at whole multiples of {model.dt:g} s only, and "
            "forecasts have bands that do not grow."
        )
    none = np.zeros((n, len(C)))
    return in_state_space(model, (whole[:n, :n], whole[:n, n:], C, D, none), dt, noise, words)
