"""Free-run errors of candidate NARX rows: judged side by side, and refined from many starts.

Candidates differ in their products and units; padded to one shape they are run and refined in one
compiled call. The cost of a refinement is the free-run error over chunks of the data, each started
from its measured past (Ribeiro et al. 2020, "On the smoothness of nonlinear system
identification"), with a pull of dilations and centres to where the frame put them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.errors import Termination
from sysid.estimation.holdout import HoldOut
from sysid.estimation.solvers import many_starts
from sysid.structures.expressions import Signal, replaced
from sysid.structures.narx_compiled import Chunks, Shape, chunk_functions
from sysid.structures.narx_problems import chunked, pieces, spreads
from sysid.structures.narx_run import NarxRun
from sysid.structures.narx_wavelet import NarxWavelet
from sysid.structures.narx_words import shapes
from sysid.structures.regressors import columns
from sysid.structures.wavelet_network import KINDS, Frame, RowDesign, one_hot, size, split

STEP = 4
"""Numbers of products and units are padded to multiples of this: few shapes are compiled."""

PULL = 1e-2
"""A dilation or centre one unit from its start costs this share of the start's cost."""

FIRM = 1e-5
"""The same for all other parameters in units of the outputs' spread: what data leave open stays."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One map of one output.

    Attributes:
        design, theta: the map.
        error: free-run error on the held-out data relative to the output's spread.
        how: where it came from, in words.
        degree: of its products (1: none).
        chunk: samples of free run it was refined over; 0 for least squares.
        evaluations: iterations spent on it.
        termination: how its refinement ended.
    """

    design: RowDesign
    theta: Array
    error: float
    how: str
    degree: int = 1
    chunk: int = 0
    evaluations: int = 1
    termination: Termination = Termination.CLOSED_FORM

    @property
    def n(self) -> int:
        """Parameters that count."""
        return int(np.sum(np.concatenate([np.ones(1), self.theta != 0.0])))


class Bounds(NamedTuple):
    """Lower and upper bounds, what is estimated, and what places units, (n,) each."""

    lower: Array
    upper: Array
    free: Array
    moving: NDArray[np.bool_]


