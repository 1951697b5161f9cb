"""Rows in which a drive is released or braked: what moves there answers no command.

A log that was recorded on a bench goes on after the motor was switched off: a pendulum swings on, a
wheel coasts with an open bridge, a brake holds. No model of the driven machine is judged there. A
column of two values whose name says so (``torque_on``, ``enable``, ``brake``) marks those rows;
they are left out, and what lies between them are experiments of their own.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.column_words import releases
from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.errors import DataError

NONE = "none"
"""Given in place of a column, it keeps every row."""

LEAST_DRIVEN = 60
"""Fewer driven rows show no motion: then the column is taken for something else."""


def released_rows(
    columns: Mapping[str, Array], given: str | None, rows: int, where: str
) -> tuple[NDArray[np.bool_], tuple[Finding, ...]]:
    """Rows in which the drive is off, (N,), and the finding that tells it.

    Args:
        columns: unused columns that may say it, (N,) each.
        given: the column that says it, ``none``, or None to go by name.
        rows: N.
    """
    off = np.zeros(rows, dtype=bool)
    for name, values in columns.items():
        engaged = two_states(values)
        if engaged is None:
            if name == given:
                raise DataError(f"{where}: `enable` {name} must hold two values, 0 where it is off")
            continue
        off |= engaged if releases(name) == "brake" else ~engaged
    n = int(np.count_nonzero(off))
    if not n or (given is None and rows - n < LEAST_DRIVEN):
        return np.zeros(rows, dtype=bool), ()
    names = ", ".join(n for n, v in columns.items() if two_states(v) is not None)
    text = (
        f"{where}: {n} of {rows} rows were left out: by {names} the drive is released or braked "
        "there, and answers no command."
    )
    advice = f"`enable='{NONE}'` keeps every row."
    return off, (Finding("released", Severity.NOTE, text, advice, names, where),)


def is_switch(values: Array) -> bool:
    """Whether a column holds 0 and 1 and nothing else."""
    return two_states(values) is not None


def two_states(values: Array) -> NDArray[np.bool_] | None:
    """Where a switch is on, (N,); None for a column that is none. An empty cell holds the last."""
    there = np.flatnonzero(np.isfinite(values))
    if not len(there) or set(np.unique(values[there])) != {0.0, 1.0}:
        return None
    last = np.maximum(np.searchsorted(there, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(values[there][last] > 0.5)


def may_release(
    names: Sequence[str], given: str | None, inputs: Sequence[str] = ()
) -> tuple[str, ...]:
    """The columns to look at: where a brake is an input, what it does is to be modelled."""
    if given is not None:
        return () if given == NONE else (given,)
    braking = any(releases(n) == "brake" for n in inputs)
    return tuple(n for n in names if releases(n) and not (braking and releases(n) == "brake"))
