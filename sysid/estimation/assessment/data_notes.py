"""Findings about the data that matter to one kind of model, repeated with its fit."""

from collections.abc import Sequence

from sysid.data.finding import Finding, Severity
from sysid.structures.base import Structure

FOR_LINEAR = ("nonlinearity", "integrates")
"""Findings that are no fault of the log but say what the numbers of a linear structure hide."""

FOR_NONLINEAR = ("levels",)
"""Findings that say what no nonlinear structure can learn from this log."""


def notes_for(structure: Structure, findings: Sequence[Finding]) -> tuple[str, ...]:
    """The sentences of warnings, and of the notes that matter to such a structure.

    Args:
        findings: verdicts on the data, of any severity.
    """
    codes = FOR_LINEAR if structure.traits.linear else FOR_NONLINEAR
    return tuple(
        f.text
        for f in findings
        if f.severity >= Severity.WARNING or (f.severity >= Severity.NOTE and f.code in codes)
    )
