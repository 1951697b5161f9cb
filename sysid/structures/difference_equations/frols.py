"""Forward regression by orthogonal least squares: terms in the order of what they explain.

At each step the candidate whose part orthogonal to the terms already chosen explains most of the
output is added; its error reduction ratio is that part's share of the output's power,

    ERR_k = g_k² ‖w_k‖² / ‖y‖²      (Chen, Billings & Luo 1989; Billings 2013, eq. 3.23).

Orthogonalising all candidates against the chosen ones is a pivoted Cholesky decomposition of
their Gram matrix: one pass over the data, and then every subset of candidates can be searched
without touching them again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Index
from sysid.structures.difference_equations.monomials import Term, columns

BLOCK = 8192
"""Samples whose terms are held at a time."""

DEPENDENT = 1e-10
"""A candidate with less than this share of its power left is a combination of the chosen ones."""


NOTHING = 1e-10
"""Share of a candidate's power that terms which are there anyway must leave for it to be of use."""

EXTRA = 8
"""Terms beyond the wanted number from which terms are then left out."""


@dataclass(frozen=True, eq=False)
class TermGram:
    """Products of candidate terms with each other and with one output, summed over the data.

    Attributes:
        norms: their Euclidean norms over the data, (K,); 1 where a term is zero throughout.
        gram: products of the terms divided by their norms, (K, K).
        right: products of those with the output, (K,).
        power: ‖y‖².
        samples: equations.
    """

    terms: tuple[Term, ...]
    norms: Array
    gram: Array
    right: Array
    power: float
    samples: int

    def solve(self, chosen: Sequence[int]) -> Array:
        """Least-squares coefficients of some of the terms, (len(chosen),)."""
        where = np.asarray(chosen, dtype=int)
        block = self.gram[np.ix_(where, where)]
        coefficients = np.linalg.lstsq(block, self.right[where], rcond=1e-13)[0]
        return np.asarray(coefficients / self.norms[where])


def term_gram(
    terms: Sequence[Term], data: Sequence[tuple[Array, Array]], output: int, first: int
) -> TermGram:
    """Gram matrix of candidate terms on (u, y) of each record, from sample ``first`` on."""
    size = len(terms)
    gram, right, power, samples = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for u, y in data:
        for start in range(first, len(y), BLOCK):
            stop = min(start + BLOCK, len(y))
            rows = slice(start - first, stop)
            values = columns(terms, u[rows], y[rows])[first:]
            target = y[start:stop, output]
            gram += values.T @ values
            right += values.T @ target
            power += float(target @ target)
            samples += len(target)
    norms = np.sqrt(np.diag(gram))
    norms = np.where((norms > 0.0) & np.isfinite(norms), norms, 1.0)
    return TermGram(
        tuple(terms), norms, gram / np.outer(norms, norms), right / norms, power, samples
    )


def gram_beyond(
    given: Array, values: Array, target: Array, products: Array | None = None
) -> tuple[TermGram, list[int], int]:
    """Gram matrix of what candidates add to columns that are there anyway.

    Args:
        given: columns that are there anyway, (N, G).
        values: candidates, (N, K).
        target: the output, (N,).
        products: valuesᵀ values, where they are known.

    Returns:
        The Gram matrix of the candidates' parts orthogonal to the given columns, candidates of
        which enough is left to be of use, and the rank of the given columns.
    """
    norms = np.linalg.norm(given, axis=0)
    Q, R = np.linalg.qr(given / np.where(norms > 0.0, norms, 1.0))
    Q = Q[:, np.abs(np.diag(R)) > DEPENDENT * np.abs(R).max(initial=1e-300)]
    taken = Q.T @ values
    rest = target - Q @ (Q.T @ target)
    whole = values.T @ values if products is None else products
    part = whole - taken.T @ taken
    unexplained = np.maximum(np.diag(part), 0.0)
    usable = unexplained > NOTHING * np.diag(whole)
    norms = np.sqrt(np.where(usable, unexplained, 1.0))
    part, right = part / np.outer(norms, norms), values.T @ rest / norms
    gram = TermGram((), norms, part, right, float(rest @ rest), len(target))
    return gram, np.flatnonzero(usable).tolist(), Q.shape[1]


