"""The paths of some runs, for pictures."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.mission.loop import Verdict
from sysid.mission.monte_carlo.chunks import LANES
from sysid.mission.monte_carlo.compiled import CompiledRuns
from sysid.mission.monte_carlo.setup import Setup
from sysid.mission.monte_carlo.workers import why_not_at_once


def paths_of(setup: Setup, seeds: Sequence[int]) -> list[Array]:
    """X, Y of runs from their starts to their ends, (n, 2) each [m].

    Side by side where they can be compiled; a run alone that fails has none.

    Args:
        setup: of the runs.
        seeds: of the runs.
    """
    if why_not_at_once(setup):
        return [path for seed in seeds for path in _alone(setup, seed)]
    choices = np.array([setup.choice(s) for s in seeds])
    found: dict[int, Array] = {}
    for which, driver in enumerate(setup.drivers):
        runs = np.flatnonzero(choices == which).tolist()
        if not runs:
            continue
        seen: list[tuple[Array, Array]] = []

        def keep(verdict: Array, places: Array, seen: list[tuple[Array, Array]] = seen) -> None:
            seen.append((verdict, places))

        draws = driver.drawing.draw([seeds[k] for k in runs])
        # as many lanes as the runs themselves had: what was compiled for them serves again
        CompiledRuns(setup, which, max(LANES, len(runs))).figures(draws, keep)
        verdict = np.concatenate([v for v, _ in seen])
        places = np.concatenate([p for _, p in seen])
        for lane, k in enumerate(runs):
            last = int(np.argmax(verdict[:, lane] != Verdict.GOES_ON))
            found[k] = places[: last + 1, :, lane]
    return [found[k] for k in sorted(found)]


def _alone(setup: Setup, seed: int) -> list[Array]:
    try:
        log = setup.simulated(seed).log
    except ModelError:
        return []
    return [np.column_stack([log["x"], log["y"]])]
