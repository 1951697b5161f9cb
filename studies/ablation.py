"""What each rule and move of a diagnosis is worth: each left out in turn, on development seeds.

A rule is left out only where it acted; elsewhere the answer is the same without it. The page counts
for each how often it acted, how often the answer changed without it, and how many right names were
lost and wrong ones came up. What changes nothing is a candidate for deletion. The measured records
of ``real_diagnose`` are asked, too, where they are.

    python -m studies.ablation [--runs N] [--results FILE]
"""

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any
from unittest import mock

from sysid_datasets.physics.logs import make, write
from sysid_datasets.physics.suites import case

from studies.physics_diagnose import diagnose
from studies.real_diagnose import CASES, OF_SAMPLES, Case, diagnosed
from studies.records import data_folder
from sysid.diagnosis import diagnose as whole
from sysid.diagnosis.rules import ledger
from sysid.diagnosis.search import forward_selection
from sysid.report.markdown import foot, table

SUITES = {"singles": 34, "pairs": 16, "triples": 6, "nothing": 12, "outside": 12}
"""Runs of each suite; seeds from ``FIRST`` on, which no judgement uses."""

FIRST = 300

PAGE = Path(__file__).resolve().parent.parent / "reports" / "ablation.md"

Acted = Callable[..., bool]


@dataclass(frozen=True)
class Switch:
    """A rule or move that can be left out.

    Attributes:
        owner, name: the function, by its place.
        off: what stands in its place.
        acted: (result, *arguments) → whether it did anything.
    """

    owner: Any
    name: str
    off: Callable[..., Any]
    acted: Acted


def _some(result: Any, *_: Any) -> bool:
    return result is not None


def _nothing(*_: Any, **__: Any) -> None:
    return None


SWITCHES: Mapping[str, Switch] = MappingProxyType(
    {
        "move: pairs": Switch(forward_selection, "together", _nothing, _some),
        "move: look-alikes in place": Switch(
            forward_selection,
            "swapped",
            lambda search, base, model, effects: model,
            lambda result, search, base, model, effects: result is not model,
        ),
        "move: first order": Switch(
            whole,
            "or_on_first_order",
            lambda result, *_: result,
            lambda found, result, *_: found is not result,
        ),
        "rule: redundant": Switch(
            forward_selection, "is_redundant", lambda *_: False, lambda found, *_: bool(found)
        ),
        "rule: needless dropped": Switch(
            forward_selection.ForwardSelection,
            "pruned",
            lambda self, base, model: model,
            lambda found, self, base, model: found is not model,
        ),
    }
)

OBJECTIONS = {
    f"objection: {name}": (book, name)
    for book in ("BEFORE_INTERVALS", "OBJECTIONS")
    for name in getattr(ledger, book)
}


@contextmanager
def watched(acted: Counter[str]) -> Iterator[None]:
    """Counts what acts."""
    with _patches({n: _counting(s, n, acted) for n, s in SWITCHES.items()}), _rules(acted):
        yield


def _counting(switch: Switch, name: str, acted: Counter[str]) -> Callable[..., Any]:
    function = getattr(switch.owner, switch.name)

    def call(*args: Any, **more: Any) -> Any:
        result = function(*args, **more)
        acted[name] += switch.acted(result, *args)
        return result

    return call


@contextmanager
def _patches(functions: Mapping[str, Callable[..., Any]]) -> Iterator[None]:
    patches = [
        mock.patch.object(SWITCHES[n].owner, SWITCHES[n].name, f) for n, f in functions.items()
    ]
    for p in patches:
        p.start()
    try:
        yield
    finally:
        for p in patches:
            p.stop()


@contextmanager
def _rules(acted: Counter[str], without: str = "") -> Iterator[None]:
    books: dict[str, dict[str, Any]] = {"BEFORE_INTERVALS": {}, "OBJECTIONS": {}}
    for key, (book, name) in OBJECTIONS.items():
        rule = getattr(ledger, book)[name]

        def said(*args: Any, rule: Any = rule, key: str = key) -> Any:
            result = rule(*args)
            acted[key] += result is not None
            return result

        if key != without:
            books[book][name] = said
    with mock.patch.multiple(ledger, **{k: MappingProxyType(v) for k, v in books.items()}):
        yield


@contextmanager
def left_out(name: str) -> Iterator[None]:
    """Without one rule or move."""
    if name in SWITCHES:
        with _patches({name: SWITCHES[name].off}):
            yield
    else:
        with _rules(Counter(), name):
            yield


