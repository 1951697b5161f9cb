"""Computing time of one step of a model."""

import time

from sysid.errors import SysidError
from sysid.structures.model import Model

STEPS, ROUNDS = 50, 4
"""Steps timed together, and how often: the quickest round is the one that nothing disturbed."""


def step_time(model: Model) -> float | None:
    """Processor time of one step of the model's plant in Python [s]; None where it has none.

    Args:
        model: stepped from rest with the middle of its inputs' range.
    """
    try:
        plant = model.plant()
        state, u = plant.initial_state(), plant.u_offset
        best = float("inf")
        for _ in range(ROUNDS):
            start = time.process_time()
            for _ in range(STEPS):
                state, _ = plant.step(state, u)
            best = min(best, time.process_time() - start)
    except SysidError:
        return None
    return best / STEPS
