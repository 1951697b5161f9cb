"""Many small fits to free runs over chunks, all advanced at once.

The search for terms fits the same few samples again and again: each candidate on each fold. What
costs time is stepping through the chunks sample by sample, not the arithmetic of a step; so all
candidates and folds step together as one batch, and each has its own Levenberg-Marquardt damping
(Marquardt 1963). Normal equations of columns of unit norm serve a search; the coefficients of the
winner are estimated again by QR.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.structures.narmax.runs import PolynomialRun
from sysid.structures.recursive.chunks import Data, Piece, pieces, side_by_side
from sysid.structures.recursive.monomials import Term

START = 1e-9
"""Damping of the first step: next to none, lagged signals are nearly collinear."""

FALL, RISE = 0.1, 30.0
LEAST, STIFFEST = 1e-13, 1e5
"""Damping is kept above the rounding of normal equations; where it grows beyond the other, a fit
is over: steps have become too short to matter."""

LOOSE = 1e-4
"""Damping below which a step that gains little means an end; a stiff one may only be short."""


@dataclass(frozen=True, eq=False)
class ChunkFit:
    """One fit: its terms, where it starts, and the (u, y) it is fitted to, y of shape (N, 1)."""

    terms: tuple[Term, ...]
    theta: Array
    data: Data


def fit_together(
    fits: Sequence[ChunkFit],
    limits: tuple[float, float],
    length: int,
    evaluations: int,
    tolerance: float = 1e-5,
) -> list[Array]:
    """Coefficients of each fit from free runs of about ``length`` samples, (n,) each.

    Args:
        fits: terms, starts and data; all with the same inputs.
        limits: bounds of the output in free run.
        length: samples a chunk.
        evaluations: limit on free runs.
        tolerance: relative decrease of the squared error at which a fit is over.
    """
    batch = _Batch(fits, limits, length)
    theta, mask = batch.starts()
    # with fewer samples than coefficients there is nothing to fit
    going = batch.samples > mask.sum(axis=1)
    weights, full, cost = batch.run(theta)
    normal = batch.normal(weights, full)
    damping = np.full(len(fits), START)
    for _ in range(evaluations - 1):
        if not going.any():
            break
        trial = theta + np.where(going[:, None], _steps(*normal, mask, damping), 0.0)
        new_weights, new_full, new_cost = batch.run(trial)
        better = going & (new_cost < cost)
        settled = better & (new_cost > (1.0 - tolerance) * cost) & (damping < LOOSE)
        damping = np.where(better, np.maximum(damping * FALL, LEAST), damping * RISE)
        theta[better] = trial[better]
        cost = np.where(better, new_cost, cost)
        going = going & ~settled & (damping < STIFFEST)
        if better.any() and going.any():
            pieces = better[batch.group]
            weights[..., pieces] = new_weights[..., pieces]
            full[..., pieces] = new_full[..., pieces]
            normal = batch.normal(weights, full)
    return [theta[k, [batch.place[t] for t in fit.terms]] for k, fit in enumerate(fits)]


def _steps(A: Array, g: Array, mask: NDArray[np.bool_], damping: Array) -> Array:
    """(A + λ diag A)⁻¹ g of each fit in columns of unit norm, zero where a term is absent."""
    diagonal = np.einsum("gkk->gk", A)
    norms = np.sqrt(np.where(mask & (diagonal > 0.0), diagonal, 1.0))
    both = mask[:, :, None] & mask[:, None, :]
    scaled = np.where(both, A / (norms[:, :, None] * norms[:, None, :]), 0.0)
    scaled += np.einsum("gk,kl->gkl", np.where(mask, damping[:, None], 1.0), np.eye(g.shape[1]))
    found = np.linalg.solve(scaled, np.where(mask, g / norms, 0.0)[:, :, None])[:, :, 0] / norms
    return np.asarray(np.where(mask, found, 0.0))


class _Batch:
    """The chunks of all fits side by side."""

    def __init__(self, fits: Sequence[ChunkFit], limits: tuple[float, float], length: int) -> None:
        self.fits = fits
        self.terms = tuple(dict.fromkeys(t for f in fits for t in f.terms))
        self.place = {t: k for k, t in enumerate(self.terms)}
        nu = fits[0].data[0][0].shape[1]
        run = self._run = PolynomialRun((self.terms,), nu, (limits,))
        data: list[tuple[Array, Array]] = []
        where: list[Piece] = []
        group: list[int] = []
        for k, fit in enumerate(fits):
            mine = pieces(run, fit.data, length)
            where += [piece._replace(record=len(data) + piece.record) for piece in mine]
            data += fit.data
            group += [k] * len(mine)
        self.group: Index = np.array(group, dtype=np.int64)
        chunks = side_by_side(run, data, where)
        self._past, self._y = chunks.past, chunks.y[:, 0]
        self._inside = chunks.inside.astype(np.float64)
        self._products = run.input_products(chunks.u)
        self.samples = self._by_fit(self._inside.sum(axis=0))

    def _by_fit(self, values: Array) -> Array:
        """Sums over the chunks of each fit; the chunks come first."""
        out = np.zeros((len(self.fits), *values.shape[1:]))
        np.add.at(out, self.group, values)
        return out

    def starts(self) -> tuple[Array, NDArray[np.bool_]]:
        """θ over all terms (zero where absent) and which are present, (fits, terms) each."""
        theta = np.zeros((len(self.fits), len(self.terms)))
        mask = np.zeros(theta.shape, dtype=bool)
        for k, fit in enumerate(self.fits):
            where = [self.place[t] for t in fit.terms]
            theta[k, where] = fit.theta
            mask[k, where] = True
        return theta, mask

    def run(self, theta: Array) -> tuple[Array, Array, Array]:
        """Weights and free runs of all chunks, and the squared error of each fit."""
        run = self._run
        length, _, pieces = self._products.shape
        weights = np.zeros((1, length, len(run.products), pieces))
        each = theta[self.group]
        for k, (m, q) in enumerate(zip(run.y_index[0], run.u_index[0], strict=True)):
            if each[:, k].any():
                weights[0, :, m] += each[:, k] * self._products[:, q]
        full = run.runs(weights, self._past)
        with np.errstate(over="ignore", invalid="ignore"):
            squares = self._inside * (full[run.depth :, 0] - self._y) ** 2
            cost = self._by_fit(squares.sum(axis=0))
        return weights, full, np.where(np.isfinite(cost), cost, np.inf)

    def normal(self, weights: Array, full: Array) -> tuple[Array, Array]:
        """SᵀS and Sᵀ(y − ŷ) of each fit, S = ∂ŷ/∂θ."""
        run = self._run
        with np.errstate(over="ignore", invalid="ignore"):
            S = run.tangent(weights, self._products, full)[:, 0]
            S = np.nan_to_num(S * self._inside[:, None], nan=0.0, posinf=0.0, neginf=0.0)
            e = np.nan_to_num(self._inside * (self._y - full[run.depth :, 0]))
            S = np.ascontiguousarray(S.transpose(2, 1, 0))
            A = self._by_fit(S @ S.transpose(0, 2, 1))
            g = self._by_fit(np.einsum("bkl,lb->bk", S, e))
        return np.nan_to_num(A), np.nan_to_num(g)
