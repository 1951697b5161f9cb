"""How far NARX networks get on the measured records: orders and options chosen on training data.

Fits every entry of the table below on the training part of its record, and prints a markdown table
with the free-run figures on the training part, on the inner hold-out that chooses among entries,
and on the test part, which chooses nothing. The entry of each record with the best hold-out is
marked; the others are what lost:

    python benchmarks/study_narx_wavelet.py [record ...]
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from records import TRIALS, Trial

from sysid.data.record import Record
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.selection.contest import run_contest
from sysid.fitting.options import FitOptions
from sysid.report.markdown import table
from sysid.structures.model import Model
from sysid.structures.orders import orders_text, parse_orders


@dataclass(frozen=True)
class Entry:
    """One attempt at one record: orders and options, empty for the default fit."""

    record: str
    orders: str = ""
    options: dict[str, str] = field(default_factory=dict)


ENTRIES = (
    *(Entry(name) for name in ("tanks", "generator", "tacho", "damper", "ced-low", "ced-high")),
    Entry("silverbox", "na=3 nb=3 nk=0", {"units": "0", "degree": "3"}),
    Entry("hoop", "na=2 nb=2 nk=0", {"network": "pairs", "degree": "3"}),
    Entry("ced-high", "na=3 nb=3 nk=1"),
    Entry("ced-low", "na=3 nb=3 nk=1"),
    Entry("tanks", "na=3 nb=3 nk=1"),
    Entry("hoop"),
    Entry("generator", "na=2 nb=2 nk=1", {"units": "0"}),
    Entry("damper", "na=4 nb=4 nk=0", {"estimator": "neural"}),
    Entry("silverbox", "na=2 nb=2 nk=0", {"units": "0", "degree": "3"}),
    Entry("robot"),
    Entry("robot", "na=1 nb=1 nk=1"),
    Entry("robot", "na=1,1;1,1 nb=1 nk=1"),
)
"""By record: the default fit, and what else was tried, cheap ones first."""


def figure(trial: Trial, model: Model, records: Sequence[Record]) -> float:
    """The protocol's figure of a free run on records."""
    runs = [outputs(model, r, None, Start.ESTIMATED, trial.skip) for r in records]
    return trial.figure([r.y for r in records], runs)


@dataclass(frozen=True)
class Line:
    """What one entry reached."""

    entry: Entry
    trial: Trial
    orders: str
    n: int
    train: float
    held: float
    tests: dict[str, float]
    seconds: float


def fitted(entry: Entry) -> Line:
    """Fit one entry and look at it from all sides."""
    trial = TRIALS[entry.record]()
    options = FitOptions(structure_options=entry.options)
    grid = [parse_orders(entry.orders)] if entry.orders else None
    started = perf_counter()
    contest = run_contest(("narx-wavelet",), trial.train, options, trial.detrend, grid=grid)
    seconds = perf_counter() - started
    model = contest.entries[0].model
    by_output: dict[str, list[float]] = {}
    for s in model.starts:
        if s.output != "all" and s.cost is not None:
            by_output.setdefault(s.output, []).append(s.cost)
    held = float(np.mean([min(costs) for costs in by_output.values()]))
    tests = {name: figure(trial, model, r) for name, r in trial.tests.items()}
    return Line(
        entry, trial, orders_text(model.structure.order_values()), len(model.theta),
        figure(trial, model, trial.train), held, tests, seconds,
    )  # fmt: skip


HEADS = (
    "record", "test", "orders", "options", "n", "train", "hold-out fit %", "test", "least", "aim",
    "s",
)  # fmt: skip


def cells(line: Line, chosen: bool) -> list[list[str]]:
    """One row for every test of an entry."""
    e, t = line.entry, line.trial
    return [
        [
            t.name,
            name,
            line.orders + ("" if e.orders else " (default fit)"),
            " ".join(f"{k}={v}" for k, v in e.options.items()) or "–",
            str(line.n),
            f"{line.train:.4g}",
            f"{100.0 * (1.0 - line.held):.2f}" + (" ←" if chosen else ""),
            f"{value:.4g} {t.unit}",
            f"{t.least[name]:g}" if name in t.least else "–",
            f"{t.aim[name]:g}" if name in t.aim else "–",
            f"{line.seconds:.1f}",
        ]
        for name, value in line.tests.items()
    ]


def main() -> None:
    """Print the table."""
    wanted = sys.argv[1:]
    lines = []
    for entry in ENTRIES:
        if not wanted or entry.record in wanted:
            lines.append(fitted(entry))
            for row in cells(lines[-1], False):
                print(" | ".join(row), file=sys.stderr, flush=True)
    best = {n: min((x.held for x in lines if x.entry.record == n), default=0.0) for n in TRIALS}
    rows = [r for x in lines for r in cells(x, x.held == best[x.entry.record])]
    rows.sort(key=lambda row: row[0])
    print(table(HEADS, rows))


if __name__ == "__main__":
    main()
