"""Checks of each signal by itself: constant, stuck, doubled, clipped, coarse, with outliers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.outliers import Bridged
from sysid.data.record import PWM_FULL_SCALE, Array, Record
from sysid.errors import argument

STUCK_SAMPLES = 20
"""An output that repeats one number for so many samples while the input moves is suspect."""
MANY_VALUES = 100
"""A signal with fewer steps of resolution over its range cannot show clipping."""


def check_finite(records: Sequence[Record]) -> list[Finding]:
    """Missing or infinite samples."""
    findings = []
    for record in records:
        for name, column in _channels(record):
            bad = np.flatnonzero(~np.isfinite(column))
            if len(bad):
                many = "1 sample" if len(bad) == 1 else f"{len(bad)} samples, first"
                text = f"{record.name}: {name} is not a number in {many} at "
                findings.append(
                    Finding(
                        "missing",
                        Severity.FATAL,
                        f"{text}t = {record.t0 + bad[0] * record.dt:.6g} s.",
                        "Leave these samples out.",
                        name,
                        record.name,
                    )
                )
    return findings or [Finding("missing", Severity.OK, "No sample is missing.")]


def check_constant(records: Sequence[Record]) -> list[Finding]:
    """Channels that never change: they hold no information."""
    findings = []
    still = [[_is_constant(c) for _, c in _channels(r)] for r in records]
    moves = [not all(rows) for rows in zip(*still, strict=True)]
    nu = records[0].nu
    for i, (name, column) in enumerate(_channels(records[0])):
        what, same = ("input", range(nu)) if i < nu else ("output", range(nu, len(moves)))
        if not moves[i]:
            every = (*records[0].input_names, *records[0].output_names)
            rest = [every[k] for k in same if moves[k]]
            others = argument(inputs=rest) if i < nu else argument(outputs=rest)
            leave = (
                f"Leave it out with {others}, or record"
                if any(moves[k] for k in same)
                else "Record"
            )
            findings.append(
                Finding(
                    "constant",
                    Severity.FATAL,
                    f"The {what} {name} never changes (it stays at {column[0]:.6g}).",
                    f"{leave} a run in which it moves.",
                    name,
                )
            )
        elif any(row[i] for row in still):
            where = next(r.name for r, row in zip(records, still, strict=True) if row[i])
            text = f"The {what} {name} never changes in {where}; the other experiments move it."
            findings.append(Finding("constant", Severity.NOTE, text, "", name, where))
    return findings or [Finding("constant", Severity.OK, "Every input and output moves.")]


def check_stuck(records: Sequence[Record]) -> list[Finding]:
    """Outputs that hold one value while the inputs move, and samples logged twice."""
    findings = []
    for record in records:
        if len(record) < 2 * STUCK_SAMPLES:
            continue
        moved = np.any(np.diff(record.u, axis=0) != 0, axis=1)
        for name, y in zip(record.output_names, record.y.T, strict=True):
            findings += _stuck(record, name, y, moved) + _doubled(record, name, y)
    return findings or [Finding("stuck", Severity.OK, "No output is stuck or logged twice.")]


def _stuck(record: Record, name: str, y: Array, moved: NDArray[np.bool_]) -> list[Finding]:
    starts, lengths = _runs(y)
    typical = float(np.percentile(lengths, 95)) if len(lengths) > 20 else float(np.median(lengths))
    changes = np.concatenate([[0], np.cumsum(moved)])
    # The rest before the first command and after the last one is no fault, nor is standing
    # still at zero: friction holds a robot there.
    first, quarter = starts + lengths // 4, lengths // 4
    last = np.maximum(starts + lengths - 1 - quarter, first)
    driven = changes[last] - changes[first] >= 2
    long = (lengths >= max(STUCK_SAMPLES, 5 * typical)) & (y[starts] != 0) & driven
    if not long.any():
        return []
    longest = int(np.argmax(np.where(long, lengths, 0)))
    start, length = int(starts[longest]), int(lengths[longest])
    if _at_an_end(y, float(y[start])):
        return []
    return [
        Finding(
            "stuck",
            Severity.WARNING,
            f"{record.name}: {name} repeats {y[start]:.6g} for {length} samples from "
            f"t = {record.t0 + start * record.dt:.6g} s while the input varies.",
            "Check the sensor and its wire, and leave that stretch out.",
            name,
            record.name,
        )
    ]


def _at_an_end(y: Array, value: float) -> bool:
    """At its largest or smallest value a signal is clipped or at a stop rather than stuck."""
    return bool(value in (y.max(), y.min()))


def _doubled(record: Record, name: str, y: Array) -> list[Finding]:
    """A sensor slower than the logger: nearly every value stands there twice (or m times)."""
    _, lengths = _runs(y)
    repeats = int(np.median(lengths))
    regular = np.mean(lengths == repeats)
    if repeats < 2 or regular < 0.8 or len(lengths) < 20:
        return []
    return [
        Finding(
            "doubled",
            Severity.WARNING,
            f"{record.name}: {name} shows each value {repeats} times in a row.",
            f"The sensor is slower than the log: keep every {repeats}th row, or log at its rate.",
            name,
            record.name,
        )
    ]


def check_saturation(records: Sequence[Record]) -> list[Finding]:
    """Values piled up at an end of the range: a clipping sensor, or PWM at full drive."""
    findings = []
    for record in records:
        for name, y in zip(record.output_names, record.y.T, strict=True):
            for end, word in ((y.max(), "largest"), (y.min(), "smallest")):
                share = _pile_up(y, float(end))
                if share:
                    text = f"{record.name}: {name} is at its {word} value {end:.6g} for "
                    findings.append(
                        Finding(
                            "saturation",
                            Severity.WARNING if share > 0.02 else Severity.NOTE,
                            f"{text}{100 * share:.2g} % of the time, as a clipping sensor would.",
                            "Widen the sensor's range or leave those stretches out: "
                            "a linear model reads them as lower gain.",
                            name,
                            record.name,
                        )
                    )
        for channel, u in zip(record.inputs, record.u.T, strict=True):
            name = channel.name
            full = np.mean(np.abs(u) >= 0.9999 * PWM_FULL_SCALE)
            if channel.unit == "µs" and full > 0.05:
                text = f"{record.name}: {name} is at full drive for {100 * full:.2g} % of the time."
                advice = "Near full drive the motors saturate; a linear model is worst there."
                findings.append(
                    Finding("saturation", Severity.NOTE, text, advice, name, record.name)
                )
    return findings or [Finding("saturation", Severity.OK, "No signal is clipped.")]


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


def check_resolution(records: Sequence[Record]) -> list[Finding]:
    """Outputs whose resolution is coarse relative to their variation."""
    findings = []
    for record in records:
        for name, y in zip(record.output_names, record.y.T, strict=True):
            values = np.unique(y)
            if len(values) < 2 or len(values) > len(y) // 4:
                continue
            gaps = np.diff(values)
            step = float(np.median(gaps[gaps > 1e-9 * np.ptp(y)]))
            part = step / float(np.std(y))
            if part > 0.1:
                text = f"{record.name}: {name} has a resolution of about {step:.3g}, "
                findings.append(
                    Finding(
                        "resolution",
                        Severity.WARNING if part > 0.5 else Severity.NOTE,
                        f"{text}{100 * part:.2g} % of its standard deviation.",
                        "Use a finer sensor, drive harder, or average over a longer sample time.",
                        name,
                        record.name,
                    )
                )
    return findings or [
        Finding("resolution", Severity.OK, "The resolution of the outputs is sufficient.")
    ]


def check_outliers(records: Sequence[Record], outliers: Bridged) -> list[Finding]:
    """Single samples far from both neighbours."""
    findings = []
    for record, flags in zip(records, outliers.flags, strict=True):
        for j, name in enumerate(record.output_names):
            hits = np.flatnonzero(flags[:, j])
            if len(hits):
                n = len(hits)
                seen = "1 outlier" if n == 1 else f"{n} outliers"
                text = f"{record.name}: {seen} in {name}, the first at t = "
                y = record.y[:, j]
                far = np.max(np.abs(y[hits] - np.median(y))) > 4 * np.std(y)
                findings.append(
                    Finding(
                        "outliers",
                        Severity.WARNING if far or n > 0.005 * len(y) else Severity.NOTE,
                        f"{text}{record.t0 + hits[0] * record.dt:.6g} s. "
                        "The checks of dynamics ignore "
                        f"{'this sample' if n == 1 else 'these samples'}.",
                        "Correct the log, or fit with a robust loss.",
                        name,
                        record.name,
                    )
                )
    return findings or [Finding("outliers", Severity.OK, "No output has outliers.")]


def _channels(record: Record) -> list[tuple[str, Array]]:
    names = (*record.input_names, *record.output_names)
    return list(zip(names, (*record.u.T, *record.y.T), strict=True))


def _is_constant(x: Array) -> bool:
    # A column like 0.1 repeated is exactly constant; 1e-12 forgives a conversion's round-off.
    return len(x) == 0 or bool(np.ptp(x) <= 1e-12 * np.max(np.abs(x)))


def _runs(x: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Start and length of every stretch of equal values."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(x) != 0) + 1])
    return starts, np.diff(np.append(starts, len(x)))
