"""Every odd log of the tests, on several seeds: what inspect, fit and diagnose make of it.

The logs, their truth and what counts as right stand in ``tests/odd_logs``; the tests run one seed
of those that are quick.
"""

import contextlib
import io
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.runner import ROOT, Study, by_case
from sysid.report.markdown import table

sys.path.insert(0, str(ROOT / "tests" / "odd_logs"))

from catalogue import CATALOGUE
from judged import judge

STUDY = Study("odd_logs", "odd_logs.md", runs=5, first=1)

HEAD = """# Odd logs

Logs as strangers write them (`tests/odd_logs/catalogue.py`), {seeds} seeds each, with the first
command a person would type. Right: the commands ended as they should, said what they have to say
and nothing they must not, and every gain lies within 3 % or three standard errors of the truth,
whichever is larger.

"""


def one(name: str, seed: int) -> dict[str, Any]:
    """What is wrong with a log, and the relative errors of its gains."""
    log = next(o for o in CATALOGUE if o.name == name)
    out, err = io.StringIO(), io.StringIO()

    def printed() -> tuple[str, str]:
        texts = (out.getvalue(), err.getvalue())
        for stream in (out, err):
            stream.seek(0)
            stream.truncate()
        return texts

    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        verdict = judge(log, seed, Path(folder), printed)
    gains = [(value - truth) / truth for _, value, _, truth in verdict.gains]
    faults = [f"{name}, seed {seed}: {f.splitlines()[0]}" for f in verdict.faults]
    return {"faults": faults, "gains": gains}


def row(name: str, found: Sequence[dict[str, Any]]) -> list[str]:
    """A line of the report."""
    gains = [abs(g) for f in found for g in f["gains"]]
    right = sum(not f["faults"] for f in found)
    return [name, f"{right} of {len(found)}", f"{100.0 * max(gains):.2f}" if gains else "–"]


def main() -> int:
    """Run all of them and write the table; 1 when any was wrong."""
    asked = STUDY.asked(__doc__)
    found = by_case(one, [o.name for o in CATALOGUE], asked)
    wrong = [fault for some in found.values() for f in some for fault in f["faults"]]
    rows = [row(name, some) for name, some in found.items()]
    text = HEAD.format(seeds=asked.runs) + table(
        ["log", "right", "worst error of a gain [%]"], rows
    )
    if wrong:
        text += "\nWrong:\n\n" + "".join(f"- {w}\n" for w in wrong)
    STUDY.write(asked, text)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