class RowRuns:
    """One output on the estimation data, the other outputs measured: they count as inputs.

    Args:
        structure: with the ranges of the data.
        output: which output.
        data: what to fit on and what to choose on.
    """

    def __init__(self, structure: NarxWavelet, output: int, data: HoldOut) -> None:
        self.estimator = structure.options_given.estimator
        self.structure, self.output = structure, output
        self.others = [j for j in range(structure.ny) if j != output]
        self.row = tuple(replaced(e, self._inward) for e in structure.rows[output])
        self.limits = (structure.limits[output],)
        self.train = [self.view(r) for r in data.train]
        self.whole = [self.view(r) for r in data.whole]
        self.counted: Sequence[NDArray[np.bool_]] = data.counted
        self.scale = spreads([y for _, y in self.train])
        held = np.concatenate([y[m, 0] for (_, y), m in zip(self.whole, data.counted, strict=True)])
        spread = float(np.std(held)) if len(held) else 0.0
        self.spread = spread if spread > 0.0 else 1.0
        first = self.run(RowDesign.plain(len(self.row))).window.first
        self.first = first
        self.x = np.concatenate([columns(self.row, u, y)[first:] for u, y in self.train])
        self.y = np.concatenate([y[first:, 0] for _, y in self.train])

    def _inward(self, s: Signal) -> Signal:
        if s.kind == "u":
            return s
        if s.channel == self.output:
            return Signal("y", 0, s.lag)
        return Signal("u", self.structure.nu + self.others.index(s.channel), s.lag)

    def view(self, r: Record) -> tuple[Array, Array]:
        """The record as this row sees it."""
        return np.hstack([r.u, r.y[:, self.others]]), r.y[:, [self.output]]

    def run(self, design: RowDesign) -> NarxRun:
        """This row alone with some map."""
        nu = self.structure.nu + len(self.others)
        return NarxRun((self.row,), (design,), self.estimator, nu, self.limits)

    def sizes(self, d: RowDesign) -> Array:
        """Typical size of each parameter: a step of one of them moves the output by its spread."""
        _, T, K, q = d.sizes
        spread = float(self.scale[0])
        linear = spread / np.array(d.scale)
        return np.concatenate([[spread], linear, np.full(T + K, spread), np.ones(K * (1 + q))])

    def bounds(self, d: RowDesign) -> "Bounds":
        """Admissible values of a map's parameters, and which of them place units."""
        kinds = shapes(d, KINDS[self.estimator])
        _, _, K, q = d.sizes
        moving = np.zeros(len(kinds), dtype=bool)
        moving[len(kinds) - K * (1 + q) :] = True
        return Bounds(
            np.array([p.lower for p in kinds]),
            np.array([p.upper for p in kinds]),
            np.array([p.fixed is None for p in kinds], dtype=bool),
            moving,
        )

    # ----------------------------------------------------------------- judging

    def judged(self, trials: Sequence[Trial]) -> list[Trial]:
        """The trials with their free-run errors on the held-out samples of the whole records."""
        if not trials:
            return []
        plain = self.run(trials[0].design)
        where = pieces(plain, self.whole, 10**9)
        chunks, _ = chunked(plain, self.whole, where, np.ones(1))
        weight = np.zeros_like(chunks.y)
        for k, (record, a, b) in enumerate(where):
            weight[: b - a, 0, k] = self.counted[record][a:b]
        padded = Padded(trials, KINDS[self.estimator].smooth)
        runs = _batch_runs(padded.shape(self))(padded.theta, padded.frames, chunks)
        errors = (np.asarray(runs) - chunks.y) * weight
        count = max(float(weight.sum()), 1.0)
        found = np.sqrt(np.sum(errors**2, axis=(1, 2, 3)) / count) / self.spread
        return [
            replace(t, error=float(e) if np.isfinite(e) else np.inf)
            for t, e in zip(trials, found, strict=True)
        ]

    # ----------------------------------------------------------------- refining

    def refined(self, trials: Sequence[Trial], chunk: int, iterations: int) -> list[Trial]:
        """The trials after some iterations on free runs over chunks, judged anew."""
        plain = self.run(trials[0].design)
        where = pieces(plain, self.train, chunk)
        chunks, valid = chunked(plain, self.train, where, self.scale)
        count = int(valid.sum())
        chunks = chunks._replace(weight=chunks.weight / np.sqrt(count))
        padded = Padded(trials, KINDS[self.estimator].smooth)
        functions = _refinement(padded.shape(self))
        size = padded.stacked([self.sizes(t.design) for t in trials], 1.0)
        cost = self._start_costs(padded, chunks)
        pull = np.sqrt(2.0 * cost)[:, None] * padded.pulls()
        z = padded.theta / size
        each = (padded.frames, size, padded.free, z, pull)
        ends = many_starts(
            functions[0], z, each, chunks, iterations, tolerance=1e-9, jacobian=functions[1]
        )
        found = []
        for k, (t, end) in enumerate(zip(trials, ends, strict=True)):
            theta = t.theta
            if end.cost is not None:
                theta = padded.cut(k, np.where(padded.free[k], end.z, z[k]) * size[k])
            words = t.how.split(", refined")[0]
            found.append(
                replace(
                    t,
                    theta=theta,
                    how=f"{words}, refined over {chunk} samples",
                    chunk=chunk,
                    evaluations=t.evaluations + end.iterations,
                    termination=end.termination,
                )
            )
        return self.judged(found)

    def _start_costs(self, padded: "Padded", chunks: Chunks) -> Array:
        runs = _batch_runs(padded.shape(self))(padded.theta, padded.frames, chunks)
        return np.asarray(
            0.5 * np.sum(((np.asarray(runs) - chunks.y) * chunks.weight) ** 2, axis=(1, 2, 3))
        )