@dataclass(frozen=True, eq=False)
class Path:
    """Terms in the order in which they were added.

    Attributes:
        order: indices into the candidates, (n,).
        err: error reduction ratio of each, (n,), a share of ‖y‖².
    """

    order: Index
    err: Array

    def unexplained(self) -> Array:
        """Share of the output's power left after 1, 2, … terms."""
        return np.maximum(1.0 - np.cumsum(self.err), 1e-15)


def forward(g: TermGram, allowed: Sequence[int], most: int) -> Path:
    """Up to ``most`` of the allowed candidates, best first.

    It ends early when every candidate left is a combination of the chosen ones.
    """
    where = np.asarray(allowed, dtype=int)
    C, b = g.gram[np.ix_(where, where)], g.right[where].copy()
    unexplained = np.diag(C).copy()
    most = min(most, len(where), g.samples)
    factor = np.zeros((most, len(where)))
    order: list[int] = []
    err: list[float] = []
    for k in range(most):
        open_ = unexplained > DEPENDENT
        open_[order] = False
        if not open_.any():
            break
        pick = int(np.argmax(np.where(open_, b**2 / np.where(open_, unexplained, 1.0), -1.0)))
        root = float(np.sqrt(unexplained[pick]))
        row = (C[pick] - factor[:k, pick] @ factor[:k]) / root
        factor[k] = row
        gain = b[pick] / root
        b = b - row * gain
        unexplained = unexplained - row**2
        order.append(pick)
        err.append(gain**2 / g.power if g.power > 0 else 0.0)
    return Path(where[np.array(order, dtype=int)], np.array(err))


def eliminated(g: TermGram, chosen: Sequence[int]) -> list[tuple[list[int], float]]:
    """The chosen terms with one after another left out, the one that explains least first.

    Forward selection cannot take back a term that later ones replace (u where u³ is the truth);
    leaving out from a larger set can. Each set comes with the share of the output's power it
    leaves, the smallest set last.
    """
    kept = list(chosen)
    sets = []
    while kept:
        where = np.array(kept)
        inverse = np.linalg.pinv(g.gram[np.ix_(where, where)], rcond=1e-13, hermitian=True)
        theta = inverse @ g.right[where]
        explained = float(theta @ g.right[where]) / g.power if g.power > 0 else 0.0
        sets.append((kept, max(1.0 - explained, 1e-15)))
        loss = theta**2 / np.maximum(np.diag(inverse), 1e-300)
        out = int(np.argmin(loss))
        kept = [k for i, k in enumerate(kept) if i != out]
    return sets


def best_sizes(g: TermGram, allowed: Sequence[int], most: int) -> list[tuple[list[int], float]]:
    """For 1, 2, … terms the better of forward selection and of leaving out from more."""
    path = forward(g, allowed, most + EXTRA)
    unexplained = path.unexplained()
    sets = [
        (path.order[: n + 1].tolist(), float(unexplained[n]))
        for n in range(min(most, len(unexplained)))
    ]
    for kept, share in eliminated(g, path.order.tolist()):
        n = len(kept) - 1
        if n < len(sets) and share < sets[n][1] * (1.0 - 1e-9):
            sets[n] = (kept, share)
    return sets


def bic_size(unexplained: Sequence[float], samples: int) -> int:
    """Number of terms of lowest BIC = N ln V + n ln N; ``unexplained`` are V/‖y‖² of 1, 2, … "
    "terms."""
    n = np.arange(1, len(unexplained) + 1)
    score = samples * np.log(np.asarray(unexplained)) + n * np.log(max(samples, 2))
    return int(np.argmin(score)) + 1 if len(n) else 0
