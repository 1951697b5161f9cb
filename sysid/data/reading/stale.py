"""Stale measurements of sensors slower than the log: detection, and logs at the sensors' rate.

A telemetry line often repeats the last measurement until the sensor sends another one, every m rows
with a phase, more or less evenly. Repeats are no measurements: as such they double the noise's
correlation, delay the output by (m − 1)/2 rows on average and hide dynamics. What distinguishes a
slower sensor from a coarse one: between two changes of many steps of its resolution it stands still
for several rows, and these intervals keep to a clock, while measurements that get lost now and then
leave intervals that grow like a random walk.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.outside_text import whole

Mask = NDArray[np.bool_]

LARGE = 2.5
"""A change is large when it is more than so many of the smallest usual change (5 % quantile): one
step of a coarse sensor says nothing about when it was read."""

MIN_INTERVALS = 20
"""Intervals between large changes that must be seen."""

SLOWEST = 1.3
"""Rows between measurements from which on a sensor counts as slower than the log."""

EVEN = 0.3
"""Standard deviation of the intervals over their mean below which they are even. Measurements lost
at random, a share p of them, leave intervals of mean 1/(1 − p) with √p: 0.48 and more."""

CLOCK = 6
"""So many intervals in a row are summed: the variance of the sum of a jittering clock's is that
of one, of independent ones so many times as large."""

KEEPS_TIME = 0.5
"""Largest share of the variance of independent intervals that such sums of a clock's may have."""

LONGEST = 100
"""Longest period looked for [rows]."""

ONE_PHASE = 0.97
"""Share of all changes in one phase of a period that even a coarse sensor shows."""

MIN_CHANGES = 60
"""Changes needed to decide by the phase alone."""

SHORTER = 0.3
"""A sensor up to this part of a row slower than a whole number of rows is read at that number."""

SHORTEST_LOG = 20
"""Samples that must be left at the sensor's rate."""

FOLLOWS = 0.95
"""Where so many of the changes come with a change of the command, at one lag, the output may just
be one that follows steps at once."""


@dataclass(frozen=True, eq=False)
class Refresh:
    """When a slow sensor's measurements are fresh.

    Attributes:
        period: rows from one measurement to the next, on average.
        fresh: rows that hold a new measurement, (N,) a series.
    """

    period: float
    fresh: tuple[Mask, ...]

    @property
    def repeated(self) -> float:
        """Share of the rows that repeat the last reading."""
        return 1.0 - float(np.mean(np.concatenate(self.fresh)))

    def phase(self, series: int, rows: int) -> int:
        """The row of every ``rows`` in which most measurements of a series arrive."""
        at = np.flatnonzero(self.fresh[series]) % rows
        return int(np.argmax(np.bincount(at, minlength=rows)))


def refreshed(series: Sequence[Array], inputs: Sequence[Array]) -> Refresh | None:
    """How a sensor that repeats its measurements is refreshed; None for one as fast as the log.

    Args:
        series: measurements of one output, (N,) an experiment.
        inputs: the commands beside them, (N, nu).
    """
    changes = [np.flatnonzero(np.diff(y) != 0.0) + 1 for y in series]
    total, rows = sum(len(c) for c in changes), sum(len(y) for y in series)
    if total < MIN_INTERVALS or total * SLOWEST > rows:
        return None
    period = _by_intervals(series, changes) or _by_phase(changes)
    if period is None or _follows_steps(changes, inputs):
        return None
    fresh = tuple(_fresh(len(y), c, period) for y, c in zip(series, changes, strict=True))
    return Refresh(period, fresh)


def _by_intervals(series: Sequence[Array], changes: Sequence[NDArray[np.int64]]) -> float | None:
    """Period from the intervals between large changes, if they keep to a clock."""
    sizes = [np.abs(y[c] - y[c - 1]) for y, c in zip(series, changes, strict=True)]
    least = LARGE * float(np.quantile(np.concatenate(sizes), 0.05))
    runs: list[Array] = []
    for c, size in zip(changes, sizes, strict=True):
        large = size > least
        good = large[1:] & large[:-1]
        intervals = np.diff(c).astype(np.float64)
        cuts = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
        runs += [intervals[a:b] for a, b in zip(cuts[::2], cuts[1::2], strict=True)]
    if sum(len(r) for r in runs) < MIN_INTERVALS:
        return None
    # a rest between two measurements, or one that was lost, spans several periods
    usual = float(np.median(np.concatenate(runs)))
    runs = [part for r in runs for part in _without(r, 1.6 * usual + 1.0)]
    every = np.concatenate(runs) if runs else np.zeros(0)
    if len(every) < MIN_INTERVALS:
        return None
    mean, spread = float(np.mean(every)), float(np.var(every))
    if not SLOWEST <= mean <= LONGEST:
        return None
    if spread <= (EVEN * mean) ** 2:
        return mean
    sums = [np.convolve(r, np.ones(CLOCK), "valid") for r in runs if len(r) >= CLOCK]
    if sum(len(s) for s in sums) < MIN_INTERVALS:
        return None
    return mean if np.var(np.concatenate(sums)) <= KEEPS_TIME * CLOCK * spread else None


