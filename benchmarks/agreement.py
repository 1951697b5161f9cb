"""Agreement of compiled runs with single ones: some are repeated alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.batch.figures import Figures
from sysid.robot.mission.batch.runner import BatchRunner
from sysid.robot.mission.batch.setup import Setup

TOLERANCE = 1e-9
"""Difference up to which figures agree: hundreds of steps, each rounded otherwise, keep below it;
a decision taken one sample later does not."""


@dataclass(frozen=True)
class Apart:
    """A run whose figures differ alone: its seed, and the largest difference."""

    seed: int
    difference: float


@dataclass(frozen=True)
class Agreement:
    """What driving some runs again has shown.

    Attributes:
        runs: driven again.
        largest: difference of any figure among those that agree.
        apart: runs that do not.
    """

    runs: int
    largest: float
    apart: tuple[Apart, ...]

    @property
    def share(self) -> float:
        """Of the runs that agree."""
        return 1.0 - len(self.apart) / self.runs


def figures_alone(setup: Setup, seed: int) -> Array:
    """Figures of one run, driven alone in NumPy."""
    runner = BatchRunner(setup, setup.choice(seed), 1, alone=True)
    return np.concatenate(runner.of(runner.variant.sampler.draw([seed])).figures)


def agreement(setup: Setup, seeds: Sequence[int], figures: Figures) -> Agreement:
    """Drive runs again, one after the other in NumPy, and compare every figure.

    A run that meets an edge (a stop, a switch, the end of a turn) within rounding may take it one
    sample earlier or later; it is listed.

    Args:
        seeds: of the runs to compare.
        figures: theirs, in this order.
    """
    largest, apart = 0.0, []
    for k, seed in enumerate(seeds):
        alone = figures_alone(setup, seed)
        together = np.array([float(column[k]) for column in figures])
        same = (alone == together) | (np.isnan(alone) & np.isnan(together))
        with np.errstate(invalid="ignore"):  # infinities that differ
            difference = float(np.max(np.where(same, 0.0, np.abs(alone - together))))
        if difference <= TOLERANCE:
            largest = max(largest, difference)
        else:
            apart.append(Apart(seed, difference))
    return Agreement(len(seeds), largest, tuple(apart))
