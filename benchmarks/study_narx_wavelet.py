"""How far NARX networks get on the measured records: orders and options chosen on training data.

Fits every entry of the table below on the training part of its record, and prints a markdown table
with the free-run figures on the training part, on the inner hold-out that chose among the entries,
and on the test part, which chooses nothing:

    python benchmarks/study_narx_wavelet.py [record ...]
"""

import sys
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from records import TRIALS, Trial

from sysid.data.record import Record
from sysid.estimation.figures import Start, outputs
from sysid.estimation.identify import choose_detrend
from sysid.estimation.pem import fit
from sysid.estimation.search import FitOptions
from sysid.report.markdown import table
from sysid.structures.base import Focus, structure_class
from sysid.structures.model import Model
from sysid.structures.orders import parse_orders


@dataclass(frozen=True)
class Entry:
    """One attempt at one record."""

    record: str
    orders: str
    options: dict[str, str] = field(default_factory=dict)
    structure: str = "narx-wavelet"


ENTRIES = (
    Entry("hoop", "na=2 nb=2 nk=1"),
    Entry("hoop", "na=3 nb=3 nk=0"),
    Entry("tacho", "na=2 nb=2 nk=1"),
    Entry("tacho", "na=3 nb=3 nk=0"),
    Entry("damper", "na=3 nb=3 nk=0"),
    Entry("damper", "na=4 nb=4 nk=0"),
    Entry("generator", "na=2 nb=2 nk=1"),
    Entry("generator", "na=1 nb=2 nk=1"),
    Entry("tanks", "na=2 nb=2 nk=1"),
    Entry("tanks", "na=3 nb=3 nk=1"),
    Entry("silverbox", "na=2 nb=2 nk=0"),
    Entry("silverbox", "na=3 nb=3 nk=0"),
    Entry("robot", "na=1 nb=1 nk=1"),
)


def figure(trial: Trial, model: Model, records: tuple[Record, ...]) -> float:
    """The protocol's figure of a free run on records."""
    runs = [outputs(model, r, None, Start.ESTIMATED, trial.skip) for r in records]
    return trial.figure([r.y for r in records], runs)


def row(entry: Entry) -> list[str]:
    """One line of the table for every test of a record."""
    trial = TRIALS[entry.record]()
    detrend = choose_detrend(trial.train, "auto")
    first = trial.train[0]
    structure = structure_class(entry.structure).from_orders(
        parse_orders(entry.orders), first.nu, first.ny, entry.options
    )
    started = perf_counter()
    model = fit(structure, trial.train, FitOptions(focus=Focus.SIMULATION), detrend=detrend)
    seconds = perf_counter() - started
    held = [s.cost for s in model.starts if s.output != "all" and s.cost is not None]
    lines = []
    for name, records in trial.tests.items():
        lines.append([
            trial.name,
            name,
            f"{entry.structure} {entry.orders}",
            " ".join(f"{k}={v}" for k, v in entry.options.items()) or "–",
            str(len(model.theta)),
            f"{figure(trial, model, trial.train):.4g}",
            f"{100.0 * (1.0 - float(np.min(held))):.2f}" if held else "–",
            f"{figure(trial, model, records):.4g} {trial.unit}",
            f"{trial.least[name]:g}" if name in trial.least else "–",
            f"{trial.aim[name]:g}" if name in trial.aim else "–",
            f"{seconds:.1f}",
        ])  # fmt: skip
    return lines


HEADS = (
    "record", "test", "orders", "options", "n", "train", "hold-out fit %", "test", "least", "aim",
    "s",
)  # fmt: skip


def main() -> None:
    """Print the table."""
    wanted = sys.argv[1:]
    lines = []
    for entry in ENTRIES:
        if not wanted or entry.record in wanted:
            for line in row(entry):
                print(" | ".join(line), file=sys.stderr, flush=True)
                lines.append(line)
    print(table(HEADS, lines))


if __name__ == "__main__":
    main()
