"""The full model: every effect of the catalogue in one compiled simulation.

Absent effects sit at their null values, so that trying a candidate means freeing a few parameters
and never compiling a new model. Many candidates, starts and shifted copies for slopes run side by
side (``batched_search.py`` searches over them).

What has no memory of its own is computed for a whole record at once; only the motion is stepped.
"""

from functools import cached_property

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.parameter_table import ParameterTable
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.runs import Runs


class FullModel(ParameterTable):
    """All effects around cores of one order, for a number of tracks."""

    @cached_property
    def runs(self) -> Runs:
        return Runs(self)

    def run(self, q: Array, data: Data) -> Array:
        """Measurements for parameter vectors q (batch, parameters), shape (batch, M, tracks)."""
        return self.runs(np.atleast_2d(q), data)
