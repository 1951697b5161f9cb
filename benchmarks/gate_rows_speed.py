"""The speed rows of the gate: what the package does over the least that anybody could do instead.

Ratios within one process against references measured beside them (``gate_bare_references.py``), so
that neither the machine nor its load counts for much; processor time, as load leaves it alone.
"""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path

import numpy as np
import sysid_datasets
from gate_bare_references import Array, bare_fit, best_orders, normal_equations, plain_steps
from gate_judging import SpeedRow
from scipy.signal import lfilter
from sysid_datasets.hidden_logs import Request, hide

import sysid

HIDDEN = Request(("coulomb-friction",), seed=3, duration=30.0)
"""The log that is diagnosed: as short as still tells the effect."""

BARE_IMPORTS = "import numpy, scipy.signal, scipy.optimize, pandas"
COMMAND = "from sysid_cli.start import main; raise SystemExit(main())"


def own_time() -> float:
    """Processor time of this process [s]."""
    return time.process_time()


def time_of_children() -> float:
    """Processor time of all processes that were started here and have ended [s]."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def steady_heap() -> None:
    """Let the C library keep what is freed, as it does anyway once something large was freed.

    Until then it gives every array of some size back to the system and takes new pages for the
    next: ``read_csv`` took 13 ms alone and 8 ms after a diagnosis in the same process.
    """
    np.ones(31 * 2**17)  # 31 MiB: glibc raises its threshold to what was freed, to 32 MiB at most


NOISES = {
    "white": ([1.0], [1.0]),
    "armax": ([1.0, -0.5, 0.2], [1.0, -1.5, 0.7]),
    "bj": ([1.0, -0.5, 0.2], [1.0, -0.8, 0.1]),
}
"""What colours the noise, C and D, so that each structure is fitted to what it can describe."""


def signals(samples: int, noise: str = "white") -> tuple[Array, Array]:
    """Random binary input and noisy output of a plant of second order, (N,) each."""
    rng = np.random.default_rng(1)
    u = np.sign(rng.standard_normal(samples))
    coloured = lfilter(*NOISES[noise], 0.1 * rng.standard_normal(samples))
    return u, np.asarray(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + coloured)


def record(u: Array, y: Array) -> sysid.Record:
    """The same as a record."""
    return sysid.Record(u[:, None], y[:, None], 0.1)


def log_file(folder: Path, samples: int) -> Path:
    """The same as a file."""
    file = folder / f"{samples}.csv"
    table = np.column_stack([0.1 * np.arange(samples), *signals(samples)])
    np.savetxt(file, table, "%.9g", ",", header="t,u,y", comments="")
    return file


def reading(folder: Path) -> SpeedRow:
    """A log read, its columns recognised and checked, over the bare parser."""
    import pandas as pd

    file = log_file(folder, 100_000)
    return SpeedRow(
        "speed/reading",
        "10⁵ rows by read_log over pandas.read_csv",
        lambda: sysid.read_log(file),
        lambda: pd.read_csv(file),
        own_time,
        3,
    )


def inspecting(folder: Path) -> SpeedRow:
    """Every check of a log over its reading."""
    file = log_file(folder, 2000)
    log = sysid.read_log(file)
    return SpeedRow(
        "speed/inspect",
        "inspect of 2000 rows over read_log of them",
        lambda: sysid.inspect(log),
        lambda: sysid.read_log(file),
        own_time,
        3,
    )


def arx(folder: Path) -> SpeedRow:
    """A whole fit with covariance, criteria and checks, over its arithmetic."""
    u, y = signals(100_000)
    log = record(u, y)
    return SpeedRow(
        "speed/arx",
        "fit of ARX(2,2,1) to 10⁵ samples over its normal equations",
        lambda: sysid.fit(log, "arx", "na=2 nb=2 nk=1"),
        lambda: normal_equations(u, y, 2, 2),
        own_time,
        3,
        10,
    )


def orders(folder: Path) -> SpeedRow:
    """Orders searched over the plainest search of the same candidates."""
    u, y = signals(2000)
    log = record(u, y)
    return SpeedRow(
        "speed/orders",
        "orders of ARX, 1 to 4 each on 2000 samples, by identify over 16 × lstsq and free run",
        lambda: sysid.identify(log, structures=("arx",), orders="na=1:4 nb=1:4 nk=1"),
        lambda: best_orders(u, y, 4),
        own_time,
        3,
        2,
    )


ITERATIVE = {
    "armax": "na=2 nb=2 nc=2 nk=1",
    "oe": "nb=2 nf=2 nk=1",
    "bj": "nb=2 nc=2 nd=2 nf=2 nk=1",
}


def iterative(structure: str) -> Callable[[Path], SpeedRow]:
    """A whole fit by iteration over a bare search."""

    def prepared(folder: Path) -> SpeedRow:
        u, y = signals(10_000, structure if structure in NOISES else "white")
        log = record(u, y)
        return SpeedRow(
            f"speed/{structure}",
            f"fit of {structure.upper()}, 2 of each, to 10⁴ samples over scipy's least_squares",
            lambda: sysid.fit(log, structure, ITERATIVE[structure]),
            lambda: bare_fit(structure, u, y),
            own_time,
            4,
            2,
        )

    return prepared


TOOLBOX: Mapping[str, tuple[str, Mapping[str, int], Mapping[str, str]]] = {
    "process": ("P1D", {}, {"type": "P1D"}),
    "ss": ("order 2", {"n": 2}, {}),
}
"""Structures of the toolbox, each with its words, orders and options."""


def beside_oe(structure: str) -> Callable[[Path], SpeedRow]:
    """A structure of the toolbox over an output-error fit of the same log."""
    words, orders, options = TOOLBOX[structure]

    def prepared(folder: Path) -> SpeedRow:
        u, y = signals(2000)
        runs = count()

        def fresh() -> sysid.Record:
            return record(u, y + 1e-9 * next(runs))  # starts are kept for a log that is known

        log = fresh()
        return SpeedRow(
            f"speed/{structure}",
            f"fit of {structure}, {words}, to 2000 samples over its fit by OE(2,2)",
            lambda: sysid.fit(fresh(), sysid.structure(log, structure, orders, options)),
            lambda: sysid.fit(fresh(), "oe", "nb=2 nf=2 nk=1"),
            own_time,
            3,
            2,
        )

    return prepared


def looking(folder: Path) -> SpeedRow:
    """Impulse and frequency responses with their bands over every check of the log."""
    log = record(*signals(2000))
    return SpeedRow(
        "speed/look",
        "look at 2000 samples over inspect of them",
        lambda: sysid.look(log),
        lambda: sysid.inspect(log),
        own_time,
        2,
    )


def cold_fit(folder: Path) -> SpeedRow:
    """The command from a cold start over the imports that nobody who fits can do without."""
    log = str(sysid_datasets.path("prbs"))
    words = ["fit", log, "--structure", "arx", "--orders", "na=2 nb=2 nk=1"]

    def run(code: str, *arguments: str) -> None:
        with tempfile.TemporaryDirectory(dir=folder) as place:
            line = [sys.executable, "-c", code, *arguments]
            subprocess.run(line, cwd=place, check=True, capture_output=True)

    return SpeedRow(
        "speed/cold-fit",
        "the command sysid fit over importing numpy, scipy and pandas",
        lambda: run(COMMAND, *words),
        lambda: run(BARE_IMPORTS),
        time_of_children,
        1,
    )


def mission(folder: Path) -> SpeedRow:
    """Guidance, control and vehicle around a plant over the plant alone."""
    model = sysid.fit(sysid.read_log(sysid_datasets.path("prbs")), "oe", "nb=2 nf=2 nk=1")
    plan = sysid.load_mission(sysid_datasets.path("obstacles_6_3"))
    plant = model.plant()
    samples = len(sysid.simulate(plan, plant).log["t"])
    start, u = plant.initial_state(), np.full(2, 5000.0)
    return SpeedRow(
        "speed/mission",
        f"a mission of {samples} samples over as many bare steps of its plant",
        lambda: sysid.simulate(plan, plant),
        lambda: plain_steps(plant.step, start, u, samples),
        own_time,
        5,
        5,
    )


def diagnosis(folder: Path) -> SpeedRow:
    """A diagnosis, its code compiled before, over an output-error fit of the same log."""
    files = hide(HIDDEN).files
    for name in ("est.csv", "val.csv"):
        (folder / name).write_text(files[name], encoding="utf-8")
    log, held = (sysid.read_log(folder / name) for name in ("est.csv", "val.csv"))
    sysid.diagnose(log, held)
    return SpeedRow(
        "speed/diagnosis",
        "diagnosis of a log of 30 s over its fit by OE(1,1)",
        lambda: sysid.diagnose(log, held),
        lambda: sysid.fit(log, "oe", "nb=1 nf=1 nk=1"),
        own_time,
        1,
        3,
    )


ROWS: Mapping[str, Callable[[Path], SpeedRow]] = {
    "speed/reading": reading,
    "speed/inspect": inspecting,
    "speed/arx": arx,
    "speed/orders": orders,
    **{f"speed/{structure}": iterative(structure) for structure in ITERATIVE},
    **{f"speed/{structure}": beside_oe(structure) for structure in TOOLBOX},
    "speed/look": looking,
    "speed/cold-fit": cold_fit,
    "speed/mission": mission,
    "speed/diagnosis": diagnosis,
}
"""Name → what makes a row ready, given a folder for its files."""