def _without(run: Array, most: float) -> list[Array]:
    """Stretches of a run without intervals longer than ``most``."""
    parts = np.split(run, np.flatnonzero(run > most))
    return [p[p <= most] for p in parts if len(p)]


def _by_phase(changes: Sequence[NDArray[np.int64]]) -> float | None:
    """Longest period of which every change of a coarse sensor has one phase."""
    if sum(len(c) for c in changes) < MIN_CHANGES:
        return None
    period = None
    for m in range(2, LONGEST + 1):
        counts = [np.bincount(c % m, minlength=m) for c in changes]
        if sum(int(n.max()) for n in counts) >= ONE_PHASE * sum(int(n.sum()) for n in counts):
            period = float(m)
    return period


def _follows_steps(changes: Sequence[NDArray[np.int64]], inputs: Sequence[Array]) -> bool:
    """Whether the output changes only where the command has changed a fixed time before."""
    moved = [np.any(np.diff(u, axis=0) != 0.0, axis=1) for u in inputs]
    total = sum(len(c) for c in changes)
    if sum(int(m.sum()) for m in moved) > 1.2 * total:
        return False
    for lag in range(LONGEST):
        met = 0
        for c, m in zip(changes, moved, strict=True):
            at = c - 1 - lag
            met += int(np.sum(m[at[at >= 0]]))
        if met >= FOLLOWS * total:
            return True
    return False


def _fresh(rows: int, changes: NDArray[np.int64], period: float) -> Mask:
    """Changes, and where measurements arrived that happened to be the same again."""
    fresh = np.zeros(rows, dtype=bool)
    edges = np.concatenate([[0], changes, [rows]])
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        count = max(round((b - a) / period), 1) if b > a else 0
        at = a + np.rint(np.arange(count) * (b - a) / max(count, 1)).astype(int)
        fresh[at[at < rows]] = True
    return fresh


def refreshes(records: Sequence[Record]) -> tuple[Refresh | None, ...]:
    """``refreshed`` of every output of the records."""
    inputs = [r.u for r in records]
    return tuple(refreshed([r.y[:, i] for r in records], inputs) for i in range(records[0].ny))


def without_repeats(
    records: Sequence[Record], slow: Sequence[Refresh | None]
) -> tuple[Record, ...]:
    """The records with repeats of slow sensors replaced by what lies between fresh measurements.

    So that a dead time can be read off them: repeats would lengthen it by (m − 1)/2 rows.
    """
    filled = []
    for k, r in enumerate(records):
        columns = [
            y if s is None else between_measurements(r.t, y, s.fresh[k])
            for y, s in zip(r.y.T, slow, strict=True)
        ]
        filled.append(replace(r, y=np.column_stack(columns)))
    return tuple(filled)


def at_own_rate(
    records: Sequence[Record], of_outputs: Sequence[Refresh | None]
) -> tuple[Record, ...]:
    """The records at the rate of the slowest sensor, in the phase of its fresh measurements."""
    slow = [r for r in of_outputs if r is not None]
    rows = max(max(int(np.ceil(s.period - SHORTER)) for s in slow), 1)
    slowest = max(slow, key=lambda s: s.period)
    return tuple(
        r.every(rows, slowest.phase(k, rows))
        for k, r in enumerate(without_repeats(records, of_outputs))
        if len(r) >= SHORTEST_LOG * rows
    ) or tuple(records)


def fresh_only(records: Sequence[Record], i: int, refresh: Refresh | None) -> tuple[Record, ...]:
    """Output ``i`` alone, one row a fresh measurement; their instants may be uneven."""
    alone = tuple(r.select(r.input_names, r.output_names[i : i + 1]) for r in records)
    if refresh is None:
        return alone
    pairs = zip(alone, refresh.fresh, strict=True)
    return tuple(r.mapped(partial(np.compress, fresh, axis=0)) for r, fresh in pairs)


