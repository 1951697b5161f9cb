"""Polynomial difference equations, ready for free runs, and their gradients over chunks of data.

Every output is a sum of products of past outputs and inputs,

    ŷ_i(t) = clip( Σ_k θ_k Π ŷ(t−·) Π u(t−·) ).

Gradients obey the linear time-varying recursion S(t) = ∂ŷ/∂θ|explicit + Σ_s ∂ŷ/∂s S(t − lag_s)
along the finished run, which is advanced for all chunks of the data at once.
"""

from collections.abc import Sequence
from operator import mul
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.runners import floats
from sysid.structures.difference_equations.free_run import (
    Chunks,
    FreeRun,
    Limits,
    OfInputs,
    OfOutputs,
    Place,
)
from sysid.structures.difference_equations.monomials import Term, is_noise, products
from sysid.structures.difference_equations.signals import Signal


class Products:
    """Products of signals, each one factor longer than an earlier one, number 0 being 1."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._numbers: dict[Term, int] = {(): 0}
        self.steps: list[tuple[int, int]] = []

    def number(self, t: Term) -> int:
        """That of a product, which is planned if need be."""
        if t not in self._numbers:
            shorter = self.number(t[:-1])
            self.steps.append((shorter, self._place(t[-1])))
            self._numbers[t] = len(self.steps)
        return self._numbers[t]

    def values(self, known: Any) -> list[Any]:
        """The products by number."""
        values: list[Any] = [1.0]
        for shorter, at in self.steps:
            values.append(values[shorter] * known[at] if shorter else known[at])
        return values


class PolynomialRun(FreeRun):
    """The terms of all outputs; noise terms (their error is zero) left out.

    Args:
        terms: terms of each output; θ stacks their coefficients in this order.
        limits: bounds of each output.
    """

    def __init__(self, terms: Sequence[Sequence[Term]], nu: int, limits: Limits) -> None:
        super().__init__(
            (f for row in terms for t in row if not is_noise(t) for f in t), nu, limits
        )
        self.terms = tuple(tuple(t for t in row if not is_noise(t)) for row in terms)
        self.theta_index: list[Index] = []
        at = 0
        for row in terms:
            kept = [at + k for k, t in enumerate(row) if not is_noise(t)]
            self.theta_index.append(np.array(kept, dtype=int))
            at += len(row)
        self.n_theta = at

    def parts(self, xp: Any, theta: Any, place: Place) -> tuple[OfInputs, OfOutputs]:
        """Weights w_im = Σ_k θ_k Π u of products μ_m = Π ŷ, which follow from each other."""
        of_outputs, of_inputs = Products(place), Products(place)
        values = theta.tolist() if xp is floats else theta
        sums: list[dict[int, list[tuple[Any, int]]]] = [{} for _ in self.terms]
        for row, terms, index in zip(sums, self.terms, self.theta_index, strict=True):
            for t, k in zip(terms, index.tolist(), strict=True):
                m = of_outputs.number(tuple(f for f in t if f.kind == "y"))
                q = of_inputs.number(tuple(f for f in t if f.kind == "u"))
                row.setdefault(m, []).append((values[k], q))
        n = len(of_outputs.steps) + 1
        weights = [row.get(m, [(0.0, 0)]) for row in sums for m in range(n)]
        # most weights have one term: a sum for each would take as long as all products
        first = [terms[0] for terms in weights]
        more = [(k, *term) for k, terms in enumerate(weights) for term in terms[1:]]
        starts = range(0, len(weights), n)

        def weighted(known: Any) -> list[Any]:
            products = of_inputs.values(known)
            found = [c * products[q] for c, q in first]
            for k, c, q in more:
                found[k] = found[k] + c * products[q]
            return found

        def outputs(known: Any, row: Any) -> list[Any]:
            products = of_outputs.values(known)
            return [sum(map(mul, row[k : k + n], products), 0.0) for k in starts]

        return weighted, outputs

    # ----------------------------------------------------------------- over chunks

    def slopes_over(self, theta: Array, chunks: Chunks, outputs: Array) -> Array:
        length, ny, batch = outputs.shape
        run = np.concatenate([chunks.past, outputs])

        def signal(s: Signal) -> Array:
            whole, first = (run, self.depth) if s.kind == "y" else (chunks.u, self.before)
            return np.asarray(whole[first - s.lag : first - s.lag + length, s.channel])

        value = products(signal, np.ones((length, batch)))
        # one sample's slopes lie together: the recursion below goes from sample to sample
        S = np.zeros((length, ny, self.n_theta, batch))
        pulls: list[dict[Signal, Array]] = [{} for _ in range(ny)]
        for i, (row, index) in enumerate(zip(self.terms, self.theta_index, strict=True)):
            for t, k in zip(row, index.tolist(), strict=True):
                S[:, i, k] = value(t)
                for s in {f for f in t if f.kind == "y"}:
                    rest = list(t)
                    rest.remove(s)
                    pull = t.count(s) * theta[k] * value(tuple(rest))
                    pulls[i][s] = pulls[i].get(s, 0.0) + pull
        low, high = (np.array([lim[k] for lim in self.limits])[:, None] for k in (0, 1))
        inside = (outputs > low) & (outputs < high)
        always = bool(inside.all())
        with np.errstate(over="ignore", invalid="ignore"):
            for now in range(length):
                for i in range(ny):
                    for s, pull in pulls[i].items():
                        if now >= s.lag:
                            S[now, i] += pull[now] * S[now - s.lag, s.channel]
                    if not always:
                        S[now, i] *= inside[now, i]
        return S.transpose(0, 1, 3, 2)
