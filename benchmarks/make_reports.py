"""Write everything in ``reports/`` that the workbench itself makes: the tour, pictures, tables.

    python benchmarks/make_reports.py [tour|missions|measured|published ...]

All of them unless some are named. Nothing in these files depends on the time, the place or the
load of the machine, so a second run writes the same bytes. Tables of measured records are left as
they are where the records are not there (see ``measured_records.py``). The two studies of the
statistics, ``coverage.md`` and ``residual_tests.md``, take minutes and are written by ``make study``.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # before NumPy: sums in another order are other bytes

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import measured_report
import mission_report
import published_report
import tour_report

from sysid.data.files import write_atomic

REPORTS = Path(__file__).resolve().parent.parent / "reports"

Writer = Callable[[Path], Mapping[str, str]]
"""Draws pictures into a folder and returns the texts that belong there by file name."""

WRITERS: dict[str, Writer] = {
    "tour": tour_report.write,
    "missions": mission_report.write,
    "measured": measured_report.write,
    "published": published_report.write,
}


def main(names: list[str], folder: Path = REPORTS) -> int:
    """Write the reports asked for, all of them when none is named."""
    unknown = [n for n in names if n not in WRITERS]
    if unknown:
        print(f"no report {unknown[0]!r}; there are {', '.join(WRITERS)}", file=sys.stderr)
        return 2
    folder.mkdir(exist_ok=True)
    for name in names or WRITERS:
        print(f"{name} …", flush=True)
        texts = WRITERS[name](folder)
        for file, text in texts.items():
            write_atomic(folder / file, text)
        if not texts:
            print(f"  left as it is: {measured_report.MISSING}")
    print(f"Written to {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
