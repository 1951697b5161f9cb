"""Public benchmarks under their official windows: free-run errors beside published figures.

Each record is split as its benchmark says; the first samples of a test (CED 10, cascaded tanks 50,
EMPS 20, others 50) may set the initial state and are not counted. Orders and everything else are
chosen on the training part. Six minutes of one core.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from studies.attempts import Attempt, Fitted, available, fitted, number
from studies.records import TRIALS, Trial
from studies.runner import Study, finished, restored
from sysid.report.markdown import table

STUDY = Study("public_benchmarks", "public_benchmarks.md", jobs=1)

WINDOWS = {"ced-low": 10, "ced-high": 10, "tanks": 50, "silverbox": 50, "emps": 20}
"""Samples at the head of a test that set the initial state (nonlinear_benchmarks 1.0)."""

PUBLISHED: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("ced-low", "low"): (".224", ".100", ".096"),
    ("ced-high", "high"): (".384", ".141", ".074"),
    ("tanks", "val"): (".588", ".413", ".191"),
    ("silverbox", "multisine"): ("6.96", ".640", ".26"),
    ("silverbox", "arrow"): ("14.4", "2.25", ".26"),
    ("emps", "last quarter"): ("5.53", "5.17", "2.64"),
}
"""Linear state space, polynomial NARX, and the best published (Champneys et al., arXiv 2405.10779
v1; of EMPS those on the official test record, which is not at hand)."""

NONLINEAR = {
    "ced-low": "hammerstein-wiener",
    "ced-high": "hammerstein-wiener",
    "tanks": "tanks",
    "silverbox": "narmax",
    "emps": "dc-motor",
}
"""What the hold-out within the training part chose in nonlinear_structures.md, or the rig's own
grey box."""

HEAD = """# Public benchmarks

Free-run RMSE on the test part under the official windows: the first samples of a test (CED 10,
cascaded tanks 50, EMPS 20, Silverbox 50) set the initial state and are not counted. Orders are
searched on the training part alone; *n* counts estimated numbers, *s* processor seconds of search
and fit. `linear` is what `sysid fit` puts first among ARX, ARMAX, OE and BJ. Published: linear
state space, polynomial NARX, and the best one (Champneys et al., arXiv 2405.10779 v1, and what it
lists).

The official test record of EMPS is not at hand: ours is the last quarter of the training record,
the published figures are those on the official one, so that the two do not compare.

"""


def official(name: str) -> Callable[[], Trial]:
    """The trial with its official window."""
    return lambda: replace(TRIALS[name](), skip=WINDOWS[name])


def wanted() -> list[Attempt]:
    """A linear model, one in state space, and a nonlinear one of each record."""
    some = []
    for name in WINDOWS:
        nonlinear = NONLINEAR[name]
        options = {"output": "position"} if nonlinear == "dc-motor" and name == "emps" else {}
        some += [
            Attempt(name, "linear"),
            Attempt(name, "ss"),
            Attempt(name, nonlinear, options=options),
        ]
    return some


def page(found: Iterable[Fitted]) -> str:
    """One row a model and test."""
    rows = []
    for f in found:
        trial = TRIALS[f.record]()
        for test in f.tests or trial.tests:
            head = [trial.name, test]
            published = PUBLISHED[f.record, test]
            if f.error:
                rows.append([*head, f"{f.structure}: {f.error}", "–", "–", *published, "–"])
                continue
            seconds = f"{f.seconds:.1f}" if f.seconds else "–"
            error = f"{number(f.tests[test])} {trial.unit}"
            rows.append([*head, f.chosen, str(f.n), error, *published, seconds])
    heads = ["record", "test", "model", "n", "RMSE", "published: linear", "NARX", "best", "s"]
    return table(heads, rows, "lllrrrrrr")


def main(words: Sequence[str] | None = None) -> None:
    """Run what is not yet there and write the page."""
    asked = STUDY.asked(__doc__, words)
    results = finished(judged, available(wanted()), asked)
    STUDY.write(asked, HEAD + page(Fitted(**restored(r)) for r in results.values()), "none")


def judged(attempt: Attempt) -> dict[str, object]:
    """The attempt under the official window."""
    return fitted(attempt, official(attempt.record)())


if __name__ == "__main__":
    main()
