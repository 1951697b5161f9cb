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

from sysid.data.record import Array, Index
from sysid.fitting.batched import Damping, descend_together
from sysid.fitting.holdout import HoldOut
from sysid.fitting.run_errors import output_scales
from sysid.structures.difference_equations.chunks import Piece, pieces, side_by_side
from sysid.structures.difference_equations.expressions import replaced
from sysid.structures.difference_equations.regressors import columns
from sysid.structures.difference_equations.signals import OneOutput, Signal
from sysid.structures.narx.compiled import WeightedChunks, compiled_runs
from sysid.structures.narx.run import Maps, NarxRun
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_network import (
    KINDS,
    Frame,
    RowDesign,
    one_hot,
    size,
    split,
)
from sysid.structures.narx.words import shapes

LANES = 12
"""Maps judged side by side."""

STRETCH = 512
"""Samples a stretch of data that is run side by side with others."""

STRETCHES = 6
"""Stretches that a refinement looks at, evenly spread over the data."""

SIZES = (1, 2, 3, 4, 6, 8, 12)
"""Numbers of stretches, and lengths of records in them, are rounded up to these and then to powers
of two: records of other lengths find what was compiled."""

PRODUCT_STEPS, VIEW_STEPS = (0, 8), (2,)
"""Numbers of products and of dimensions that units see for which a refinement is compiled, besides
the largest."""

PULL = 1e-2
"""A dilation or centre one unit from its start costs this share of the start's cost."""

SHRINK = 1e-2
"""An amplitude of one spread of the output costs this share of the start's cost."""

FIRM = 1e-5
"""The same for a change of the linear part by one spread: what data leave open stays."""
DAMPING = Damping(fall=0.3, rise=3.0, alike=True)
"""Of a refinement, which few steps must not lead far away: parameters count in typical sizes."""
SETTLED = 1e-6
"""Relative decrease of the cost by which a step must lower it, or it was the last."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One map of one output.

    Attributes:
        error: free-run error on the held-out data relative to the output's spread.
        how: where it came from, in words.
        chunk: samples of free run it was refined over; 0 for least squares.
        evaluations: iterations spent on it.
    """

    design: RowDesign
    theta: Array
    error: float
    how: str
    chunk: int = 0
    evaluations: int = 1

    @property
    def size(self) -> int:
        """Parameters that count."""
        return 1 + int(np.count_nonzero(self.theta))


class Prior(NamedTuple):
    """What is known of a map's parameters before they are refined, (n,) each.

    Attributes:
        lower, upper: bounds.
        free: which are estimated.
        share: of the start's cost that a change by a typical size costs.
        to_zero: which are drawn to zero, not to their start.
    """

    lower: Array
    upper: Array
    free: NDArray[np.bool_]
    share: Array
    to_zero: NDArray[np.bool_]


