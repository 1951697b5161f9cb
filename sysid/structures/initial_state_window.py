"""Length of the window at the start of a record that fits its initial state."""

import numpy as np

from sysid.data.record import Array
from sysid.structures.dynamics import Dynamics

LONGEST_HEAD = 10_000
"""Samples that suffice for the initial state of any run, even of an integrator."""

FORGETTING = 2.0
"""Slowest time constants in a head: over less, the amplitude of a slow mode is guesswork."""


def initial_state_window(dynamics: Dynamics, theta: Array, skip: int = 0) -> int:
    """Samples at the head of a record from which its unknown initial state is fitted.

    Exactly as many as there are states when just that many are left out of the figures: the run
    then starts from the measured outputs, as published protocols have it. Otherwise at least the
    skipped samples, three times the number of states, so that their noise averages out, and
    ``FORGETTING`` of the slowest time constants: what is guessed wrong stays in the run for long.
    """
    states = dynamics.n_states(theta)
    if skip == states > 0:
        return skip
    if states == 0:
        return 0
    slowest = float(np.max(np.abs(dynamics.time_constants(theta)), initial=0.0))
    return max(skip, 3 * states, int(min(FORGETTING * slowest, LONGEST_HEAD)))
