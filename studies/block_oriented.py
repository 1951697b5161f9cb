"""How far block-oriented models get on the measured records and on a simulated circuit.

Every entry is fitted to the training part; what it leaves open (orders, statics) the fit chooses
on held-out samples of that part. The table shows the free-run figure on the training part, the
fit on its inner hold-out of the same entry fitted to the rest, and the figure on the test part,
which chooses nothing. All records write ``reports/block_oriented.md``; named ones are printed:

    python benchmarks/study_block_oriented.py [record ...]
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from diode_circuit import NOISE, simulated
from records import ROOT, TRIALS, Trial

from sysid.criteria.fit import fit_percent
from sysid.data.preprocess import Detrend
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.pem import fit
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.report.markdown import table
from sysid.structures.base import Structure
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.held_out_error import free_run_error
from sysid.structures.model import Model
from sysid.structures.orders import orders_text, parse_orders
from sysid.structures.registry import structure_class

HW, WH = "hammerstein-wiener", "wiener-hammerstein"


@dataclass(frozen=True)
class Entry:
    """One attempt at one record; orders of ``nk`` alone leave the rest to the fit."""

    record: str
    orders: str
    options: dict[str, str] = field(default_factory=dict)
    structure: str = HW


_ROBOT_DEAD_ZONE = {"input": "dead-zone", "output": "identity"}

ENTRIES = (
    *(
        entry
        for ced in ("ced-low", "ced-high")
        for entry in (
            Entry(ced, "nb=3 nf=3 nk=1", structure="oe"),
            Entry(ced, "nk=1"),
            Entry(ced, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs"}),
            Entry(ced, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,piecewise:4"}),
            Entry(ced, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,piecewise:6"}),
            Entry(ced, "nb=3 nf=3 nk=1", {"input": "identity", "output": "abs,polynomial:3"}),
        )
    ),
    Entry("tacho", "nb=2 nf=2 nk=1", structure="oe"),
    Entry("tacho", "nk=1"),
    Entry("tacho", "nb=2 nf=2 nk=1", {"form": "hammerstein"}),
    Entry("tacho", "nb=2 nf=2 nk=1", {"form": "wiener"}),
    Entry("tacho", "nk=1", structure=WH),
    Entry("hoop", "nb=1 nf=1 nk=1", structure="oe"),
    Entry("hoop", "nk=1"),
    Entry("hoop", "nb=1 nf=1 nk=1", {"input": "piecewise:8", "output": "piecewise:8"}),
    Entry("hoop", "nk=1", structure=WH),
    Entry("robot", "nb=2 nf=2 nk=1", structure="oe"),
    Entry("robot", "nk=1"),
    Entry("robot", "nb=2 nf=2 nk=1", _ROBOT_DEAD_ZONE),
    Entry("robot", "nb1=1 nf1=1 nb=2 nf=2 nk=1", {"static": "dead-zone"}, WH),
    Entry("circuit", "nb=6 nf=6 nk=0", structure="oe"),
    Entry("circuit", "nk=1", structure=WH),
)


def circuit() -> Trial:
    """100 000 samples of the simulated circuit, and 50 000 others to test on."""
    train, test = simulated(100_000, seed=1), simulated(50_000, seed=2)
    return Trial(
        f"diode circuit (simulated, noise {1e3 * NOISE:g} mV)",
        (train.record,),
        {"test": (test.record,)},
        500,
        "rmse",
        "mV",
        1e3,
        {"test": 1.0},
        {"test": 0.30},
    )


def figure(trial: Trial, model: Model, records: tuple[Record, ...]) -> float:
    """The protocol's figure of a free run on records."""
    runs = [outputs(model, r, None, Start.ESTIMATED, trial.skip) for r in records]
    return trial.figure([r.y for r in records], runs)


def joined_fit(model: Model, records: tuple[Record, ...]) -> float:
    """Fit of all records as one [%]: the spread counts the distance between their levels too."""
    runs = np.concatenate([outputs(model, r, None, Start.ESTIMATED, 0) for r in records])
    return float(np.mean(fit_percent(np.concatenate([r.y for r in records]), runs)))


