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
from sysid.fitting.batched import Damping, descend_together
from sysid.fitting.problem import Data
from sysid.structures.difference_equations.chunks import Piece, pieces, side_by_side
from sysid.structures.difference_equations.monomials import Term
from sysid.structures.narmax.runs import PolynomialRun

DAMPING = Damping(first=1e-9, fall=0.1, rise=30.0, least=1e-13, most=1e5, loose=1e-4)
"""Next to none at first: lagged signals are nearly collinear, and shorter steps lead nowhere."""


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
    free = mask & (batch.samples > mask.sum(axis=1))[:, None]
    open_ = (np.array(-np.inf), np.array(np.inf))
    theta, _ = descend_together(batch.run, theta, free, open_, DAMPING, evaluations - 1, tolerance)
    return [theta[k, [batch.place[t] for t in fit.terms]] for k, fit in enumerate(fits)]


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
            chunks_of_fit = pieces(run, fit.data, length)
            where += [piece._replace(record=len(data) + piece.record) for piece in chunks_of_fit]
            data += fit.data
            group += [k] * len(chunks_of_fit)
        self.group: Index = np.array(group, dtype=np.int64)
        chunks = side_by_side(run, data, where)
        self._chunks, self._y = chunks, chunks.y[:, 0]
        self._inside = chunks.inside.astype(np.float64)
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

    def run(self, theta: Array, which: Index) -> "_Trial":
        """Free runs of all chunks, of which those of some fits count."""
        each = theta[self.group].T
        return _Trial(self, each, self._run.outputs_over(each, self._chunks), which)

    def squares(self, outputs: Array) -> Array:
        """Squared error of each fit."""
        with np.errstate(over="ignore", invalid="ignore"):
            errors = self._inside * (outputs[:, 0] - self._y) ** 2
            return self._by_fit(errors.sum(axis=0))

    def normal(self, theta: Array, outputs: Array) -> tuple[Array, Array]:
        """SᵀS and Sᵀ(y − ŷ) of each fit, S = ∂ŷ/∂θ."""
        with np.errstate(over="ignore", invalid="ignore"):
            S = self._run.slopes_over(theta, self._chunks, outputs)[:, 0]
            S = np.nan_to_num(S * self._inside[:, :, None], nan=0.0, posinf=0.0, neginf=0.0)
            e = np.nan_to_num(self._inside * (self._y - outputs[:, 0]))
            S = np.ascontiguousarray(S.transpose(1, 2, 0))
            A = self._by_fit(S @ S.transpose(0, 2, 1))
            g = self._by_fit(np.einsum("bkl,lb->bk", S, e))
        return np.nan_to_num(A), np.nan_to_num(g)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Free runs of all chunks at some coefficients."""

    batch: _Batch
    theta: Array
    outputs: Array
    which: Index

    @property
    def cost(self) -> Array:
        """Squared errors of the fits that count."""
        return self.batch.squares(self.outputs)[self.which, None]

    def normal(self, of: Index) -> tuple[Array, Array]:
        """Normal equations of some of them."""
        A, g = self.batch.normal(self.theta, self.outputs)
        return A[self.which[of]], g[self.which[of]]
