"""Free runs of grey boxes and their derivatives, compiled once and carried from chunk to chunk.

A run of any length is made of chunks of equal length whose end state (and its derivatives) starts
the next one, so one compilation serves every record. Derivatives are exact: forward mode through
the time steps, with respect to θ and to each record's own initial state.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.fitting.batched import OneTrial, descend_alone
from sysid.fitting.problem import Data
from sysid.fitting.run_errors import Masks, RunErrors
from sysid.runners.compiled import compiled, jax_module
from sysid.structures.difference_equations.probing import probing_inputs
from sysid.structures.grey_box.physics import Physics
from sysid.structures.motion import time_constants

if TYPE_CHECKING:
    from sysid.structures.grey_box.structure import GreyBox

    AnyBox = GreyBox[Any]

CHUNK = 256
"""Samples a compiled call runs through."""

DIRECTIONS = 6
"""Derivatives are taken along so many directions an output at once: one compilation serves every
fit."""

LARGEST = 1e12
"""Relative errors beyond this count as divergence."""

PULL = 1e-2
"""Weight of the guess against one sample when a state is fitted: it decides what the head leaves
open, such as the speed of a track that stands."""

ROUNDS = 30
GAIN = 1e-10

LASTING = 8.0
"""Slowest time constants in a run that shows whether it stays bounded: four in each half."""

PROBE = (200, 1000)
"""Fewest and most samples of such a run; the most where no time constant is known."""

RUNAWAY = 2.5
"""Growth from the first to the second half that is more than an integral's, which is 2."""

Compiled = Callable[..., Any]


def compiled_runs(physics: Physics) -> tuple[Compiled, Compiled]:
    """Run and derivative of a chunk, compiled when they are first called.

    Along a run δx(t+1) = A(t) δx(t) + b(t), δy(t) = C(t) δx(t) + d(t), where A, b, C and d of all
    samples are found at once and only this recursion is run through, which is faster than
    differentiating the run itself. The step's length and number are arguments: one compilation
    serves every sample time.

    Returns:
        run (θ, x, U, h, steps) → (x⁺, X, Y);
        along (θ, X, U, h, steps, δΘ, δx) → (δx⁺, δY), directions along axis 0;
        U (samples, nu, runs), X (samples, n, runs), Y (samples, ny, runs).
    """
    return _compiled_runs(physics.bare())


@lru_cache(maxsize=32)
def _compiled_runs(physics: Physics) -> tuple[Compiled, Compiled]:
    jax = jax_module()
    jnp = jax.numpy

    def run(theta: Any, x: Any, inputs: Any, h: Any, steps: Any) -> Any:
        after, (states, out) = scan(physics, jnp, jax.lax, theta, x, inputs, h, steps)
        return after, states, out

    def along(
        theta: Any, states: Any, inputs: Any, h: Any, steps: Any, d_theta: Any, d_x: Any
    ) -> Any:
        samples, n, runs = states.shape
        flat = states.transpose(1, 0, 2).reshape(n, samples * runs)
        u = inputs.transpose(1, 0, 2).reshape(inputs.shape[1], -1)

        def local(theta: Any, x: Any) -> Any:
            """One sample from each state, all samples side by side."""
            p = physics.prepared(jnp, physics.unpack(jnp, theta), h)
            return physics.sample(jnp, x, u, p, h, steps), physics.reading(jnp, x, p)

        def moved(d_theta: Any, d_state: Any) -> Any:
            every = jnp.broadcast_to(d_state[:, None], flat.shape)
            found = jax.jvp(local, (theta, flat), (d_theta, every))[1]
            return [v.reshape(-1, samples, runs).transpose(1, 0, 2) for v in found]

        # states first, then parameters: the equations are differentiated in one place only
        count = d_theta.shape[0]
        by_theta = jnp.concatenate([jnp.zeros((n, d_theta.shape[1])), d_theta])
        by_state = jnp.concatenate([jnp.eye(n), jnp.zeros((count, n))])
        ahead, out = jax.vmap(moved)(by_theta, by_state)
        A, C = (jnp.moveaxis(v[:n], 0, 2) for v in (ahead, out))
        b, d = jnp.moveaxis(ahead[n:], 0, 1), out[n:]

        def one(dx: Any, parts: Any) -> Any:
            A, b = parts
            return jnp.sum(A * dx[:, None], axis=2) + b, dx

        d_after, path = jax.lax.scan(one, d_x, (A, b))
        return d_after, jnp.sum(C * jnp.moveaxis(path, 1, 0)[:, :, None], axis=3) + d

    return compiled(run), compiled(along)


