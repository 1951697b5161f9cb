"""Steady-state outputs of a plant under constant inputs, by simulation."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import SteppablePlant


@dataclass(frozen=True)
class SettlingRule:
    """When a plant counts as settled.

    Attributes:
        first_block: samples of the first block; each following one is twice as long. Shorter than
            the lag of most robots, so that a quick plant costs little.
        most_steps: samples after which a plant that still moves is given up: a time constant of
            a tenth of that has passed its settling by far.
        still: ripple over the second half of a block, as a part of the change so far, of a plant at
            rest: a tenth of the last digit of the figures that are printed.
        agree: difference of two successive means, as a part of the change so far, of a plant that
            rings about its rest: what it does to a scale is below what a model's gain is known to.
        runaway: outputs beyond this are no physical quantity any more.
    """

    first_block: int = 256
    most_steps: int = 2**16
    still: float = 1e-4
    agree: float = 1e-2
    runaway: float = 1e12


RULE = SettlingRule()


class Ending(StrEnum):
    """How holding the inputs ended; each is a sentence for a plant that needs to rest."""

    RESTS = "the plant's output rests"
    RUNS_AWAY = (
        "the plant's output runs away: the model is unstable; fit it with stability "
        "enforced or with lower orders"
    )
    KEEPS_MOVING = (
        "the plant's output keeps moving under a constant input, like a position under a "
        "constant speed: identify a plant whose output settles"
    )


@dataclass(frozen=True, eq=False)
class Settling:
    """What became of a plant whose inputs were held.

    Attributes:
        y: the outputs it rests at, (ny,); the last ones where it does not rest.
        response: the outputs at every sample until then, (N, ny).
    """

    ending: Ending
    state: Array
    y: Array
    response: Array

    @property
    def swing(self) -> Array:
        """The largest excursion of each output from its first value, (ny,)."""
        return np.asarray(np.max(np.abs(self.response - self.response[0]), axis=0))


def settle(plant: SteppablePlant, state: Array, u: Array) -> Settling:
    """Hold the inputs until the outputs rest.

    The plant is stepped in blocks of growing length. It rests once no output moved by more than
    1e-4 of its change so far during the second half of a block; a lightly damped plant that
    still rings at the last block is given the mean of the ringing, if that mean stands still.

    Args:
        plant: the plant; simulation serves nonlinear ones as well as linear ones.
        u: the inputs to hold, shape (nu,).
    """
    previous: Array | None = None
    block, blocks = RULE.first_block, list[Array]()

    def ended(ending: Ending, y: Array) -> Settling:
        return Settling(ending, state, y, np.concatenate(blocks))

    while True:
        values = np.empty((block, len(plant.outputs)))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(block):
                after, values[k] = plant.step(state, u)
                if np.array_equal(after, state):  # a step is pure: the others change nothing
                    values[k:] = values[k]
                    break
                state = after
        last = values[-1].copy()
        blocks.append(values)
        if not np.all(np.abs(values) < RULE.runaway):
            return ended(Ending.RUNS_AWAY, last)
        half, swing = values[block // 2 :], ended(Ending.KEEPS_MOVING, last).swing
        mean = half.mean(axis=0)
        floor = 1e-12 * np.max(np.abs(values), axis=0)
        if np.all(np.ptp(half, axis=0) <= RULE.still * swing + floor):
            return ended(Ending.RESTS, last)
        if sum(map(len, blocks)) + 2 * block > RULE.most_steps and previous is not None:
            change = np.abs(mean - blocks[0][0])
            rings = bool(np.all(np.abs(mean - previous) <= RULE.agree * change + floor))
            return ended(Ending.RESTS, mean) if rings else ended(Ending.KEEPS_MOVING, last)
        previous = mean
        block *= 2
