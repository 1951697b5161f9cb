"""The four commands in a row on every bundled log, with default options and by every criterion.

    python benchmarks/study_tour.py [file]

One fit a log (judged on the log of the same kind), then for each criterion compare, export and
simulate, as a person types them. Writes ``reports/tours.md``; ends with 1 when a command failed, or
when a model leads with a doubt that nobody mentioned.
"""

import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

LOGS = ("forward_back", "rotation", "multilevel", "prbs", "multisine")

MISSION = "obstacles_6_3"

HEAD = """# Tours

`python benchmarks/study_tour.py`: `sysid fit LOG --val LOG_val`, then for every criterion
`sysid compare --criteria …`, `sysid export`, `sysid simulate {mission}.yaml`, all with default
options. Doubts: what the commands say about a leading model that does not settle within the log or
whose search was given up.

"""


def main(target: Path) -> int:
    """Walk all tours and write the table."""
    from stamps import stamped
    from sysid_datasets import path

    from sysid.criteria.table import BUILT_IN
    from sysid.report.markdown import table

    rows, failed = [], 0
    for log in LOGS:
        with tempfile.TemporaryDirectory() as folder:
            place = ["--workspace", folder]
            fit = _run("fit", path(log), "--val", path(f"{log}_val"), *place, "--json")
            for criterion in BUILT_IN:
                ranking = _run("compare", "--criteria", criterion, *place, "--json")
                best = ranking["best"]
                (line,) = [x for x in ranking["ranking"] if x["model"] == best]
                said = any(best in note for note in ranking["notes"])
                failed += bool(line["doubts"]) and not said
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
                    ]
                )
                print(*rows[-1], sep=" | ", flush=True)
            assert fit["models"]
    heads = ["log", "criterion", "best", "free run %", "doubts, said", "self-test", "mission"]
    text = HEAD.format(mission=MISSION) + table(heads, rows)
    target.write_text(text, encoding="utf-8", newline="\n")
    stamped(target)
    return 1 if failed else 0


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
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "reports" / "tours.md"))
