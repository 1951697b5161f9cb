"""Does the log of the proposed next experiment resolve the tie that it was proposed for?

For each tie of the catalogue and each of its two effects that ``sysid_datasets.physics`` has a
cause of: a machine with that cause is driven and diagnosed; the schedule that the diagnosis
proposes for the tie is driven on the same machine; both logs are diagnosed together. The pair is
*resolved* when the true effect is named, first and without its rival in a tie.

Seeds from 10000 on judge, once: no rule may be set on them. ``--only A=B`` runs one tie.
"""

import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sysid_datasets.physics import logs
from sysid_datasets.physics.causes import CAUSES
from sysid_datasets.physics.suites import FRESH, tied

import sysid
from studies.runner import Study, finished, restored, seeds
from sysid.effects.catalogue import about, catalogue
from sysid.report.markdown import table
from sysid.vehicle.kinematics import Geometry

STUDY = Study("ties", "ties.md", runs=7, first=FRESH)

SHOWN = 2.0
"""Error of the best plain line over the noise that the first log of a machine must show: twice
what a person sees."""

TRIED = 40
"""Machines that are drawn at most until one shows its effect."""

INSEPARABLE = {
    frozenset({"actuator-lag", "sensor-lag"}): "Two lags in a row commute: whichever comes first, "
    "every command gives the same readings from a machine that is linear between them.",
    frozenset({"load-bias", "sensor-bias"}): "On a machine without dry friction a constant load "
    "and a zero point shift every reading alike, whatever is commanded, and the speed at which a "
    "log begins is read off it.",
}
"""Ties that no command resolves on a linear machine, and why."""


@dataclass(frozen=True)
class Run:
    """One machine, before and after the log of the proposed experiment.

    Attributes:
        tie, truth, seed: which.
        cause: what is hidden physically.
        right: names that are right for it, without the rival.
        visible: error of the best plain line over the noise in the first log.
        first, both: what was named from the first log and from both, ties joined by ``=``.
        proposed: whether the diagnosis of the first log proposed the experiment; else it saw no
            tie, and the experiment is the first that the catalogue lists for the true effect.
        by_hand: whether the diagnosis said that no command helps, and what does.
        seconds: of both diagnoses.
        error: why there is no answer, else empty.
    """

    tie: tuple[str, str]
    truth: str
    seed: int
    cause: str = ""
    right: tuple[str, ...] = ()
    visible: float = 0.0
    first: tuple[str, ...] = ()
    both: tuple[str, ...] = ()
    proposed: bool = False
    by_hand: bool = False
    seconds: float = 0.0
    error: str = ""

    @property
    def key(self) -> str:
        """A name that no other run has."""
        return f"{'='.join(self.tie)}/{self.truth}-{self.seed}"

    @property
    def alone_before(self) -> bool:
        """Whether the first log names the true one alone."""
        return self._is_right(self.first)

    @property
    def tied_before(self) -> bool:
        """Whether the first log left the tie open."""
        return any(set(self.tie) <= set(entry.split("=")) for entry in self.first)

    @property
    def alone(self) -> bool:
        """Whether both logs name the true one, first and alone."""
        return self._is_right(self.both)

    def _is_right(self, named: Sequence[str]) -> bool:
        """Whether the first name, and what it cannot be told from, are all right."""
        return bool(named) and set(named[0].split("=")) <= {self.truth, *self.right}

    @property
    def others(self) -> int:
        """Further names, in both logs."""
        return max(len(self.both) - 1, 0)


def ties() -> list[tuple[str, str]]:
    """Pairs of the catalogue, each once."""
    found = {tuple(sorted((e.id, t))) for e in catalogue().values() for t in e.hints.ties}
    return sorted((a, b) for a, b in found)


