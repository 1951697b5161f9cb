"""Every nonlinear structure on every measured record, by default options.

Each fit runs in a process of its own and is given up after ``--seconds``. Records that are not at
hand are left out, see ``records.py``.
"""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from typing import Any

from studies.attempts import RECORDS, Fitted, attempts, available, fitted
from studies.nonlinear_report import report
from studies.runner import ROOT, Study, finished, restored

STUDY = Study("nonlinear", "nonlinear_structures.md", jobs=1)


def measure(record: str, structure: str, limit: float) -> dict[str, Any]:
    """One fit in a process of its own."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", "studies.nonlinear", "--one", record, structure],
            cwd=ROOT,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            timeout=limit,
            capture_output=True,
            text=True,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return asdict(Fitted(record, structure, error=f"given up after {limit:g} s"))
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return asdict(Fitted(record, structure, error=f"broke down: {last}"))
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def said(f: dict[str, Any]) -> str:
    """A fit in a few words."""
    if f["error"]:
        return str(f["error"])
    figures = ", ".join(f"{k} {v:.4g}" if v is not None else k for k, v in f["tests"].items())
    return f"{figures}; held out {f['held']}; {f['seconds']:.0f} s; {f['chosen']}"


def main() -> None:
    """Run what is missing and write the report."""
    parser = STUDY.parser(__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="for a fit")
    parser.add_argument("--one", nargs=2, metavar=("RECORD", "STRUCTURE"), help="print this fit")
    asked = parser.parse_args()
    if asked.one:
        record, name = asked.one
        print(json.dumps(fitted(next(a for a in attempts(record) if a.structure == name))))
        return
    some = available(a for record in RECORDS for a in attempts(record))
    wanted = {key: (a.record, a.structure, asked.seconds) for key, (a,) in some.items()}
    results: dict[str, list[Fitted]] = {}
    for f in finished(measure, wanted, asked, said).values():
        results.setdefault(f["record"], []).append(Fitted(**restored(f)))
    STUDY.write(asked, report({record: RECORDS[record]() for record in results}, results), "none")


if __name__ == "__main__":
    main()
