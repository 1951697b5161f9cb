"""Compiled free runs of NARX models over chunks of data, with their gradients.

The runs are one ``lax.scan`` over time, all chunks side by side. The gradient is forward-mode, in
two parts: along the finished run the partial derivatives ∂F/∂θ and ∂F/∂ŷ(t−l) are evaluated for
all samples at once, and then only the linear recursion

    S(t) = ∂F/∂θ(t) + Σ_l ∂F/∂ŷ(t−l) S(t−l)

is scanned. ``jax.jacfwd`` through the scan gives the same numbers but carries every unit of the
network through every step for every parameter, some twenty times slower.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from sysid.structures.difference_equations.expressions import evaluate, signals
from sysid.structures.difference_equations.regressors import Row
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.narx.wavelet_network import (
    KINDS,
    Frame,
    Weights,
    gradients,
    size,
    split,
    value,
)

Values = Any
"""An array of jax.numpy."""


class WeightedChunks(NamedTuple):
    """Stretches of data side by side, and what each error counts.

    Attributes:
        u, past, y: as in ``Chunks``.
        weight: what each error counts, 0 where a stretch has ended, (L, ny, B).
        restart: where the run begins anew from the measured past, (L, B): shorter runs without
            another shape to compile.
        limits: lowest and highest output, (ny, 2).
    """

    u: Values
    past: Values
    y: Values
    weight: Values
    restart: Values
    limits: Values


@dataclass(frozen=True)
class Shape:
    """What decides what is compiled.

    Attributes:
        rows: regressors of each output.
        sizes: (regressors, products, units, dimension of v) of each row.
        depth, before: past outputs and inputs that a run needs.
    """

    rows: tuple[Row, ...]
    sizes: tuple[tuple[int, int, int, int], ...]
    kind: str
    depth: int
    before: int


@dataclass(frozen=True, eq=False)
class ChunkFunctions:
    """Pure functions of (θ, frames, chunks), ready for ``jit`` and ``vmap``, and compiled ones.

    Attributes:
        outputs: ŷ (L, ny, B).
        residual: weight·(y − ŷ), flat over (L, ny, B).
        jacobian: its derivative, (L·ny·B, n).
        runs, slopes: ``outputs`` and ``jacobian``, compiled.
    """

    outputs: Callable[..., Values]
    residual: Callable[..., Values]
    jacobian: Callable[..., Values]
    runs: Callable[..., Values]
    slopes: Callable[..., Values]


@lru_cache(maxsize=64)
def chunk_functions(shape: Shape) -> ChunkFunctions:
    """The functions for one shape; the same shape gives the same compiled functions."""
    from sysid.fitting.compiled import jax_module

    jax, maps = jax_module(), _Maps(shape)
    return ChunkFunctions(
        maps.outputs, maps.residual, maps.jacobian, jax.jit(maps.outputs), jax.jit(maps.jacobian)
    )


HUGE = 1e8
"""Slope beyond which one is cut: a chunk in which the model is locally unstable must not flood the
solver with infinities."""


class _Maps:
    """The maps of all outputs over chunks side by side, for one shape, in jax.numpy."""

    def __init__(self, shape: Shape) -> None:
        from sysid.fitting.compiled import jax_module

        self.jax = jax_module()
        self.jnp = self.jax.numpy
        self.shape, self.kind, self.ny = shape, KINDS[shape.kind], len(shape.rows)
        counts = [size(*s) for s in shape.sizes]
        self.ends = [sum(counts[:i]) for i in range(self.ny + 1)]
        all_signals = sorted({s for row in shape.rows for e in row for s in signals(e)})
        self.inputs = [s for s in all_signals if s.kind == "u"]
        self.past_outputs = [s for s in all_signals if s.kind == "y"]

    def weights(self, theta: Values) -> list[Weights]:
        """θ cut into the parts of each row."""
        ends = self.ends
        return [split(theta[ends[i] : ends[i + 1]], *self.shape.sizes[i]) for i in range(self.ny)]

    def input_signals(self, u: Values) -> Values:
        """The lagged inputs at every sample, (L, signals, B)."""
        jnp, before = self.jnp, self.shape.before
        length = u.shape[0] - before
        taken = [u[before - s.lag :][:length, s.channel] for s in self.inputs]
        return jnp.stack(taken, axis=1) if taken else jnp.zeros((length, 0, u.shape[2]))

    def regressors(self, row: Row, ys: dict[Signal, Values], us: Values) -> Values:
        """(…, B, d) from signals of shape (…, B); us has its signals on the last axis but one."""

        def lookup(s: Signal) -> Values:
            return ys[s] if s.kind == "y" else us[..., self.inputs.index(s), :]

        return self.jnp.stack([evaluate(e, lookup, self.jnp) for e in row], axis=-1)

    # ----------------------------------------------------------------- runs

    def outputs(self, theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        """ŷ (L, ny, B)."""
        return self.runs(theta, frames, data)[0]

    def residual(self, theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        """weight·(y − ŷ), flat over (L, ny, B)."""
        return ((data.y - self.outputs(theta, frames, data)) * data.weight).ravel()

    def runs(
        self, theta: Values, frames: list[Frame], data: WeightedChunks
    ) -> tuple[Values, Values]:
        """ŷ (L, ny, B) and the past outputs it was computed from, (L, signals, B)."""
        jnp, weights = self.jnp, self.weights(theta)

        def sample(carry: tuple[Values, Values], now: Any) -> tuple[Any, Any]:
            ys, measured = carry
            us, y_now, restart = now
            ys = jnp.where(restart, measured, ys)
            known = {s: ys[-s.lag, s.channel] for s in self.past_outputs}
            outputs = [
                value(jnp, self.kind, f, w, self.regressors(row, known, us))
                for row, f, w in zip(self.shape.rows, frames, weights, strict=True)
            ]
            y = jnp.clip(jnp.stack(outputs), data.limits[:, :1], data.limits[:, 1:])
            used = jnp.stack(list(known.values())) if known else y[:0]
            after = jnp.concatenate([ys[1:], y[None]])
            return (after, jnp.concatenate([measured[1:], y_now[None]])), (y, used)

        xs = (self.input_signals(data.u), data.y, data.restart)
        outputs: tuple[Values, Values] = self.jax.lax.scan(sample, (data.past, data.past), xs)[1]
        return outputs

    # ----------------------------------------------------------------- slopes

    def jacobian(self, theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        """Derivative of the residual, (L·ny·B, n)."""
        jnp = self.jnp
        run, used = self.runs(theta, frames, data)
        inside = (run > data.limits[:, :1]) & (run < data.limits[:, 1:])
        slopes, to_past = self.partial(theta, frames, data, used, inside)
        if self.past_outputs:
            slopes = self.carried(slopes, to_past, data.restart)
        slopes = -slopes * data.weight[..., None]
        return jnp.nan_to_num(jnp.clip(slopes, -HUGE, HUGE)).reshape(-1, self.ends[-1])

    def partial(
        self,
        theta: Values,
        frames: list[Frame],
        data: WeightedChunks,
        used: Values,
        inside: Values,
    ) -> tuple[Values, list[list[Values]]]:
        """∂F/∂θ (L, ny, B, n) and ∂F/∂(each past output) (L, B) of each row along a run."""
        jnp, ends = self.jnp, self.ends
        us = self.input_signals(data.u)
        ys = {s: used[:, k] for k, s in enumerate(self.past_outputs)}
        to_theta, to_past = [], []
        parts = zip(self.shape.rows, frames, self.weights(theta), strict=True)
        for i, (row, f, w) in enumerate(parts):
            own, to_x = gradients(jnp, self.kind, f, w, self.regressors(row, ys, us))
            own = own * inside[:, i, :, None]
            around = (ends[i], ends[-1] - ends[i + 1])
            to_theta.append(jnp.pad(own, ((0, 0), (0, 0), around)))
            slopes = [self.to_past_output(row, s, ys, us, to_x) for s in self.past_outputs]
            to_past.append([slope * inside[:, i] for slope in slopes])
        return jnp.stack(to_theta, axis=1), to_past

    def to_past_output(
        self, row: Row, s: Signal, ys: dict[Signal, Values], us: Values, to_x: Values
    ) -> Values:
        """∂F/∂(one past output): through every regressor that holds it."""
        jnp = self.jnp
        total = jnp.zeros(to_x.shape[:-1])
        for k, e in enumerate(row):
            if e == s:
                total = total + to_x[..., k]
            elif s in set(signals(e)):

                def of_past_output(v: Values, e: Any = e) -> Values:
                    return self.regressors((e,), {**ys, s: v}, us)[..., 0]

                along = (jnp.ones_like(ys[s]),)
                total = total + to_x[..., k] * self.jax.jvp(of_past_output, (ys[s],), along)[1]
        return total

    def carried(self, slopes: Values, to_past: list[list[Values]], restart: Values) -> Values:
        """S(t) = ∂F/∂θ(t) + Σ_l ∂F/∂ŷ(t−l) S(t−l), anew where a run begins, (L, ny, B, n)."""
        jnp = self.jnp

        def advance(S: Values, now: Any) -> tuple[Values, Values]:
            new, pull, restart = now
            S = jnp.where(restart[:, None], 0.0, S)
            for k, s in enumerate(self.past_outputs):
                new = new + pull[:, k, :, None] * S[-s.lag, s.channel]
            return jnp.concatenate([S[1:], new[None]]), new

        S0 = jnp.zeros((self.shape.depth, *slopes.shape[1:]))
        pulls = jnp.stack([jnp.stack(p, 1) for p in to_past], 1)
        return self.jax.lax.scan(advance, S0, (slopes, pulls, restart))[1]