def scan(
    physics: Physics,
    xp: Any,
    lax: Any,
    theta: Any,
    x: Any,
    inputs: Any,
    h: Any,
    steps: Any,
) -> tuple[Any, tuple[Any, Any]]:
    """(x⁺, (X, Y)) of a run of ``steps`` steps h a sample, for tracing by JAX."""
    p = physics.prepared(xp, physics.unpack(xp, theta), h)

    def one(x: Any, u: Any) -> Any:
        return physics.sample(xp, x, u, p, h, steps), (x, physics.reading(xp, x, p))

    after, rest = lax.scan(one, x, inputs)
    return after, rest


def _chunks(inputs: Sequence[Array]) -> Array:
    """Inputs of records under one time axis, (chunks, CHUNK, nu, runs), zeros at the end."""
    longest = max((len(u) for u in inputs), default=0)
    count = max(-(-longest // CHUNK), 1)
    out = np.zeros((count * CHUNK, inputs[0].shape[1], len(inputs)))
    for k, u in enumerate(inputs):
        out[: len(u), :, k] = u
    return out.reshape(count, CHUNK, inputs[0].shape[1], len(inputs))


def trajectory(
    structure: "AnyBox", theta: Array, inputs: Sequence[Array], x0: Array
) -> tuple[list[Any], list[Array]]:
    """States at the samples of each chunk (CHUNK, n, records), and ŷ (N, ny) of each record.

    Args:
        inputs: u (N, nu) of each record.
        x0: initial states, (n, records).
    """
    run, _ = compiled_runs(structure.physics)
    states, parts, x = [], [], x0
    theta = np.asarray(theta, dtype=np.float64)
    for chunk in _chunks(inputs):
        x, path, y = run(theta, x, chunk, structure.sampling.h, structure.sampling.steps)
        states.append(path)
        parts.append(np.asarray(y))
    joined = np.concatenate(parts)
    return states, [joined[: len(u), :, k] for k, u in enumerate(inputs)]


def stays_bounded(structure: "AnyBox", theta: Array) -> bool:
    """Whether probing runs from rest stay finite and grow no faster than an integral.

    Run in NumPy, all probes side by side, for ``LASTING`` of the slowest time constants: whatever
    settles has settled in the first half, and the integral of a constant doubles in the second.
    The inputs fill the range of the data, ±1 where there are none.
    """
    physics, sampling = structure.physics, structure.sampling
    modes = time_constants(structure, theta)
    slowest = float(np.max(np.abs(modes[np.isfinite(modes)]), initial=0.0))
    length = int(np.clip(LASTING * slowest, *PROBE)) if slowest else PROBE[1]
    p = physics.prepared(np, physics.unpack(np, np.asarray(theta)), sampling.h)
    ranges = sampling.input_range or ((-1.0, 1.0),) * physics.nu
    inputs = probing_inputs(ranges, length)
    x = np.zeros((structure.n_states(theta), inputs.shape[2]))
    outputs = np.zeros((length, physics.ny, inputs.shape[2]))
    with np.errstate(all="ignore"):
        for k, u in enumerate(inputs):
            outputs[k] = physics.reading(np, x, p)
            if not np.all(np.isfinite(outputs[k])):
                return False
            x = np.asarray(physics.sample(np, x, u, p, sampling.h, sampling.steps))
    # all probes together: one by itself may begin near zero by chance
    size = np.abs(outputs).max(axis=2)
    before, after = size[: length // 2].max(axis=0), size[length // 2 :].max(axis=0)
    return bool(np.all(after <= RUNAWAY * before))


def tangents(
    structure: "AnyBox",
    theta: Array,
    inputs: Sequence[Array],
    x0: Array,
    wanted: NDArray[np.bool_] | None = None,
    path: Sequence[Any] | None = None,
) -> list[Array]:
    """∂ŷ/∂(θ, own initial state) of each record, (n_θ + n, ny, N).

    Args:
        inputs: u (N, nu) of each record.
        x0: initial states, (n, records).
        wanted: entries of (θ, state) to differentiate by, all when None; other rows are zero.
        path: states along the run, as ``trajectory`` gives them; found when None.
    """
    _, along = compiled_runs(structure.physics)
    path = trajectory(structure, theta, inputs, x0)[0] if path is None else path
    theta = np.asarray(theta, dtype=np.float64)
    n_theta, (n, records) = len(theta), x0.shape
    width = n_theta + n
    rows = np.arange(width) if wanted is None else np.flatnonzero(wanted)
    at_once = DIRECTIONS * structure.ny
    blocks = [rows[k : k + at_once] for k in range(0, len(rows), at_once)]
    seeds = [np.zeros((at_once, width)) for _ in blocks]
    for seed, some in zip(seeds, blocks, strict=True):
        seed[np.arange(len(some)), some] = 1.0
    moved = [np.repeat(seed[:, n_theta:, None], records, axis=2) for seed in seeds]
    chunks = _chunks(inputs)
    out = np.zeros((width, len(chunks), CHUNK, structure.ny, records))
    h, steps = structure.sampling.h, structure.sampling.steps
    for at, (chunk, states) in enumerate(zip(chunks, path, strict=True)):
        for k, (seed, some) in enumerate(zip(seeds, blocks, strict=True)):
            moved[k], found = along(theta, states, chunk, h, steps, seed[:, :n_theta], moved[k])
            out[some, at] = np.asarray(found)[: len(some)]
    joined = out.reshape(width, len(chunks) * CHUNK, structure.ny, records)
    return [joined[:, : len(u), :, k].transpose(0, 2, 1) for k, u in enumerate(inputs)]


class GreyErrors(RunErrors):
    """Free-run errors of a grey box.

    Args:
        estimate_initial: whether initial states are estimated, or all zero.
        wanted: entries of θ that will be moved, all when None: other columns of the Jacobian are
            zero and cost nothing.
        data, kept, scales: as in ``RunErrors``.
    """

    def __init__(
        self,
        structure: "AnyBox",
        data: Data,
        estimate_initial: bool,
        kept: Masks | None = None,
        scales: Array | None = None,
        wanted: NDArray[np.bool_] | None = None,
    ) -> None:
        self.structure, self.wanted = structure, wanted
        self.n_theta = len(structure.physics.pack({}))
        self._n_states = len(structure.physics.state_names)
        states_each = self._n_states if estimate_initial else 0
        super().__init__(self.n_theta, data, states_each, kept, scales, LARGEST)
        self._last: tuple[bytes, tuple[list[Any], list[Array]]] = (b"", ([], []))

    def initial_states(self, p: Array) -> Array:
        """Initial states (n, records): those in p, or zeros."""
        if not self.states_each:
            return np.zeros((self._n_states, len(self.data)))
        return np.ascontiguousarray(self.states(p).T)

    def _run(self, p: Array) -> tuple[list[Any], list[Array]]:
        """``trajectory`` at p, kept until another p is asked for: the Jacobian needs it again."""
        key = p.tobytes()
        if self._last[0] != key:
            inputs, theta = [u for u, _ in self.data], p[: self.n_theta]
            self._last = (key, trajectory(self.structure, theta, inputs, self.initial_states(p)))
        return self._last[1]

    def runs(self, p: Array) -> list[Array]:
        return self._run(p)[1]

    def tangents(self, p: Array) -> Iterator[Array]:
        states = np.array(self.structure.physics.estimated_states()) & (self.states_each > 0)
        moved = np.ones(self.n_theta, dtype=bool) if self.wanted is None else self.wanted
        slopes = tangents(
            self.structure,
            p[: self.n_theta],
            [u for u, _ in self.data],
            self.initial_states(p),
            np.concatenate([moved, states]),
            self._run(p)[0],
        )
        for D in slopes:
            yield np.swapaxes(D[: self.n_theta + self.states_each], 0, 1)

    def initial_guess(self, theta: Array) -> Array:
        """θ, and for each experiment the state that its first samples suggest."""
        states = []
        if self.states_each:
            states = [state_guess(self.structure, theta, u, y) for u, y in self.data]
        return np.concatenate([theta[: self.n_theta], *states])


def state_guess(structure: "AnyBox", theta: Array, u: Array, y: Array) -> Array:
    """A state that suits the head of a record, (n,)."""
    return np.asarray(structure.physics.state_guess(theta, u, y, structure.sampling.dt))


def fitted_state(structure: "AnyBox", theta: Array, u: Array, y: Array, samples: int) -> Array:
    """State whose free run meets the first samples of y best.

    Levenberg-Marquardt over the state alone, drawn weakly towards ``state_guess``.
    """
    k = min(samples, len(y))
    prior = state_guess(structure, theta, u[: max(k, 1)], y[: max(k, 1)])
    n = len(prior)
    if n == 0 or k == 0:
        return prior
    scale = np.maximum(np.std(y, axis=0), 1e-300)
    moved = structure.physics.estimated_states()
    states = np.concatenate([np.zeros(len(theta), dtype=bool), np.array(moved, dtype=bool)])

    def slopes(x: Array) -> Array:
        """∂ŷ/∂x in spreads of the outputs, (k·ny, n)."""
        D = tangents(structure, theta, [u[:k]], x[:, None], states)[0][len(theta) :]
        return np.asarray((D / scale[:, None]).reshape(n, -1).T)

    # the pull counts in units in which one sample sees one state
    seen = np.linalg.norm(slopes(prior), axis=0) / np.sqrt(k)
    typical = np.where(np.abs(prior) > 0, np.abs(prior), 1.0)
    pull = PULL * np.where(seen > 0.0, seen, 1.0 / typical)

    def tried(x: Array, _: Index) -> OneTrial:
        e = (y[:k] - trajectory(structure, theta, [u[:k]], x[0][:, None])[1][0]) / scale
        errors = np.concatenate([e.T.ravel(), pull * (prior - x[0])])
        return OneTrial(errors, lambda: np.vstack([slopes(x[0]), np.diag(pull)]))

    return descend_alone(tried, prior, ROUNDS, GAIN)
