"""What all studies share: options, seeds, finished runs that are kept, processes, the report.

A study names its report, says in a mapping which runs it wants (a key that no other run has →
arguments of one function), and makes a page of what they gave. Every study has the options
``--runs``, ``--first``, ``--only``, ``--limit``, ``--jobs``, ``--results`` and ``-o``.
"""

import json
import shlex
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from sysid.data.files import write_atomic
from sysid.report.markdown import foot

ROOT = Path(__file__).resolve().parent.parent
REPORTS = ROOT / "reports"

LINES = 100
"""Lines of progress at most: a study of thousands of quick runs does not tell of each."""

_CHANGE_NOTHING = ("parser", "jobs", "results", "out")


@dataclass(frozen=True)
class Study:
    """A study as the command line knows it.

    Attributes:
        name: of its module.
        report: file in ``reports/``.
        runs: seeds of each case.
        first: the first of them.
        jobs: processes; one where the page tells how long runs take.
    """

    name: str
    report: str
    runs: int = 1
    first: int = 0
    jobs: int = 2

    def parser(self, doc: str | None) -> ArgumentParser:
        """The options of every study; a study may add its own."""
        parser = ArgumentParser(
            prog=f"python -m studies.{self.name}", description=(doc or "").partition("\n")[0]
        )
        parser.add_argument("--runs", type=int, default=self.runs, help="seeds of each case")
        parser.add_argument("--first", type=int, default=self.first, help="the first seed")
        parser.add_argument(
            "--only",
            nargs="+",
            default=[],
            metavar="TEXT",
            help="runs whose key holds one of these",
        )
        parser.add_argument("--limit", type=int, metavar="N", help="new runs at most")
        parser.add_argument("--jobs", type=int, default=self.jobs, help="processes")
        parser.add_argument("--results", type=Path, metavar="FILE", help="keep finished runs here")
        parser.add_argument("-o", "--out", type=Path, default=REPORTS / self.report)
        parser.set_defaults(parser=parser)
        return parser

    def asked(self, doc: str | None, words: Sequence[str] | None = None) -> Namespace:
        """What the command line asks for."""
        return self.parser(doc).parse_args(words)

    def write(self, asked: Namespace, text: str, seeds: str | None = None) -> None:
        """Write the report with its foot.

        Args:
            asked: options of the command line.
            text: the page.
            seeds: what was drawn, where it is not ``--first`` and ``--runs`` of each case.
        """
        if seeds is None:
            seeds = f"{asked.first} to {asked.first + asked.runs - 1}"
        page = text.rstrip("\n") + "\n" + foot(self._command(asked), seeds)
        write_atomic(asked.out, page)
        print(f"Report in {asked.out}", file=sys.stderr)

    def _command(self, asked: Namespace) -> str:
        """What a person types for the same report."""
        words = ["python", "-m", f"studies.{self.name}"]
        for name, value in vars(asked).items():
            if name in _CHANGE_NOTHING or value == asked.parser.get_default(name):
                continue
            given = value if isinstance(value, list) else [value]
            words += [f"--{name}", *(str(v) for v in given if v is not True)]
        return shlex.join(words)


def restored(fields: Any) -> Any:
    """What was read as JSON with tuples in the place of lists, as frozen dataclasses hold them."""
    if isinstance(fields, list):
        return tuple(map(restored, fields))
    return {k: restored(v) for k, v in fields.items()} if isinstance(fields, dict) else fields


def seeds(asked: Namespace) -> range:
    """The seeds of each case."""
    return range(asked.first, asked.first + asked.runs)


def fewer(asked: Namespace, times: int) -> Namespace:
    """The same options with a part of the seeds, one at least."""
    return Namespace(**{**vars(asked), "runs": max(asked.runs // times, 1)})


def finished(
    one: Callable[..., Any],
    wanted: Mapping[str, Sequence[Any]],
    asked: Namespace,
    say: Callable[[Any], str] = lambda found: "",
) -> dict[str, Any]:
    """What the runs gave, by key: those that are kept, and then those that are not yet.

    Args:
        one: makes a run; what it returns can be written as JSON and is what comes back from it.
        wanted: key → arguments, in the order in which they are run.
        asked: options of the command line.
        say: a run in a few words, for who watches.
    """
    wanted = {
        key: run
        for key, run in wanted.items()
        if not asked.only or any(text in key for text in asked.only)
    }
    done = _kept(asked.results)
    rest = {key: run for key, run in wanted.items() if key not in done}
    rest = dict(list(rest.items())[: asked.limit])
    for count, (key, found) in enumerate(_ended(one, rest, asked.jobs), start=1):
        done[key] = found = json.loads(json.dumps(found))  # as it will be when it is read again
        if asked.results is not None:
            asked.results.parent.mkdir(parents=True, exist_ok=True)
            with asked.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, "found": found}, ensure_ascii=False) + "\n")
        if count % max(len(rest) // LINES, 1) == 0:
            print(f"{count}/{len(rest)} {key} {say(found)}", file=sys.stderr, flush=True)
    return {key: done[key] for key in wanted if key in done}


def by_case(
    one: Callable[..., Any], cases: Sequence[str], asked: Namespace, *also: Any
) -> dict[str, list[Any]]:
    """For each case what ``one(case, seed, *also)`` gave, in the order of the seeds."""
    suffix = "".join(f"/{a}" for a in also)
    keys = {
        f"{case}{suffix}/{seed}": (case, seed, *also) for case in cases for seed in seeds(asked)
    }
    found = finished(one, keys, asked)
    rows: dict[str, list[Any]] = {}
    for key, value in found.items():
        rows.setdefault(keys[key][0], []).append(value)
    return rows


def _ended(
    one: Callable[..., Any], runs: Mapping[str, Sequence[Any]], jobs: int
) -> Iterator[tuple[str, Any]]:
    """Runs as they end. A process keeps what it has compiled for the runs that follow."""
    if jobs < 2 or len(runs) < 2:
        yield from ((key, one(*run)) for key, run in runs.items())
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        sent = {pool.submit(one, *run): key for key, run in runs.items()}
        for ended in as_completed(sent):
            yield sent[ended], ended.result()


def _kept(results: Path | None) -> dict[str, Any]:
    if results is None or not results.is_file():
        return {}
    lines = map(json.loads, results.read_text(encoding="utf-8").splitlines())
    return {line["key"]: line["found"] for line in lines}
