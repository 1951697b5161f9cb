"""Recursive least squares in information form: a triangular factor with forgetting.

With the rows [φᵀ y] weighted by λ^(age/2), the factor T of their QR factorisation holds all that
a fit needs,

    T = [R z; 0 ρ],   RᵀR = Σ λ^age φ φᵀ,   R θ = z,   ρ² = Σ λ^age ε²

and new rows are taken in by factorising [√λᵐ T; √W Φ √W y] again. No matrix is inverted and no
square is formed, so that the condition of the data counts once, not twice (Bierman 1977, ch. 5).

Where nothing excites the plant, plain forgetting lets the information fade to nothing and the
covariance grow beyond all bounds. Stabilised forgetting (Milek & Kraus 1995) holds a small share of
the best information there has been, about the estimate of the moment, so that it moves nothing:

    RᵀR ← λᵐ RᵀR + (1 − λᵐ) κ R*ᵀR* + Φᵀ W Φ.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.fitting import normal_equations as ne

HELD = 0.05
"""Share κ of the best information that never fades: standard errors stay below 1/√κ = 4.5 times
their best, and an excited estimate is as slow as if its memory were 5 % longer."""

RESOLVED = 1e-9
"""Diagonal of R, relative to the norm of its column, below which a column adds nothing new."""


@dataclass(frozen=True, eq=False)
class Factor:
    """What all rows so far say about one equation.

    Attributes:
        T: the triangle [R z; 0 ρ], (n + 1, n + 1).
        weight: Σ λ^age over the rows.
        squared: Σ λ^(2 age): how many rows the weights are worth is weight² / squared.
        best: R where the information was largest, for what forgetting never lets fade.
        volume: log det of that R.
        noise: mean squared error then: at rest a plant is quieter, and nothing is learnt of it.
    """

    T: Array
    weight: float
    squared: float
    best: Array
    volume: float
    noise: float = 0.0

    @staticmethod
    def empty(n: int) -> "Factor":
        """Nothing is known of ``n`` coefficients."""
        return Factor(np.zeros((n + 1, n + 1)), 0.0, 0.0, np.zeros((n, n)), -np.inf)

    @property
    def n(self) -> int:
        return len(self.T) - 1

    @property
    def R(self) -> Array:
        return self.T[:-1, :-1]

    @property
    def z(self) -> Array:
        return self.T[:-1, -1]

    @property
    def loss(self) -> float:
        """Weighted sum of squared errors at the estimate."""
        return float(self.T[-1, -1] ** 2)

    def taking(self, rows: Array, forgetting: float = 1.0) -> "Factor":
        """With more rows, the newest last, and all that was there as much older.

        Args:
            rows: [φᵀ y], (m, n + 1).
            forgetting: λ, what a row's weight is multiplied by with every later row.
        """
        m = len(rows)
        if m == 0:
            return self
        faded = forgetting**m
        parts = [np.sqrt(faded) * self.T]
        if forgetting < 1.0:
            age = np.sqrt(forgetting ** np.arange(m - 1.0, -1.0, -1.0))
            rows = rows * age[:, None]
            parts.append(np.sqrt((1.0 - faded) * HELD) * self._held())
        T = triangle_of(np.vstack([*parts, rows]))
        powers = forgetting ** np.arange(m)
        weight = faded * self.weight + float(powers.sum())
        squared = faded**2 * self.squared + float((powers**2).sum())
        grown = replace(self, T=T, weight=weight, squared=squared)
        if forgetting == 1.0:
            return grown
        volume = log_volume(grown.R)
        if volume <= self.volume:
            return grown
        return replace(grown, best=grown.R, volume=volume, noise=grown.loss / weight)

    def _held(self) -> Array:
        """The best information there was as rows that agree with the estimate of now."""
        theta = self.solution().theta
        return np.column_stack([self.best, self.best @ theta])

    def solution(self) -> ne.LeastSquares:
        if self.weight == 0.0:
            n = self.n
            return ne.LeastSquares(np.zeros(n), np.zeros((n, n)), 0.0, np.eye(n))
        solved = ne.solve_triangular_form(self.R, self.z)
        return replace(solved, loss=solved.loss + self.loss)

    def resolved(self) -> bool:
        """Whether every coefficient has information of its own."""
        columns = np.linalg.norm(self.R, axis=0)
        return bool(np.all(np.abs(np.diag(self.R)) > RESOLVED * columns) and np.all(columns > 0.0))


def triangle_of(rows: Array) -> Array:
    """R of the QR factorisation as a square matrix, however few rows there are."""
    n = rows.shape[1]
    triangle = ne.triangle(rows)
    if len(triangle) == n:
        return triangle
    return np.vstack([triangle, np.zeros((n - len(triangle), n))])


def log_volume(R: Array) -> float:
    """log |det R|; −∞ where a direction is without information."""
    diagonal = np.abs(np.diag(R))
    if not np.all(diagonal > RESOLVED * np.linalg.norm(R, axis=0)):
        return -np.inf
    return float(np.sum(np.log(diagonal)))
