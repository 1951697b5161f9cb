"""How long a diagnosis takes as a cold command, and how that compares with the runs it needs.

    python benchmarks/bench_diagnose.py [--out FILE]

Logs of 240 s at 20 Hz with two tracks, one hidden effect and a pair, the whole catalogue tried.
Each is diagnosed by the command in a process of its own, first with nothing compiled, then again.
The reference in the same run is `sysid fit` of an output-error model, the quickest cold command
that reads, simulates and judges the same log. Writes ``reports/benchmark_diagnose.md``; ends with 1
when the target is missed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from sysid_datasets.hidden_logs import Request, hide

from sysid.report.markdown import table

REPORT = Path(__file__).resolve().parent.parent / "reports" / "benchmark_diagnose.md"
TARGET = 20.0
"""A cold diagnosis [s]."""

CASES = (
    ("one effect", ("dead-zone",)),
    ("one effect that changes runs by jumps", ("backlash",)),
    ("two effects", ("dead-zone", "cross-coupling")),
    ("nothing", ()),
)


def timed(folder: Path, cache: Path, *arguments: str) -> float:
    """Seconds that a command takes in a process of its own.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    program = "import sys; from sysid_cli.app import main; sys.exit(main())"
    start = perf_counter()
    subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        env={**os.environ, "SYSID_CACHE": str(cache)},
        check=True,
        capture_output=True,
    )
    return perf_counter() - start


def measured(effects: tuple[str, ...], folder: Path) -> tuple[float, float, float]:
    """Seconds of a diagnosis cold and again, and of the reference."""
    for name, text in hide(Request(effects, seed=3, duration=240.0)).files.items():
        (folder / name).write_text(text, encoding="utf-8")
    cache = folder / "cache"
    logs = ("est.csv", "--val", "val.csv")
    cold = timed(folder, cache, "diagnose", *logs, "--workspace", "a")
    again = timed(folder, cache, "diagnose", *logs, "--workspace", "b")
    orders = ("--structure", "oe", "--orders", "nb=1 nf=1 nk=1")
    return cold, again, timed(folder, cache, "fit", *logs, *orders, "--workspace", "c")


def main() -> int:
    """Measure, print, write; 1 where a cold diagnosis takes longer than the target."""
    parser = argparse.ArgumentParser(description="How long a diagnosis takes.")
    parser.add_argument("-o", "--out", type=Path, default=REPORT, metavar="FILE")
    options = parser.parse_args()
    rows, worst = [], 0.0
    for words, effects in CASES:
        with tempfile.TemporaryDirectory() as folder:
            cold, again, fit = measured(effects, Path(folder))
        worst = max(worst, cold)
        rows.append(
            [words, ", ".join(effects) or "–", f"{cold:.1f}", f"{again:.1f}", f"{fit:.1f}",
             f"{cold / fit:.1f}", "yes" if cold < TARGET else "no"]
        )  # fmt: skip
        print(f"{words}: cold {cold:.1f} s, again {again:.1f} s, fit {fit:.1f} s", flush=True)
    head = ["hidden", "effects", "cold [s]", "again [s]", "fit [s]", "cold / fit", "< 20 s"]
    page = f"# Time of a diagnosis\n\n{INTRODUCTION}\n{table(head, rows, 'llrrrrc')}\n"
    options.out.write_text(page, encoding="utf-8")
    from stamps import stamped

    stamped(options.out)
    return int(worst >= TARGET)


INTRODUCTION = f"""Logs of 240 s at 20 Hz, two tracks, the whole catalogue; `make bench` on
{os.cpu_count()} cores. *Cold*: the command in a new process with nothing compiled; *again*:
compiled code kept from the first. *Fit*: `sysid fit` of an output-error model on the same logs, the
least that a command does which reads, simulates and judges them.
"""

if __name__ == "__main__":
    sys.exit(main())
