"""Least-squares problems of NARX models: one step ahead, and free runs over chunks of the data."""

import numpy as np

from sysid.data.record import Array, Index
from sysid.fitting.problem import Problem
from sysid.structures.difference_equations.chunks import Chunks, Data, pieces, side_by_side, spreads
from sysid.structures.difference_equations.regressors import columns
from sysid.structures.narx.compiled import Shape, WeightedChunks, chunk_functions
from sysid.structures.narx.run import NarxRun
from sysid.structures.narx.wavelet_network import gradients


class OneStepRow(Problem):
    """ε(t) = y(t) − F(x(t)) of one output.

    Args:
        run: the maps.
        output: which one.
        data: (u, y) of each record.
    """

    def __init__(self, run: NarxRun, output: int, data: Data) -> None:
        first = run.first
        self.index = run.theta_index[output]
        self.n_initial = 0
        self.lengths = tuple(max(len(y) - first, 0) for _, y in data)
        self.channels = (output,) * len(data)
        self._run, self._output = run, output
        self._x = np.concatenate([columns(run.rows[output], u, y)[first:] for u, y in data])
        self._y = np.concatenate([y[first:, output] for _, y in data])

    def residual(self, p: Array) -> Array:
        """ε, record after record."""
        return self._y - self._run.row_values(self._output, p, self._x)

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂θ."""
        d = self._run.designs[self._output]
        return -np.asarray(gradients(np, self._run.kind, d.frame(), d.weights(p), self._x)[0])


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
        where = pieces(run, data, length)
        self._scale = spreads([y for _, y in data])
        chunks = side_by_side(run, data, where)
        self._chunks = weighted_chunks(run, chunks, self._scale)
        self._inside = np.repeat(chunks.inside.T[:, None], run.ny, axis=1)
        self._functions = chunk_functions(compiled_shape(run))
        self._frames = [d.frame() for d in run.designs]
        drawn = np.zeros(0, dtype=int) if pull is None else np.flatnonzero(pull)
        self._drawn, self._pull = drawn, np.zeros(0) if pull is None else pull[drawn]
        self._centre = np.zeros(0) if centre is None else centre[drawn]
        self.lengths = tuple(b - a for _, a, b in where for _ in range(run.ny))
        self.channels = tuple(i for _ in where for i in range(run.ny))

    @property
    def samples(self) -> int:
        """Errors of the data, what draws the parameters not counted."""
        return sum(self.lengths)

    def residual(self, p: Array) -> Array:
        """(y − ŷ)/spread: chunk after chunk, output after output; then what draws."""
        errors = np.asarray(self._functions.runs(p, self._frames, self._chunks))
        e = (self._chunks.y - errors) / self._scale[:, None]
        data = e.transpose(2, 1, 0)[self._inside]
        return np.concatenate([data, self._pull * (p[self._drawn] - self._centre)])

    def jacobian(self, p: Array) -> Array:
        """∂/∂θ of it."""
        J = np.asarray(self._functions.slopes(p, self._frames, self._chunks))
        length, ny, batch = self._chunks.y.shape
        J = J.reshape(length, ny, batch, -1).transpose(2, 1, 0, 3)[self._inside]
        draw = np.zeros((len(self._drawn), len(p)))
        draw[np.arange(len(self._drawn)), self._drawn] = self._pull
        return np.concatenate([J, draw])


def weighted_chunks(run: NarxRun, chunks: Chunks, scale: Array) -> WeightedChunks:
    """The chunks as compiled runs take them, errors divided by ``scale`` (ny,)."""
    weight = chunks.inside[:, None, :] / scale[:, None]
    restart = np.zeros(chunks.inside.shape, dtype=bool)
    return WeightedChunks(chunks.u, chunks.past, chunks.y, weight, restart, np.array(run.limits))
