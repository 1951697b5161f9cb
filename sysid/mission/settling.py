"""Where the outputs of a plant come to rest when its inputs are held, found by simulation."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.mission.simulator import SteppablePlant

_FIRST_BLOCK = 256
_MOST_STEPS = 2**16
_STILL = 1e-4  # ripple over the second half of a block, as a part of the change so far
_AGREE = 1e-2  # two successive means of a plant that still rings
_RUNAWAY = 1e12


@dataclass(frozen=True, eq=False)
class Settled:
    """A plant at rest.

    Attributes:
        state: its state.
        y: its outputs, shape (ny,).
        swing: the largest excursion of each output from its first value, shape (ny,).
    """

    state: Array
    y: Array
    swing: Array


def settle(plant: SteppablePlant, state: Array, u: Array) -> Settled:
    """Hold the inputs until the outputs rest.

    The plant is stepped in blocks of growing length. It rests once no output moved by more than
    1e-4 of its change so far during the second half of a block; a lightly damped plant that
    still rings at the last block is given the mean of the ringing, if that mean stands still.

    Args:
        plant: the plant; simulation serves nonlinear ones as well as linear ones.
        state: where to start.
        u: the inputs to hold, shape (nu,).

    Raises:
        ModelError: the outputs run away or keep moving (the message begins "the plant's output").
    """
    first: Array | None = None
    swing = np.zeros(len(plant.outputs))
    previous: Array | None = None
    steps, block = 0, _FIRST_BLOCK
    while True:
        values = np.empty((block, len(plant.outputs)))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(block):
                state, values[k] = plant.step(state, u)
        if not np.all(np.abs(values) < _RUNAWAY):
            raise ModelError(
                "the plant's output runs away: the model is unstable; fit it with stability "
                "enforced or with lower orders"
            )
        first = values[0] if first is None else first
        swing = np.maximum(swing, np.max(np.abs(values - first), axis=0))
        half = values[block // 2 :]
        mean = half.mean(axis=0)
        floor = 1e-12 * np.max(np.abs(values), axis=0)
        if np.all(np.ptp(half, axis=0) <= _STILL * swing + floor):
            return Settled(state, values[-1].copy(), swing)
        steps += block
        if steps + 2 * block > _MOST_STEPS and previous is not None:
            if np.all(np.abs(mean - previous) <= _AGREE * np.abs(mean - first) + floor):
                return Settled(state, mean, swing)
            raise ModelError(
                "the plant's output keeps moving under a constant input, like a position under a "
                "constant speed: identify a plant whose output settles"
            )
        previous = mean
        block *= 2
