"""Every odd log of the tests, on several seeds: what inspect, fit and diagnose make of it.

    python benchmarks/study_odd_logs.py [seeds] [file]

The logs, their truth and what counts as right stand in ``tests/odd_logs``; the tests run one seed
of those that are quick. Writes ``reports/odd_logs.md``.
"""

import contextlib
import io
import os
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "odd_logs"))

SEEDS = 5

HEAD = """# Odd logs

`python benchmarks/study_odd_logs.py`: logs as strangers write them (`tests/odd_logs/catalogue.py`),
{seeds} seeds each, with the first command a person would type. Right: the commands ended as they
should, said what they have to say and nothing they must not, and every gain lies within 3 % or
three standard errors of the truth, whichever is larger.

"""


def main(seeds: int, target: Path) -> int:
    """Run all of them and write the table; 1 when any was wrong."""
    from catalogue import CATALOGUE
    from judged import judge
    from stamps import stamped

    from sysid.report.markdown import table

    rows, wrong = [], []
    for log in CATALOGUE:
        right, gains = 0, []
        for seed in range(1, seeds + 1):
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                verdict = _quietly(judge, log, seed, Path(folder))
            right += not verdict.faults
            gains += [(value - truth) / truth for _, value, _, truth in verdict.gains]
            wrong += [f"{log.name}, seed {seed}: {f.splitlines()[0]}" for f in verdict.faults]
        worst = f"{100.0 * max(map(abs, gains)):.2f}" if gains else "–"
        rows.append([log.name, f"{right} of {seeds}", worst])
        print(*rows[-1], sep=" | ", flush=True)
    text = HEAD.format(seeds=seeds) + table(["log", "right", "worst error of a gain [%]"], rows)
    if wrong:
        text += "\nWrong:\n\n" + "".join(f"- {w}\n" for w in wrong)
    target.write_text(text, encoding="utf-8", newline="\n")
    stamped(target)
    return 1 if wrong else 0


def _quietly(judge, log, seed, folder):  # type: ignore[no-untyped-def]
    """A verdict, with what the commands print caught for the judge alone."""
    out, err = io.StringIO(), io.StringIO()

    def printed() -> tuple[str, str]:
        texts = (out.getvalue(), err.getvalue())
        for stream in (out, err):
            stream.seek(0)
            stream.truncate()
        return texts

    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        return judge(log, seed, folder, printed)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(
        main(
            int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS,
            Path(sys.argv[2]).resolve() if len(sys.argv) > 2 else ROOT / "reports" / "odd_logs.md",
        )
    )
