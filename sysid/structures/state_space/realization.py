"""State-space matrices and their runs over long records, real or complex.

    x(t+1) = A x(t) + B u(t),  y(t) = C x(t) + D u(t)

A run goes block by block: within one of L samples y is a product of a Toeplitz matrix of Markov
parameters with the inputs, so that only every L-th state is stepped. Complex matrices are run like
real ones: with A(θ + iε e_k) the imaginary part over ε is the derivative, exact to rounding
(Squire & Trapp 1998, SIAM Rev. 40, 110).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.structures.linear.transfer import TransferMatrix

BLOCK, SHORT = 32, 16
"""Samples of a block of one run, and of many side by side."""

SLIGHT = 8
"""Up to so many paths from inputs to outputs long blocks cost many runs less than their number."""

SMALL = 1e-30
"""Step of the complex derivatives."""

INSIDE = 0.98
"""Where a start's pole outside the unit circle is brought to."""

NOTHING = 1e-12
"""Leading coefficients of a numerator below this share of its largest are rounding."""


@dataclass(frozen=True, eq=False)
class Realization:
    """Matrices of a model, some of whose inputs act later.

    Attributes:
        A, B, C, D: (n, n), (n, m), (ny, n), (ny, m).
        K: Kalman gain, (n, ny); None where errors are those of the free run.
        source: which input each column of B and D belongs to, (m,).
        lag: by how many samples it acts later, (m,).
    """

    A: Any
    B: Any
    C: Any
    D: Any
    K: Any
    source: tuple[int, ...]
    lag: tuple[int, ...]
    nu: int

    @property
    def core(self) -> int:
        """States besides what waits in the delays."""
        return len(self.A)

    @property
    def waiting(self) -> tuple[int, ...]:
        """Past samples of each input that are needed, (nu,)."""
        pairs = list(zip(self.source, self.lag, strict=True))
        return tuple(max([lag for s, lag in pairs if s == j], default=0) for j in range(self.nu))

    def delayed(self, u: Array, past: Array | None = None) -> Array:
        """The columns' inputs (N, m).

        Args:
            past: what waits, input after input, the newest first; each input's first value before
                its first sample when None.
        """
        columns, at = [], np.concatenate([[0], np.cumsum(self.waiting)])
        for j, lag in zip(self.source, self.lag, strict=True):
            if past is None:
                head = np.full(min(lag, len(u)), u[0, j] if len(u) else 0.0)
            else:
                head = past[at[j] : at[j] + lag][::-1]
            columns.append(np.concatenate([head, u[:, j]])[: len(u)])
        return np.column_stack(columns) if columns else np.zeros((len(u), 0))

    def whole(self) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) with the delays as states, input after input, the newest first."""
        n, waiting = self.core, self.waiting
        size = n + sum(waiting)
        A, B = np.zeros((size, size)), np.zeros((size, self.nu))
        C, D = np.zeros((len(self.C), size)), np.zeros((len(self.C), self.nu))
        A[:n, :n], C[:, :n] = self.A, self.C
        first = n + np.concatenate([[0], np.cumsum(waiting)])
        for k, (j, lag) in enumerate(zip(self.source, self.lag, strict=True)):
            if lag:
                A[:n, first[j] + lag - 1] += self.B[:, k]
                C[:, first[j] + lag - 1] += self.D[:, k]
            else:
                B[:n, j] += self.B[:, k]
                D[:, j] += self.D[:, k]
        for j, count in enumerate(waiting):
            if count:
                B[first[j], j] = 1.0
                A[first[j] + 1 : first[j] + count, first[j] : first[j] + count - 1] = np.eye(
                    count - 1
                )
        return A, B, C, D

    def predictor(self) -> "Realization":
        """x(t+1) = (A − K C) x + (B − K D) u + K y: one step ahead, with y as further inputs."""
        ny = len(self.C)
        return Realization(
            self.A - self.K @ self.C,
            np.hstack([self.B - self.K @ self.D, self.K]),
            self.C,
            np.hstack([self.D, np.zeros((ny, ny))]),
            None,
            (*self.source, *range(self.nu, self.nu + ny)),
            (*self.lag, *(0,) * ny),
            self.nu + ny,
        )

    def run(self, u: Array, x0: Any = None) -> Any:
        """y (N, ny) for delayed inputs (N, m) from x0 (core,)."""
        return run((self.A, self.B, self.C, self.D), u, x0)

    def free_responses(self, samples: int) -> Array:
        """Outputs of the unit states, (samples, ny, core)."""
        out = np.zeros((samples, *np.shape(self.C)))
        out[:1], power, known = self.C, self.A, 1
        while known < samples:
            more = out[known : 2 * known]
            more[:] = out[: len(more)] @ power
            power, known = power @ power, 2 * known
        return out

    def response(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """C (z − A)⁻¹ B + D at points z, each column later by z^−lag, (len(z), ny, nu)."""
        inner = np.linalg.solve(z[:, None, None] * np.eye(self.core) - self.A, self.B[None])
        columns = (self.C @ inner + self.D) * z[:, None, None] ** -np.array(self.lag)
        out = np.zeros((len(z), len(self.C), self.nu), dtype=np.complex128)
        for k, j in enumerate(self.source):
            out[:, :, j] += columns[:, :, k]
        return out

    def transfer(self) -> TransferMatrix:
        """G(q): numerators det(q − A + B_k C_i) − (1 − D_ik) det(q − A) over det(q − A), of every
        column k, later by its lag.
        """
        A, B, C, D = (np.real(M) for M in (self.A, self.B, self.C, self.D))
        ny = len(C)
        bottom = np.real(np.poly(A)) if len(A) else np.ones(1)
        longest = max(self.lag, default=0)
        num = np.zeros((ny, self.nu, len(bottom) + longest))
        for i in range(ny):
            for k, (j, lag) in enumerate(zip(self.source, self.lag, strict=True)):
                top = D[i, k] * bottom
                if len(A) and np.any(C[i]) and np.any(B[:, k]):
                    top = top + np.real(np.poly(A - np.outer(B[:, k], C[i]))) - bottom
                small = np.abs(top) < NOTHING * max(float(np.abs(top).max()), 1e-300)
                num[i, j, lag : lag + len(top)] += np.where(small, 0.0, top)
        return TransferMatrix.build(list(map(list, num)), [[bottom] * self.nu for _ in range(ny)])


def run(matrices: tuple[Any, Any, Any, Any], u: Array, x0: Any = None) -> Any:
    """y (…, N, ny) of x⁺ = A x + B u, y = C x + D u from x0, rest when None.

    Args:
        matrices: (…, n, n), (…, n, m), (…, ny, n), (…, ny, m); the same inputs drive them all.
        u: (N, m); (…, N, m) for many inputs of one system.
    """
    A, B, C, D = matrices
    *many, n, m = B.shape
    *each, samples, _ = u.shape
    ny = C.shape[-2]
    kind = np.result_type(A, B, C, D, u)
    if not samples:
        return np.zeros((*each, *many, 0, ny), dtype=kind)
    L = SHORT if many or (each and m * ny > SLIGHT) else BLOCK
    blocks = -(-samples // L)
    padded = np.zeros((*each, blocks * L, m))
    padded[..., :samples, :] = u
    seen = np.empty((*many, L, ny, n), dtype=kind)  # C Aᵏ
    reach = np.empty((*many, L, n, m), dtype=kind)  # Aᵏ B
    seen[..., 0, :, :], reach[..., 0, :, :] = C, B
    over, known = A, 1  # A to the power of what is known
    while known < L:
        seen[..., known : 2 * known, :, :] = seen[..., :known, :, :] @ over[..., None, :, :]
        reach[..., known : 2 * known, :, :] = over[..., None, :, :] @ reach[..., :known, :, :]
        over, known = over @ over, 2 * known
    markov = np.zeros((*many, L + 1, ny, m), dtype=kind)
    markov[..., 0, :, :] = D
    markov[..., 1:L, :, :] = C[..., None, :, :] @ reach[..., :-1, :, :]
    later = np.subtract.outer(np.arange(L), np.arange(L))
    toeplitz = markov[..., np.where(later >= 0, later, L), :, :]  # (…, L, L, ny, m)
    U = padded.reshape(*each, blocks, L * m)
    rows = np.moveaxis(toeplitz, -2, -1).swapaxes(-4, -3).swapaxes(-3, -2)
    y = U @ rows.reshape(*many, L * m, L * ny)
    drive = U @ reach[..., ::-1, :, :].swapaxes(-2, -1).reshape(*many, L * m, n)
    states = np.empty(
        (blocks, *each, *many, n), dtype=np.result_type(kind, 0.0 if x0 is None else x0)
    )
    x = np.zeros((*each, *many, n), dtype=states.dtype) + (0.0 if x0 is None else np.asarray(x0))
    for b in range(blocks):
        states[b] = x
        x = (over @ x[..., None])[..., 0] + drive[..., b, :]
    out = seen.reshape(*many, L * ny, n).swapaxes(-2, -1)
    y = y + np.moveaxis(states, 0, -2) @ out
    return y.reshape(*each, *many, blocks * L, ny)[..., :samples, :]


def moved(theta: Array) -> tuple[Any, Array]:
    """θ with each entry moved by a complex step, (n, n), and the steps, (n,)."""
    steps = SMALL * np.maximum(np.abs(theta), 1e-10)
    return theta + 1j * np.diag(steps), steps


def inside(A: Array) -> Array:
    """A with the eigenvalues outside the unit circle mirrored into it."""
    values, vectors = np.linalg.eig(A)
    outside = np.abs(values) >= 1.0
    if not outside.any():
        return A
    values[outside] = INSIDE / np.conj(values[outside])
    return np.real(vectors @ np.diag(values) @ np.linalg.inv(vectors))
