"""Least-squares problems of NARX models: one step ahead, and free runs over chunks of the data."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.fitting.problem import Problem
from sysid.structures.narx.compiled import Shape, chunk_functions
from sysid.structures.narx.run import NarxRun
from sysid.structures.narx.wavelet_network import gradients, value
from sysid.structures.recursive.chunks import Chunks
from sysid.structures.recursive.regressors import columns

Data = Sequence[tuple[Array, Array]]

WORK = 200_000
"""Runs × samples that k-step predictions advance at a time."""


class OneStepRow(Problem):
    """ε(t) = y(t) − F(x(t)) of one output.

    Args:
        run: the maps.
        output: which one.
        data: (u, y) of each record.
    """

    def __init__(self, run: NarxRun, output: int, data: Data) -> None:
        first = run.window.first
        self.index = run.theta_index[output]
        self.n_initial = 0
        self.lengths = tuple(max(len(y) - first, 0) for _, y in data)
        self.channels = (output,) * len(data)
        self._design, self._kind = run.designs[output], run.kind
        self._x = np.concatenate([columns(run.rows[output], u, y)[first:] for u, y in data])
        self._y = np.concatenate([y[first:, output] for _, y in data])

    def residual(self, p: Array) -> Array:
        """ε, record after record."""
        d = self._design
        found: Array = value(np, self._kind, d.frame(), d.weights(p), self._x)
        return self._y - found

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂θ."""
        d = self._design
        return -np.asarray(gradients(np, self._kind, d.frame(), d.weights(p), self._x)[0])


def compiled_shape(run: NarxRun) -> Shape:
    """The shape of these maps."""
    sizes = tuple(d.sizes for d in run.designs)
    return Shape(run.rows, sizes, run.estimator, run.depth, run.before)


class FreeRuns(Problem):
    """Free-run errors over chunks of the data, each started from its measured past.

    Each output's errors are divided by its spread. Long chunks make it the simulation error; short
    ones keep the cost smooth where the model forgets slowly (Ribeiro et al. 2020).

    Args:
        run: the maps.
        data: (u, y) of each record.
        length: samples a chunk, about; those of one record are equally long.
        pull: weight that draws each parameter to ``centre``, (n,), or None.
        centre: (n,).
    """

    def __init__(
        self,
        run: NarxRun,
        data: Data,
        length: int,
        pull: Array | None = None,
        centre: Array | None = None,
    ) -> None:
        self.index: Index = np.arange(run.n_theta)
        self.n_initial = 0
        self._pieces = pieces(run, data, length)
        self._scale = spreads([y for _, y in data])
        self._chunks, self._valid = chunked(run, data, self._pieces, self._scale)
        self._functions = chunk_functions(compiled_shape(run))
        self._frames = [d.frame() for d in run.designs]
        drawn = np.zeros(0, dtype=int) if pull is None else np.flatnonzero(pull)
        self._drawn, self._pull = drawn, np.zeros(0) if pull is None else pull[drawn]
        self._centre = np.zeros(0) if centre is None else centre[drawn]
        self.lengths = tuple(b - a for _, a, b in self._pieces for _ in range(run.ny))
        self.channels = tuple(i for _ in self._pieces for i in range(run.ny))

    @property
    def samples(self) -> int:
        """Errors of the data, what draws the parameters not counted."""
        return sum(self.lengths)

    def residual(self, p: Array) -> Array:
        """(y − ŷ)/spread: chunk after chunk, output after output; then what draws."""
        found = np.asarray(self._functions.runs(p, self._frames, self._chunks))
        e = (self._chunks.y - found) / self._scale[:, None]
        data = e.transpose(2, 1, 0)[self._valid]
        return np.concatenate([data, self._pull * (p[self._drawn] - self._centre)])

    def jacobian(self, p: Array) -> Array:
        """∂/∂θ of it."""
        J = np.asarray(self._functions.slopes(p, self._frames, self._chunks))
        length, ny, batch = self._chunks.y.shape
        J = J.reshape(length, ny, batch, -1).transpose(2, 1, 0, 3)[self._valid]
        draw = np.zeros((len(self._drawn), len(p)))
        draw[np.arange(len(self._drawn)), self._drawn] = self._pull
        return np.concatenate([J, draw])


def spreads(ys: Sequence[Array]) -> Array:
    """Standard deviation of each output over all records, 1 where it does not move, (ny,)."""
    found = np.std(np.concatenate(ys), axis=0)
    return np.where(found > 0.0, found, 1.0)


def pieces(run: NarxRun, data: Data, length: int) -> list[tuple[int, int, int]]:
    """(record, from, to) of chunks of about ``length`` samples that cover the data."""
    first = run.window.first
    found = []
    for k, (_, y) in enumerate(data):
        free = len(y) - first
        if free > 0:
            count = max(1, round(free / length))
            edges = [first + round(j * free / count) for j in range(count + 1)]
            found += [(k, a, b) for a, b in pairwise(edges) if b > a]
    return found


def chunked(
    run: NarxRun,
    data: Data,
    where: Sequence[tuple[int, int, int]],
    scale: Array,
    longest: int | None = None,
) -> tuple[Chunks, NDArray[np.bool_]]:
    """Chunks of ``longest`` samples side by side, and which samples (B, ny, L) are theirs."""
    longest = longest or max((b - a for _, a, b in where), default=0)
    batch, ny = len(where), run.ny
    u = np.zeros((run.before + longest, run.nu, batch))
    past = np.zeros((run.depth, ny, batch))
    y = np.zeros((longest, ny, batch))
    valid: NDArray[np.bool_] = np.zeros((batch, ny, longest), dtype=bool)
    for k, (record, a, b) in enumerate(where):
        inputs, outputs = data[record]
        u[: run.before + b - a, :, k] = inputs[a - run.before : b]
        if run.window.feeds_back:
            past[:, :, k] = outputs[a - run.depth : a]
        y[: b - a, :, k] = outputs[a:b]
        valid[k, :, : b - a] = True
    weight = valid.transpose(2, 1, 0) / scale[:, None]
    restart = np.zeros((longest, batch), dtype=bool)
    return Chunks(u, past, y, weight, restart, np.array(run.limits)), valid


def windows(
    run: NarxRun, theta: Array, u: Array, y: Array, horizon: int
) -> Iterator[tuple[Index, Array]]:
    """(samples, predictions there) of free runs of ``horizon`` steps started at every sample."""
    starts = np.arange(run.window.first, len(y) - horizon + 1)
    each = max(WORK // horizon, 1)
    for at in range(0, len(starts), each):
        s = starts[at : at + each]
        # windows reach before the record only where nothing is looked up
        around = np.maximum(np.arange(-run.before, horizon)[:, None] + s, 0)
        back = np.maximum(np.arange(-run.depth, 0)[:, None] + s, 0)
        inputs, past = u[around].transpose(0, 2, 1), y[back].transpose(0, 2, 1)
        yield s + horizon - 1, run.runs((theta, inputs), past)[-1].T
