"""Stretches of data side by side, over which free runs are made at once.

Each starts from its measured past. Long ones make the cost the simulation error; short ones keep it
smooth where the model forgets slowly (Ribeiro et al. 2020, "On the smoothness of nonlinear system
identification").
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import HUGE, Data, Problem
from sysid.fitting.run_errors import output_scales
from sysid.structures.difference_equations.free_run import Chunks, FreeRun


class Piece(NamedTuple):
    """Samples ``start`` to ``stop`` of one record, by number."""

    record: int
    start: int
    stop: int


def pieces(run: FreeRun, data: Data, length: int) -> list[Piece]:
    """Chunks of about ``length`` samples that cover the data; those of a record equally long."""
    chunks = []
    for k, (_, y) in enumerate(data):
        free = len(y) - run.first
        if free > 0:
            count = max(1, round(free / length))
            edges = [run.first + round(j * free / count) for j in range(count + 1)]
            chunks += [Piece(k, a, b) for a, b in pairwise(edges)]
    return chunks


def side_by_side(
    run: FreeRun, data: Data, where: Sequence[Piece], longest: int | None = None
) -> Chunks:
    """The pieces as arrays for ``run``, ``longest`` samples long or as long as the longest."""
    length = longest or max((b - a for _, a, b in where), default=0)
    batch = len(where)
    u = np.zeros((run.before + length, run.nu, batch))
    past = np.zeros((run.depth, run.ny, batch))
    y = np.zeros((length, run.ny, batch))
    inside = np.zeros((length, batch), dtype=bool)
    for k, (record, a, b) in enumerate(where):
        inputs, outputs = data[record]
        u[: run.before + b - a, :, k] = inputs[a - run.before : b]
        if run.feeds_back:
            past[:, :, k] = outputs[a - run.depth : a]
        y[: b - a, :, k] = outputs[a:b]
        inside[: b - a, k] = True
    return Chunks(u, past, y, inside)


class ChunkedRuns(Problem):
    """Free-run errors over chunks of the data, each started from its measured past.

    Each output's errors are divided by its scale, so that all count alike.

    Args:
        data: (u, y) of each record.
        length: samples a chunk, about; those of one record are equally long.
        scale: (ny,); the outputs' spreads when None.
        pull: weight that draws each parameter to ``centre``, (n,), or None.
        centre: (n,).
    """

    def __init__(
        self,
        run: FreeRun,
        data: Data,
        length: int,
        scale: Array | None = None,
        pull: Array | None = None,
        centre: Array | None = None,
    ) -> None:
        self._run = run
        self._scale = output_scales([y for _, y in data]) if scale is None else scale
        self.index = np.unique(np.concatenate([np.zeros(0, dtype=int), *run.theta_index]))
        self.n_initial = 0
        where = pieces(run, data, length)
        self._chunks = side_by_side(run, data, where)
        self._inside = np.repeat(self._chunks.inside.T[:, None], run.ny, axis=1)
        drawn = np.zeros(0, dtype=int) if pull is None else np.flatnonzero(pull)
        self._drawn, self._pull = drawn, np.zeros(0) if pull is None else pull[drawn]
        self._centre = np.zeros(0) if centre is None else centre[drawn]
        self.lengths = tuple(b - a for _, a, b in where for _ in range(run.ny))
        self.channels = tuple(i for _ in where for i in range(run.ny))
        self._last: tuple[bytes, Array] = (b"", np.zeros(0))

    @property
    def samples(self) -> int:
        """Errors of the data, what draws the parameters not counted."""
        return sum(self.lengths)

    def _outputs(self, p: Array) -> tuple[Array, Array]:
        """θ and the runs with it, kept until another is asked for: the slopes need them again."""
        theta = np.zeros(self._run.n_theta)
        theta[self.index] = p
        if self._last[0] != theta.tobytes():
            self._last = (theta.tobytes(), self._run.outputs_over(theta, self._chunks))
        return theta, self._last[1]

    def residual(self, p: Array) -> Array:
        """(y − ŷ)/scale: chunk after chunk, output after output; then what draws."""
        e = (self._chunks.y - self._outputs(p)[1]) / self._scale[:, None]
        errors = e.transpose(2, 1, 0)[self._inside]
        return np.concatenate([errors, self._pull * (p[self._drawn] - self._centre)])

    def jacobian(self, p: Array) -> Array:
        theta, outputs = self._outputs(p)
        S = self._run.slopes_over(theta, self._chunks, outputs) / -self._scale[:, None, None]
        J = S[..., self.index].transpose(2, 1, 0, 3)[self._inside]
        draw = np.zeros((len(self._drawn), len(p)))
        draw[np.arange(len(self._drawn)), self._drawn] = self._pull
        J = np.nan_to_num(J, nan=0.0, posinf=HUGE, neginf=-HUGE)
        return np.concatenate([J, draw])
