"""The four commands in a row on every bundled log, with default options and by every criterion.

One fit a log (judged on the log of the same kind), then for each criterion compare, export and
simulate, as a person types them. Ends with 1 when a command failed, or when a model leads with a
doubt that nobody mentioned.
"""

import contextlib
import io
import json
import sys
import tempfile
from typing import Any

from sysid_datasets import path

from studies.runner import Study, finished
from sysid.criteria.table import BUILT_IN
from sysid.report.markdown import table

STUDY = Study("tours", "tours.md")

LOGS = ("forward_back", "rotation", "multilevel", "prbs", "multisine")

MISSION = "obstacles_6_3"

HEAD = """# Tours

`sysid fit LOG --val LOG_val`, then for every criterion
`sysid compare --criterion …`, `sysid export`, `sysid simulate {mission}.yaml`, all with default
options. Doubts: what the commands say about a leading model that does not settle within the log or
whose search was given up.

"""


def one(log: str) -> list[list[str]]:
    """The tours of a log: a row a criterion; the last cell holds a doubt that nobody mentioned."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = ["--workspace", folder]
        _run("fit", path(log), "--val", path(f"{log}_val"), *place, "--json")
        for criterion in BUILT_IN:
            ranking = _run("compare", "--criterion", criterion, *place, "--json")
            best = ranking["best"]
            (line,) = [x for x in ranking["ranking"] if x["model"] == best]
            said = any(best in note for note in ranking["notes"])
            plant = _run("export", *place, "--json")
            drive = _run("simulate", path(MISSION), *place, "--json")
            rows.append(
                [
                    f"{log}.csv",
                    criterion,
                    best.rpartition("-")[0],
                    ", ".join(f"{v:.4g}" for v in line["fit_percent"].values()),
                    "; ".join(line["doubts"]) or "–",
                    f"{plant['selftest']['max_error']:.0e}",
                    f"{drive['outcome']}, {drive['time_s']:.4g} s",
                    "" if said else "; ".join(line["doubts"]),
                ]
            )
    return rows


def main() -> int:
    """Walk all tours and write the table."""
    asked = STUDY.asked(__doc__)
    rows = [
        r for some in finished(one, {log: (log,) for log in LOGS}, asked).values() for r in some
    ]
    heads = ["log", "criterion", "best", "free run %", "doubts, said", "self-test", "mission"]
    text = HEAD.format(mission=MISSION) + table(heads, [r[:-1] for r in rows])
    STUDY.write(asked, text, "none")
    return int(any(r[-1] for r in rows))


def _run(*arguments: object) -> Any:
    """The document a command prints."""
    from sysid_cli.app import main as sysid

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = sysid([str(a) for a in arguments])
    if code != 0:
        raise SystemExit(f"sysid {' '.join(map(str, arguments))}: {err.getvalue()}")
    return json.loads(out.getvalue())


if __name__ == "__main__":
    sys.exit(main())