def between_measurements(t: Array, values: Array, fresh: Mask) -> Array:
    """Repeats replaced by what lies on the line between fresh measurements, (N,).

    Args:
        t: instants, (N,).
        values: measurements, (N,).
        fresh: rows that hold a new one, (N,).
    """
    at = np.flatnonzero(fresh)
    return np.asarray(np.interp(t, t[at], values[at]))


@dataclass(frozen=True, eq=False)
class SlowSensors:
    """What the sensors of one file ask for.

    Attributes:
        rows: rows of the file that make one sample at the slowest sensor's rate; 1 for none.
        values: the columns, with repeats replaced by what lies between fresh measurements.
        fresh: rows that hold a new measurement of a slow output, (N,).
    """

    rows: int
    values: Array
    fresh: Mask
    findings: tuple[Finding, ...] = ()


def slow_sensors(
    t: Array, values: Array, names: Sequence[str], counts: tuple[int, int], how: str, where: str
) -> SlowSensors:
    """Slow sensors among the outputs and the pose of one file.

    Args:
        t: instants of the rows [s], (N,).
        values: (N, n): inputs, outputs, pose.
        counts: numbers of inputs and of outputs.
        how: ``auto``, ``keep`` (every row as logged), or a number of rows in a sample.
    """
    nu, ny = counts
    every = SlowSensors(1, values, np.ones(len(values), dtype=bool))
    if how == "keep":
        return every
    refreshes_by_column = {
        k: refreshed([values[:, k]], [values[:, :nu]]) for k in range(nu, len(names))
    }
    slow = {k: r for k, r in refreshes_by_column.items() if r is not None}
    outputs = {k: r for k, r in slow.items() if k < nu + ny}
    if how != "auto":
        rows = int(how)
    elif outputs:
        rows = max(int(np.ceil(r.period - SHORTER)) for r in outputs.values())
    else:
        rows = 1
    if len(values) // rows < SHORTEST_LOG:
        if how == "auto":
            return every
        raise UsageError(
            f"{where}: one sample every {rows} rows leaves {len(values) // rows} samples; "
            "give a smaller number of rows"
        )
    filled = values.copy()
    for k, r in slow.items():
        filled[:, k] = between_measurements(t, values[:, k], r.fresh[0])
    fresh = np.sum([r.fresh[0] for r in outputs.values()], axis=0) if outputs else every.fresh
    findings = () if not outputs else (_stale_finding(names, outputs, rows, t, where),)
    return SlowSensors(rows, filled, np.asarray(fresh, dtype=bool), findings)


def _stale_finding(
    names: Sequence[str], slow: Mapping[int, Refresh], rows: int, t: Array, where: str
) -> Finding:
    step = float(np.median(np.diff(t)))
    phases = [r.phase(0, rows) + 1 for r in slow.values()]
    period = float(np.mean([r.period for r in slow.values()]))
    repeated = float(np.mean([r.repeated for r in slow.values()]))
    who = " and ".join(", ".join(names[k] for k in slow).rsplit(", ", 1))
    are, their = ("is", "its") if len(slow) == 1 else ("are", "their")
    text = (
        f"{where}: {who} {are} refreshed every {period:.3g} rows ({period * step:.3g} s, mostly in "
        f"row {', '.join(str(p) for p in dict.fromkeys(phases))} of {rows}); "
        f"{100 * repeated:.0f} % of the rows repeat the last measurement, so {their} fresh "
        f"measurements are used, one sample every {rows * step:.4g} s."
    )
    advice = "`held='keep'` reads every row as it was logged."
    only = names[next(iter(slow))] if len(slow) == 1 else None
    return Finding("held-telemetry", Severity.WARNING, text, advice, only, where)


def at_sensor_rate(record: Record, slow: SlowSensors, t: Array, rows: slice) -> Record:
    """A record of the file at the slowest sensor's rate, in the phase of its fresh measurements.

    Args:
        record: on the log's uniform grid.
        slow: as ``slow_sensors`` found it.
        t: instants of the file's rows [s], (N,).
    """
    if slow.rows == 1:
        return record
    part = t[rows]
    at = np.rint((part - part[0]) / record.dt).astype(np.int64)[slow.fresh[rows]]
    counts = np.bincount(at % slow.rows, minlength=slow.rows)
    return record.every(slow.rows, int(np.argmax(counts)))


def check_held(how: str) -> str:
    """``auto``, ``keep`` or a number of rows."""
    if how in ("auto", "keep") or (whole(how) or 0) >= 1:
        return how
    raise UsageError(f"`held` is auto, keep or a number of rows per sample, got {how!r}")
