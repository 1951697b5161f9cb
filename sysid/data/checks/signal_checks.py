"""Checks of each signal by itself: constant, stuck, doubled, clipped, coarse, with outliers."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity, ok_unless
from sysid.data.record import PWM_FULL_SCALE, Array, Record
from sysid.errors import argument

STUCK_SAMPLES = 20
"""An output that repeats one number for so many samples while the input moves is suspect."""
MANY_VALUES = 100
"""A signal with fewer steps of resolution over its range cannot show clipping."""
MAX_LEVELS = 4
"""Levels up to which a curve is guessed rather than seen: a dead zone alone has two edges."""
SAME = 1e-6
"""Values closer than this share of the range are one level."""
MEANT = 0.9
"""Share of the samples that must stand on a few levels for the commands to be such a grid."""


MIN_SAMPLES = 20
"""Records with fewer samples in all are too short for any of the fits."""


def check_length(facts: LogFacts) -> list[Finding]:
    """Samples and seconds of all records together."""
    records = facts.records
    n = sum(len(r) for r in records)
    seconds = float(np.sum([len(r) * r.dt for r in records]))
    several = "" if len(records) == 1 else f" in {len(records)} experiments"
    text = f"{n} samples{several}, {seconds:.4g} s at {records[0].dt:.4g} s."
    if n < MIN_SAMPLES:
        return [Finding("length", Severity.FATAL, text, f"Record at least {MIN_SAMPLES} samples.")]
    if n < 100:
        return [Finding("length", Severity.NOTE, text, "Few: keep the orders low.")]
    return [Finding("length", Severity.OK, text)]


@ok_unless("missing", "No sample is missing.")
def check_finite(facts: LogFacts) -> Iterator[Finding]:
    """Missing or infinite samples."""
    for r, name, column in _channels(facts.records):
        bad = np.flatnonzero(~np.isfinite(column))
        if len(bad):
            many = "1 sample" if len(bad) == 1 else f"{len(bad)} samples, first"
            text = f"{r.name}: {name} is not a number in {many} at {_instant(r, bad[0])}."
            yield Finding("missing", Severity.FATAL, text, "Leave these samples out.", name, r.name)


@ok_unless("constant", "Every input and output moves.")
def check_constant(facts: LogFacts) -> Iterator[Finding]:
    """Channels that never change: they hold no information."""
    records, first, nu = facts.records, facts.records[0], facts.records[0].nu
    still = [[_is_constant(c) for _, _, c in _channels([r])] for r in records]
    moves = [not all(rows) for rows in zip(*still, strict=True)]
    for i, (_, name, column) in enumerate(_channels([first])):
        what, same = ("input", range(nu)) if i < nu else ("output", range(nu, len(moves)))
        if not moves[i]:
            every = (*first.input_names, *first.output_names)
            rest = [every[k] for k in same if moves[k]]
            others = argument(inputs=rest) if i < nu else argument(outputs=rest)
            leave = f"Leave it out with {others}, or record" if rest else "Record"
            text = f"The {what} {name} never changes (it stays at {column[0]:.6g})."
            advice = f"{leave} a run in which it moves."
            yield Finding("constant", Severity.FATAL, text, advice, name)
        elif any(row[i] for row in still):
            where = next(r.name for r, row in zip(records, still, strict=True) if row[i])
            text = f"The {what} {name} never changes in {where}; the other experiments move it."
            yield Finding("constant", Severity.NOTE, text, "", name, where)


@ok_unless("stuck", "No output is stuck or logged twice.")
def check_stuck(facts: LogFacts) -> Iterator[Finding]:
    """Outputs that hold one value while the inputs move, and samples logged twice."""
    for r, name, y in _outputs(facts.records):
        if len(r) >= 2 * STUCK_SAMPLES:
            yield from _stuck(r, name, y, np.any(np.diff(r.u, axis=0) != 0, axis=1))
            yield from _doubled(r, name, y)


def _stuck(r: Record, name: str, y: Array, moved: NDArray[np.bool_]) -> Iterator[Finding]:
    starts, lengths = _runs(y)
    typical = float(np.percentile(lengths, 95)) if len(lengths) > 20 else float(np.median(lengths))
    changes = np.concatenate([[0], np.cumsum(moved)])
    # The rest before the first command and after the last one is no fault, nor is standing
    # still at zero: friction holds a robot there.
    first, quarter = starts + lengths // 4, lengths // 4
    last = np.maximum(starts + lengths - 1 - quarter, first)
    driven = changes[last] - changes[first] >= 2
    long = (lengths >= max(STUCK_SAMPLES, 5 * typical)) & (y[starts] != 0) & driven
    longest = int(np.argmax(np.where(long, lengths, 0)))
    start, length = int(starts[longest]), int(lengths[longest])
    # at its largest or smallest value a signal is clipped or at a stop rather than stuck
    if not long.any() or y[start] in (y.max(), y.min()):
        return
    text = (
        f"{r.name}: {name} repeats {y[start]:.6g} for {length} samples from "
        f"{_instant(r, start)} while the input varies."
    )
    advice = "Check the sensor and its wire, and leave that stretch out."
    yield Finding("stuck", Severity.WARNING, text, advice, name, r.name)


def _doubled(r: Record, name: str, y: Array) -> Iterator[Finding]:
    """A sensor slower than the logger: nearly every value stands there twice (or m times)."""
    _, lengths = _runs(y)
    repeats = int(np.median(lengths))
    if repeats >= 2 and len(lengths) >= 20 and np.mean(lengths == repeats) >= 0.8:
        text = f"{r.name}: {name} shows each value {repeats} times in a row."
        advice = (
            f"The sensor is slower than the log: keep every {repeats}th row, or log at its rate."
        )
        yield Finding("doubled", Severity.WARNING, text, advice, name, r.name)


@ok_unless("saturation", "No signal is clipped.")
def check_saturation(facts: LogFacts) -> Iterator[Finding]:
    """Values piled up at an end of the range: a clipping sensor, or PWM at full drive."""
    for r in facts.records:
        for _, name, y in _outputs([r]):
            for end, word in ((y.max(), "largest"), (y.min(), "smallest")):
                share = _pile_up(y, float(end))
                if share:
                    text = (
                        f"{r.name}: {name} is at its {word} value {end:.6g} for "
                        f"{100 * share:.2g} % of the time, as a clipping sensor would."
                    )
                    advice = (
                        "Widen the sensor's range or leave those stretches out: "
                        "a linear model reads them as lower gain."
                    )
                    severity = Severity.WARNING if share > 0.02 else Severity.NOTE
                    yield Finding("saturation", severity, text, advice, name, r.name)
        for channel, u in zip(r.inputs, r.u.T, strict=True):
            name, full = channel.name, np.mean(np.abs(u) >= 0.9999 * PWM_FULL_SCALE)
            if channel.unit == "µs" and full > 0.05:
                text = f"{r.name}: {name} is at full drive for {100 * full:.2g} % of the time."
                advice = "Near full drive the motors saturate; a linear model is worst there."
                yield Finding("saturation", Severity.NOTE, text, advice, name, r.name)


def _pile_up(y: Array, end: float) -> float:
    """Share of samples exactly at ``end``, if they are too many for an unclipped signal."""
    width = float(np.ptp(y))
    if end == 0 or width == 0 or len(np.unique(y)) < MANY_VALUES:
        return 0.0
    at = y == end
    if at[0] and np.count_nonzero(np.diff(at)) == 1:
        return 0.0  # it waits where it starts and never comes back, as a position does
    near = np.abs(y - end) <= 0.05 * width
    _, lengths = _runs(np.where(at, 1.0, 0.0))
    longest = int(lengths[0::2].max() if at[0] else lengths[1::2].max(initial=0))
    many = np.count_nonzero(at) >= max(10, 0.3 * np.count_nonzero(near))
    return float(np.mean(at)) if many and longest >= 3 else 0.0


@ok_unless("resolution", "The resolution of the outputs is sufficient.")
def check_resolution(facts: LogFacts) -> Iterator[Finding]:
    """Outputs whose resolution is coarse relative to their variation."""
    for r, name, y in _outputs(facts.records):
        values = np.unique(y)
        if len(values) < 2 or len(values) > len(y) // 4:
            continue
        gaps = np.diff(values)
        step = float(np.median(gaps[gaps > 1e-9 * np.ptp(y)]))
        part = step / float(np.std(y))
        if part > 0.1:
            text = (
                f"{r.name}: {name} has a resolution of about {step:.3g}, "
                f"{100 * part:.2g} % of its standard deviation."
            )
            advice = "Use a finer sensor, drive harder, or average over a longer sample time."
            severity = Severity.WARNING if part > 0.5 else Severity.NOTE
            yield Finding("resolution", severity, text, advice, name, r.name)


@ok_unless("outliers", "No output has outliers.")
def check_outliers(facts: LogFacts) -> Iterator[Finding]:
    """Single samples far from both neighbours."""
    flags = (flag for of_record in facts.outliers.flags for flag in of_record.T)
    for (r, name, y), flag in zip(_outputs(facts.records), flags, strict=True):
        hits = np.flatnonzero(flag)
        if len(hits):
            n = len(hits)
            text = (
                f"{r.name}: {n} outlier{'s' * (n > 1)} in {name}, the first at "
                f"{_instant(r, hits[0])}. The checks of dynamics ignore "
                f"{'this sample' if n == 1 else 'these samples'}."
            )
            far = np.max(np.abs(y[hits] - np.median(y))) > 4 * np.std(y)
            severity = Severity.WARNING if far or n > 0.005 * len(y) else Severity.NOTE
            advice = "Correct the log, or fit with a robust loss."
            yield Finding("outliers", severity, text, advice, name, r.name)


@ok_unless("levels", "The inputs take enough levels.")
def check_levels(facts: LogFacts) -> Iterator[Finding]:
    """Inputs that take so few values that no curve between input and output can be seen.

    A log between two levels is fitted by any static curve through two points: a dead zone, a
    saturation or a curved gain would be an invention. A third level shows that there is a bend,
    not which.
    """
    records = facts.outliers.records
    for j, name in enumerate(records[0].input_names):
        levels = visited_levels(np.concatenate([r.u[:, j] for r in records]))
        if 2 <= len(levels) < MAX_LEVELS:
            text = (
                f"{name} takes the values {', '.join(f'{v:.6g}' for v in levels)} only: a dead "
                f"zone, a saturation or a curved gain cannot be identified from {len(levels)} "
                "levels."
            )
            advice = "Record more levels before trusting a nonlinear structure."
            yield Finding("levels", Severity.NOTE, text, advice, name)


def visited_levels(u: Array) -> Array:
    """The values on which nearly all samples of a signal stand, ascending, at most ``MAX_LEVELS``.

    Empty where the signal has more levels, or none.
    """
    spread = float(np.ptp(u)) if len(u) else 0.0
    if spread == 0.0:
        return np.zeros(0)
    values, counts = np.unique(np.rint((u - u.min()) / (SAME * spread)), return_counts=True)
    order = np.argsort(-counts, kind="stable")[:MAX_LEVELS]
    if counts[order].sum() < MEANT * len(u):
        return np.zeros(0)
    kept = order[np.cumsum(counts[order]) - counts[order] < MEANT * len(u)]
    return np.asarray(np.sort(u.min() + values[kept] * SAME * spread))


def _channels(records: Sequence[Record]) -> Iterator[tuple[Record, str, Array]]:
    """Every channel of every record, with its name."""
    for r in records:
        names = (*r.input_names, *r.output_names)
        yield from zip([r] * len(names), names, (*r.u.T, *r.y.T), strict=True)


def _outputs(records: Sequence[Record]) -> Iterator[tuple[Record, str, Array]]:
    return ((r, name, y) for r in records for name, y in zip(r.output_names, r.y.T, strict=True))


def _instant(record: Record, row: int) -> str:
    return f"t = {record.t0 + row * record.dt:.6g} s"


def _is_constant(x: Array) -> bool:
    # A column like 0.1 repeated is exactly constant; 1e-12 forgives a conversion's round-off.
    return len(x) == 0 or bool(np.ptp(x) <= 1e-12 * np.max(np.abs(x)))


def _runs(x: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Start and length of every stretch of equal values."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(x) != 0) + 1])
    return starts, np.diff(np.append(starts, len(x)))
