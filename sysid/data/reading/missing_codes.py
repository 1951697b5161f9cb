"""Numbers that stand for a missing measurement: -999, 9999, or 0 where nothing comes near 0.

A code is one number, repeated exactly, beyond all others by a large part of their range, from
which the signal returns to where it was. A clipping sensor, a signal that is switched off and a
counter that starts over have neighbours on the way, or stay away from where they were.
"""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.errors import UsageError, argument

NINES = re.compile(r"-99|-?9{3,}(\.9+)?|-?9{2}\.9{2,}|-?9{2,}\.(25|0)")
"""Numbers that are written where there is none."""

APART = 0.5
"""Distance from all other values, as a share of their range."""

RETURNS = 0.3
"""Change over an absence, as a share of the distance of the code: the signal goes on."""

MOST = 0.05
"""Share of rows that a code without nines may have."""

MIN_VALUES = 20
"""Different other values: a signal of fewer is switched."""

OWN = 0.1
"""An input of one value in a code's rows, and in so few others, has moved the output there."""

Mask = NDArray[np.bool_]


def given_codes(missing: Sequence[str]) -> tuple[float, ...] | None:
    """The codes that an option names: none for "none", None where it names nothing."""
    if not missing:
        return None
    if tuple(missing) == ("none",):
        return ()
    try:
        return tuple(float(m) for m in missing)
    except ValueError:
        raise UsageError(
            f"`missing` takes numbers that stand for a missing measurement, such as -999, or "
            f"'none', got {', '.join(missing)!r}"
        ) from None


def without_codes(
    values: Array, names: Sequence[str], nu: int, missing: Sequence[str], where: str
) -> tuple[Array, tuple[Finding, ...]]:
    """Signals with NaN in place of codes, and what was taken for one.

    Args:
        values: (N, n) in the file's units, NaN in empty cells.
        names: of the columns, the inputs first.
        nu: the number of inputs; only nines are a code there, for 0 is a command.
        missing: codes by option, see ``given_codes``.
    """
    codes = given_codes(missing)
    out = values.copy()
    findings = []
    for k, name in enumerate(names):
        if codes is None:
            commands = [out[:, j] for j in range(nu) if k >= nu]
            own = _codes(out[:, k], commands)
        else:
            own = [c for c in codes if np.any(values[:, k] == c)]
        for code in own:
            at = values[:, k] == code
            out[at, k] = np.nan
            n = int(np.count_nonzero(at))
            text = (
                f"{where}: {name} is {code:g} in {n} row{'s' * (n > 1)}, which stands for a "
                "missing measurement; such cells were read as empty."
            )
            keep = f"If it was measured, keep it with {argument(missing='none')}."
            severity, advice = (Severity.WARNING, keep) if codes is None else (Severity.NOTE, "")
            findings.append(Finding("missing-code", severity, text, advice, name, where))
    return out, tuple(findings)


def _codes(column: Array, commands: Sequence[Array]) -> list[float]:
    """The codes of one column, the farthest first."""
    found: list[float] = []
    while True:
        kept = np.isfinite(column) & ~np.isin(column, found)
        rows = np.flatnonzero(kept)
        if len(rows) < MIN_VALUES:
            return found
        ends = column[rows].min(), column[rows].max()
        code = next((float(c) for c in ends if _is_code(column, rows, float(c), commands)), None)
        if code is None:
            return found
        found.append(code)


def _is_code(
    column: Array, rows: NDArray[np.int64], code: float, commands: Sequence[Array]
) -> bool:
    x = column[rows]
    at = x == code
    n = int(np.count_nonzero(at))
    rest = x[~at]
    if n < 2 or len(rest) < MIN_VALUES:
        return False
    apart = float(np.min(np.abs(rest - code)))
    if apart < APART * float(np.ptp(rest)) or apart == 0.0:
        return False
    if len(np.unique(rest)) < MIN_VALUES:
        return False
    if NINES.fullmatch(f"{code:.12g}"):
        return True
    if n > MOST * len(x) or not commands:
        return False
    edges = np.diff(at.astype(int))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) + 1
    if at[0] or at[-1] or not len(first):
        return False
    moved = np.abs(x[last] - x[first])
    if float(np.quantile(moved, 0.8)) > RETURNS * apart:
        return False
    return not any(_own_value(u[rows], at) for u in commands)


def _own_value(u: Array, at: Mask) -> bool:
    """Whether an input stands at a value of its own in these rows, or in those just before."""
    for late in (0, 1):
        there = np.roll(at, -late)
        inside, rest = u[there], u[~there]
        if np.min(inside) > np.max(rest) or np.max(inside) < np.min(rest):
            return True
        same = np.ptp(inside) == 0.0
        if same and np.count_nonzero(rest == inside[0]) <= OWN * len(inside):
            return True
    return False
