"""The linear motion of a structure: poles, time constants, and what they say of initial states."""

from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.structures.base import Structure

LONGEST_HEAD = 10_000
"""Samples that suffice for the initial state of any run, even of an integrator."""

FORGETTING = 2.0
"""Slowest time constants in a head: over less, the amplitude of a slow mode is guesswork."""


@singledispatch
def poles(structure: Structure, theta: Array) -> NDArray[np.complex128]:
    """Poles of the linear motion in the z plane; none where there is no such motion."""
    return np.zeros(0, dtype=np.complex128)


@singledispatch
def time_constants(structure: Structure, theta: Array) -> Array:
    """Samples in which each motion of its own falls to 1/e.

    τ = −1 / ln |p| of the poles p: infinite for an integrator, negative for a motion that
    grows. Empty where nothing is known.
    """
    radii = np.abs(poles(structure, theta))
    growth = np.log(radii[radii > 0.0])
    constants = np.full(len(growth), np.inf)
    np.divide(-1.0, growth, out=constants, where=growth != 0.0)
    return constants


@singledispatch
def dead_time_entry(structure: Structure, i: int, j: int) -> int | None:
    """Entry of θ that is the dead time from input j to output i [s]; None where there is none."""
    return None


def initial_state_window(structure: Structure, theta: Array, skip: int = 0) -> int:
    """Samples at the head of a record from which its unknown initial state is fitted.

    Exactly as many as there are states when just that many are left out of the figures: the run
    then starts from the measured outputs, as published protocols have it. Otherwise at least the
    skipped samples, three times the number of states, so that their noise averages out, and
    ``FORGETTING`` of the slowest time constants: what is guessed wrong stays in the run for long.
    """
    states = structure.n_states(theta)
    if skip == states > 0:
        return skip
    if states == 0:
        return 0
    slowest = float(np.max(np.abs(time_constants(structure, theta)), initial=0.0))
    return max(skip, 3 * states, int(min(FORGETTING * slowest, LONGEST_HEAD)))
