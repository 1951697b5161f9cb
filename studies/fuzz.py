"""A hundred thousand wrong inputs to every parser: tracebacks, hangs and memory.

The inputs are those of ``tests/fuzz``: a valid file, text or command line of each kind with one to
four faults, drawn from a seed. The tests try twenty times fewer.
"""

import resource
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.runner import ROOT, Study, finished, seeds
from sysid.report.markdown import table

sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT / "tests" / "fuzz"))

from parsers import PARSERS
from trials import SECONDS, drawn, fault

STUDY = Study("fuzz", "fuzz.md", runs=20)

GIGABYTE = 1024.0**2
"""In the kB that the system counts."""

HEAD = """# Wrong inputs

The parsers got {total} inputs: what is valid, with one to four faults
(`tests/fuzz/mutations.py`). Right: nothing is said, or one sentence of the workbench. Wrong: any
other exception, {seconds:g} s of CPU time, or 1 GB of memory more than before.

"""


def batch(name: str, number: int) -> dict[str, Any]:
    """One batch of a parser: how many inputs, what was wrong with which, and the memory grown."""
    share = PARSERS[name].share
    before = _peak()
    wrong: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(number * share, (number + 1) * share):
            if why := fault(name, drawn(name, seed), Path(folder)):
                wrong.setdefault(why, seed)
    return {"inputs": share, "wrong": wrong, "grown": (_peak() - before) / GIGABYTE}


def _peak() -> float:
    """Largest memory of the process so far [kB]."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def row(name: str, batches: list[Mapping[str, Any]]) -> list[str]:
    """A line of the report."""
    whys = [w for b in batches for w in b["wrong"]]
    hangs = sum(w.startswith("Hang ") for w in whys)
    large = sum(b["grown"] > 1.0 for b in batches)
    inputs = sum(b["inputs"] for b in batches)
    return [name, str(inputs), str(len(whys) - hangs), str(hangs), str(large)]


def main() -> int:
    """Run all batches and write the table; 1 when anything was wrong."""
    asked = STUDY.asked(__doc__)
    wanted = {f"{name}/{k}": (name, k) for k in seeds(asked) for name in PARSERS}
    found = finished(batch, wanted, asked)
    by_name: dict[str, list[Mapping[str, Any]]] = {}
    for key, value in found.items():
        by_name.setdefault(wanted[key][0], []).append(value)
    rows = [row(name, batches) for name, batches in by_name.items()]
    total = sum(int(r[1]) for r in rows)
    text = HEAD.format(total=total, seconds=SECONDS) + table(
        ["parser", "inputs", "tracebacks", "hangs", "beyond 1 GB"], rows, "lrrrr"
    )
    wrong = [
        f"{name}, seed {seed}: {why}"
        for name, batches in by_name.items()
        for b in batches
        for why, seed in b["wrong"].items()
    ]
    text += "\nWrong:\n\n" + "".join(f"- {w}\n" for w in wrong) if wrong else ""
    STUDY.write(asked, text)
    return int(any(cell != "0" for r in rows for cell in r[2:]))


if __name__ == "__main__":
    sys.exit(main())
