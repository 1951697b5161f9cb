"""Does ``sysid.diagnose`` name what is wrong with a machine whose physics is not its formulas?

Each run makes the logs of a case of ``sysid_datasets.physics``, reads them from files as a person
would, and calls the function without any further knowledge. Marks are those of ``diagnose.py``; a
name that the case lists as also right counts as the right one. All suites are some 600 runs, three
hours on two quiet cores; the page tells of those that are done (``--limit``, ``--results``). Seeds
from 10000 on judge, once: no rule may be set on them.
"""

import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

from sysid_datasets.physics.logs import make, write
from sysid_datasets.physics.suites import FRESH, case

from studies.diagnose_scores import (
    SAMPLES_ONLY,
    Outcome,
    confusion,
    failures,
    matched,
    share_closed,
)
from studies.runner import Study, finished, restored
from sysid.report.markdown import table

BELIEVED = 3.0
"""Standard errors within which a stated number should be."""

SHOWN = 1.0
"""Error of the best plain line over the noise from which an effect is called visible."""

WHOLE = {
    "singles": 160,
    "small": 60,
    "nothing": 170,
    "pairs": 80,
    "triples": 48,
    "realistic": 3,
    "machines": 60,
    "outside": 40,
}
"""Runs of each suite in a whole study."""

STUDY = Study("physics_diagnose", "physics_diagnose.md", runs=max(WHOLE.values()), first=FRESH)

HIDES_NOTHING = frozenset({"nothing", "outside"})


@dataclass(frozen=True)
class Run(Outcome):
    """An outcome of ``diagnose.py``, and what only this study asks.

    Attributes:
        said: the names as they were given, ties joined by ``=``.
        visible: error of the best plain line over the noise, of the reading where it is largest.
        believed, stated: numbers with a true value that were within ``BELIEVED`` standard errors,
            and how many there were.
        wrong_numbers: the others, in words.
        shown: of several causes those that show by ``SHOWN`` beside the others.
    """

    said: tuple[str, ...] = ()
    visible: float = 0.0
    believed: int = 0
    stated: int = 0
    wrong_numbers: tuple[str, ...] = field(default=())
    shown: tuple[str, ...] = ()

    @property
    def all_right(self) -> bool:
        """Whether each cause that shows has an entry of its own."""
        asked = self.shown or self.truth
        return matched(asked, self.entries) == len(asked)


def run(suite: str, seed: int) -> Run:
    """One blind run."""
    made = case(suite, seed)
    plain = Run(
        made.key, suite, made.noise, tuple(dict.fromkeys(h.id for h in made.hidden))
    )  # fmt: skip
    start = time.perf_counter()
    try:
        logs = make(made)
        with tempfile.TemporaryDirectory() as folder:
            *_, told = write(logs, Path(folder))
            truth = json.loads(told.read_text(encoding="utf-8"))
            told.unlink()
            start = time.perf_counter()
            answer = diagnose(Path(folder) / "est.csv", Path(folder) / "val.csv", made.rig.lengths)
        found = marked(plain, truth, answer)
    except Exception as error:  # a study goes on whatever one run does
        found = replace(plain, error=f"{type(error).__name__}: {error}".splitlines()[0][:200])
    return replace(found, seconds=round(time.perf_counter() - start, 1))


def diagnose(est: Path, val: Path, lengths: tuple[float, float] | None) -> dict[str, Any]:
    """What a script gets that knows radius and width of a robot by its drawing, nothing else.

    Rows of a slow sensor are kept, as the command ``sysid diagnose`` keeps them.
    """
    import sysid
    from sysid.vehicle.kinematics import Geometry

    geometry = None if lengths is None else Geometry(*lengths)
    kept = sysid.ReadOptions(held="keep")
    records = sysid.read_log(est, kept), sysid.read_log(val, kept)
    return sysid.diagnose(*records, geometry=geometry).to_json()


