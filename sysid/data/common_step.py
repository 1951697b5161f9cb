"""Records of different sample times at one: a finer one is read at the coarser one's step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.finding import Finding, Severity
from sysid.data.reading.stale import every_rows
from sysid.data.reading.timing import onto_grid
from sysid.data.record import Array, Record
from sysid.data.same_kind import SAME_CLOCK
from sysid.errors import DataError

MOST = 20.0
"""Sample times that differ by more are mostly a unit misread; such logs are not fitted together."""


def at_step(record: Record, dt: float) -> Record:
    """A record at a coarser step: y as measured at its instants, u the mean until the next one.

    ū_k = (1/dt)∫ u(τ)dτ over [t_k, t_k + dt) acts on a plant as the finer input
    did, to first order.

    Args:
        record: sampled at ``dt`` or finer.
        dt: the step [s].
    """
    ratio = dt / record.dt
    if abs(ratio - 1.0) <= SAME_CLOCK:
        return record if record.dt == dt else _with_step(record, dt)
    rows = round(ratio)
    if abs(ratio / rows - 1.0) <= SAME_CLOCK / len(record):
        return _with_step(every_rows(record, rows, 0), dt)
    references = record.references if record.references is not None else record.u[:, :0]
    pose = record.pose if record.pose is not None else record.y[:, :0]
    held = np.column_stack([record.u, references])
    u, y = onto_grid(record.t, dt, held, np.column_stack([record.y, pose]))
    return _with_step(record, dt, u, y)


def _with_step(record: Record, dt: float, u: Array | None = None, y: Array | None = None) -> Record:
    if u is None or y is None:
        return replace(record, dt=dt)
    return replace(
        record,
        dt=dt,
        u=u[:, : record.nu],
        y=y[:, : record.ny],
        references=None if record.references is None else u[:, record.nu :],
        pose=None if record.pose is None else y[:, record.ny :],
        weights=None,
    )


def common_step(
    records: Sequence[Record], dt: float | None = None
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records at one step, and what was done; steps within 1 % are one clock, the first one's.

    Args:
        records: of one system.
        dt: the step wanted [s], None for that of the coarsest record.

    Raises:
        DataError: their steps differ by too much.
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
