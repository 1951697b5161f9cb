"""What the workbench costs beside its arithmetic: memory, imports, cold starts, whole commands.

Each figure is taken in a process of its own. Run as a script this file is that process:

    python benchmarks/footprint.py fit-memory | traced-memory | imports ARGUMENT…
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

NUMERIC = ("numpy", "scipy", "pandas", "pyarrow")
HEAVY = ("jax", "jaxlib", "matplotlib", "sklearn", "pysindy")
LOG = Path(__file__).resolve().parent.parent / "datasets" / "devastator" / "prbs.csv"
COMMAND = (sys.executable, "-m", "sysid_cli.start")
LINEAR_FIT = ("fit", str(LOG), "--structure", "arx", "--orders", "na=2 nb=2 nk=1")
MEGA = 1e6


def memory_of_fit(samples: int) -> dict[str, float]:
    """Peak memory of ARX(4,4,1) above its data in MB: by the system and by tracemalloc."""
    return {
        "resident": _answer("fit-memory", str(samples))["above"],
        "traced": _answer("traced-memory", str(samples))["above"],
    }


def imports_of(*arguments: str) -> dict[str, Any]:
    """Which of the heavy modules a command imports, and how many threads it ends with."""
    return dict(_answer("imports", *arguments))


def seconds_of_command(arguments: tuple[str, ...], runs: int) -> float:
    """Median wall time of a command from a cold start, in a workspace of its own."""
    times = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            _run((*COMMAND, *arguments), folder)
            times.append(time.perf_counter() - start)
    return statistics.median(times)


def _run(line: tuple[str, ...], folder: str | None = None) -> str:
    # the command must cap the threads by itself
    inherited = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.run(line, cwd=folder, env=inherited, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(line)} ended with {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def _answer(*arguments: str) -> Any:
    return json.loads(_run((sys.executable, __file__, *arguments)).splitlines()[-1])


def _measure_memory(samples: int, traced: bool) -> dict[str, float]:
    import tracemalloc

    import numpy as np

    from sysid.data.record import Record
    from sysid.estimation.pem import fit
    from sysid.structures.registry import structure_class

    structure = structure_class("arx").from_orders({"na": 4, "nb": 4, "nk": 1}, 1, 1)
    rng = np.random.default_rng(11)
    small = Record(rng.standard_normal(500), rng.standard_normal(500), 0.1)
    fit(structure, [small])  # what is imported on first use is no part of the fit
    record = Record(rng.standard_normal(samples), rng.standard_normal(samples), 0.1)
    if traced:
        tracemalloc.start()
        fit(structure, [record])
        return {"above": tracemalloc.get_traced_memory()[1] / MEGA}
    before = _resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak of making the data
    fit(structure, [record])
    return {"above": (_resident("VmHWM") - before) / MEGA}


def _resident(name: str) -> float:
    """A line of /proc/self/status in bytes; getrusage would report the parent's peak too."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024.0 * next(int(x.split()[1]) for x in lines if x.startswith(f"{name}:"))


def _measure_imports(arguments: list[str]) -> dict[str, Any]:
    import contextlib
    import io

    from sysid_cli.app import main

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        with contextlib.redirect_stdout(io.StringIO()):
            code = main(arguments)
        threads = len(os.listdir("/proc/self/task"))
    return {
        "code": code,
        "numeric": [m for m in NUMERIC if m in sys.modules],
        "heavy": [m for m in HEAVY if m in sys.modules],
        "threads": threads,
        "cap": os.environ.get("OPENBLAS_NUM_THREADS"),
    }


if __name__ == "__main__":
    what, *rest = sys.argv[1:]
    if what == "imports":
        found: dict[str, Any] = _measure_imports(rest)
    else:
        found = _measure_memory(int(rest[0]), traced=what == "traced-memory")
    print(json.dumps(found))
