"""Structures fitted to measured records as ``sysid fit`` would, and judged by their protocols."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from time import process_time
from typing import Any

import numpy as np

from studies.diode_circuit import NOISE, simulated
from studies.records import TRIALS, Trial, data_folder
from studies.runner import Study, finished, restored
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.pem import fit
from sysid.estimation.selection.defaults import default_structures
from sysid.estimation.selection.ranking import Entry
from sysid.estimation.selection.select_structure import select_structure
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.methods.held_out_error import free_run_error
from sysid.report.markdown import table
from sysid.structures.base import Structure
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.orders import orders_text, parse_orders
from sysid.structures.registry import BUILT_IN, structure_class

BEST_LINEAR = "linear"
"""The four linear structures together; the one that ``sysid fit`` puts first is shown."""

MOTORS = ("ced-low", "ced-high", "emps", "hoop", "tacho", "generator", "robot")
RIGS = {"dc-motor": MOTORS, "tanks": ("tanks",)}
"""Grey boxes mean something for these records only."""

OPTIONS: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("emps", "dc-motor"): {"output": "position"},
}
"""What a user would have to say about a rig; everything else is left to the fit."""


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


RECORDS: Mapping[str, Callable[[], Trial]] = {**TRIALS, "circuit": circuit}
BUNDLED = ("robot", "circuit")
"""Records that need no folder of measured ones."""


@dataclass(frozen=True)
class Attempt:
    """One structure on one record; orders that are not given are left to the fit."""

    record: str
    structure: str
    orders: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def asked(self) -> str:
        """Orders, options and fixed constants as a person would type them."""
        given = [f"{k}={v}" for k, v in self.options.items()]
        fixed = [f"{k}={v:g} fixed" for k, v in self.fixed.items()]
        return "; ".join([*([self.orders] if self.orders else []), *given, *fixed])

    @property
    def key(self) -> str:
        """A name that no other attempt has."""
        return f"{self.record}/{self.structure}/{self.asked}"


@dataclass(frozen=True)
class Fitted:
    """What became of one structure on one record; figures are None where there is none.

    Attributes:
        record, structure: names.
        chosen: structure, orders and what else the fit chose, in words.
        asked: orders and options that were given.
        n: estimated numbers.
        held: free-run fit on the inner hold-out of the training part [%].
        train: the protocol's figure on the training part.
        tests: the protocol's figure on each test.
        seconds: processor time of search and fit.
        stable: whether the free run is bounded.
        error: why there is no model, empty where there is one.
        estimated: the estimated numbers by name.
    """

    record: str
    structure: str
    chosen: str = ""
    asked: str = ""
    n: int = 0
    held: float | None = None
    train: float | None = None
    tests: Mapping[str, float | None] = field(default_factory=dict)
    seconds: float | None = None
    stable: bool = True
    error: str = ""
    estimated: Mapping[str, float] = field(default_factory=dict)


def attempts(record: str) -> tuple[Attempt, ...]:
    """By default options: the best linear structure, then every nonlinear one."""
    nonlinear = [name for name in BUILT_IN if not structure_class(name).traits.linear]
    names = (BEST_LINEAR, *(n for n in nonlinear if record in RIGS.get(n, (record,))))
    return tuple(Attempt(record, n, options=OPTIONS.get((record, n), {})) for n in names)


def available(some: Iterable[Attempt]) -> dict[str, tuple[Attempt]]:
    """The attempts whose records are at hand, by key."""
    there = data_folder() is not None
    return {a.key: (a,) for a in some if there or a.record in BUNDLED}


def fitted(attempt: Attempt, trial: Trial | None = None) -> dict[str, Any]:
    """Fit, what is not given chosen on the training part, and judge on the tests: a ``Fitted``.

    Args:
        trial: how it is judged, that of the record when None.
    """
    trial = RECORDS[attempt.record]() if trial is None else trial
    options = FitOptions(structure_options=attempt.options, fixed=attempt.fixed)
    detrend = trial.detrend
    linear = attempt.structure == BEST_LINEAR
    names = default_structures(True) if linear else (attempt.structure,)
    grid = [parse_orders(attempt.orders)] if attempt.orders else None
    found = Fitted(attempt.record, attempt.structure, asked=attempt.asked)
    started = process_time()
    try:
        entry = select_structure(names, trial.train, options, detrend, grid=grid).entries[0]
        seconds = process_time() - started
        model = entry.model
        held = (
            None if attempt.record == "circuit" else held_out(entry, trial.train, options, attempt)
        )
    except SysidError as error:
        return asdict(replace(found, error=str(error)))
    names_of = zip(model.parameters, model.theta, strict=True)
    estimated = {p.name: float(v) for p, v in names_of if p.fixed is None}
    return asdict(
        replace(
            found,
            chosen=words(model.structure),
            n=len(estimated),
            held=held,
            train=_finite(figure(trial, model, trial.train)),
            tests={t: _finite(figure(trial, model, r)) for t, r in trial.tests.items()},
            seconds=seconds,
            stable=model.stable,
            estimated=estimated,
        )
    )


def figure(trial: Trial, model: Model, records: Sequence[Record]) -> float:
    """The protocol's figure of a free run on records."""
    runs = [outputs(model, r, None, Start.ESTIMATED, trial.skip) for r in records]
    return trial.figure([r.y for r in records], runs)


