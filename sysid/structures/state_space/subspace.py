"""Subspace identification in predictor form: matrices of any order from one regression and an SVD.

With Ā = A − K C, B̄ = [B − K D, K] and z = [u; y] the model is x(t+1) = Ā x(t) + B̄ z(t), whose
errors are white whether or not the inputs come from a controller. So:

1. y(t) = Σ_{k=1}^{p} C Ā^{k−1} B̄ z(t−k) + D u(t) + e(t) by least squares (a long ARX), p by AIC;
2. with these Markov parameters Γ X̂, the states seen by f future outputs, from past z;
3. W Γ X̂ = U S Vᵀ; the n largest singular values span the states, X̂ = S^{1/2} Vᵀ;
4. C, D, then A, B, K by least squares from X̂, u and the errors.

W = I weighs outputs as N4SID does; W = Λ^{−1/2} of the innovations' covariance makes of the
singular values σ/√N the canonical correlations √(σ²/(N + σ²)) of past and future (CVA, Larimore
1990): the future outputs less what future inputs and outputs explain are Γ X + E, and E is white.
The covariance of the future outputs themselves must not stand there: it hides slow states behind
what moves most.

Sources: Chiuso (2007), Automatica 43, 1034 (PBSIDopt); Jansson (2003), SYSID (SSARX); Van Overschee
& De Moor (1996), Subspace Identification for Linear Systems.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import Data

LEAST_PAST, MOST_PAST = 4, 40
"""Past samples of the long ARX."""

PART = 8
"""A past takes at most one in so many of the equations as unknowns."""


@dataclass(frozen=True, eq=False)
class Subspace:
    """What the regressions leave to choose: how many singular values count.

    Attributes:
        singular: singular values of W Γ X̂ over √N, falling.
        states: S^{1/2} Vᵀ of each record, from its sample ``past`` on, (f ny, N − p).
        data: the records.
        errors: of the long ARX, from sample ``past`` on, (N − p, ny) each.
    """

    singular: Array
    states: tuple[Array, ...]
    data: Data
    errors: tuple[Array, ...]
    past: int
    feedthrough: bool

    def matrices(self, n: int) -> tuple[Array, Array, Array, Array, Array]:
        """(A, B, C, D, K) of order n."""
        x = [s[:n].T for s in self.states]
        u = [u[self.past :] for u, _ in self.data]
        y = np.concatenate([y[self.past :] for _, y in self.data])
        X, U = np.concatenate(x), np.concatenate(u)
        nu = U.shape[1] if self.feedthrough else 0
        now = np.hstack([X, U[:, :nu]])
        CD = np.linalg.lstsq(now, y, rcond=None)[0].T
        C, D = CD[:, :n], np.zeros((y.shape[1], U.shape[1]))
        D[:, :nu] = CD[:, n:]
        e = y - now @ CD.T
        ends = np.cumsum([len(s) for s in x])
        stays = np.setdiff1d(np.arange(len(X)), ends - 1)
        before = np.hstack([X, U, e])[stays]
        ABK = np.linalg.lstsq(before, X[stays + 1], rcond=None)[0].T
        return ABK[:, :n], ABK[:, n : n + U.shape[1]], C, D, ABK[:, n + U.shape[1] :]


def subspace(data: Data, feedthrough: bool, most: int, cva: bool = True) -> Subspace | None:
    """The states of the records' common model; None where they are too short for one.

    Args:
        data: (u, y) of each record, without offsets.
        most: states that must be distinguished.
        cva: whether innovations are whitened.
    """
    nu, ny = data[0][0].shape[1], data[0][1].shape[1]
    shortest = min(len(y) for _, y in data)
    samples = sum(len(y) for _, y in data)
    least = max(LEAST_PAST, -(-2 * most // ny))
    past = int(np.clip(samples // (PART * (nu + ny)), least, max(MOST_PAST, least)))
    past = min(past, shortest // 3)
    if past < 2 or samples - len(data) * past < (nu + ny) * past + 2 * ny:
        return None
    z = [np.hstack([u, y]) for u, y in data]
    past = _past_of(z, past, min(least, past), ny)
    rows = [_past_rows(one, past) for one in z]
    now = [u[past:] if feedthrough else u[past:, :0] for u, _ in data]
    left = np.hstack([np.concatenate(rows), np.concatenate(now)])
    right = np.concatenate([y[past:] for _, y in data])
    scale = np.linalg.norm(left, axis=0)
    scale[scale == 0.0] = 1.0
    found = (np.linalg.lstsq(left / scale, right, rcond=1e-10)[0].T / scale).T
    width = nu + ny
    gamma = np.zeros((past * ny, past * width))
    for i in range(past):  # the i-th future output sees the past from lag i + 1 on
        gamma[i * ny : (i + 1) * ny, : (past - i) * width] = found[i * width : past * width].T
    e = right - left @ found
    W = np.kron(np.eye(past), _whitening(e)) if cva else np.eye(past * ny)
    seen = W @ gamma @ np.concatenate(rows).T
    U, s, _ = np.linalg.svd(seen @ seen.T)
    singular = np.sqrt(s)
    states = (U.T @ seen) / np.sqrt(np.maximum(singular, 1e-300))[:, None]
    ends = np.cumsum([len(r) for r in rows])[:-1]
    return Subspace(
        singular / np.sqrt(len(right)),
        tuple(np.split(states, ends, axis=1)),
        data,
        tuple(np.split(e, ends)),
        past,
        feedthrough,
    )


def _past_rows(z: Array, past: int) -> Array:
    """z(t−1) … z(t−p), side by side, for t = p … N − 1."""
    return np.hstack([z[past - k : len(z) - k] for k in range(1, past + 1)])


def _past_of(z: Sequence[Array], longest: int, least: int, ny: int) -> int:
    """Length of the ARX with the smallest AIC; one triangle has the errors of every length."""
    left = np.concatenate([_past_rows(one, longest) for one in z])
    right = np.concatenate([one[longest:, -ny:] for one in z])
    triangle = np.asarray(np.linalg.qr(np.hstack([left, right]), mode="r"))[:, -ny:]
    width, samples = z[0].shape[1], len(left)
    best, chosen = np.inf, longest
    for p in range(least, longest + 1):
        rest = triangle[p * width :]
        size = np.linalg.slogdet(rest.T @ rest / samples)[1]
        aic = samples * size + 2.0 * p * width * ny
        if aic < best:
            best, chosen = aic, p
    return chosen


def _whitening(e: Array) -> Array:
    """Λ^{−1/2} of the covariance of errors."""
    values, vectors = np.linalg.eigh(e.T @ e / len(e))
    values = np.maximum(values, 1e-12 * values[-1])
    return np.asarray((vectors / np.sqrt(np.maximum(values, 1e-300))) @ vectors.T)