def answers(suite: str, seed: int) -> dict[str, Any]:
    """Names with everything, what acted, and the names without each thing that did."""
    made = case(suite, seed)
    with tempfile.TemporaryDirectory() as folder:
        *_, told = write(make(made), Path(folder))
        logs = Path(folder) / "est.csv", Path(folder) / "val.csv"
        told.unlink()

        run = _asked(lambda: _names(diagnose(*logs, made.rig.lengths)))
    truth = sorted({h.id for h in made.hidden})
    also = {a for h in made.hidden for a in getattr(h, "also", ())}
    return {"key": f"{suite} {seed}", "truth": truth, "also": sorted(also), **run}


def of_record(case: Case, folder: Path) -> dict[str, Any]:
    """The same for a measured record; of several names that are right each is enough."""
    run = _asked(lambda: [sorted(n.split("=")) for n in diagnosed(case, folder).named])
    also = sorted(case.may.union(OF_SAMPLES))
    truth = ["=".join(sorted(m)) for m in case.must]
    return {"key": f"measured {case.name}", "truth": truth, "also": also, **run}


def _names(answer: Mapping[str, Any]) -> list[list[str]]:
    return [sorted((e["id"], *e["indistinguishable"])) for e in answer["effects"]]


def _asked(named: Callable[[], list[list[str]]]) -> dict[str, Any]:
    """Names with everything, what acted, and the names without each thing that did."""
    acted: Counter[str] = Counter()
    with watched(acted):
        names = named()
    without = {}
    for name, times in acted.items():
        if times:
            with left_out(name):
                without[name] = named()
    return {"names": names, "acted": dict(acted), "without": without}


def marks(names: list[list[str]], run: Mapping[str, Any]) -> tuple[int, int]:
    """(right names, wrong names)."""
    asked = [set(t.split("=")) for t in run["truth"]]
    known = set(run["also"]).union(*asked)
    right = sum(any(t.intersection(entry) for entry in names) for t in asked)
    return right, sum(not known & set(entry) for entry in names)


def page(runs: list[dict[str, Any]]) -> str:
    """The table, one row a rule or move."""
    rows = []
    for name in (*SWITCHES, *OBJECTIONS):
        asked = [r for r in runs if r["acted"].get(name)]
        changed = [r for r in asked if r["without"][name] != r["names"]]
        lost = gained = came = went = 0
        for r in changed:
            (right, wrong), (then, false) = marks(r["names"], r), marks(r["without"][name], r)
            lost, gained = lost + max(right - then, 0), gained + max(then - right, 0)
            came, went = came + max(false - wrong, 0), went + max(wrong - false, 0)
        counts = (len(asked), len(changed), lost, gained, came, went)
        rows.append([name, *map(str, counts)])
    heads = [
        "left out",
        "acted in",
        "changed",
        "right lost",
        "right won",
        "wrong came",
        "wrong went",
    ]
    total = Counter(r["key"].split()[0] for r in runs)
    said = ", ".join(f"{n} {suite}" for suite, n in total.items())
    return "\n".join(
        [
            "# What each rule of a diagnosis is worth",
            "",
            f"Physics twin, development seeds from {FIRST} on, and measured records: {said}. Each",
            "rule and move is left out where it acted. Counts are runs (acted in, changed) and",
            "names (the others).",
            "",
            table(heads, rows, "lrrrrrr"),
            "",
            foot("python -m studies.ablation"),
        ]
    )


def _keep(kept: Path | None, run: Mapping[str, Any]) -> None:
    if kept:
        with kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps(run) + "\n")


def main() -> None:
    """Runs what is not done yet, and writes the page of what is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, help="of each suite at most")
    parser.add_argument("--results", type=Path, help="keeps finished runs, a line of JSON each")
    parser.add_argument("-o", type=Path, default=PAGE)
    asked = parser.parse_args()
    kept = asked.results
    done = (
        [json.loads(line) for line in kept.read_text().splitlines()]
        if kept and kept.exists()
        else []
    )
    known = {r["key"] for r in done}
    counts = {s: min(n, asked.runs or n) for s, n in SUITES.items()}
    for k in range(max(counts.values())):
        for suite, n in counts.items():
            if k < n and f"{suite} {FIRST + k}" not in known:
                done.append(answers(suite, FIRST + k))
                _keep(kept, done[-1])
    data = data_folder()
    for measured in CASES:
        if data is not None and f"measured {measured.name}" not in known:
            done.append(of_record(measured, data))
            _keep(kept, done[-1])
    asked.o.write_text(page(done) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
