"""Free runs of polynomial difference equations, one by one or many at once, and their gradients.

Every output is a sum of products of past outputs times products of inputs,

    ŷ_i(t) = clip( Σ_m w_im(t) μ_m(t) ),   w_im(t) = Σ_k θ_k Π u(t−·),   μ_m(t) = Π ŷ(t−·),

so that everything of the inputs is known before the run: what is left to do sample by sample is
one short chain of products μ (each one factor longer than an earlier one) and one dot product.
Gradients obey the linear time-varying recursion S(t) = ∂ŷ/∂θ|explicit + Σ_s ∂ŷ/∂s S(t − lag_s)
along the finished run; both are advanced for all chunks of the data at once.
"""

from collections.abc import Callable, Sequence
from operator import mul
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.structures.difference_equations.free_run import FreeRun
from sysid.structures.difference_equations.monomials import Term, columns, is_noise
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.difference_equations.single_values import Limits, kept_inside, together

BLOCK = 8192
"""Samples whose input products are held at a time."""


class PolynomialRun(FreeRun):
    """The terms of all outputs, sorted for fast runs; noise terms (their error is zero) left out.

    Args:
        terms: terms of each output; θ stacks their coefficients in this order.
        nu: number of inputs.
        limits: bounds of each output.
    """

    def __init__(self, terms: Sequence[Sequence[Term]], nu: int, limits: Limits) -> None:
        super().__init__(
            (f for row in terms for t in row if not is_noise(t) for f in t), nu, limits
        )
        self.plan: list[tuple[int, int, int]] = []
        self.products: list[Term] = [()]
        self._place: dict[Term, int] = {(): 0}
        self.u_terms: list[Term] = []
        self.y_index: list[Index] = []
        self.u_index: list[Index] = []
        self.theta_index: list[Index] = []
        at = 0
        for row in terms:
            kept = [k for k, t in enumerate(row) if not is_noise(t)]
            self.theta_index.append(np.array([at + k for k in kept], dtype=int))
            parts = [_parted(row[k]) for k in kept]
            self.y_index.append(np.array([self._product(y) for y, _ in parts], dtype=int))
            self.u_index.append(np.array([self._input_term(u) for _, u in parts], dtype=int))
            at += len(row)
        self.n_theta = at
        self.slots = sorted({(j, lag) for _, j, lag in self.plan})

    def _product(self, t: Term) -> int:
        if t not in self._place:
            before = self._product(t[:-1])
            self.plan.append((before, t[-1].channel, t[-1].lag))
            self.products.append(t)
            self._place[t] = len(self.plan)
        return self._place[t]

    def _input_term(self, t: Term) -> int:
        if t not in self.u_terms:
            self.u_terms.append(t)
        return self.u_terms.index(t)

    # ----------------------------------------------------------------- one run

    def coefficients(self, theta: Array) -> Array:
        """C with w_i(t) = u-products(t) @ C[i], shape (ny, n_u, n_products)."""
        C = np.zeros((self.ny, len(self.u_terms), len(self.products)))
        for i in range(self.ny):
            np.add.at(C[i], (self.u_index[i], self.y_index[i]), theta[self.theta_index[i]])
        return C

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run for inputs (N, nu) from a state, (N, ny)."""
        past_y, past_u = self.past(x0)
        u = np.concatenate([past_u, u])
        n, ny = len(u) - self.before, self.ny
        flat: list[float] = past_y.ravel().tolist()
        # y_j(t − lag) sits at a fixed place from the end of the list while time t is computed
        plan = [(a, j - lag * ny) for a, j, lag in self.plan]
        C, limits = self.coefficients(theta), self.limits
        for start in range(0, n, BLOCK):
            stop = min(start + BLOCK, n)
            part = u[start : stop + self.before]
            U = columns(self.u_terms, part, part[:, :0])
            with np.errstate(over="ignore", invalid="ignore"):
                weights = [(U[self.before :] @ C[i]).tolist() for i in range(ny)]
            for row in zip(*weights, strict=True):
                products = [1.0]
                for a, place in plan:
                    products.append(products[a] * flat[place])
                now = []
                for w, (low, high) in zip(row, limits, strict=True):
                    value = sum(map(mul, w, products))
                    now.append(high if value > high else value if value >= low else low)
                flat += now
        return np.array(flat[self.depth * ny :]).reshape(n, ny)

    def stepper(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        # products of signals, each one factor longer than an earlier one, number 0 being 1
        """(x, u) → (x⁺, y), everything looked up beforehand."""
        plan = [(a, self.place(Signal("y", j, lag))) for a, j, lag in self.plan]
        known_products: dict[Term, int] = {(): 0}

        def place_of(t: Term) -> int:
            if t not in known_products:
                plan.append((place_of(t[:-1]), self.place(t[-1])))
                known_products[t] = len(plan)
            return known_products[t]

        u_places = [place_of(t) for t in self.u_terms]
        number = float if isinstance(theta, np.ndarray) else (lambda value: value)
        rows = [
            [
                (number(theta[k]), int(m), u_places[q])
                for k, m, q in zip(self.theta_index[i], self.y_index[i], self.u_index[i],
                                   strict=True)
            ]
            for i in range(self.ny)
        ]  # fmt: skip
        limits, source, n = self.limits, self.shift().tolist(), self.n_states

        def step(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            known = [*x.tolist(), *u.tolist()] if xp is np else [*x, *u]
            products: list[Any] = [1.0]
            for a, where in plan:
                products.append(products[a] * known[where])
            y = []
            for row, (low, high) in zip(rows, limits, strict=True):
                value = sum((c * products[m] * products[q] for c, m, q in row), 0.0)
                y.append(kept_inside(xp, value, low, high))
            pool = [*known[:n], *y, *known[n:]]
            after = together(xp, [pool[k] for k in source]) if source else x
            return after, together(xp, y)

        return step

    # ----------------------------------------------------------------- many runs at once

    def input_products(self, u: Array) -> Array:
        """u (before + L, nu, B) → values of the input terms, (L, n_u, B)."""
        out = np.empty((len(u) - self.before, len(self.u_terms), u.shape[2]))
        for q, t in enumerate(self.u_terms):
            value = np.ones_like(out[:, q])
            for f in t:
                value = value * u[self.before - f.lag : len(u) - f.lag, f.channel]
            out[:, q] = value
        return out

    def weights(self, theta: Array, products: Array) -> Array:
        """w_im(t), (ny, L, n_products, B)."""
        C = self.coefficients(theta)
        return np.asarray(np.einsum("lqb,iqm->ilmb", products, C, optimize=True))

    @property
    def width(self) -> int:
        """Products of past outputs, for each output."""
        return len(self.products) * self.ny

    def runs(self, weights: Array, past: Array) -> Array:
        _, length, n_products, batch = weights.shape
        full = np.empty((self.depth + length, self.ny, batch))
        full[: self.depth] = past
        low, high = (np.array([lim[k] for lim in self.limits])[:, None] for k in (0, 1))
        products = np.ones((n_products, batch))
        with np.errstate(over="ignore", invalid="ignore"):
            for t in range(length):
                now = t + self.depth
                for m, (a, j, lag) in enumerate(self.plan, 1):
                    np.multiply(products[a], full[now - lag, j], out=products[m])
                value = np.einsum("imb,mb->ib", weights[:, t], products)
                full[now] = np.fmin(np.fmax(value, low), high)
        return full

    def tangent(self, weights: Array, U: Array, full: Array) -> Array:
        """∂ŷ/∂θ along finished runs, (L, ny, n_theta, B); zero where the run is at its limits."""
        length, batch = len(U), U.shape[2]
        products, slopes = self._products_of(full)
        S = np.zeros((self.depth + length, self.ny, self.n_theta, batch))
        now = S[self.depth :]
        pulls: list[list[tuple[int, int, Array]]] = []
        for i in range(self.ny):
            explicit = products[self.y_index[i]] * U.transpose(1, 0, 2)[self.u_index[i]]
            now[:, i, self.theta_index[i]] = explicit.transpose(1, 0, 2)
            pulls.append([])
            for slot, (which, slope) in slopes.items():
                g = np.einsum("lmb,mlb->lb", weights[i][:, which], slope)
                if np.any(g):
                    pulls[i].append((*slot, g))
        run = full[self.depth :]
        low, high = (np.array([lim[k] for lim in self.limits])[:, None] for k in (0, 1))
        inside = (run > low) & (run < high)
        always = bool(inside.all())
        with np.errstate(over="ignore", invalid="ignore"):
            for t in range(length):
                for i in range(self.ny):
                    row = now[t, i]
                    for j, lag, g in pulls[i]:
                        if t >= lag:
                            row += g[t] * now[t - lag, j]
                    if not always:
                        row *= inside[t, i]
        return now

    def _products_of(self, full: Array) -> tuple[Array, dict[tuple[int, int], tuple[Index, Array]]]:
        """μ (n_products, L, B), and by slot the products that hold it with their slope."""
        length = len(full) - self.depth
        values = np.ones((len(self.products), length, full.shape[2]))

        def signal(j: int, lag: int) -> Array:
            return full[self.depth - lag : self.depth - lag + length, j]

        for m, (a, j, lag) in enumerate(self.plan, 1):
            np.multiply(values[a], signal(j, lag), out=values[m])
        slopes = {}
        for slot in self.slots:
            holding = [m for m, t in enumerate(self.products)
                       if any((f.channel, f.lag) == slot for f in t)]  # fmt: skip
            parts = []
            for m in holding:
                rest = [f for f in self.products[m] if (f.channel, f.lag) != slot]
                power = len(self.products[m]) - len(rest)
                value = float(power) * signal(*slot) ** (power - 1)
                for f in rest:
                    value = value * signal(f.channel, f.lag)
                parts.append(value)
            slopes[slot] = (np.array(holding, dtype=int), np.array(parts))
        return values, slopes


def _parted(t: Term) -> tuple[Term, Term]:
    """The factors of past outputs and those of inputs."""
    return tuple(f for f in t if f.kind == "y"), tuple(f for f in t if f.kind == "u")
