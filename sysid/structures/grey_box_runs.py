"""Free runs of grey boxes and their derivatives, compiled once and carried from chunk to chunk.

A run of any length is made of chunks of equal length whose end state (and its derivatives) starts
the next one, so one compilation serves every record. Derivatives are exact: forward mode through
the time steps, with respect to θ and to each record's own initial state.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.structures.base import Problem
from sysid.structures.compiled import jax_module
from sysid.structures.predictor import HUGE

if TYPE_CHECKING:
    from sysid.structures.grey_box import GreyBox

CHUNK = 256
"""Samples a compiled call runs through."""

LARGEST = 1e12
"""Relative errors beyond this count as divergence."""

PULL = 1e-2
"""Weight of the guess against one sample when a state is fitted: it decides what the head leaves
open, such as the speed of a track that stands."""

ROUNDS = 15

Masks = Sequence[NDArray[np.bool_]]
Compiled = Callable[..., Any]


@lru_cache(maxsize=32)
def compiled_runs(structure: "GreyBox") -> tuple[Compiled, Compiled]:
    """(θ, x, U) → (x⁺, Y) and (θ, x, Θ', X', U) → (x⁺, Y, X'⁺, Y'), compiled when first called.

    U is (samples, nu, runs), Y (samples, ny, runs); derivatives lie along axis 0.
    """
    jax = jax_module()
    jnp = jax.numpy

    def run(theta: Any, x: Any, inputs: Any) -> Any:
        p = structure.prepared(jnp, structure.unpack(jnp, theta))

        def one(x: Any, u: Any) -> Any:
            return structure.sample(jnp, x, u, p), structure.reading(jnp, x, p)

        return jax.lax.scan(one, x, inputs)

    def tangent(theta: Any, x: Any, d_theta: Any, d_x: Any, inputs: Any) -> Any:
        def along(dt: Any, dx: Any) -> Any:
            return jax.jvp(lambda t, s: run(t, s, inputs), (theta, x), (dt, dx))

        (after, out), (d_after, d_out) = jax.vmap(along, out_axes=((None, None), (0, 0)))(
            d_theta, d_x
        )
        return after, out, d_after, d_out

    return jax.jit(run), jax.jit(tangent)


def _chunks(inputs: Sequence[Array]) -> Array:
    """Inputs of several records on one time axis: (chunks, CHUNK, nu, runs), zeros at the end."""
    longest = max((len(u) for u in inputs), default=0)
    count = max(-(-longest // CHUNK), 1)
    out = np.zeros((count * CHUNK, inputs[0].shape[1], len(inputs)))
    for k, u in enumerate(inputs):
        out[: len(u), :, k] = u
    return out.reshape(count, CHUNK, inputs[0].shape[1], len(inputs))


def free_run(structure: "GreyBox", theta: Array, inputs: Sequence[Array], x0: Array) -> list[Array]:
    """ŷ (N, ny) of each record.

    Args:
        structure: the grey box.
        theta: its parameters.
        inputs: u (N, nu) of each record.
        x0: initial states, (n, records).
    """
    run, _ = compiled_runs(structure)
    parts, x = [], x0
    theta = np.asarray(theta, dtype=np.float64)
    for chunk in _chunks(inputs):
        x, y = run(theta, x, chunk)
        parts.append(np.asarray(y))
    joined = np.concatenate(parts)
    return [joined[: len(u), :, k] for k, u in enumerate(inputs)]


def tangents(structure: "GreyBox", theta: Array, inputs: Sequence[Array], x0: Array) -> list[Array]:
    """∂ŷ/∂(θ, own initial state) of each record, (n_θ + n, ny, N)."""
    _, tangent = compiled_runs(structure)
    n_theta, (n, records) = len(theta), x0.shape
    seeds = np.eye(n_theta + n)[:, :n_theta]
    d_x = np.zeros((n_theta + n, n, records))
    d_x[n_theta:] = np.eye(n)[:, :, None]
    parts, x, moved = [], x0, d_x
    theta = np.asarray(theta, dtype=np.float64)
    for chunk in _chunks(inputs):
        x, _, moved, dy = tangent(theta, x, seeds, moved, chunk)
        parts.append(np.asarray(dy))
    joined = np.concatenate(parts, axis=1)
    return [joined[:, : len(u), :, k].transpose(0, 2, 1) for k, u in enumerate(inputs)]


class GreyErrors(Problem):
    """Free-run errors (y − ŷ)/scale of a grey box, all outputs of all records together.

    Args:
        structure: the grey box.
        data: (u, y) of each experiment.
        estimate_initial: whether initial states are estimated, or all zero.
        kept: samples that count, by experiment; all when None. The run goes through the others,
            which is how data are held out without cutting a record.
        scales: divisor of each output's errors; their standard deviation when None.
    """

    def __init__(
        self,
        structure: "GreyBox",
        data: Sequence[tuple[Array, Array]],
        estimate_initial: bool,
        kept: Masks | None = None,
        scales: Array | None = None,
    ) -> None:
        self.structure, self.data = structure, list(data)
        self.n_theta = len(structure.by_entry(lambda c: c.value))
        self.index = np.arange(self.n_theta)
        self.states_each = len(structure.state_names) if estimate_initial else 0
        self.n_initial = self.states_each * len(data)
        self.kept = [np.ones(len(y), dtype=bool) for _, y in data] if kept is None else list(kept)
        self.scales = output_scales([y for _, y in data]) if scales is None else scales
        self.lengths = tuple(int(k.sum()) for k in self.kept for _ in range(structure.ny))
        self.channels = tuple(i for _ in data for i in range(structure.ny))

    def states(self, p: Array) -> Array:
        """Initial states (n, records) in p."""
        n = len(self.structure.state_names)
        if not self.states_each:
            return np.zeros((n, len(self.data)))
        return np.ascontiguousarray(p[self.n_theta :].reshape(len(self.data), n).T)

    def residual(self, p: Array) -> Array:
        """Errors, experiment after experiment, output after output."""
        runs = free_run(
            self.structure, p[: self.n_theta], [u for u, _ in self.data], self.states(p)
        )
        parts = [
            ((y - run)[kept] / self.scales).T.ravel()
            for run, (_, y), kept in zip(runs, self.data, self.kept, strict=True)
        ]
        e = np.concatenate(parts)
        if not np.all(np.isfinite(e)) or np.max(np.abs(e), initial=0.0) > LARGEST:
            return np.full(len(e), HUGE)
        return e

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, (M, len(p))."""
        found = tangents(
            self.structure, p[: self.n_theta], [u for u, _ in self.data], self.states(p)
        )
        out = np.zeros((sum(self.lengths), len(p)))
        at, n = 0, self.n_theta
        for k, (D, kept) in enumerate(zip(found, self.kept, strict=True)):
            first = n + k * self.states_each
            for i, scale in enumerate(self.scales):
                rows = slice(at, at + int(kept.sum()))
                out[rows, :n] = D[:n, i, kept].T / -scale
                if self.states_each:
                    out[rows, first : first + self.states_each] = D[n:, i, kept].T / -scale
                at = rows.stop
        return np.nan_to_num(out, nan=0.0, posinf=HUGE, neginf=-HUGE)

    def initial_guess(self, theta: Array) -> Array:
        """θ, and for each experiment the state that its first samples suggest."""
        states = []
        if self.states_each:
            states = [self.structure.state_guess(theta, u, y) for u, y in self.data]
        return np.concatenate([theta[: self.n_theta], *states])


