"""Compiled runs of NARX maps over chunks of data, with their gradients.

The runs are one ``lax.scan`` over time, all chunks side by side. The gradient is in two parts:
along the finished run the partial derivatives ∂F/∂θ and ∂F/∂ŷ(t−l) of all samples are found at
once, by differentiating F backwards, and then only the linear recursion

    S(t) = ∂F/∂θ(t) + Σ_l ∂F/∂ŷ(t−l) S(t−l)

is scanned. ``jax.jacfwd`` through the scan gives the same numbers but carries every unit of a
network through every step for every parameter, some twenty times slower.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from sysid.structures.narx.run import Maps

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


HUGE = 1e8
"""Slope beyond which one is cut: a chunk in which the model is locally unstable must not flood the
solver with infinities."""


class CompiledRuns:
    """The maps over chunks side by side, in jax.numpy: functions of (θ, frames, chunks).

    ``outputs``, ``residual`` and ``jacobian`` are ready for ``jit`` and ``vmap``.

    Attributes:
        runs: ``outputs``, compiled.
        slopes: ∂ŷ/∂θ (L, ny, B, n), compiled.
        partial: (θ, frames, signals (N, …)) → ∂F/∂θ (N, ny, n) alone, compiled.
    """

    def __init__(self, maps: "Maps") -> None:
        from sysid.runners.compiled import jax_module

        self.jax = jax_module()
        self.jnp = self.jax.numpy
        self.maps, self.ny = maps, len(maps.theta_index)
        self.past = [s for s in maps.signals if s.kind == "y"]
        self.inputs = [s for s in maps.signals if s.kind == "u"]
        self.place = maps.signals.index
        self.runs = self.jax.jit(self.outputs)
        self.slopes = self.jax.jit(lambda *given: self.cut(self.along(*given)))
        self.partial = self.jax.jit(lambda *given: self.partials(*given)[0])

    def lagged_inputs(self, data: WeightedChunks) -> list[Values]:
        """The inputs of all samples, (L, B) each, behind as many places as past outputs take."""
        length = len(data.y)
        before = len(data.u) - length
        inputs = [data.u[before - s.lag :][:length, s.channel] for s in self.inputs]
        return [*[None] * len(self.past), *inputs]

    # ----------------------------------------------------------------- runs

    def outputs(self, theta: Values, frames: Any, data: WeightedChunks) -> Values:
        """ŷ (L, ny, B)."""
        return self.run(theta, frames, data)[0]

    def residual(self, theta: Values, frames: Any, data: WeightedChunks) -> Values:
        """weight·(y − ŷ), flat over (L, ny, B)."""
        return ((data.y - self.outputs(theta, frames, data)) * data.weight).ravel()

    def run(self, theta: Values, frames: Any, data: WeightedChunks) -> tuple[Values, Values]:
        """ŷ (L, ny, B) and the past outputs it was computed from, (L, signals, B)."""
        jnp = self.jnp
        of_inputs, of_outputs = self.maps.parts(jnp, theta, frames, self.place)
        low, high = data.limits[:, :1], data.limits[:, 1:]

        def sample(carry: tuple[Values, Values], now: Any) -> tuple[Any, Any]:
            ys, measured = carry
            row, y_now, restart = now
            ys = jnp.where(restart, measured, ys)
            known = [ys[-s.lag, s.channel] for s in self.past]
            y = jnp.clip(jnp.stack(of_outputs(known, row)), low, high)
            used = jnp.stack(known) if known else y[:0]
            after = jnp.concatenate([ys[1:], y[None]])
            return (after, jnp.concatenate([measured[1:], y_now[None]])), (y, used)

        rows = of_inputs(self.lagged_inputs(data))
        start = (data.past, data.past)
        runs: tuple[Values, Values] = self.jax.lax.scan(
            sample, start, (rows, data.y, data.restart)
        )[1]
        return runs

    # ----------------------------------------------------------------- slopes

    def jacobian(self, theta: Values, frames: Any, data: WeightedChunks) -> Values:
        """Derivative of the residual, (L·ny·B, n)."""
        slopes = -self.along(theta, frames, data) * data.weight[..., None]
        return self.cut(slopes).reshape(-1, slopes.shape[-1])

    def cut(self, slopes: Values) -> Values:
        """Without what is too large, or no number."""
        return self.jnp.nan_to_num(self.jnp.clip(slopes, -HUGE, HUGE))

    def partials(self, theta: Values, frames: Any, known: Values) -> tuple[Values, Values]:
        """∂F/∂θ (N, ny, n) and ∂F/∂(past outputs) (N, ny, signals) for known signals (N, …)."""
        jax, jnp, at = self.jax, self.jnp, len(self.past)

        def values(theta: Values, past: Values, inputs: Values) -> Values:
            of_inputs, of_outputs = self.maps.parts(jnp, theta, frames, self.place)
            known = [*past, *inputs]
            return jnp.stack(of_outputs(known, of_inputs(known)))

        each = jax.vmap(jax.jacrev(values, (0, 1)), (None, 0, 0))
        found: tuple[Values, Values] = each(theta, known[:, :at], known[:, at:])
        return found

    def along(self, theta: Values, frames: Any, data: WeightedChunks) -> Values:
        """S(t) = ∂F/∂θ(t) + Σ_l ∂F/∂ŷ(t−l) S(t−l), anew where a run begins, (L, ny, B, n)."""
        jnp = self.jnp
        run, used = self.run(theta, frames, data)
        length, _, batch = run.shape
        inputs = self.lagged_inputs(data)[len(self.past) :]
        known = jnp.concatenate([used, *(u[:, None] for u in inputs)], axis=1)
        flat = known.transpose(0, 2, 1).reshape(length * batch, -1)
        inside = (run > data.limits[:, :1]) & (run < data.limits[:, 1:])
        explicit, pulls = (
            d.reshape(length, batch, self.ny, -1).transpose(0, 2, 1, 3) * inside[..., None]
            for d in self.partials(theta, frames, flat)
        )
        if not self.past:
            return explicit

        def advance(S: Values, now: Any) -> tuple[Values, Values]:
            new, pull, restart = now
            S = jnp.where(restart[:, None], 0.0, S)
            for k, s in enumerate(self.past):
                new = new + pull[..., k, None] * S[-s.lag, s.channel]
            return jnp.concatenate([S[1:], new[None]]), new

        S0 = jnp.zeros((len(data.past), *explicit.shape[1:]))
        return self.jax.lax.scan(advance, S0, (explicit, pulls, data.restart))[1]


@lru_cache(maxsize=64)
def compiled_runs(maps: "Maps") -> CompiledRuns:
    """The functions for some maps, each compiled once."""
    return CompiledRuns(maps)
