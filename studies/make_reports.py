"""Write everything in ``reports/`` that the workbench itself makes: the tour, pictures, tables.

    python benchmarks/make_reports.py [NAME ...]

All of them unless some are named: tour, missions, motions, tuning, thesis, traps, measured,
published, methods, lumped. Nothing in these files depends on the time, the place or the
load of the machine, so a second run writes the same bytes. Tables of measured records are left as
they are where the records are not there (see ``measured_records.py``). The studies of the
statistics, ``coverage.md`` and ``residual_tests.md``, take minutes: ``make study`` writes them.
"""

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from stamps import REPORTS, stamped

Writer = Callable[[Path], Mapping[str, str]]
"""Draws pictures into a folder and returns the texts that belong there by file name."""

NAMES = (
    "tour",
    "missions",
    "motions",
    "tuning",
    "thesis",
    "traps",
    "measured",
    "published",
    "methods",
    "lumped",
)


def writers() -> dict[str, Writer]:
    """The writer of each report; imports NumPy, which must find the number of threads set."""
    import lumped_report
    import measured_report
    import methods_report
    import mission_report
    import motion_report
    import published_report
    import thesis_report
    import tour_report
    import trap_report
    import tuning_report

    modules = (
        tour_report,
        mission_report,
        motion_report,
        tuning_report,
        thesis_report,
        trap_report,
        measured_report,
        published_report,
        methods_report,
        lumped_report,
    )
    return dict(zip(NAMES, (m.write for m in modules), strict=True))


def main(names: list[str], folder: Path = REPORTS) -> int:
    """Write the reports asked for, all of them when none is named."""
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        print(f"no report {unknown[0]!r}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 2
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"  # sums in another order would be other bytes
    folder.mkdir(exist_ok=True)
    every = writers()
    for name in names or NAMES:
        print(f"{name} …", flush=True)
        texts = every[name](folder)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        stamped(*(folder / file for file in texts))
        if not texts:
            print("  left as it is: the measured records are not there (see measured_records.py)")
    print(f"Written to {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
