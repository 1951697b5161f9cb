"""The guard of what was reached: errors on data that chose nothing, and times over bare references.

    python benchmarks/gate.py [ROW …] [--accuracy | --speed] [--ci] [--json]
    python benchmarks/gate.py --update ROW …        writes gate.json; a commit says why
    python benchmarks/gate.py --double ROW|all      shows that a doubled time is caught
    python benchmarks/gate.py --speed --repeat 20   shows that noise is not

Ends with 1 when a row fails, with 2 when it was called wrongly. ``docs/gate.md`` tells what the
rows are and how to read a failure.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from gate_judging import (
    LIMITS,
    Committed,
    Gate,
    Judged,
    Prepare,
    Skip,
    Value,
    Verdict,
    chosen,
    judge_accuracy,
    measure_in_turns,
)

FILE = Path(__file__).with_name("gate.json")

NEW_REASON = {
    "accuracy": "Deterministic but for rounding: room for the libraries of another machine.",
    "speed": "The best that was measured; the limits are factors of it.",
}
"""What stands beside a new value until somebody says it better."""

NEW_TOLERANCE = 1e-3

Say = Callable[[str], None]


def main(words: Sequence[str] | None = None) -> int:
    """Parse, measure, show; the exit code."""
    asked = options().parse_args(words)
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"):
        # Before NumPy is imported: threads that wait for each other count as processor time.
        os.environ[name] = "1"
    from gate_rows_accuracy import ROWS as ACCURACY
    from gate_rows_speed import ROWS as SPEED
    from gate_rows_speed import steady_heap

    raw = json.loads(FILE.read_text(encoding="utf-8"))
    gate = Gate.of(raw)
    try:
        names = chosen([*asked.rows, *asked.update, *asked.double], [*ACCURACY, *SPEED])
    except KeyError as error:
        print(f"gate: {error.args[0]}", file=sys.stderr)
        return 2
    accuracy = {n: ACCURACY[n] for n in names if n in ACCURACY and not asked.speed}
    say = progress(asked.json)
    steady_heap()
    with tempfile.TemporaryDirectory() as place:
        ready = {name: cache(partial(prepare, Path(place))) for name, prepare in SPEED.items()}
        speed = {n: ready[n] for n in names if n in SPEED and not asked.accuracy}
        if asked.update:
            return update(raw, accuracy, speed, say)
        if asked.double:
            return double(speed, gate, asked.ci, say)
        if asked.repeat:
            return repeat(speed, gate, asked.repeat, asked.ci, say)
        began = time.perf_counter()
        timed = measure_in_turns(speed, gate.speed, asked.ci, said=say)
        between = time.perf_counter()
        judged = [accurate(n, run, gate.accuracy.get(n), say) for n, run in accuracy.items()]
    seconds = (time.perf_counter() - between, between - began)
    judged += timed
    show(judged, seconds, asked.json, {**gate.accuracy, **gate.speed})
    return int(any(j.verdict is Verdict.FAIL for j in judged))


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="gate.py", description="Judge every row of gate.json against what is measured now."
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="only these, or a group: ced-low")
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--accuracy", action="store_true", help="only rows of errors and names")
    part.add_argument("--speed", action="store_true", help="only rows of times")
    parser.add_argument(
        "--ci",
        action="store_true",
        help=f"fail at {LIMITS.ci:g} times a committed time instead of {LIMITS.hand:g}",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document")
    does = parser.add_mutually_exclusive_group()
    does.add_argument(
        "--update", nargs="+", default=[], metavar="ROW", help="commit what is measured now, or all"
    )
    does.add_argument(
        "--double", nargs="+", default=[], metavar="ROW",
        help="run the work of these rows, or all, twice, one at a time: is it caught?",
    )  # fmt: skip
    does.add_argument("--repeat", type=int, default=0, metavar="N", help="speed rows N times")
    return parser


def progress(quiet: bool) -> Say:
    """What shows the row that is being measured, on a terminal."""
    if quiet or not sys.stderr.isatty():
        return lambda words: None
    return lambda words: print(f"\r\033[K{words} …", end="", file=sys.stderr, flush=True)


def accurate(name: str, run: Callable[[], Value], committed: Committed | None, say: Say) -> Judged:
    """One accuracy row, judged."""
    say(name)
    try:
        return judge_accuracy(name, run(), committed)
    except Skip as reason:
        return Judged(name, Verdict.SKIP, words=str(reason))


def update(
    raw: dict[str, dict[str, Any]],
    accuracy: Mapping[str, Callable[[], Value]],
    speed: Mapping[str, Prepare],
    say: Say,
) -> int:
    """Write what is measured now as committed values; reasons and tolerances stay."""
    long = replace(LIMITS, rounds=LIMITS.rounds + LIMITS.repeats)
    found = [*measure_in_turns(speed, {}, False, limits=long, said=say)]
    found += [accurate(name, run, None, say) for name, run in accuracy.items()]
    for judged in (j for j in found if j.value is not None):
        kind = "speed" if judged.row in speed else "accuracy"
        line = raw[kind].setdefault(judged.row, {"value": None, "reason": NEW_REASON[kind]})
        if isinstance(judged.value, float):
            if kind == "accuracy":
                line.setdefault("tolerance", NEW_TOLERANCE)
            rounded = float(f"{judged.value:.{3 if kind == 'speed' else 6}g}")
            print(f"{judged.row}: {line['value']} → {rounded}")
            line["value"] = rounded
        else:
            line["value"] = list(judged.value or ())
            print(f"{judged.row}: {line['value']}")
    for judged in (j for j in found if j.verdict is Verdict.SKIP):
        print(f"{judged.row}: left as it is; {judged.words}")
    draft = FILE.with_suffix(".part")
    draft.write_text(json.dumps(raw, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    draft.replace(FILE)
    return 0


def double(rows: Mapping[str, Prepare], gate: Gate, ci: bool, say: Say) -> int:
    """Each row alone with its work done twice; 1 where that is not caught."""
    if not rows:
        print("gate: only rows of speed have a work to double", file=sys.stderr)
        return 2
    missed = []
    for name, prepare in rows.items():
        (judged,) = measure_in_turns({name: prepare}, gate.speed, ci, doubled=[name], said=say)
        caught = judged.verdict is Verdict.FAIL
        missed += [] if caught else [name]
        value, was = judged.value, judged.committed
        assert isinstance(value, float)
        over = value / was if isinstance(was, float) else float("nan")
        print(f"{name}: {value:.3g}, {over:.2f} × committed: {'caught' if caught else 'MISSED'}")
    print(f"{len(rows) - len(missed)} of {len(rows)} doublings caught")
    return int(bool(missed))


def repeat(rows: Mapping[str, Prepare], gate: Gate, runs: int, ci: bool, say: Say) -> int:
    """The speed part again and again, to see what noise does to it; 1 where a run failed."""
    failed, again = 0, 0
    over: dict[str, list[float]] = {name: [] for name in rows}
    for run in range(1, runs + 1):
        began = time.perf_counter()
        judged = measure_in_turns(rows, gate.speed, ci, said=say)
        bad = [j.row for j in judged if j.verdict is Verdict.FAIL]
        failed += bool(bad)
        again += sum(j.measured > LIMITS.rounds for j in judged)
        for j in judged:
            if isinstance(j.value, float) and isinstance(j.committed, float):
                over[j.row].append(j.value / j.committed)
        load = ", ".join(f"{x:.1f}" for x in os.getloadavg()[:1])
        seconds = time.perf_counter() - began
        words = ", ".join(bad) or "–"
        print(f"run {run}: load {load}, {seconds:.0f} s, failed: {words}", flush=True)
    for name, ratios in over.items():
        if ratios:
            print(f"{name}: {min(ratios):.2f} … {max(ratios):.2f} × committed")
    print(f"{failed} of {runs} runs failed; {again} rows were measured again")
    return int(failed > 0)


def show(
    judged: Sequence[Judged],
    seconds: tuple[float, float],
    as_json: bool,
    committed: Mapping[str, Committed],
) -> None:
    """The answer, as a table or as JSON."""
    count = {v: sum(j.verdict is v for j in judged) for v in Verdict}
    if as_json:
        parts = dict(zip(("accuracy", "speed"), seconds, strict=True))
        document = {"rows": [j.to_json() for j in judged], "seconds": parts}
        print(json.dumps(document, indent=2, ensure_ascii=False))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("row", *(_right(x) for x in ("now", "committed", "limit")), "", title="Gate")
    for j in judged:
        style = {Verdict.FAIL: "bold red", Verdict.SKIP: "dim"}.get(j.verdict)
        line = committed.get(j.row)
        numbers = [_words(x, line) for x in (j.value, j.committed, j.limit)]
        state = f"{j.verdict.value}: {j.words}" if j.words else j.verdict.value
        table.add_row(j.row, *numbers, state, style=style)
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print("\r", end="") if sys.stdout.isatty() else None
    console.print(table)
    said = f"{len(judged)} rows: {count[Verdict.FAIL]} failed, {count[Verdict.SKIP]} skipped"
    console.print(f"{said}. Accuracy {seconds[0]:.0f} s, speed {seconds[1]:.0f} s.")
    for j in judged:
        if j.verdict is Verdict.FAIL and j.row in committed:
            console.print(f"{j.row}: {committed[j.row].reason}")


def _right(title: str) -> Any:
    from rich.table import Column

    return Column(title, justify="right")


def _words(value: Value | None, line: Committed | None) -> str:
    if value is None:
        return "–"
    if isinstance(value, tuple):
        return ", ".join(value) or "no name"
    unit = f" {line.unit}" if line and line.unit else ""
    return f"{value:.4g}{unit}"


if __name__ == "__main__":
    sys.exit(main())
