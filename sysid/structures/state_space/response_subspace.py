"""Matrices of any order from a sampled frequency response, by one projection and one SVD.

With z_k = e^{jω_k dt} and X(z) = (z − A)⁻¹ B, rows Gᵢ = zⁱ G(z), i = 0 … q − 1, are

    𝐆 = O X + Γ 𝐔,   O = [C; C A; …],  𝐔 = [I; z I; …]

so that what of 𝐆 is orthogonal to 𝐔, real and imaginary parts side by side, spans O (McKelvey,
Akçay & Ljung 1996, IEEE Trans. Autom. Control 41, 960, algorithm 2). A and C follow from O, B and D
by weighed least squares. Frequencies far below 1/dt crowd at z = 1; so it is done in

    z' = (z − a)/(1 − a z),   A = (1 + a A')⁻¹ (A' + a),   C = C' (1 − a A)

which maps the unit circle onto itself, and the middle of the frequencies to a quarter of it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.structures.state_space.realization import inside

Complex = NDArray[np.complexfloating[Any, Any]]
Matrices = tuple[Array, Array, Array, Array]


def from_response(
    value: Complex, sigma: Array, w: Array, n: int, feedthrough: bool
) -> Matrices | None:
    """(A, B, C, D) of order n; None where there are too few frequencies.

    Args:
        value: G, (nf, ny, nu).
        sigma: its standard errors, of the same shape.
        w: frequencies [rad a sample], (nf,).
        feedthrough: whether D is free.
    """
    nf, ny, nu = value.shape
    least = -(-n // ny) + 1
    most = 2 * nf * nu // (nu + ny)
    best: tuple[float, Matrices] | None = None
    for q in sorted({min(k * least, most) for k in (1, 2, 4)}):
        if q < least:
            continue
        found = _with_rows(value, sigma, w, n, feedthrough, q)
        if best is None or found[0] < best[0]:
            best = found
    return None if best is None else best[1]


def _with_rows(
    value: Complex, sigma: Array, w: Array, n: int, feedthrough: bool, q: int
) -> tuple[float, Matrices]:
    """The weighed error and the matrices that q block rows give."""
    nf, ny, nu = value.shape
    z = np.exp(1j * w)
    slow = np.tan(0.5 * np.sqrt(w[0] * w[-1]))
    a = float((1.0 - slow) / (1.0 + slow))
    powers = ((z - a) / (1.0 - a * z))[:, None] ** np.arange(q)
    of_output = np.sqrt(np.median(sigma**2, axis=(0, 2)))
    even = value / of_output[:, None]
    weight = 1.0 / np.sqrt(np.mean((sigma / of_output[:, None]) ** 2, axis=1))  # (nf, nu)
    G = np.einsum("kq,kij,kj->qikj", powers, even, weight).reshape(q * ny, nf * nu)
    U = np.einsum("kq,ij,kj->qikj", powers, np.eye(nu), weight).reshape(q * nu, nf * nu)
    both = np.vstack([np.hstack([M.real, M.imag]) for M in (U, G)])
    triangle = np.asarray(np.linalg.qr(both.T, mode="r")).T
    seen_by = np.linalg.svd(triangle[q * nu :, q * nu :])[0][:, :n]
    inner = np.linalg.lstsq(seen_by[:-ny], seen_by[ny:], rcond=None)[0]
    A = inside(np.linalg.solve(np.eye(n) + a * inner, inner + a * np.eye(n)))
    C = of_output[:, None] * seen_by[:ny] @ (np.eye(n) - a * A)
    seen = C @ np.linalg.inv(z[:, None, None] * np.eye(n) - A)  # (nf, ny, n)
    if feedthrough:
        seen = np.concatenate([seen, np.broadcast_to(np.eye(ny), (nf, ny, ny))], axis=2)
    columns, cost = [], 0.0
    for j in range(nu):
        rows = (seen / sigma[:, :, [j]]).reshape(nf * ny, -1)
        right = (value[:, :, j] / sigma[:, :, j]).ravel()
        rows, right = (np.concatenate([M.real, M.imag]) for M in (rows, right))
        found, *_ = np.linalg.lstsq(rows, right, rcond=None)
        cost += float(np.sum((right - rows @ found) ** 2))
        columns.append(found)
    BD = np.column_stack(columns)
    D = BD[n:] if feedthrough else np.zeros((ny, nu))
    return cost, (A, BD[:n], C, D)