def held_out(
    entry: Entry, train: Sequence[Record], options: FitOptions, attempt: Attempt
) -> float | None:
    """Free-run fit [%] on inner blocks of the training part that the parameters did not see.

    That of the order search where there was one; else the structure that was chosen is fitted
    once more to the rest.
    """
    if entry.error is not None:
        return _finite(100.0 * (1.0 - entry.error))
    found = entry.model.structure
    cut = hold_out([entry.model.detrend.remove(r) for r in train])
    settled = found
    if not isinstance(found, BlockStructure):
        name = attempt.structure if isinstance(found, FromFile) else found.name
        settled = structure_class(name).from_orders(
            found.order_values(), found.nu, found.ny, options.structure_options
        )
    try:
        part = fit(settled, cut.train, options)
    except SysidError:
        return None
    error = free_run_error(part.structure, part.theta, cut.whole, cut.counted)
    return _finite(100.0 * (1.0 - error))


def words(structure: Structure) -> str:
    """What a fit chose: structure, orders and what it read off the data."""
    values = structure.order_values()
    parts = [f"{structure.name} {orders_text(values)}" if values else structure.name]
    if isinstance(structure, BlockStructure):
        sides = (dict.fromkeys(s.text for s in side) for side in structure.statics)
        parts.append(" → ".join(", ".join(side) for side in sides))
    elif isinstance(structure, NARMAX):
        degree = max((len(t) for row in structure.rows for t in row), default=0)
        parts.append(f"{_each([len(row) for row in structure.rows])} terms of degree ≤ {degree}")
    elif isinstance(structure, NarxWavelet):
        maps = structure.maps
        parts.append(f"{_each([len(d.terms) for d in maps])} products")
        parts.append(f"{_each([len(d.flags) for d in maps])} units")
    elif isinstance(structure, GreyBox):
        parts += list(structure.opened)
    return "; ".join(parts)


HEADS = (
    "record", "test", "fitted", "asked", "n", "train", "hold-out fit %", "figure", "least", "aim",
    "s",
)  # fmt: skip


def page(found: Sequence[Fitted]) -> str:
    """A table of attempts; an arrow marks the best hold-out of each record."""
    trials = {name: RECORDS[name]() for name in dict.fromkeys(f.record for f in found)}
    best = {
        name: max((f.held for f in found if f.record == name and f.held is not None), default=None)
        for name in trials
    }
    rows = []
    for name, trial in trials.items():
        for f in (f for f in found if f.record == name):
            arrow = " ←" if f.held is not None and f.held == best[name] else ""
            held = "–" if f.held is None else f"{f.held:.2f}{arrow}"
            for test, value in f.tests.items():
                goals = [f"{g[test]:g}" if test in g else "–" for g in (trial.least, trial.aim)]
                shown = f"{number(value)} {trial.unit}"
                rows.append(
                    [trial.name, test, f.chosen, f.asked or "–", str(f.n), number(f.train), held,
                     shown, *goals, f"{f.seconds or 0.0:.1f}"]
                )  # fmt: skip
            if f.error:
                rows.append([trial.name, "–", f.structure, f.asked or "–", f.error, *("–",) * 6])
    return table(HEADS, rows)


def run(study: Study, doc: str | None, some: Iterable[Attempt], head: str, tail: str = "") -> None:
    """A study of attempts from the command line to its report, ``{estimated}`` in ``tail``."""
    asked = study.asked(doc)
    found = [Fitted(**restored(f)) for f in finished(fitted, available(some), asked).values()]
    lines = [
        f"- {f.record}, {f.structure} ({f.asked or 'defaults'}): "
        + ", ".join(f"{name} = {value:.4g}" for name, value in f.estimated.items())
        for f in found
    ]
    text = head + "\n" + page(found) + tail.replace("{estimated}", "\n".join(lines))
    study.write(asked, text, "none")


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def _each(counts: Sequence[int]) -> str:
    return " + ".join(map(str, counts))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