class Padded:
    """Trials brought to one shape: products of ones, units of amplitude zero, columns of zeros."""

    def __init__(self, trials: Sequence[Trial], smooth: bool) -> None:
        self.smooth = smooth
        self.designs = [t.design for t in trials]
        d = len(self.designs[0].mean)
        T = _padded(max(len(x.terms) for x in self.designs))
        K = _padded(max(len(x.flags) for x in self.designs))
        q = max(x.sizes[3] for x in self.designs)
        self.size = (d, T, K, q)
        self.theta = self.stacked([t.theta for t in trials], 0.0)
        self.free = self.stacked([self._free(x) for x in self.designs], 0.0) > 0.0
        frames = [self._frame(x) for x in self.designs]
        self.frames = [Frame(*(np.stack(parts) for parts in zip(*frames, strict=True)))]

    def _free(self, d: RowDesign) -> Array:
        """1 where a parameter is estimated."""
        _, T, K, q = d.sizes
        move = 1.0 if self.smooth else 0.0
        return np.concatenate([np.ones(1 + len(d.mean) + T + K), np.full(K * (1 + q), move)])

    def _frame(self, x: RowDesign) -> Frame:
        f, (d, T, K, q) = x.frame(), self.size
        Q, flag = np.zeros((d, q)), np.zeros(K)
        Q[:, : f.Q.shape[1]], flag[: len(f.flag)] = f.Q, f.flag
        ones = ((),) * (T - len(x.terms))
        return f._replace(factors=one_hot((*x.terms, *ones), d), Q=Q, flag=flag)

    def stacked(self, rows: Sequence[Array], fill: float) -> Array:
        """Parameter vectors of the trials in the padded layout, (S, n)."""
        out = np.full((len(rows), size(*self.size)), fill)
        d, T, K, q = self.size
        for row, design, into in zip(rows, self.designs, out, strict=True):
            _, t, k, m = design.sizes
            w = split(row, *design.sizes)
            into[0], into[1 : 1 + d] = w.constant, w.linear
            at = 1 + d
            into[at : at + t] = w.products
            at += T
            into[at : at + k] = w.amplitude
            into[at + K : at + K + k] = w.shape
            if k:
                into[at + 2 * K :].reshape(K, q)[:k, :m] = w.place
        return out

    def cut(self, k: int, row: Array) -> Array:
        """Undo ``stacked`` for one trial."""
        _, t, units, m = self.designs[k].sizes
        w = split(row, *self.size)
        return np.concatenate([
            [w.constant], w.linear, w.products[:t], w.amplitude[:units], w.shape[:units],
            w.place[:units, :m].ravel(),
        ])  # fmt: skip

    def pulls(self) -> Array:
        """Relative weight that draws each parameter to its start, (S, n)."""
        d, T, K, _ = self.size
        out = np.full(self.theta.shape, np.sqrt(FIRM))
        out[:, 1 + d + T + K :] = np.sqrt(PULL)
        return np.where(self.free, out, 1.0)

    def shape(self, row: RowRuns) -> Shape:
        """What is compiled."""
        plain = row.run(self.designs[0])
        return Shape((row.row,), (self.size,), row.estimator, plain.depth, plain.before)


def _padded(count: int) -> int:
    return -(-count // STEP) * STEP


@lru_cache(maxsize=64)
def _batch_runs(shape: Shape) -> Callable[..., Any]:
    """(θ (S, n), frames, chunks) → ŷ (S, L, ny, B), compiled."""
    from sysid.structures.compiled import jax_module

    jax = jax_module()
    compiled: Callable[..., Any] = jax.jit(
        jax.vmap(chunk_functions(shape).outputs, in_axes=(0, 0, None))
    )
    return compiled


@lru_cache(maxsize=64)
def _refinement(shape: Shape) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Residual and Jacobian as ``many_starts`` takes them, in parameters of size one.

    ``each`` holds frames, sizes, which parameters are free, where all start and what draws them
    there.
    """
    functions = chunk_functions(shape)

    def residual(jnp: Any, lax: Any, z: Any, each: Any, chunks: Chunks) -> Any:
        frames, scale, free, start, pull = each
        theta = jnp.where(free, z, start) * scale
        return jnp.concatenate([functions.residual(theta, frames, chunks), pull * (z - start)])

    def jacobian(jnp: Any, lax: Any, z: Any, each: Any, chunks: Chunks) -> Any:
        frames, scale, free, start, pull = each
        theta = jnp.where(free, z, start) * scale
        J = functions.jacobian(theta, frames, chunks) * jnp.where(free, scale, 0.0)
        return jnp.concatenate([J, jnp.diag(pull)])

    return residual, jacobian
