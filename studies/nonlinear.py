"""Every nonlinear structure on every measured record, into ``reports/nonlinear_structures.md``.

    python benchmarks/study_nonlinear.py [RECORD ...] [--again NAME ...] [--limit SECONDS]

Each fit runs in a process of its own, one at a time, and is given up after the limit. Results are
kept in ``.study-cache/``, so that a second call only runs what is missing; ``--again`` forgets
records or structures of these names first (``all`` for everything). Records that are not at hand
are left out, see ``records.py``.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from nonlinear_fits import RECORDS, Fitted, fitted, structures
from nonlinear_report import report
from records import ROOT, Trial, data_folder

from sysid.data.files import write_atomic

CACHE = ROOT / ".study-cache" / "nonlinear"
REPORT = ROOT / "reports" / "nonlinear_structures.md"
LIMIT = 600.0
BUNDLED = ("robot", "circuit")
"""Records that need no folder of measured ones."""


def kept(record: str, name: str) -> Path:
    """Where the result of one fit is kept."""
    return CACHE / record / f"{name}.json"


def load(record: str, name: str) -> Fitted | None:
    """A result that is kept, None where there is none."""
    path = kept(record, name)
    if not path.is_file():
        return None
    return Fitted(**json.loads(path.read_text(encoding="utf-8")))


def store(result: Fitted) -> None:
    """Keep a result."""
    path = kept(result.record, result.structure)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, json.dumps(result.to_json(), indent=1, ensure_ascii=False) + "\n")


def measure(record: str, name: str, limit: float) -> Fitted:
    """One fit in a process of its own."""
    command = [sys.executable, __file__, "--one", record, name]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, env=environment, timeout=limit, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return Fitted(record, name, error=f"given up after {limit:g} s")
    found = None if done.returncode else load(record, name)
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return found or Fitted(record, name, error=f"broke down: {last}")


def forget(names: Sequence[str], records: Sequence[str]) -> None:
    """Drop the kept results of these records or structures."""
    for record in records:
        for name in structures(record):
            if {"all", record, name} & set(names):
                kept(record, name).unlink(missing_ok=True)


def main(arguments: Sequence[str]) -> int:
    """Run what is missing and write the report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("records", nargs="*", metavar="RECORD", help=", ".join(RECORDS))
    parser.add_argument("--again", nargs="+", default=(), metavar="NAME")
    parser.add_argument("--limit", type=float, default=LIMIT, metavar="SECONDS")
    parser.add_argument("--one", nargs=2, metavar=("RECORD", "STRUCTURE"), help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    if asked.one:
        store(fitted(*asked.one))
        return 0
    known = [r for r in RECORDS if data_folder() is not None or r in BUNDLED]
    unknown = [r for r in asked.records if r not in known]
    if unknown:
        parser.error(f"no record {', '.join(unknown)}; there are {', '.join(known)}")
    wanted = asked.records or known
    forget(asked.again, wanted)
    for record in wanted:
        for name in structures(record):
            if load(record, name) is None:
                result = measure(record, name, asked.limit)
                store(result)
                print(f"{record:10s} {name:20s} {_line(result)}", flush=True)
    write_atomic(REPORT, page(known))
    from stamps import stamped

    stamped(REPORT)
    print(f"Written to {REPORT}")
    return 0


def page(records: Sequence[str]) -> str:
    """The report on all that is kept."""
    trials: dict[str, Trial] = {}
    results: dict[str, list[Fitted]] = {}
    for record in records:
        found = [load(record, name) for name in structures(record)]
        if any(found):
            trials[record] = RECORDS[record]()
            results[record] = [
                f or Fitted(record, name, error="not run")
                for f, name in zip(found, structures(record), strict=True)
            ]
    return report(trials, results)


def _line(f: Fitted) -> str:
    if f.error:
        return f.error
    figures = ", ".join(f"{k} {v:.4g}" if v is not None else k for k, v in f.tests.items())
    return f"{figures}; held out {f.held}; {f.seconds:.0f} s; {f.chosen}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