def run(tie: tuple[str, str], truth: str, seed: int) -> Run:
    """One machine: first log, proposed experiment, both."""
    rival = next(t for t in tie if t != truth)
    plain = Run(tie, truth, seed)
    start = time.perf_counter()
    try:
        made, first, visible = _shown(truth, rival, seed)
        (hidden,) = made.hidden
        right = tuple(name for name in (hidden.id, *hidden.also) if name != rival)
        found = replace(plain, cause=hidden.cause, right=right, visible=round(visible, 1))
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / "first.csv", Path(folder) / "next.csv"]
            answer = _diagnosed(made, paths[:1], [first])
            rows, proposed = _schedule(answer, tie, truth, first)
            hand = any(set(tie) <= set(e["effects"]) for e in _by_hand(answer))
            wanted = _sampled(rows, 1.0 / made.rig.telemetry.rate)
            both = _diagnosed(made, paths, [first, logs.driven(made, 3, wanted)])
        found = replace(found, first=_named(answer), both=_named(both))
        found = replace(found, proposed=proposed, by_hand=hand)
    except Exception as error:  # a study goes on whatever one run does
        found = replace(plain, error=f"{type(error).__name__}: {error}".splitlines()[0][:200])
    return replace(found, seconds=round(time.perf_counter() - start, 1))


def _shown(truth: str, rival: str, seed: int) -> tuple[logs.Case, logs.Log, float]:
    """The first machine of a seed whose first log shows the effect."""
    for k in range(TRIED):
        made = tied(truth, rival, seed * TRIED + k)
        first = logs.first_log(made)
        size = visible(made, first)
        if size >= SHOWN:
            return made, first, size
    raise RuntimeError(f"none of {TRIED} machines shows {truth}")


def visible(case: logs.Case, log: logs.Log) -> float:
    """Error of the best plain line over the noise, of the reading where it is largest."""
    sizes = list(zip(logs.excess(log), logs.floor(log), strict=True))
    if log.pose is not None and case.rig.pose is not None:
        noises = logs.pose_floor(case.rig.pose)
        sizes = list(
            zip(logs.pose_excess(log, case.rig.lengths or (1.0, 1.0)), noises, strict=True)
        )
    return max(v / s for v, s in sizes)


def _diagnosed(made: logs.Case, paths: Sequence[Path], some: Sequence[logs.Log]) -> dict[str, Any]:
    """What a person gets who knows nothing but the drawing of the robot."""
    for path, log in zip(paths, some, strict=True):
        path.write_text(logs.csv_of(log, made.columns or logs.ROBOT), encoding="ascii")
    lengths = made.rig.lengths
    records = [sysid.read_log(p, sysid.ReadOptions(held="keep")) for p in paths]
    geometry = None if lengths is None else Geometry(*lengths)
    return sysid.diagnose(records, geometry=geometry).to_json()


def _named(answer: dict[str, Any]) -> tuple[str, ...]:
    return tuple("=".join((e["id"], *e["indistinguishable"])) for e in answer["effects"])


