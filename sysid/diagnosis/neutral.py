"""Commands that are counted from a neutral value: pulses of 1 to 2 ms, a valve's half, 8 bits.

A dead zone, friction and a battery act on what a command is beyond the value at which nothing
happens. Where a command never comes near zero, that value is read off the log: where the output
rests, the end of a command that drives one way only, else the value that is given there most, or
the middle of those that are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.structures.model import Model

FAR = 0.3
"""A command whose smallest size is above this share of its largest never comes near zero."""

RESTS = 0.02
"""Share of its large values within which an output rests."""

LEAST = 20
"""Resting samples that say where."""

MOSTLY, ENDS = 0.5, (0.1, 0.9)
"""One command given in most of the rest is the neutral one; else it is the middle of those between
which the output rests: many are, where a dead zone is wide or something else holds the machine."""

PULSES, NEUTRAL_PULSE = (800.0, 2200.0), 1500.0
"""Pulses of hobby drives [µs], and the one that is neutral by their convention."""


def neutral_commands(records: Sequence[Record]) -> tuple[Array, bool]:
    """The value of each input at which its output rests, 0 where the log does not show another,
    (nu,); and whether each is one that was given, not only one between others.

    Beside one that is not known exactly an offset of the output says nothing.
    """
    u, y = (np.concatenate([getattr(r, part) for r in records]) for part in ("u", "y"))
    pairs = zip(
        u.T, y.T if y.shape[1] == u.shape[1] else np.tile(y[:, 0], (u.shape[1], 1)), strict=True
    )
    values, known = zip(*(_neutral(command, output) for command, output in pairs), strict=True)
    return np.array(values), all(known)


def _neutral(u: Array, y: Array) -> tuple[float, bool]:
    size, large = np.abs(u), float(np.nanquantile(np.abs(y), 0.98))
    if not (np.all(u > 0.0) or np.all(u < 0.0)) or size.min() <= FAR * size.max():
        return 0.0, True
    resting = u[np.abs(y) <= RESTS * large]
    if len(resting) < LEAST or large == 0.0:
        return 0.0, True
    if np.nanmin(y) >= -RESTS * large or np.nanmax(y) <= RESTS * large:
        ends = (u.min(), u.max())
        at = [np.isclose(resting, end).sum() for end in ends]
        return (float(ends[int(np.argmax(at))]) if max(at) >= LEAST else 0.0), True
    values, counts = np.unique(resting, return_counts=True)
    if counts.max() > MOSTLY * len(resting):
        return float(values[np.argmax(counts)]), True
    low, high = np.quantile(resting, ENDS)
    pulses = PULSES[0] <= size.min() and size.max() <= PULSES[1]
    by_convention = pulses and low <= NEUTRAL_PULSE <= high
    return (NEUTRAL_PULSE if by_convention else float(0.5 * (low + high))), False


def counted_from(neutral: Array, records: Sequence[Record]) -> tuple[Record, ...]:
    """Records whose inputs are counted from their neutral values."""
    return tuple(replace(r, u=r.u - neutral) for r in records)


def as_logged(found: Diagnosis, neutral: Array) -> Diagnosis:
    """A diagnosis of such records with models and records of the commands as they were logged."""
    traces = tuple(
        replace(t, record=replace(t.record, u=t.record.u + neutral)) for t in found.traces
    )
    inputs = found.traces[0].record.inputs
    said = ", ".join(
        f"{c.name} from {v * c.to_file[0]:.4g} {c.to_file[1]}".rstrip()
        for c, v in zip(inputs, neutral.tolist(), strict=True)
        if v
    )
    before = _offset(found.before, neutral)
    return replace(
        found,
        before=before,
        after=_offset(found.after, neutral) if found.grown else before,
        traces=traces,
        base_words=f"{found.base_words}; counts {said}, where the output rests",
    )


def _offset(model: Model, neutral: Array) -> Model:
    """A model of commands beyond their neutral values as one of the commands."""
    ranges = model.ranges.copy()
    ranges[: len(neutral)] += neutral[:, None]
    return replace(model, detrend=Detrend(neutral, np.zeros(len(model.outputs))), ranges=ranges)