class RowRuns:
    """One output on the estimation data, the other outputs measured: they count as inputs.

    Args:
        structure: with the ranges of the data.
        data: what to fit on and what to choose on.
        largest: most products and units that any map has, and dimensions that units see: they
            decide what is compiled.
    """

    def __init__(
        self,
        structure: NarxWavelet,
        output: int,
        data: HoldOut,
        largest: tuple[int, int, int],
    ) -> None:
        self.estimator = structure.options_given.estimator
        self.largest = largest
        self.structure, self.output = structure, output
        self.view = OneOutput(output, structure.nu, structure.ny)
        self.row = tuple(replaced(e, Signal, self.view.inward) for e in structure.rows[output])
        self.limits = (structure.limits[output],)
        self.train = [self.view.data(r) for r in data.train]
        self.whole = [self.view.data(r) for r in data.whole]
        self.counted: Sequence[NDArray[np.bool_]] = [
            m & ~r.left_out[:, output] for m, r in zip(data.counted, data.whole, strict=True)
        ]
        self.scale = output_scales([y for _, y in self.train])
        outputs = np.concatenate(
            [y[m, 0] for (_, y), m in zip(self.whole, self.counted, strict=True)]
        )
        spread = float(np.std(outputs)) if len(outputs) else 0.0
        self.spread = spread if spread > 0.0 else 1.0
        first = self.run(RowDesign.plain(len(self.row))).first
        self.first = first
        self.fitted = [
            (~m if data.holdout else m | True) & ~r.left_out[:, output]
            for m, r in zip(data.counted, data.whole, strict=True)
        ]
        used = [r.fitted[first:, output] for r in data.train]
        self.x = np.concatenate(
            [columns(self.row, u, y)[first:][k] for (u, y), k in zip(self.train, used, strict=True)]
        )
        self.y = np.concatenate(
            [y[first:, 0][k] for (_, y), k in zip(self.train, used, strict=True)]
        )

    def run(self, design: RowDesign) -> NarxRun:
        """This row alone with some map."""
        return NarxRun((self.row,), (design,), self.estimator, self.view.nu, self.limits)

    def sizes(self, d: RowDesign) -> Array:
        """Typical size of each parameter: a step of one of them moves the output by its spread."""
        _, T, K, q = d.sizes
        spread = float(self.scale[0])
        linear = spread / np.array(d.scale)
        return np.concatenate([[spread], linear, np.full(T + K, spread), np.ones(K * (1 + q))])

    def prior(self, design: RowDesign) -> Prior:
        """Admissible values of a map's parameters, and what draws them."""
        kinds = shapes(design, KINDS[self.estimator])
        d, T, K, q = design.sizes
        counts = (1 + d, T + K, K * (1 + q))
        return Prior(
            np.array([p.lower for p in kinds]),
            np.array([p.upper for p in kinds]),
            np.array([p.fixed is None for p in kinds], dtype=bool),
            np.repeat([FIRM, SHRINK, PULL], counts),
            np.repeat([False, True, False], counts),
        )

    # ----------------------------------------------------------------- judging

    def judged(self, trials: Sequence[Trial]) -> list[Trial]:
        """The trials with their free-run errors on the held-out samples of the whole records."""
        plain = self.run(RowDesign.plain(len(self.row)))
        where = pieces(plain, self.whole, 10**9)
        longest = STRETCH * rounded(-(-max(b - a for _, a, b in where) // STRETCH))
        chunks = side_by_side(plain, self.whole, where, longest)
        data = plain.weighted(chunks, np.ones(1))
        weight = np.zeros_like(chunks.y)
        for k, (record, a, b) in enumerate(where):
            weight[: b - a, 0, k] = self.counted[record][a:b]
        count = max(float(weight.sum()), 1.0)
        judged = []
        for at in range(0, len(trials), LANES):
            some = trials[at : at + LANES]
            # every call has as many lanes: one compilation
            padded = Padded([*some, *[some[0]] * (LANES - len(some))], self)
            runs = _batch_runs(padded.maps(self))(padded.theta, padded.frames, data)
            square = np.sum(((np.asarray(runs) - chunks.y) * weight) ** 2, axis=(1, 2, 3))
            errors = np.sqrt(square / count) / self.spread
            judged += [
                replace(t, error=float(e) if np.isfinite(e) else np.inf)
                for t, e in zip(some, errors, strict=False)
            ]
        return judged

    # ----------------------------------------------------------------- refining

    def refined(self, trials: Sequence[Trial], chunk: int, iterations: int) -> list[Trial]:
        """The trials after some iterations on free runs over chunks, judged anew."""
        lanes = self.structure.options_given.starts
        some = [*trials, *[trials[0]] * (lanes - len(trials))]
        padded = Padded(some, self, self.compact(trials))
        scale = padded.stacked([self.sizes(d) for d in padded.designs], 1.0)
        prior, z = padded.prior(self), padded.theta / scale
        aim = np.where(prior.to_zero, 0.0, z)
        # the cost at the start, near enough to weigh what draws the parameters
        cost = np.array([[min(t.error, 1.0)] for t in some])
        pull = np.where(prior.free, cost * np.sqrt(prior.share), 0.0)
        runs = _Candidates(padded, self, self._chunks(chunk), scale, aim, pull)
        bounds = (prior.lower / scale, prior.upper / scale)
        start = np.where(prior.free, np.clip(z, *bounds), z)
        with np.errstate(over="ignore", invalid="ignore"):
            ends, _ = descend_together(
                runs, start, prior.free, bounds, DAMPING, iterations, SETTLED
            )
        refined = [
            replace(
                t,
                theta=padded.cut(k, ends[k] * scale[k]),
                how=f"{t.how.split(', refined')[0]}, refined over {chunk} samples",
                chunk=chunk,
                evaluations=t.evaluations + int(runs.count[k]),
            )
            for k, t in enumerate(trials)
        ]
        return self.judged(refined)

    def compact(self, trials: Sequence[Trial]) -> tuple[int, int, int]:
        """``largest`` without what none of these maps needs, in few steps: each is compiled."""
        T, K, q = self.largest
        sizes = [t.design.sizes for t in trials]
        products, seen = max(x[1] for x in sizes), max(x[3] for x in sizes)
        return (
            next((n for n in PRODUCT_STEPS if products <= n < T), T),
            K,
            next((n for n in VIEW_STEPS if seen <= n < q), q),
        )

    def _chunks(self, chunk: int) -> WeightedChunks:
        """Runs of about ``chunk`` samples over what is to be fitted, errors weighted to 1/√N.

        Longer stretches side by side, with restarts inside: only the weights and the restarts
        depend on ``chunk`` and on what is held out, so that all refinements share a compilation.
        Runs go through what is held out without looking at it.
        """
        plain = self.run(RowDesign.plain(len(self.row)))
        where = [
            Piece(k, at, min(at + STRETCH, b))
            for k, a, b in pieces(plain, self.whole, 10**9)
            for at in range(a, b, STRETCH)
        ]
        if len(where) > STRETCHES:
            where = [where[k] for k in np.linspace(0, len(where) - 1, STRETCHES).astype(int)]
        empty = [Piece(0, self.first, self.first)] * (rounded(len(where)) - len(where))
        where += empty
        stretches = side_by_side(plain, self.whole, where, STRETCH)
        chunks = plain.weighted(stretches, self.scale)
        used = stretches.inside[:, None].copy()
        restart = chunks.restart.copy()
        for k, (record, a, b) in enumerate(where):
            fitted = self.fitted[record][a:b]
            used[: b - a, 0, k] &= fitted
            begins = np.arange(chunk, b - a, chunk)
            restart[begins[fitted[begins - 1]], k] = True
        weight = chunks.weight * used / np.sqrt(max(int(used.sum()), 1))
        return chunks._replace(weight=weight, restart=restart)


def rounded(count: int) -> int:
    """The next of SIZES, or of the powers of two."""
    return next((n for n in SIZES if n >= count), 1 << (count - 1).bit_length())


class Padded:
    """Trials brought to one shape: products of ones, units of amplitude zero, columns of zeros."""

    def __init__(
        self, trials: Sequence[Trial], row: RowRuns, largest: tuple[int, int, int] | None = None
    ) -> None:
        self.designs = [t.design for t in trials]
        T, K, q = largest or row.largest
        self.size = (len(row.row), T, K, q)
        self.theta = self.stacked([t.theta for t in trials], 0.0)
        frames = [self._frame(x) for x in self.designs]
        self.frames = [Frame(*(np.stack(parts) for parts in zip(*frames, strict=True)))]

    def _frame(self, x: RowDesign) -> Frame:
        f, (d, T, K, q) = x.frame(), self.size
        k, m = f.Q.shape[1:]
        Q, flag, dim = np.zeros((d, K, q)), np.zeros(K), np.zeros(K)
        Q[:, :k, :m], flag[:k], dim[:k] = f.Q, f.flag, f.dim
        ones = ((),) * (T - len(x.terms))
        return f._replace(factors=one_hot((*x.terms, *ones), d), Q=Q, flag=flag, dim=dim)

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

    def prior(self, row: RowRuns) -> Prior:
        """What is known of all parameters in the padded layout, (S, n) each."""
        each = zip(*(row.prior(d) for d in self.designs), strict=True)
        fills = (-np.inf, np.inf, 0.0, 1.0, 0.0)
        lower, upper, free, share, to_zero = map(self.stacked, each, fills)
        return Prior(lower, upper, free > 0.0, share, to_zero > 0.0)

    def cut(self, k: int, row: Array) -> Array:
        _, t, units, m = self.designs[k].sizes
        w = split(row, *self.size)
        return np.concatenate([
            [w.constant], w.linear, w.products[:t], w.amplitude[:units], w.shape[:units],
            w.place[:units, :m].ravel(),
        ])  # fmt: skip

    def maps(self, row: RowRuns) -> Maps:
        return Maps((row.row,), (self.size,), row.estimator)


@lru_cache(maxsize=64)
def _batch_runs(maps: Maps) -> Callable[..., Any]:
    """(θ (S, n), frames, chunks) → ŷ (S, L, ny, B), compiled."""
    from sysid.runners.compiled import jax_module

    jax = jax_module()
    compiled: Callable[..., Any] = jax.jit(
        jax.vmap(compiled_runs(maps).outputs, in_axes=(0, 0, None))
    )
    return compiled


@lru_cache(maxsize=64)
def _batch_slopes(maps: Maps) -> Callable[..., Any]:
    """(θ (S, n), frames, chunks) → ‖ε‖² (S,), JᵀJ (S, n, n) and Jᵀε (S, n), compiled."""
    from sysid.runners.compiled import jax_module

    jax, functions = jax_module(), compiled_runs(maps)

    def sums(theta: Any, frames: Any, chunks: Any) -> Any:
        e = functions.residual(theta, frames, chunks)
        J = functions.jacobian(theta, frames, chunks)
        return e @ e, J.T @ J, J.T @ e

    compiled: Callable[..., Any] = jax.jit(jax.vmap(sums, in_axes=(0, 0, None)))
    return compiled


class _Candidates:
    """Free runs of maps of one shape, and what draws their parameters, as a batch is fitted.

    Args:
        scale: typical size of each parameter, (S, n): θ counts in these.
        aim: to where each is drawn.
        pull: how firmly.
    """

    def __init__(
        self,
        padded: "Padded",
        row: RowRuns,
        chunks: WeightedChunks,
        scale: Array,
        aim: Array,
        pull: Array,
    ) -> None:
        self._sums, self._frames = _batch_slopes(padded.maps(row)), padded.frames
        self._chunks, self._scale, self._aim, self._pull = chunks, scale, aim, pull
        self.count: Index = np.zeros(len(scale), dtype=np.int64)

    def __call__(self, z: Array, which: Index) -> "_Tried":
        self.count[which] += 1
        square, A, g = (
            np.asarray(part) for part in self._sums(z * self._scale, self._frames, self._chunks)
        )
        drawn = self._pull * (z - self._aim)
        A = self._scale[:, :, None] * A * self._scale[:, None, :]
        A = np.nan_to_num(A, posinf=0.0, neginf=0.0) + np.eye(A.shape[1]) * self._pull[:, None] ** 2
        g = -np.nan_to_num(self._scale * g, posinf=0.0, neginf=0.0) - self._pull * drawn
        return _Tried((square + np.sum(drawn**2, axis=1))[which, None], A[which], g[which])


class _Tried(NamedTuple):
    """Candidates run at some parameters: squared errors (k, 1), normal equations."""

    cost: Array
    A: Array
    g: Array

    def normal(self, of: Index) -> tuple[Array, Array]:
        return self.A[of], self.g[of]
