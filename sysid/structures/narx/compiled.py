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

from sysid.structures.narx.wavelet_network import (
    KINDS,
    Frame,
    gradients,
    size,
    split,
    value,
)
from sysid.structures.recursive.expressions import evaluate, signals
from sysid.structures.recursive.regressors import Row
from sysid.structures.recursive.signals import Signal

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
        kind: name of the estimator.
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

    jax = jax_module()
    jnp = jax.numpy
    kind, ny, before = KINDS[shape.kind], len(shape.rows), shape.before
    counts = [size(*s) for s in shape.sizes]
    ends = [sum(counts[:i]) for i in range(ny + 1)]
    found = sorted({s for row in shape.rows for e in row for s in signals(e)})
    inputs = [s for s in found if s.kind == "u"]
    slots = [s for s in found if s.kind == "y"]

    def parts(theta: Values) -> list[Any]:
        return [split(theta[ends[i] : ends[i + 1]], *shape.sizes[i]) for i in range(ny)]

    def input_signals(u: Values) -> Values:
        length = u.shape[0] - before
        taken = [u[before - s.lag :][:length, s.channel] for s in inputs]
        return jnp.stack(taken, axis=1) if taken else jnp.zeros((length, 0, u.shape[2]))

    def regressors(row: Row, ys: dict[Signal, Values], us: Values) -> Values:
        """(…, B, d) from signals of shape (…, B); us has its signals on the last axis but one."""

        def lookup(s: Signal) -> Values:
            return ys[s] if s.kind == "y" else us[..., inputs.index(s), :]

        return jnp.stack([evaluate(e, lookup, jnp) for e in row], axis=-1)

    def runs(theta: Values, frames: list[Frame], data: WeightedChunks) -> tuple[Values, Values]:
        """ŷ (L, ny, B) and the past outputs it was computed from, (L, slots, B)."""
        weights = parts(theta)

        def sample(carry: tuple[Values, Values], now: Any) -> tuple[Any, Any]:
            ys, measured = carry
            us, y_now, restart = now
            ys = jnp.where(restart, measured, ys)
            known = {s: ys[-s.lag, s.channel] for s in slots}
            found = [
                value(jnp, kind, f, w, regressors(row, known, us))
                for row, f, w in zip(shape.rows, frames, weights, strict=True)
            ]
            y = jnp.clip(jnp.stack(found), data.limits[:, :1], data.limits[:, 1:])
            used = jnp.stack([known[s] for s in slots]) if slots else y[:0]
            after = jnp.concatenate([ys[1:], y[None]])
            return (after, jnp.concatenate([measured[1:], y_now[None]])), (y, used)

        xs = (input_signals(data.u), data.y, data.restart)
        found: tuple[Values, Values] = jax.lax.scan(sample, (data.past, data.past), xs)[1]
        return found

    def outputs(theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        return runs(theta, frames, data)[0]

    def residual(theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        return ((data.y - outputs(theta, frames, data)) * data.weight).ravel()

    def jacobian(theta: Values, frames: list[Frame], data: WeightedChunks) -> Values:
        run, used = runs(theta, frames, data)
        batch = run.shape[2]
        us, weights = input_signals(data.u), parts(theta)
        ys = {s: used[:, k] for k, s in enumerate(slots)}
        inside = (run > data.limits[:, :1]) & (run < data.limits[:, 1:])
        explicit, pulls = [], []
        for i, (row, f, w) in enumerate(zip(shape.rows, frames, weights, strict=True)):
            to_theta, to_x = gradients(jnp, kind, f, w, regressors(row, ys, us))
            gate = inside[:, i, :, None]
            explicit.append(
                jnp.pad(to_theta * gate, ((0, 0), (0, 0), (ends[i], ends[ny] - ends[i + 1])))
            )
            pulls.append([to_slot(row, s, ys, us, to_x) * inside[:, i] for s in slots])
        S0 = jnp.zeros((shape.depth, ny, batch, ends[ny]))

        def advance(S: Values, now: Any) -> tuple[Values, Values]:
            new, pull, restart = now
            S = jnp.where(restart[:, None], 0.0, S)
            for k, s in enumerate(slots):
                new = new + pull[:, k, :, None] * S[-s.lag, s.channel]
            return jnp.concatenate([S[1:], new[None]]), new

        out = jnp.stack(explicit, axis=1)
        if slots:
            xs = (out, jnp.stack([jnp.stack(p, 1) for p in pulls], 1), data.restart)
            out = jax.lax.scan(advance, S0, xs)[1]
        out = -out * data.weight[..., None]
        # a chunk in which the model is locally unstable must not flood the solver with infinities
        return jnp.nan_to_num(jnp.clip(out, -HUGE, HUGE)).reshape(-1, ends[ny])

    def to_slot(row: Row, s: Signal, ys: dict[Signal, Values], us: Values, to_x: Values) -> Values:
        """∂F/∂(one past output): through every regressor that holds it."""
        total = jnp.zeros(to_x.shape[:-1])
        for k, e in enumerate(row):
            if e == s:
                total = total + to_x[..., k]
            elif s in set(signals(e)):

                def of_slot(v: Values, e: Any = e) -> Values:
                    def lookup(r: Signal) -> Values:
                        if r == s:
                            return v
                        return ys[r] if r.kind == "y" else us[..., inputs.index(r), :]

                    return evaluate(e, lookup, jnp)

                slope = jax.jvp(of_slot, (ys[s],), (jnp.ones_like(ys[s]),))[1]
                total = total + to_x[..., k] * slope
        return total

    return ChunkFunctions(outputs, residual, jacobian, jax.jit(outputs), jax.jit(jacobian))


HUGE = 1e8
