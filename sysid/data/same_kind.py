"""Whether a record has the channels, units and sample time of another record or of a model."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

from sysid.data.finding import Finding, Severity
from sysid.data.reading.timing import held_on_grid, measured_on_grid
from sysid.data.record import Channel, Record
from sysid.errors import DataError

SAME_CLOCK = 0.01
"""Relative difference of sample times below which two clocks are the same."""


class Sampled(Protocol):
    """What has channels and a sample time [s]."""

    @property
    def inputs(self) -> tuple[Channel, ...]: ...
    @property
    def outputs(self) -> tuple[Channel, ...]: ...
    @property
    def dt(self) -> float: ...


def difference(record: Record, other: Sampled, called: str, unstated_fits: bool = False) -> str:
    """In what a record is of another kind, as a sentence without its full stop; empty where alike.

    Args:
        called: the name of ``other`` in the sentence.
        unstated_fits: whether a unit that one of both does not state is taken for the other's.
    """
    if (names := _names(record)) != (wanted := _names(other)):
        return (
            f"{record.name} has {_arrow(names)} but {called} has {_arrow(wanted)}; choose the "
            "same columns with `inputs` and `outputs`"
        )
    for channel, same in zip(_channels(record), _channels(other), strict=True):
        fits = unstated_fits and not (channel.unit and same.unit)
        if channel.unit != same.unit and not fits:
            return (
                f"{channel.name} is in {channel.unit or 'no unit'} in {record.name}, in "
                f"{same.unit or 'no unit'} in {called}; give its unit with `units`"
            )
    if abs(record.dt - other.dt) > SAME_CLOCK * other.dt:
        return (
            f"{record.name} is sampled every {record.dt:.4g} s, {called} every {other.dt:.4g} s; "
            "fit the logs together, which reads all at the coarsest step"
        )
    return ""


def require_same_kind(records: Sequence[Record], first: Record) -> None:
    """Refuse records whose channels, units or sample time are not those of the first one."""
    for record in records:
        if unlike := difference(record, first, first.name):
            raise DataError(unlike)


def _channels(owner: Sampled) -> tuple[Channel, ...]:
    return (*owner.inputs, *owner.outputs)


def _names(owner: Sampled) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return tuple(c.name for c in owner.inputs), tuple(c.name for c in owner.outputs)


def _arrow(names: tuple[tuple[str, ...], tuple[str, ...]]) -> str:
    inputs, outputs = (", ".join(side) or "nothing" for side in names)
    return f"{inputs} -> {outputs}"


MOST = 20.0
"""Sample times that differ by more are mostly a unit misread; such logs are not fitted together."""


def at_step(record: Record, dt: float) -> Record:
    """A record at a coarser step: y as measured at its instants, u the mean until the next one.

    ū_k = (1/dt)∫ u(τ)dτ over [t_k, t_k + dt) acts on a plant as the finer input
    did, to first order.

    Args:
        dt: the step [s].
    """
    ratio = dt / record.dt
    rows = round(ratio)
    if record.dt == dt:
        return record
    if abs(ratio - 1.0) > SAME_CLOCK:
        if abs(ratio / rows - 1.0) <= SAME_CLOCK / len(record):
            record = record.every(rows)
        else:
            between = (partial(put, record.t, dt) for put in (measured_on_grid, held_on_grid))
            record = replace(record, weights=None, unused=None).mapped(*between)
    return replace(record, dt=dt)


def common_step(
    records: Sequence[Record], dt: float | None = None
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records at one step, and what was done; steps within 1 % are one clock, the first one's.

    Args:
        records: of one system.
        dt: the step wanted [s], None for that of the coarsest record.
    """
    steps = [r.dt for r in records]
    wanted = next(s for s in steps if s >= max(steps) / (1.0 + SAME_CLOCK)) if dt is None else dt
    finer = [r for r in records if r.dt < wanted * (1.0 - SAME_CLOCK)]
    fastest = min(records, key=lambda r: r.dt)
    if wanted > MOST * fastest.dt:
        raise DataError(
            f"{fastest.name} is sampled every {fastest.dt:.4g} s, the others every {wanted:.4g} s; "
            "check the unit of its time, or decimate it"
        )
    read = tuple(at_step(r, wanted) if r.dt < wanted * (1.0 + SAME_CLOCK) else r for r in records)
    findings = tuple(
        Finding(
            "common-step",
            Severity.NOTE,
            f"{r.name}: one sample every {r.dt:.6g} s was read every {wanted:.6g} s, the sample "
            "time of all together.",
            "Fit it alone to use every sample.",
            record=r.name,
        )
        for r in finer
    )
    return read, findings


def with_validation(
    records: Sequence[Record], validation: Sequence[Record]
) -> tuple[tuple[Record, ...], tuple[Record, ...], tuple[Finding, ...]]:
    """Both at the step of the coarsest record, and what was done, see ``common_step``."""
    for record in validation:
        require_same_kind([replace(record, dt=records[0].dt)], records[0])
    together, resampled = common_step((*records, *validation))
    return together[: len(records)], together[len(records) :], resampled
