"""Free runs of NARX models: sample by sample, many at once, and compiled where they are long.

ŷ_i(t) = clip(F_i(x_i(t))), x_i(t) the regressors of past ŷ and of u. What holds no past output is
evaluated before the run; one sample then costs a dozen small array operations for all outputs.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.structures.difference_equations.expressions import FLOATS, evaluate, signals
from sysid.structures.difference_equations.free_run import FreeRun
from sysid.structures.difference_equations.regressors import Row, columns, holds_output, scalar
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.difference_equations.single_values import Limits, kept_inside, together
from sysid.structures.narx.wavelet_network import (
    KINDS,
    Kind,
    RowDesign,
    value,
)

LONG = 20_000
"""Samples from which a run is compiled: importing and compiling then cost less than they save."""


class NarxRun(FreeRun):
    """The maps of all outputs, prepared for runs. θ stacks the rows' parameters.

    Args:
        rows: regressors of each output.
        designs: what else makes each row.
        estimator: kind of its units, a name of KINDS.
        nu: number of inputs.
        limits: bounds of each output.
        compiled_from: samples from which one run is compiled.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        designs: Sequence[RowDesign],
        estimator: str,
        nu: int,
        limits: Limits,
        compiled_from: int = LONG,
    ) -> None:
        super().__init__((s for row in rows for e in row for s in signals(e)), nu, limits)
        self.rows, self.designs = tuple(rows), tuple(designs)
        self.estimator, self.kind = estimator, KINDS[estimator]
        self._compiled_from = compiled_from
        edges = np.cumsum([0, *(d.n for d in designs)])
        self.theta_index: list[Index] = [np.arange(a, b) for a, b in pairwise(edges.tolist())]
        self.n_theta = int(edges[-1])

    # ----------------------------------------------------------------- one run

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run for inputs (N, nu) from a state, (N, ny)."""
        if not self.feeds_back:
            return self._static(theta, u, x0)
        if len(u) >= self._compiled_from:
            return self._compiled(theta, u, x0)
        point = Point(self, theta)
        past_y, past_u = self.past(x0)
        driven = np.concatenate([past_u, u])
        start, ny = self.before, self.ny
        blank = np.zeros((len(driven), ny))
        x = np.hstack([columns(row, driven, blank) for row in self.rows])[start:]
        every = [e for row in self.rows for e in row]
        plain = [(k, e.channel - e.lag * ny) for k, e in enumerate(every)
                 if isinstance(e, Signal) and e.kind == "y"]  # fmt: skip
        mixed = [(k, e) for k, e in enumerate(every)
                 if not isinstance(e, Signal) and holds_output(e)]  # fmt: skip
        flat: list[float] = past_y.ravel().tolist()
        limits = self.limits
        with np.errstate(over="ignore", invalid="ignore"):
            for t, row in enumerate(x):
                for k, place in plain:
                    row[k] = flat[place]
                for k, e in mixed:
                    row[k] = evaluate(e, _looked_up(flat, driven, start + t, ny), FLOATS)
                for v, (low, high) in zip(point(row), limits, strict=True):
                    flat.append(high if v > high else v if v >= low else low)
        return np.array(flat[self.depth * ny :]).reshape(len(u), ny)

    def _static(self, theta: Array, u: Array, x0: Array | None) -> Array:
        """Without past outputs the whole run is one evaluation."""
        driven = np.concatenate([self.past(x0)[1], u])
        blank = np.zeros((len(driven), self.ny))
        values_of_rows = []
        for i, (row, index) in enumerate(zip(self.rows, self.theta_index, strict=True)):
            x = columns(row, driven, blank)[self.before :]
            values_of_rows.append(self.row_values(i, theta[index], x))
        low, high = np.array(self.limits).T
        return np.asarray(np.clip(np.stack(values_of_rows, axis=1), low, high))

    def row_values(self, i: int, p: Array, x: Array) -> Array:
        """Map of one output with its parameters p for regressors (N, d), unlimited, (N,)."""
        d = self.designs[i]
        frame, weights = d.frame(), d.weights(p)
        parts = [value(np, self.kind, frame, weights, x[a : a + BLOCK])
                 for a in range(0, len(x), BLOCK)]  # fmt: skip
        return np.concatenate([np.zeros(0), *parts])

    def stepper(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        """(x, u) → (x⁺, y), everything looked up beforehand."""
        point = Point(self, theta) if isinstance(theta, np.ndarray) else None
        every = [e for row in self.rows for e in row]
        simple = all(isinstance(e, Signal) for e in every)
        places = np.array([self.place(e) if isinstance(e, Signal) else 0 for e in every])
        each = [scalar(e, self.place) for e in every]
        source, limits = self.shift(), self.limits

        def step(x: Array, u: Array) -> tuple[Array, Array]:
            xp: Any = x.__array_namespace__()
            known: Any = xp.concatenate([x, u])
            if point is None or xp is not np:
                row_values = self._values_at(xp, theta, known)
            elif simple:
                row_values = point(known[places])
            else:
                values = known.tolist()
                row_values = point(np.array([f(values) for f in each]))
            limited = [
                kept_inside(xp, v, *ends) for v, ends in zip(row_values, limits, strict=True)
            ]
            y = together(xp, limited)
            return xp.concatenate([x, y, u])[source], y

        return step

    def _values_at(self, xp: Any, theta: Array, known: Any) -> list[Any]:
        """The maps of all outputs where ``known`` holds the state and the inputs of now."""
        values = []
        for row, d, index in zip(self.rows, self.designs, self.theta_index, strict=True):
            x = xp.stack([evaluate(e, lambda s: known[self.place(s)], xp) for e in row])
            values.append(value(xp, self.kind, d.frame(), d.weights(theta[index]), x))
        return values

    # ----------------------------------------------------------------- many runs at once

    def input_products(self, u: Array) -> Array:
        """The inputs themselves, (before + L, nu, B): nothing is to be prepared."""
        return u

    def weights(self, theta: Array, products: Array) -> tuple[Array, Array]:
        return theta, products

    @property
    def width(self) -> int:
        """Regressors and what the units see of them, for the largest output."""
        return max(d + K * q for d, _, K, q in (x.sizes for x in self.designs))

    def runs(self, weights: tuple[Array, Array], past: Array) -> Array:
        theta, u = weights
        length, batch, depth = len(u) - self.before, u.shape[2], self.depth
        full = np.empty((depth + length, self.ny, batch))
        full[:depth] = past
        maps = [
            (self.rows[i], d.frame(), d.weights(theta[self.theta_index[i]]), *self.limits[i])
            for i, d in enumerate(self.designs)
        ]
        with np.errstate(over="ignore", invalid="ignore"):
            for t in range(length):

                def lookup(s: Signal, t: int = t) -> Array:
                    if s.kind == "y":
                        return np.asarray(full[t + depth - s.lag, s.channel])
                    return np.asarray(u[t + self.before - s.lag, s.channel])

                for i, (row, frame, w, low, high) in enumerate(maps):
                    x = np.empty((batch, len(row)))
                    for k, e in enumerate(row):
                        x[:, k] = evaluate(e, lookup, np)
                    outputs = value(np, self.kind, frame, w, x)
                    full[t + depth, i] = np.fmin(np.fmax(outputs, low), high)
        return full

    def _compiled(self, theta: Array, u: Array, x0: Array | None) -> Array:
        past_y, past_u = self.past(x0)
        length = 1 << (len(u) - 1).bit_length()
        driven = np.zeros((self.before + length, self.nu))
        driven[: self.before], driven[self.before : self.before + len(u)] = past_u, u
        kinds = tuple(d.sizes for d in self.designs)
        run = _long_run(self.rows, kinds, self.kind, self.depth, self.before)
        frames = [d.frame() for d in self.designs]
        weights = [d.weights(theta[i]) for d, i in zip(self.designs, self.theta_index, strict=True)]
        outputs = run(frames, weights, np.array(self.limits), driven, past_y)
        return np.asarray(outputs)[: len(u)]


BLOCK = 8192
"""Samples whose units are held at a time."""


def _looked_up(flat: list[float], u: Array, at: int, ny: int) -> Callable[[Signal], float]:
    def lookup(s: Signal) -> float:
        if s.kind == "y":
            return flat[s.channel - s.lag * ny]
        return float(u[at - s.lag, s.channel])

    return lookup


@lru_cache(maxsize=32)
def _long_run(
    rows: tuple[Row, ...], sizes: tuple[Any, ...], kind: Kind, depth: int, before: int
) -> Callable[..., Any]:
    """A compiled free run of these regressors, any parameters."""
    from sysid.fitting.compiled import jax_module

    jax = jax_module()
    jnp = jax.numpy

    def run(frames: Any, weights: Any, limits: Any, u: Any, past: Any) -> Any:
        def sample(carry: tuple[Any, Any], now: Any) -> tuple[tuple[Any, Any], Any]:
            ys, us = carry
            us = jnp.concatenate([us[1:], now[None]])

            def lookup(s: Signal) -> Any:
                return ys[-s.lag, s.channel] if s.kind == "y" else us[-1 - s.lag, s.channel]

            values = [
                value(jnp, kind, f, w, jnp.stack([evaluate(e, lookup, jnp) for e in row]))
                for row, f, w in zip(rows, frames, weights, strict=True)
            ]
            y = jnp.clip(jnp.stack(values), limits[:, 0], limits[:, 1])
            return (jnp.concatenate([ys[1:], y[None]]), us), y

        known = jnp.concatenate([jnp.zeros((1, u.shape[1])), u[:before]])
        return jax.lax.scan(sample, (past, known), u[before:])[1]

    compiled: Callable[..., Any] = jax.jit(run)
    return compiled


class Point:
    """The maps of all outputs at one sample: units of all outputs side by side.

    The argument of every unit is affine in the scaled regressors, so that one product of a matrix
    and a vector gives those of all units of all outputs.
    """

    def __init__(self, run: NarxRun, theta: Array) -> None:
        frames = [d.frame() for d in run.designs]
        weights = [d.weights(theta[i]) for d, i in zip(run.designs, run.theta_index, strict=True)]
        self._mean, self._scale, self._low, self._high = (
            np.concatenate([getattr(f, name) for f in frames])
            for name in ("mean", "scale", "low", "high")
        )
        total, ny = len(self._mean), run.ny
        starts = np.cumsum([0, *(len(f.mean) for f in frames)])
        self._linear = np.zeros((ny, total))
        self._constant = np.array([float(w.constant) for w in weights])
        factors: list[list[int]] = []
        products: list[tuple[int, float]] = []
        slopes, offsets, flags, dims, amplitudes = [], [], [], [], []
        at_zero = [run.kind.argument(np, np.zeros(w.place.shape), w.shape, w.place)
                   for w in weights]  # fmt: skip
        width = max(t.shape[1] for t in at_zero)
        for i, (f, w, design) in enumerate(zip(frames, weights, run.designs, strict=True)):
            here = slice(int(starts[i]), int(starts[i + 1]))
            self._linear[i, here] = w.linear
            for t, p in zip(design.terms, w.products, strict=True):
                # the entry after all regressors is the constant 1
                factors.append([int(starts[i]) + k for k in t] + [total] * (3 - len(t)))
                products.append((i, float(p)))
            K, m = at_zero[i].shape
            if K:
                along = [run.kind.argument(np, row, w.shape, w.place) - at_zero[i] for row in f.Q]
                slope, offset = np.zeros((total, K, width)), np.zeros((K, width))
                slope[here, :, :m], offset[:, :m] = np.array(along), at_zero[i]
                amplitude = np.zeros((ny, K))
                amplitude[i] = w.amplitude
                slopes.append(slope)
                offsets.append(offset)
                flags.append(f.flag)
                dims.append(f.dim)
                amplitudes.append(amplitude)
        self._factors = np.array(factors, dtype=int).reshape(len(factors), 3).T
        self._products = np.zeros((ny, len(products)))
        for k, (i, p) in enumerate(products):
            self._products[i, k] = p
        self._units = bool(slopes)
        if slopes:
            slope = np.concatenate(slopes, axis=1)
            self._shape = slope.shape[1:]
            self._slope = np.ascontiguousarray(slope.reshape(total, -1).T)
            self._offset = np.concatenate(offsets).ravel()
            self._flag, self._dim = np.concatenate(flags), np.concatenate(dims)
            self._amplitude = np.concatenate(amplitudes, axis=1)
        self._value = run.kind.value

    def __call__(self, x: Array) -> list[float]:
        """ŷ of every output for the regressors of all of them in a row."""
        away = x - self._mean
        out = self._constant + self._linear @ away
        if self._units or self._products.size:
            z = np.minimum(np.maximum(away / self._scale, self._low), self._high)
            if self._products.size:
                zx = np.empty(len(z) + 1)
                zx[:-1], zx[-1] = z, 1.0
                a, b, c = self._factors
                out += self._products @ (zx[a] * zx[b] * zx[c])
            if self._units:
                t = (self._slope @ z + self._offset).reshape(self._shape)
                out += self._amplitude @ self._value(np, t, self._flag, self._dim)
        outputs: list[float] = out.tolist()
        return outputs
