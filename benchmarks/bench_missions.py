"""How long runs of a mission take, one or ten thousand, and `sysid simulate` from cold.

    python benchmarks/bench_missions.py [FILE [FOLDER]]

FOLDER holds plants fitted before, or gets them. Mission 2 of the thesis with plants fitted to the
bundled logs. Processor time; the quickest of several runs counts, as load only adds. Writes
``reports/benchmark_missions.md``; ends with 1 when a target is
missed. About five minutes, most of them spent by the fits.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from many_runs import (
    LINEAR,
    LONGEST,
    LONGEST_LINEAR,
    REPLAYED,
    RUNS,
    SLOWLY_DRAWN,
    memory,
    timed,
)

REPORT = Path(__file__).resolve().parent.parent / "reports" / "benchmark_missions.md"

MISSION = "obstacles_6_3"

STRUCTURES = {
    "arx": 20.0,
    "oe": 20.0,
    "narmax": 100.0,
    "wiener-hammerstein": 100.0,
    "hammerstein-wiener": 100.0,
    "narx-wavelet": 100.0,
    "dc-motor": 100.0,
}
"""The longest that a run may take [ms]: nobody should wait for one, nor hours for many."""

COLD = {"arx": 1.0, "dc-motor": 1.0}
"""The longest that the command may take [s]: a person who tries a mission does not wait."""

REPEATS = 15

HEAD = """# Time of one run of a mission

Processor time on one core, the quickest of {repeats} runs. Mission 2 of the
thesis (`{mission}`), some 330 samples; plants fitted to the bundled `multilevel` log. A float
loop of 10⁶ turns (`x = 0.5 x (1 − x) + 0.1`) takes {loop:.0f} ms on this machine: divide by it to
compare machines.

"""


MANY = """
## {runs} runs at once

Processor time, of all cores together, on {where}; the quicker of two; parameters, start, obstacles
and friction drawn for every run. *Compiling*: from nothing, once; it is kept in the user's cache.
*One by one*: the same runs after each other, from {replayed} of them that were driven alone.
*Agree*: how many of these have
the same figures to 1e-9. A draw of {slowly} is tried by free runs before it drives, which takes
some 10 ms: they are not in the table.

"""

EXTRA = """
Largest memory of a process with {runs} runs of `arx`: {few:.0f} MB, with {five}: {lots:.0f} MB.
"""


def main(target: Path, plants: str | None = None) -> int:
    """Fit, or take plants fitted before; drive, and write the report."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from sysid.data.files import write_atomic
    from sysid.report.markdown import foot, table

    rows, many, missed, extra = [], [], [], ""
    with tempfile.TemporaryDirectory() as folder:
        for structure, limit in STRUCTURES.items():
            print(f"{structure} …", flush=True)
            plant = fitted(structure, Path(plants or folder))
            took = 1e3 * one_run(plant)
            cold = cold_start(plant) if structure in COLD else None
            if took > limit or (cold or 0.0) > COLD.get(structure, 1.0):
                missed.append(structure)
            wanted = f"{limit:.0f}" + (f"; {COLD[structure]:g} s cold" if cold else "")
            rows.append([f"`{structure}`", f"{took:.1f}", f"{cold:.2f}" if cold else "", wanted])
            if structure in SLOWLY_DRAWN:
                continue
            t = timed(plant)
            most = LONGEST.get(structure, LONGEST_LINEAR if structure in LINEAR else None)
            if most is not None and t.seconds > most:
                missed.append(f"{structure}, many")
            agree = f"{t.agree} of {t.agree + t.apart}"
            at_most = "" if most is None else f"{most:.0f}"
            times = (f"{t.seconds:.1f}", f"{t.compiling:.1f}", f"{t.alone:.0f}")
            many.append([f"`{structure}`", *times, agree, at_most])
            if structure == "arx":
                few, lots = (memory(plant, n) for n in (RUNS, 5 * RUNS))
                extra = EXTRA.format(few=few, lots=lots, runs=RUNS, five=5 * RUNS)
                where = t.where
    head = HEAD.format(repeats=REPEATS, mission=MISSION, loop=1e3 * quickest(float_loop))
    headers = ["plant", "run in the library [ms]", "`sysid simulate` cold [s]", "at most"]
    of_many = ["plant", "runs [s]", "compiling [s]", "one by one [s]", "agree", "at most [s]"]
    second = MANY.format(
        runs=f"{RUNS:,}".replace(",", " "),
        where=where,
        replayed=REPLAYED,
        slowly=" or ".join(SLOWLY_DRAWN),
    )
    both = table(headers, rows, "lrrr") + second + table(of_many, many, "lrrrrr") + extra
    write_atomic(target, head + both + foot("make bench", f"0, {RUNS} runs"))
    print(f"Written to {target}; missed: {', '.join(missed) or 'none'}")
    return 1 if missed else 0


def fitted(structure: str, folder: Path) -> Path:
    """A plant package of this structure."""
    import sysid_datasets
    from sysid_cli.app import main as sysid

    place, plant = str(folder / f"{structure}.sysid"), folder / structure
    if plant.exists():
        return plant
    logs = [str(sysid_datasets.path(name)) for name in ("multilevel", "multilevel_val")]
    fit = ["fit", logs[0], "--val", logs[1], "--structure", structure]
    for line in (fit, ["export", "--format", "json", "-o", str(plant)]):
        if sysid([*line, "--workspace", place]) != 0:
            raise SystemExit(f"{structure}: {line[0]} failed")
    return plant


def one_run(plant: Path) -> float:
    """Processor time of one run in the library [s]."""
    import sysid_datasets

    from sysid.plant.package import load_plant
    from sysid.robot.mission.simulator import simulate
    from sysid.robot.mission.spec import load_mission
    from sysid.robot.mission.tracks.mapping import as_robot

    mission = load_mission(sysid_datasets.path(MISSION))
    robot, _ = as_robot(load_plant(plant), mission)
    return quickest(lambda: simulate(mission, robot))


def cold_start(plant: Path) -> float:
    """Processor time of the command, with the start of Python and all imports [s]."""
    import sysid_datasets

    mission = sysid_datasets.path(MISSION)
    code = f"from sysid_cli.app import main; main(['simulate', '{mission}', '--plant', '{plant}'])"
    times = []
    for _ in range(5):
        before = os.times()
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, cwd=plant.parent
        )
        after = os.times()
        spent = after.children_user - before.children_user
        times.append(spent + after.children_system - before.children_system)
    return min(times)


def float_loop() -> float:
    """A million turns of plain arithmetic."""
    x = 0.3
    for _ in range(1_000_000):
        x = 0.5 * x * (1.0 - x) + 0.1
    return x


def quickest(run: Callable[[], object]) -> float:
    """Processor time of the quickest of several runs [s]."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else REPORT, *sys.argv[2:3]))
