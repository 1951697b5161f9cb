"""Ten thousand runs of a mission at once: their time, what compiling costs, memory, agreement.

Run as a script this file is a process that makes runs and tells its largest memory [MB]:

    python benchmarks/many_runs.py PLANT RUNS
"""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.robot.mission.batch.setup import Setup

RUNS = 10_000

LONGEST = {"dc-motor": 60.0}
LONGEST_LINEAR = 5.0
"""The longest that so many runs may take once they are compiled [s]."""

LINEAR = ("arx", "armax", "oe", "bj")

SLOWLY_DRAWN = ("narmax", "narx-wavelet")
"""Structures whose stability is judged by free runs, for every draw."""

REPLAYED = 200
"""Runs that are driven again alone, one after the other."""


@dataclass(frozen=True)
class Timing:
    """What many runs of one plant cost.

    Attributes:
        seconds: processor time of ``RUNS`` runs, draws included, once they are compiled.
        compiling: the first chunk took so much longer [s].
        alone: the same runs one after the other [s], from those that were driven again.
        agree, apart: runs driven again that agree to 1e-9, and that do not.
        where: on what they ran.
    """

    seconds: float
    compiling: float
    alone: float
    agree: int
    apart: int
    where: str


def timed(plant: Path) -> Timing:
    """Make the runs twice in this process, compiled from nothing before the first."""
    from benchmarks.agreement import agreement
    from sysid.robot.mission.batch.pool import threaded
    from sysid.robot.mission.batch.runner import BATCH_SIZE
    from sysid.robot.mission.batch.sampler import run_seeds
    from sysid.robot.mission.monte_carlo.runs import chunks, runner_of
    from sysid.runners.compiled import jax_module

    setup = _setup(plant)
    jax_module().config.update("jax_enable_compilation_cache", False)
    run, parts = runner_of((setup, True)), chunks(setup, run_seeds(0, RUNS), BATCH_SIZE)
    start = process_time()
    run(parts[0])
    first = process_time() - start
    spans = []
    for _ in range(2):
        start = process_time()
        found = list(threaded(run, chunks(setup, run_seeds(0, RUNS), len(parts[0].runs))))
        spans.append(process_time() - start)
    seconds = min(spans)
    start = process_time()
    shown = agreement(setup, parts[0].seeds[:REPLAYED], found[0].figures)
    alone = (process_time() - start) / REPLAYED * RUNS
    device = jax_module().devices()[0]
    where = f"{device.device_kind} ({device.platform}), {os.cpu_count()} cores"
    apart = len(shown.apart)
    return Timing(seconds, first - seconds / len(parts), alone, shown.runs - apart, apart, where)


def memory(plant: Path, runs: int) -> float:
    """Largest memory of a process that makes so many runs [MB]."""
    line = [sys.executable, __file__, str(plant), str(runs)]
    return float(subprocess.run(line, check=True, capture_output=True, text=True).stdout)


def _setup(plant: Path) -> "Setup":
    import sysid_datasets

    from sysid.plant.package import load_model
    from sysid.robot.mission.batch.setup import Setup
    from sysid.robot.mission.spec import load_mission

    return Setup.of(load_mission(sysid_datasets.path("obstacles_6_3")), [load_model(plant)])


def _in_process(plant: Path, runs: int) -> None:
    import resource

    import sysid_datasets

    from sysid.plant.package import load_model
    from sysid.robot.mission.monte_carlo.runs import simulate_runs
    from sysid.robot.mission.spec import load_mission

    simulate_runs(load_mission(sysid_datasets.path("obstacles_6_3")), [load_model(plant)], runs)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)


if __name__ == "__main__":
    _in_process(Path(sys.argv[1]), int(sys.argv[2]))
