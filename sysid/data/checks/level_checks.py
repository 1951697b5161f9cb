"""Number of levels that the commands take: which static curves they can show."""

from collections.abc import Sequence

import numpy as np

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array, Record

MAX_LEVELS = 4
"""Levels up to which a curve is guessed rather than seen: a dead zone alone has two edges."""

SAME = 1e-6
"""Values closer than this share of the range are one level."""

MEANT = 0.9
"""Share of the samples that must stand on a few levels for the commands to be such a grid."""


def check_levels(records: Sequence[Record]) -> list[Finding]:
    """Inputs that take so few values that no curve between input and output can be seen.

    A log between two levels is fitted by any static curve through two points: a dead zone, a
    saturation or a curved gain would be an invention. A third level shows that there is a bend,
    not which.
    """
    findings = []
    for j, name in enumerate(records[0].input_names):
        levels = visited_levels(np.concatenate([r.u[:, j] for r in records]))
        if not 2 <= len(levels) <= MAX_LEVELS - 1:
            continue
        shown = ", ".join(f"{v:.4g}" for v in levels)
        findings.append(
            Finding(
                "levels",
                Severity.NOTE,
                f"{name} takes the values {shown} only: a dead zone, a saturation or a curved "
                f"gain cannot be identified from {len(levels)} levels.",
                "Record more levels before trusting a nonlinear structure.",
                name,
            )
        )
    return findings or [Finding("levels", Severity.OK, "The inputs take enough levels.")]


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