def _by_hand(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """What the diagnosis says that no command tells apart."""
    return [e for e in answer["next_experiments"] if not e["schedule"]]


def _schedule(
    answer: dict[str, Any], tie: tuple[str, str], truth: str, log: logs.Log
) -> tuple[Sequence[Sequence[float]], bool]:
    """The schedule for the tie (time [s], shares of full drive), and whether it was proposed."""
    for e in answer["next_experiments"]:
        for_tie = set(tie) <= set(e["effects"]) and e["purpose"].startswith("To tell")
        if for_tie and e["schedule"]:
            return [(row[0], *(v / logs.FULL for v in row[1:])) for row in e["schedule"]], True
    largest = float(np.max(np.abs(log.command))) / logs.FULL
    rows = about(truth).hints.programmes[0].rows
    return [(t, *(v * largest for v in shares)) for t, *shares in rows], False


def _sampled(rows: Sequence[Sequence[float]], dt: float) -> NDArray[np.float64]:
    """A schedule at a sample time, (N, drives)."""
    t = dt * np.arange(int(np.ceil(rows[-1][0] / dt)) + 1)
    at = np.searchsorted([r[0] for r in rows], t + 1e-9, side="right") - 1
    return np.array([r[1:] for r in rows], dtype=np.float64)[at]


def report(runs: Sequence[Run]) -> str:
    """The page."""
    open_ties = "\n".join(_open_tie(sorted(t), why) for t, why in INSEPARABLE.items())
    return "\n".join(
        [
            HEAD.format(runs=len(runs), shown=SHOWN),
            summary(runs),
            "## Ties that no command resolves\n",
            open_ties + "\n",
            "Effects that the physics twin has no cause of: "
            + (", ".join(f"`{e}`" for e in without_cause()) or "none")
            + ".\n",
            "## Runs that were not resolved\n",
            "\n".join(
                f"- {r.key} ({r.cause}, {r.visible} of the noise): {', '.join(r.first) or '–'} → "
                f"{r.error or ', '.join(r.both) or '–'}"
                for r in runs
                if not r.alone
            )
            or "None.",
            "",
        ]
    )


def _open_tie(tie: Sequence[str], why: str) -> str:
    """A tie that no command resolves: why, and what a diagnosis says helps."""
    hand = next(about(e).texts.by_hand for e in tie if about(e).by_hand)
    return f'- `{"` = `".join(tie)}`: {why} The diagnosis says: "{hand}"'


def without_cause() -> list[str]:
    """Effects in a tie that no machine of the twin has."""
    return sorted({e for tie in ties() for e in tie} - set(CAUSES))


def summary(runs: Sequence[Run]) -> str:
    """A line for each tie and truth."""
    rows = []
    for tie, truth in dict.fromkeys((r.tie, r.truth) for r in runs):
        some = [r for r in runs if (r.tie, r.truth) == (tie, truth)]
        n = len(some)
        separable = "no" if frozenset(tie) in INSEPARABLE else "yes"
        rows.append(
            [
                f"`{tie[0]}` = `{tie[1]}`",
                f"`{truth}`",
                separable,
                f"{sum(r.alone_before for r in some)}/{n}",
                f"{sum(r.tied_before for r in some)}/{n}",
                f"{sum(r.alone for r in some)}/{n}",
                f"{sum(r.by_hand for r in some)}/{n}",
                str(sum(r.others for r in some)),
                f"{float(np.median([r.seconds for r in some])):.0f}",
            ]
        )
    mine = [r for r in runs if frozenset(r.tie) not in INSEPARABLE]
    if mine:
        rows.append(
            ["all that a command can resolve", "", ""]
            + [f"{sum(getattr(r, k) for r in mine)}/{len(mine)}" for k in MARKS]
            + ["", str(sum(r.others for r in mine)), ""]
        )
    headers = ["tie", "truth", "separable", "alone, first log", "tied, first log"]
    headers += ["alone, both logs", "said: by hand", "other names", "median s"]
    return table(headers, rows, "lll" + "r" * 6)


MARKS = ("alone_before", "tied_before", "alone")


def one(tie: Sequence[str], truth: str, seed: int) -> dict[str, Any]:
    """One machine as JSON."""
    return asdict(run((tie[0], tie[1]), truth, seed))


def said(found: Mapping[str, Any]) -> str:
    """What a run gave in a few words."""
    names = found["error"] or f"{', '.join(found['first'])} → {', '.join(found['both'])}"
    proposed = ", proposed" if found["proposed"] else ""
    return f"({found['cause']}, {found['visible']} of the noise{proposed}): {names}"


def main() -> int:
    """Run the study and write its report; 1 if a run had no answer."""
    asked = STUDY.asked(__doc__)
    wanted = {
        Run(tie, truth, seed).key: (tie, truth, seed)
        for seed, tie in product(seeds(asked), ties())
        for truth in tie
        if truth in CAUSES
    }
    runs = [Run(**restored(f)) for f in finished(one, wanted, asked, said).values()]
    STUDY.write(asked, report(runs))
    return int(any(r.error for r in runs))


HEAD = """# What the log of the proposed next experiment resolves

{runs} machines simulated from physics
(`datasets/physics`), each with one cause whose effect the catalogue lists in a tie. The first log
shows it: the best plain line misses by {shown:g} times the noise or more. It is diagnosed alone;
then together with a second log, of the schedule that this diagnosis proposed for the tie, or of
the first that the catalogue lists where it saw no tie. *Alone*: the true effect is named first and
not in a tie (a name that is as right for the cause counts, the rival's never); *by hand*: the
diagnosis of the first log said that no command tells them apart, and what does; *other names*:
further entries beside the true one. Seeds below 10000 are for development.
"""

if __name__ == "__main__":
    sys.exit(main())