def output_scales(outputs: Sequence[Array]) -> Array:
    """Standard deviation of each output over all experiments, 1 where it is constant."""
    spread = np.concatenate(outputs).std(axis=0)
    return np.where(spread > 0.0, spread, 1.0)


def fitted_state(structure: "GreyBox", theta: Array, u: Array, y: Array, samples: int) -> Array:
    """State whose free run meets the first samples of y best.

    Levenberg-Marquardt over the state alone, drawn weakly towards ``state_guess``.
    """
    k = min(samples, len(y))
    x = structure.state_guess(theta, u[: max(k, 1)], y[: max(k, 1)])
    n = len(x)
    if n == 0 or k == 0:
        return x
    scale = np.maximum(np.std(y, axis=0), 1e-300)
    prior, size = x.copy(), np.where(np.abs(x) > 0, np.abs(x), 1.0)

    def slopes(x: Array) -> Array:
        D = tangents(structure, theta, [u[:k]], x[:, None])[0][len(theta) :]
        rows = (D / -scale[:, None]).reshape(n, -1).T
        return np.vstack([rows, PULL * np.diag(1.0 / size)])

    def errors(x: Array) -> Array:
        e = (y[:k] - free_run(structure, theta, [u[:k]], x[:, None])[0]) / scale
        return np.concatenate([e.T.ravel(), PULL * (x - prior) / size])

    J = slopes(x)
    # the pull counts in units in which one sample sees one state
    seen = np.linalg.norm(J[:-n], axis=0)
    size = 1.0 / np.where(seen > 0.0, seen / np.sqrt(k), 1.0 / size)
    e, damping = errors(x), 1e-3
    for _ in range(ROUNDS):
        J = slopes(x)
        gram = J.T @ J
        improved = False
        while damping < 1e8:
            step = np.linalg.solve(gram + damping * np.diag(np.diag(gram)), -J.T @ e)
            trial = errors(x + step)
            if np.all(np.isfinite(trial)) and trial @ trial < e @ e:
                improved = True
                break
            damping *= 10.0
        if not improved:
            break
        gained = 1.0 - (trial @ trial) / (e @ e)
        x, e, damping = x + step, trial, damping / 10.0
        if gained < 1e-10:
            break
    return x
