"""The equations of NARX models, ready for free runs: ŷ_i(t) = clip(F_i(x_i(t)))."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array, Index
from sysid.runners import floats
from sysid.structures.difference_equations.expressions import evaluate, signals
from sysid.structures.difference_equations.free_run import (
    Chunks,
    FreeRun,
    Limits,
    OfInputs,
    OfOutputs,
    Place,
)
from sysid.structures.difference_equations.regressors import Row, holds_output
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.narx.compiled import WeightedChunks, compiled_runs
from sysid.structures.narx.wavelet_network import KINDS, Frame, RowDesign, size, split, value

LONG = 20_000
"""Samples from which a run is compiled: importing and compiling then cost less than they save."""


@dataclass(frozen=True)
class Maps:
    """The maps of all outputs, less what a compilation takes as arguments.

    Attributes:
        rows: regressors of each output.
        sizes: (regressors, products, units, dimension of v) of each row.
        estimator: kind of the units, a name of KINDS.
    """

    rows: tuple[Row, ...]
    sizes: tuple[tuple[int, int, int, int], ...]
    estimator: str

    @cached_property
    def theta_index(self) -> list[Index]:
        """Entries of θ of each row."""
        edges = np.cumsum([0, *(size(*s) for s in self.sizes)])
        return [np.arange(a, b) for a, b in pairwise(edges.tolist())]

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What the regressors hold, past outputs first."""
        used = {s for row in self.rows for e in row for s in signals(e)}
        return tuple(sorted(used, key=lambda s: (s.kind != "y", s)))

    def parts(
        self, xp: Any, theta: Any, frames: Sequence[Frame], place: Place
    ) -> tuple[OfInputs, OfOutputs]:
        """``FreeRun.parts`` with these frames; what follows from inputs are whole regressors."""
        every = tuple(dict.fromkeys(e for row in self.rows for e in row))
        mixed = [e for e in every if not isinstance(e, Signal) and holds_output(e)]
        inside = [s for e in mixed for s in signals(e) if s.kind == "u"]
        before = list(dict.fromkeys([*(e for e in every if not holds_output(e)), *inside]))
        past = [e for e in every if isinstance(e, Signal) and e.kind == "y"]
        places = {s: place(s) for e in every for s in signals(e)}
        # a regressor's value is that of an input, a past output, or an expression in both
        order = {e: k for k, e in enumerate((*before, *past, *mixed))}
        at_past = [places[s] for s in past]
        numbers, kind = np if xp is floats else xp, KINDS[self.estimator]
        maps = [
            ([order[e] for e in row], f, split(theta[index[0] : index[-1] + 1], *s))
            for row, f, index, s in zip(
                self.rows, frames, self.theta_index, self.sizes, strict=True
            )
        ]

        def together(values: list[Any]) -> Any:
            return np.array(values) if xp is floats else xp.stack(values, axis=-1)

        def of_inputs(known: Any) -> list[Any]:
            return [evaluate(e, lambda s: known[places[s]], xp) for e in before]

        def of_outputs(known: Any, row: Any) -> list[Any]:
            def lookup(s: Signal) -> Any:
                return known[places[s]] if s.kind == "y" else row[order[s]]

            x = [*row, *(known[k] for k in at_past), *(evaluate(e, lookup, xp) for e in mixed)]
            values = [value(numbers, kind, f, w, together([x[k] for k in at])) for at, f, w in maps]
            return [float(v) for v in values] if xp is floats else values

        return of_inputs, of_outputs


class NarxRun(FreeRun):
    """The maps of all outputs, prepared for runs. θ stacks the rows' parameters.

    Args:
        rows: regressors of each output.
        designs: what else makes each row.
        estimator: kind of its units, a name of KINDS.
        limits: bounds of each output.
        compiled_from: samples from which one run is compiled.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        designs: Sequence[RowDesign],
        estimator: str,
        nu: int,
        limits: Limits,
        compiled_from: int = LONG,
    ) -> None:
        super().__init__((s for row in rows for e in row for s in signals(e)), nu, limits)
        self.maps = Maps(tuple(rows), tuple(d.sizes for d in designs), estimator)
        self.frames = [d.frame() for d in designs]
        self.theta_index = self.maps.theta_index
        self.n_theta = sum(d.n for d in designs)
        self._compiled_from = compiled_from

    def parts(self, xp: Any, theta: Any, place: Place) -> tuple[OfInputs, OfOutputs]:
        return self.maps.parts(xp, theta, self.frames, place)

    def simulate(self, theta: Array, u: Array, x0: Array | None = None) -> Array:
        """Free run for inputs (N, nu) from a state, (N, ny); compiled where it is long."""
        if len(u) < self._compiled_from:
            return super().simulate(theta, u, x0)
        past, before = self.past(x0)
        # powers of two: runs of other lengths find what was compiled
        driven = np.zeros((self.before + (1 << (len(u) - 1).bit_length()), self.nu, 1))
        driven[: self.before + len(u), :, 0] = np.concatenate([before, u])
        y = np.zeros((len(driven) - self.before, self.ny, 1))
        chunks = Chunks(driven, past[:, :, None], y, np.ones((len(y), 1), dtype=bool))
        return self.outputs_over(theta, chunks)[: len(u), :, 0]

    @property
    def width(self) -> int:
        """Regressors and what the units see of them, for the largest output."""
        return max(d + K * q for d, _, K, q in self.maps.sizes)

    def weighted(self, chunks: Chunks, scale: Array) -> WeightedChunks:
        """The chunks as compiled runs take them, errors divided by ``scale`` (ny,)."""
        weight = chunks.inside[:, None, :] / scale[:, None]
        restart = np.zeros(chunks.inside.shape, dtype=bool)
        limits = np.array(self.limits)
        return WeightedChunks(chunks.u, chunks.past, chunks.y, weight, restart, limits)

    def outputs_over(self, theta: Array, chunks: Chunks) -> Array:
        data = self.weighted(chunks, np.ones(self.ny))
        return np.asarray(compiled_runs(self.maps).runs(theta, self.frames, data))

    def slopes_over(self, theta: Array, chunks: Chunks, outputs: Array) -> Array:
        data = self.weighted(chunks, np.ones(self.ny))
        return np.asarray(compiled_runs(self.maps).slopes(theta, self.frames, data))
