"""The least-squares problem of one output of a NARX model one step ahead."""

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import Data, Problem
from sysid.structures.difference_equations.compiled import compiled_runs
from sysid.structures.difference_equations.regressors import columns
from sysid.structures.narx.run import Maps, NarxRun

BLOCK = 8192
"""Samples whose units are held at a time."""


class OneStepRow(Problem):
    """ε(t) = y(t) − F(x(t)) of one output.

    Args:
        run: the maps.
        output: which one.
        data: (u, y) of each record.
    """

    def __init__(self, run: NarxRun, output: int, data: Data) -> None:
        first, maps = run.first, run.maps
        self.index = run.theta_index[output]
        self.n_initial = 0
        self.lengths = tuple(max(len(y) - first, 0) for _, y in data)
        self.channels = (output,) * len(data)
        self._maps = Maps((maps.rows[output],), (maps.sizes[output],), maps.estimator)
        self._frames = [run.frames[output]]
        self._known = np.concatenate([columns(self._maps.signals, u, y)[first:] for u, y in data])
        self._y = np.concatenate([y[first:, output] for _, y in data])

    def residual(self, p: Array) -> Array:
        """ε, record after record."""
        place = self._maps.signals.index
        of_inputs, of_outputs = self._maps.parts(np, p, self._frames, place)
        blocks = [self._known[a : a + BLOCK].T for a in range(0, len(self._known), BLOCK)]
        values = [of_outputs(known, of_inputs(known))[0] for known in blocks]
        return np.asarray(self._y - np.concatenate([np.zeros(0), *values]))

    def jacobian(self, p: Array) -> Array:
        """∂ε/∂θ."""
        n = len(self._known)
        # powers of two: records of other lengths find what was compiled
        padded = np.zeros((1 << max(n - 1, 0).bit_length(), self._known.shape[1]))
        padded[:n] = self._known
        slopes = compiled_runs(self._maps).partial(p, self._frames, padded)
        return -np.asarray(slopes)[:n, 0]