def words(structure: Structure) -> str:
    """What was fitted: orders and statics."""
    text = orders_text(structure.order_values())
    if isinstance(structure, HammersteinWiener):
        sides = [", ".join(dict.fromkeys(s.text for s in side)) for side in (
            structure.inputs, structure.outputs)]  # fmt: skip
        return f"{text}; {sides[0]} → {sides[1]}"
    if isinstance(structure, WienerHammerstein):
        return f"{text}; {', '.join(dict.fromkeys(s.text for s in structure.statics))}"
    return text


def inner_fit(structure: Structure, trial: Trial, detrend: Detrend) -> str:
    """Fit on the inner hold-out of the training part, fitted to the rest of it [%]."""
    cut = hold_out([detrend.remove(r) for r in trial.train])
    try:
        part = fit(structure, cut.train, FitOptions())
    except SysidError:
        return "–"
    error = free_run_error(part.structure, part.theta, cut.whole, cut.counted)
    return f"{100.0 * (1.0 - error):.2f}"


def rows(entry: Entry) -> Iterator[list[str]]:
    """One line of the table for every test of a record."""
    trial = circuit() if entry.record == "circuit" else TRIALS[entry.record]()
    detrend = trial.detrend
    first = trial.train[0]
    structure = structure_class(entry.structure).from_orders(
        parse_orders(entry.orders), first.nu, first.ny, entry.options
    )
    started = perf_counter()
    model = fit(structure, trial.train, FitOptions(), detrend=detrend)
    seconds = perf_counter() - started
    found = model.structure
    settled = found if isinstance(found, BlockStructure) else structure
    held = "–" if entry.record == "circuit" else inner_fit(settled, trial, detrend)
    for name, records in trial.tests.items():
        joined = ""
        if trial.metric == "fit" and len(records) > 1:
            joined = f" ({joined_fit(model, records):.4g} joined)"
        yield [
            trial.name,
            name,
            f"{entry.structure} {words(found)}",
            "; ".join(f"{k}={v}" for k, v in entry.options.items()) or entry.orders,
            str(int(np.sum([p.fixed is None for p in model.parameters]))),
            f"{figure(trial, model, trial.train):.4g}",
            held,
            f"{figure(trial, model, records):.4g} {trial.unit}{joined}",
            f"{trial.least[name]:g}" if name in trial.least else "–",
            f"{trial.aim[name]:g}" if name in trial.aim else "–",
        ]
    print(f"{seconds:.1f} s", file=sys.stderr)


HEADS = (
    "record", "test", "fitted", "asked", "n", "train", "hold-out fit %", "test", "least", "aim",
)  # fmt: skip

REPORT = ROOT / "reports" / "block_oriented.md"

PAGE = """# Block-oriented models on measured records

Made by `python benchmarks/study_block_oriented.py`. Free run everywhere. Each entry is fitted to
the training part of its record (splits and figures: `benchmarks/records.py`); what it leaves open
(`nk=1` alone: orders and statics) the fit chooses on held-out samples of that part. *hold-out* is
the fit on inner blocks of the training part when what was chosen is fitted to the rest of it;
*test* chose nothing. Least and aim are those of the record, for whatever structure. Every entry is
shown, also those that lost. CED and the circuit: root mean square errors, the others: fits.

The two tests of hoop_motor drive forward only and backward only. Its fit is relative to the spread
within each or, *joined*, to the spread of both together, which counts the distance between their
levels.

The circuit stands in for the Wiener-Hammerstein benchmark: `benchmarks/diode_circuit.py`, 100 000
samples to fit, 50 000 others to test, measurement noise {noise:g} mV, which no model can beat.

{table}"""


def main() -> None:
    """Write the report, or print the rows of some records."""
    wanted = sys.argv[1:]
    lines = []
    for entry in ENTRIES:
        if not wanted or entry.record in wanted:
            for line in rows(entry):
                print(" | ".join(line), file=sys.stderr, flush=True)
                lines.append(line)
    page = PAGE.format(noise=1e3 * NOISE, table=table(HEADS, lines))
    if wanted:
        print(page)
    else:
        REPORT.write_text(page, encoding="utf-8", newline="\n")
        from stamps import stamped

        stamped(REPORT)


if __name__ == "__main__":
    main()
