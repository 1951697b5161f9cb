"""Write the pages that chance has no part in: the tour, missions, the thesis, pictures, tables.

    python -m studies.make_reports [NAME ...]

All of them unless some are named. Nothing in these files depends on the place or the load of the
machine, so that a second run changes the date in their last line only. Tables of measured records
are left as they are where the records are not there (see ``measured_records.py``).
"""

import os
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

REPORTS = Path(__file__).resolve().parent.parent / "reports"

WRITERS = {
    "tour": "studies.tour_report",
    "missions": "studies.mission_report",
    "motions": "studies.motion_report",
    "tuning": "studies.tuning_report",
    "thesis": "thesis.report",
    "traps": "studies.trap_report",
    "measured": "studies.measured_report",
    "published": "studies.published_report",
    "methods": "studies.methods_report",
    "lumped": "studies.lumped_report",
}
"""Name → module whose ``write(folder)`` draws pictures there and returns texts by file name."""


def main(names: list[str], folder: Path = REPORTS) -> int:
    """Write the reports asked for, all of them when none is named."""
    unknown = [n for n in names if n not in WRITERS]
    if unknown:
        print(f"no report {unknown[0]!r}; there are {', '.join(WRITERS)}", file=sys.stderr)
        return 2
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"  # before NumPy: sums in another order would be other bytes
    from sysid.report.markdown import foot

    folder.mkdir(exist_ok=True)
    for name in names or WRITERS:
        print(f"{name} …", flush=True)
        texts: Mapping[str, str] = import_module(WRITERS[name]).write(folder)
        for file, text in texts.items():
            last = "" if file.startswith("..") else foot("make reports")
            page = text.rstrip("\n") + "\n" + last
            (folder / file).write_text(page, encoding="utf-8", newline="\n")
        if not texts:
            print("  left as it is: the measured records are not there (see measured_records.py)")
    print(f"Written to {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