def marked(plain: Run, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Run:
    """The outcome of an answer, names that are also right put in the place of the right ones."""
    entries = [(e["id"], *e["indistinguishable"]) for e in answer["effects"]]
    gap = answer["gap"] or {}
    channels = list((gap.get("channels") or {}).values())
    floors = truth["floor"]["val"]
    sizes = [*truth["excess"], *truth["pose_excess"]]
    noises = [*floors, *truth["pose_floor"]]
    pairs = [(v, s) for v, s in zip(sizes, noises, strict=True) if s > 0.0]
    believed, wrong = _numbers(truth["hidden"], answer["effects"], truth["full_drive"][0])
    return replace(
        plain,
        verdict=answer["verdict"],
        entries=translated(truth["hidden"], entries),
        closed=gap.get("closed_percent"),
        closed_true=_closed(channels, floors),
        said=tuple("=".join(e) for e in entries),
        visible=round(max((v / s for v, s in pairs), default=0.0), 2),
        believed=believed,
        stated=believed + len(wrong),
        wrong_numbers=tuple(wrong),
        shown=_shown(truth),
    )


def _shown(truth: Mapping[str, Any]) -> tuple[str, ...]:
    """Of several causes, those that show beside the others; what is seen in samples always.

    Two for which either name is right (another motor constant, another friction turning backward)
    make one curve together, so that nobody can ask for two entries.
    """
    pairs = zip(truth["hidden"], truth["shows"], strict=False)
    kept: list[Mapping[str, Any]] = []
    for h in (h for h, size in pairs if size is None or size >= SHOWN):
        if not any(h["id"] in k["also"] and k["id"] in h["also"] for k in kept):
            kept.append(h)
    return tuple(dict.fromkeys(h["id"] for h in kept))


def translated(
    hidden: Sequence[Mapping[str, Any]], entries: Sequence[tuple[str, ...]]
) -> tuple[tuple[str, ...], ...]:
    """Entries in which a name that is also right for a cause is followed by the cause's own.

    A second name that is right for a cause that has been named is left out: it is not false.
    """
    open_causes = list(hidden)
    kept = []
    for entry in entries:
        own = (h for h in open_causes if h["id"] in entry)
        alike = (h for h in open_causes if set(h["also"]) & set(entry))
        mine = next(chain(own, alike), None)
        if mine is not None:
            open_causes.remove(mine)
            kept.append(tuple(dict.fromkeys((*entry, mine["id"]))))
        elif not any({h["id"], *h["also"]} & set(entry) for h in hidden):
            kept.append(entry)
    return tuple(kept)


def report(runs: Sequence[Run]) -> str:
    """The page."""
    shown = [r for r in runs if r.visible >= SHOWN or r.group in HIDES_NOTHING]
    return "\n".join(
        [
            HEAD.format(runs=len(runs)),
            summary(runs),
            "## By hidden effect\n\nLogs with one cause; *noise*: error of the best plain line "
            "over it.\n",
            by_cause(runs),
            "## Confusion matrix\n\nA row is what was hidden, a column what was named first. Only "
            "logs in which it shows: the best plain line misses by the noise or more.\n",
            confusion(shown),
            "## Every run that was not right\n",
            failures(runs),
            "## Numbers beyond three standard errors\n",
            "\n".join(f"- {r.key}: {w}" for r in runs for w in r.wrong_numbers) or "None.",
            "",
        ]
    )


def by_cause(runs: Sequence[Run]) -> str:
    """Per effect: what was said of each log, with how far it shows."""
    rows = []
    one = [r for r in runs if len(r.truth) == 1]
    for effect in dict.fromkeys(r.truth[0] for r in one):
        some = sorted((r for r in one if r.truth[0] == effect), key=lambda r: r.visible)
        said = "; ".join(f"{', '.join(r.said) or r.verdict or 'failed'}" for r in some)
        noise = ", ".join(f"{r.visible:.1f}" for r in some)
        rows.append([f"`{effect}`", f"{sum(r.right for r in some)}/{len(some)}", noise, said])
    return table(["effect", "right first", "noise", "said"], rows, "lrll")


def summary(runs: Sequence[Run]) -> str:
    """Marks of each suite, all its logs and those in which the effect shows."""
    rows = []
    for suite in dict.fromkeys(r.group for r in runs):
        some = [r for r in runs if r.group == suite]
        for name, part in ((suite, some), ("of them visible", _visible(some))):
            if name != suite and (suite in HIDES_NOTHING or len(part) == len(some)):
                continue
            rows.append([name, str(len(part)), *_marks(part)])
    headers = ["suite", "runs", "right first", "all right", "no name", "false names"]
    return table([*headers, "gap closed", "numbers", "failed", "median s"], rows, "l" + "r" * 9)


def _marks(some: Sequence[Run]) -> list[str]:
    gaps = sorted(
        r.closed_true
        for r in some
        if r.right and r.closed_true is not None and not set(r.shown or r.truth) <= SAMPLES_ONLY
    )
    hides = [r for r in some if r.truth]
    stated = sum(r.stated for r in some)
    seconds = sorted(r.seconds for r in some)
    return [
        f"{sum(r.right for r in hides)}/{len(hides)}" if hides else "–",
        f"{sum(r.all_right for r in hides)}/{len(hides)}" if hides else "–",
        str(sum(not r.entries for r in some)),
        str(sum(r.false_names for r in some)),
        f"{gaps[len(gaps) // 2]:.0f} / {gaps[0]:.0f} %" if gaps else "–",
        f"{sum(r.believed for r in some)}/{stated}" if stated else "–",
        str(sum(bool(r.error) for r in some)),
        f"{seconds[len(seconds) // 2]:.0f}" if seconds else "–",
    ]


def one(suite: str, seed: int) -> dict[str, Any]:
    """One blind run as JSON."""
    return asdict(run(suite, seed))


def said(found: Mapping[str, Any]) -> str:
    """What a run gave in a few words."""
    names = found["error"] or ", ".join(found["said"]) or found["verdict"]
    hidden = "+".join(found["truth"])
    return f"{hidden} ({found['visible']} of the noise): {names} ({found['seconds']:.0f} s)"


def main(words: list[str] | None = None) -> int:
    """Run the study and write its report; 1 if a run had no answer."""
    asked = STUDY.asked(__doc__, words)
    runs_of = {suite: min(n, asked.runs) for suite, n in WHOLE.items()}
    wanted = {f"{s}-{k}": (s, k) for s, k in interleaved(runs_of, asked.first)}
    runs = [Run(**restored(f)) for f in finished(one, wanted, asked, said).values()]
    runs = sorted(runs, key=lambda r: (list(runs_of).index(r.group), r.key))
    done = {s: [k for suite, k in map(_place, runs) if suite == s] for s in runs_of}
    seeds = "; ".join(f"{s} {min(k)} to {max(k)}" for s, k in done.items() if k)
    STUDY.write(asked, report(runs), seeds)
    return int(any(r.error for r in runs))


def interleaved(runs_of: Mapping[str, int], first: int) -> list[tuple[str, int]]:
    """(suite, seed) of all runs, each suite spread evenly: whenever it stops, all have their share.

    Args:
        runs_of: runs of each suite.
        first: seed of each suite's first run.
    """
    places = [((k + 0.5) / n, suite, first + k) for suite, n in runs_of.items() for k in range(n)]
    return [(suite, seed) for _, suite, seed in sorted(places)]


def _place(run: Run) -> tuple[str, int]:
    suite, _, seed = run.key.rpartition("-")
    return suite, int(seed)


def _numbers(
    hidden: Sequence[Mapping[str, Any]], effects: Sequence[Mapping[str, Any]], full_drive: float
) -> tuple[int, list[str]]:
    """How many stated numbers with a true value are believed, and the others in words."""
    believed, wrong = 0, []
    for e in effects:
        names = {e["id"], *e["indistinguishable"]}
        if len([h for h in hidden if h["id"] in names]) > 1:
            continue  # a tie of two that are both there: its number is that of both together
        mine = next((h for h in hidden if e["id"] in (h["id"], *h["also"])), None)
        for p in e["parameters"] if mine is not None else ():
            told = mine["same_meaning"]
            true = told.get(p["name"], told.get(p["name"].partition("[")[0]))
            if true is None or p["value"] is None or not p["std_error"]:
                continue
            value, error = _of_full_drive(p, full_drive)
            off = max(abs(abs(value) - abs(true)) - mine["spread"] * abs(true), 0.0)
            if off <= BELIEVED * error:
                believed += 1
            else:
                said = f"{p['name']} {value:.4g} ± {error:.2g}"
                wrong.append(f"{e['id']}: {said}, in truth {true:.4g}")
    return believed, wrong


def _of_full_drive(p: Mapping[str, Any], full_drive: float) -> tuple[float, float]:
    """Value and standard error of a number, shares of the log's largest command as shares of full
    drive, which no log of a motor in volts tells.

    Args:
        p: a parameter of an answer.
        full_drive: in the unit of the file.
    """
    told = p.get("in_file")
    if told is None:
        return p["value"], p["std_error"]
    factor = full_drive if p["unit"].startswith("1/") else 1.0 / full_drive
    return factor * told["value"], factor * told["std_error"]


def _closed(channels: Sequence[Mapping[str, float]], floors: Sequence[float]) -> float | None:
    """Share of the gap that is closed [%]; None where not all channels have a true floor."""
    if len(channels) != len(floors):
        return None
    pairs = zip(channels, floors, strict=True)
    return share_closed([(c["rmse_before"], c["rmse_after"], f) for c, f in pairs])


def _visible(some: Sequence[Run]) -> list[Run]:
    return [r for r in some if r.visible >= SHOWN]


HEAD = """# What `sysid.diagnose` says of machines simulated from physics

{runs} blind runs on logs of the physics twin (`datasets/physics`), whose circuits, contacts and
encoders were written without looking at any formula of the catalogue. *Visible*: the best plain
line misses by the noise or more. *Right first*: a hidden cause stands first, alone or in a reported
tie; *all right*: each cause that changes a reading by the noise or more beside the others has an
entry of its own; *gap closed*: median / worst of what the true model closes, of runs that were
right; *numbers*: stated numbers with a known true value that are within three standard errors. What
coarse readings are rounded by counts as gap, which no model closes. Seeds below 10000 are for
development.
"""

if __name__ == "__main__":
    sys.exit(main())
