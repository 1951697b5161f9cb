"""How long a diagnosis takes as a cold command, and how that compares with the runs it needs.

    python benchmarks/bench_diagnose.py [--out FILE]

Logs of 240 s at 20 Hz with two tracks, one hidden effect and a pair, the whole catalogue tried.
Each is diagnosed by the command in a process of its own, first with nothing compiled, then again;
where the seconds of the cold one went stands in a second table.
The reference in the same run is `sysid fit` of an output-error model, the quickest cold command
that reads, simulates and judges the same log. Writes ``reports/benchmark_diagnose.md``; ends with 1
when the target is missed.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from sysid_datasets.hidden_logs import Request, hide

from sysid.report.markdown import foot, table

REPORT = Path(__file__).resolve().parent.parent / "reports" / "benchmark_diagnose.md"
CASES = (
    ("one effect", ("dead-zone",), 8.0),
    ("one effect that changes runs by jumps", ("backlash",), 15.0),
    ("two effects", ("dead-zone", "cross-coupling"), 12.0),
    ("nothing", (), 8.0),
)
"""What is hidden, and the target of a cold diagnosis [s] on a quiet machine of two cores."""

STAGES = ("start", "base", "search", "proof", "page", "rest")

WATCHED = """
import sys
from time import perf_counter
began = perf_counter()
import json, pathlib
from jax import monitoring
from sysid.diagnosis import diagnose as whole
from sysid.report import diagnosis_page as drawing
from sysid_cli.app import main

marks, compiling = [("start", began)], []
run, draw = whole.diagnose, drawing.diagnosis_page

def stage(text, share):
    name = "base" if share < 0.1 else "search" if share < 0.72 else "proof"
    marks.append((name if share < 1.0 else "rest", perf_counter()))

def diagnose(*logs, progress=None, **options):
    return run(*logs, progress=stage, **options)

def page(*a):
    marks.append(("page", perf_counter()))
    try:
        return draw(*a)
    finally:
        marks.append(("rest", perf_counter()))

def noted(event, seconds, **_):
    if event.startswith("/jax/core/compile/"):
        compiling.append(seconds)

monitoring.register_event_duration_secs_listener(noted)
whole.diagnose, drawing.diagnosis_page = diagnose, page
code = 0
try:
    main(sys.argv[2:])
except SystemExit as end:
    code = end.code
marks.append(("end", perf_counter()))
spent = {}
for (name, at), (_, until) in zip(marks, marks[1:]):
    spent[name] = spent.get(name, 0.0) + until - at
pathlib.Path(sys.argv[1]).write_text(json.dumps(spent | {"compiling": sum(compiling)}))
sys.exit(code)
"""
"""The command with a clock at its stages."""


def stages_of(folder: Path, cache: Path, *arguments: str) -> dict[str, float]:
    """Seconds of a command in a process of its own: whole, by stage, and of compiling.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    kept = folder / "stages.json"
    whole = timed(folder, cache, str(kept), *arguments, program=WATCHED)
    found: dict[str, float] = json.loads(kept.read_text(encoding="utf-8"))
    found["start"] += whole - sum(found.get(name, 0.0) for name in STAGES)  # before its first line
    return found | {"whole": whole}


COMMAND = "import sys; from sysid_cli.app import main; sys.exit(main())"


def timed(folder: Path, cache: Path, *arguments: str, program: str = COMMAND) -> float:
    """Seconds that a command takes in a process of its own.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    start = perf_counter()
    subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        env={**os.environ, "SYSID_CACHE": str(cache)},
        check=True,
        capture_output=True,
    )
    return perf_counter() - start


def measured(effects: tuple[str, ...], folder: Path) -> tuple[dict[str, float], float, float]:
    """Seconds of a diagnosis cold, by stage, and again, and of the reference."""
    for name, text in hide(Request(effects, seed=3, duration=240.0)).files.items():
        (folder / name).write_text(text, encoding="utf-8")
    cache = folder / "cache"
    logs = ("est.csv", "--val", "val.csv")
    cold = stages_of(folder, cache, "diagnose", *logs, "--workspace", "a")
    again = timed(folder, cache, "diagnose", *logs, "--workspace", "b")
    orders = ("--structure", "oe", "--orders", "nb=1 nf=1 nk=1")
    return cold, again, timed(folder, cache, "fit", *logs, *orders, "--workspace", "c")


def main() -> int:
    """Measure, print, write; 1 where a cold diagnosis takes longer than the target."""
    parser = argparse.ArgumentParser(description="How long a diagnosis takes.")
    parser.add_argument("-o", "--out", type=Path, default=REPORT, metavar="FILE")
    options = parser.parse_args()
    rows, parts, missed = [], [], 0
    for words, effects, target in CASES:
        with tempfile.TemporaryDirectory() as folder:
            spent, again, fit = measured(effects, Path(folder))
        cold = spent["whole"]
        missed += cold >= target
        rows.append(
            [words, ", ".join(effects) or "–", f"{cold:.1f}", f"{again:.1f}", f"{fit:.1f}",
             f"{cold / fit:.1f}", f"{target:.0f}", "yes" if cold < target else "no"]
        )  # fmt: skip
        shares = [f"{spent.get(name, 0.0):.1f}" for name in (*STAGES, "compiling")]
        parts.append([words, *shares])
        print(f"{words}: cold {cold:.1f} s ({', '.join(shares)}), again {again:.1f} s", flush=True)
    head = ["hidden", "effects", "cold [s]", "again [s]", "fit [s]", "cold / fit", "target [s]", ""]
    page = f"# Time of a diagnosis\n\n{INTRODUCTION}\n{table(head, rows, 'llrrrrrc')}\n"
    page += f"{WHERE}\n{table(['cold [s]', *STAGES, 'compiling'], parts, 'lrrrrrrr')}\n"
    options.out.write_text(page + foot("make bench", "3"), encoding="utf-8")
    return int(missed > 0)


INTRODUCTION = f"""Logs of 240 s at 20 Hz, two tracks, the whole catalogue; `make bench` on
{os.cpu_count()} cores. *Cold*: the command in a new process with nothing compiled; *again*:
compiled code kept from the first. *Fit*: `sysid fit` of an output-error model on the same logs, the
least that a command does which reads, simulates and judges them.
"""

WHERE = """
Where the seconds of the cold command went: *start* is its imports and the reading of the logs,
*base* the model before and whether anything is missing, *search* the naming, *proof* intervals,
gap and what the log could have shown, *page* the pictures, *rest* the models and the files.
*Compiling* is within these, summed over threads.
"""

if __name__ == "__main__":
    sys.exit(main())
