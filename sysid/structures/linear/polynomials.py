"""Polynomials in q⁻¹, and the matrices of them that θ stands for.

A polynomial is its coefficients in ascending powers: numbers, arrays with an entry for every θ of
many, or what a compiler traces. Products need no array functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sysid.structures.linear.predictor import RowLayout

Coefficients = Any
"""A list, or an array, of coefficients."""

Matrix = list[list[Coefficients]]


@dataclass(frozen=True, eq=False)
class Polynomials:
    """A, B, C, D, F by [output][input]; C and D by output."""

    A: Matrix
    B: Matrix
    C: list[Coefficients]
    D: list[Coefficients]
    F: Matrix

    @staticmethod
    def of(layouts: Sequence[RowLayout], theta: Any) -> "Polynomials":
        """What θ stands for, row after row of these layouts; θ counts along its first axis."""
        A: Matrix = []
        B: Matrix = []
        F: Matrix = []
        C, D = [], []
        at = 0
        for i, lay in enumerate(layouts):
            part = [theta[k] for k in range(at, at + lay.n)]
            at += lay.n
            a, b, c, d, f = lay.slices()
            A.append([[1.0 if i == j else 0.0, *part[s]] for j, s in enumerate(a)])
            B.append([
                [*[0.0] * nk, *part[s]] if nb else [0.0]
                for nb, nk, s in zip(lay.nb, lay.nk, b, strict=True)
            ])  # fmt: skip
            F.append([[1.0, *part[s]] for s in f])
            C.append([1.0, *part[c]])
            D.append([1.0, *part[d]])
        return Polynomials(A, B, C, D, F)

    def rational(self, coupled: bool) -> tuple[Matrix, Matrix]:
        """Numerators and denominators of G(q) = A⁻¹ [B/F]; without F where outputs are coupled."""
        ny, nu = len(self.B), len(self.B[0])
        if not coupled:
            den = [[times(self.A[i][i], self.F[i][j]) for j in range(nu)] for i in range(ny)]
            return self.B, den
        det, adj = determinant(self.A), adjugate(self.A)
        num = [
            [total([times(adj[i][k], self.B[k][j]) for k in range(ny)]) for j in range(nu)]
            for i in range(ny)
        ]
        return num, [[det] * nu for _ in range(ny)]


def times(p: Coefficients, q: Coefficients) -> list[Any]:
    """Product of two polynomials."""
    product: list[Any] = [0.0] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            product[i + j] = product[i + j] + a * b
    return product


def total(terms: Sequence[Coefficients]) -> list[Any]:
    """Sum of polynomials of any lengths."""
    size = max(map(len, terms))
    return [sum((t[k] for t in terms if k < len(t)), 0.0) for k in range(size)]


def determinant(A: Matrix) -> Coefficients:
    """det A(q) of a small square polynomial matrix (expansion along the first row)."""
    if len(A) == 1:
        return A[0][0]
    terms = [times(p, determinant(_minor(A, 0, j))) for j, p in enumerate(A[0])]
    return total([[-c for c in t] if j % 2 else t for j, t in enumerate(terms)])


def adjugate(A: Matrix) -> Matrix:
    """adj A(q), so that A⁻¹ = adj A / det A."""
    n = len(A)
    if n == 1:
        return [[[1.0]]]
    return [
        [[(-1.0) ** (i + j) * c for c in determinant(_minor(A, j, i))] for j in range(n)]
        for i in range(n)
    ]


def _minor(A: Matrix, row: int, column: int) -> Matrix:
    return [[p for c, p in enumerate(r) if c != column] for k, r in enumerate(A) if k != row]
