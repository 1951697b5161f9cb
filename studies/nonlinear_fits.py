"""One structure fitted to one record as ``sysid fit`` would, and judged by its protocol."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from time import process_time
from typing import Any

import numpy as np
from records import TRIALS, Trial

from sysid.data.preprocess import Detrend
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import Start, outputs
from sysid.estimation.pem import fit
from sysid.estimation.selection.contest import default_structures, run_contest
from sysid.estimation.selection.standings import Entry
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.held_out_error import free_run_error
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.orders import orders_text
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


def _circuit() -> Trial:
    from study_block_oriented import circuit

    return circuit()


RECORDS: Mapping[str, Callable[[], Trial]] = {**TRIALS, "circuit": _circuit}


@dataclass(frozen=True)
class Fitted:
    """What became of one structure on one record; figures are None where there is none.

    Attributes:
        record, structure: names.
        chosen: structure, orders and what else the fit chose, in words.
        asked: options that were given.
        n: estimated numbers.
        held: free-run fit on the inner hold-out of the training part [%].
        train: the protocol's figure on the training part.
        tests: the protocol's figure on each test.
        seconds: processor time of search and fit.
        stable: whether the free run is bounded.
        error: why there is no model, empty where there is one.
    """

    record: str
    structure: str
    chosen: str = ""
    asked: Mapping[str, str] = field(default_factory=dict)
    n: int = 0
    held: float | None = None
    train: float | None = None
    tests: Mapping[str, float | None] = field(default_factory=dict)
    seconds: float | None = None
    stable: bool = True
    error: str = ""

    def to_json(self) -> dict[str, Any]:
        """By name."""
        return asdict(self)


def structures(record: str) -> tuple[str, ...]:
    """What is tried on a record: the best linear structure, then every nonlinear one."""
    nonlinear = [name for name in BUILT_IN if not structure_class(name).linear]
    return (BEST_LINEAR, *(n for n in nonlinear if record in RIGS.get(n, (record,))))


def fitted(record: str, name: str) -> Fitted:
    """Fit by default options, orders searched on the training part, and judge on the tests."""
    trial = RECORDS[record]()
    asked = OPTIONS.get((record, name), {})
    options = FitOptions(structure_options=asked)
    detrend = trial.detrend
    names = default_structures(True) if name == BEST_LINEAR else (name,)
    started = process_time()
    try:
        entry = run_contest(names, trial.train, options, detrend).entries[0]
        seconds = process_time() - started
        return Fitted(
            record,
            name,
            words(entry.model.structure),
            asked,
            sum(p.fixed is None for p in entry.model.parameters),
            held_out(entry, trial.train, detrend, options),
            _finite(figure(trial, entry.model, trial.train)),
            {t: _finite(figure(trial, entry.model, r)) for t, r in trial.tests.items()},
            seconds,
            entry.model.stable,
        )
    except SysidError as error:
        return Fitted(record, name, asked=asked, error=str(error))


def figure(trial: Trial, model: Model, records: Sequence[Record]) -> float:
    """The protocol's figure of a free run on records."""
    runs = [outputs(model, r, None, Start.ESTIMATED, trial.skip) for r in records]
    return trial.figure([r.y for r in records], runs)


def held_out(
    entry: Entry, train: Sequence[Record], detrend: Detrend, options: FitOptions
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
        settled = structure_class(found.name).from_orders(
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
    if isinstance(structure, HammersteinWiener):
        sides = (structure.inputs, structure.outputs)
        parts.append(" → ".join(", ".join(dict.fromkeys(s.text for s in side)) for side in sides))
    elif isinstance(structure, WienerHammerstein):
        parts.append(", ".join(dict.fromkeys(s.text for s in structure.statics)))
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


def _each(counts: Sequence[int]) -> str:
    return " + ".join(map(str, counts))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
