"""Stretches of data side by side, over which free runs are made at once.

Each starts from its measured past. Long ones make the cost the simulation error; short ones keep it
smooth where the model forgets slowly (Ribeiro et al. 2020, "On the smoothness of nonlinear system
identification").
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.structures.difference_equations.free_run import FreeRun

Data = Sequence[tuple[Array, Array]]
"""(u, y) of each record."""


class Piece(NamedTuple):
    """Samples ``start`` to ``stop`` of one record, by number."""

    record: int
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Chunks:
    """Stretches of data side by side, zero where one has ended.

    Attributes:
        u: inputs with what came before them, (before + L, nu, B).
        past: outputs before each stretch, (depth, ny, B).
        y: measured outputs, (L, ny, B).
        inside: which samples belong to each stretch, (L, B).
    """

    u: Array
    past: Array
    y: Array
    inside: NDArray[np.bool_]


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


def spreads(ys: Sequence[Array]) -> Array:
    """Standard deviation of each output over all records, 1 where it does not move, (ny,)."""
    deviations = np.std(np.concatenate(ys), axis=0)
    return np.where(deviations > 0.0, deviations, 1.0)
