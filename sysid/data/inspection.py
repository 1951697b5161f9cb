"""All checks of a log that need no model, in a fixed order."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from sysid.data.checks.dynamics_checks import (
    check_constancy,
    check_delay,
    check_excitation,
    check_feedback,
    check_integrals,
    check_nonlinearity,
    check_sampling,
)
from sysid.data.checks.robot_checks import check_robot
from sysid.data.checks.signal_checks import (
    check_constant,
    check_finite,
    check_length,
    check_levels,
    check_outliers,
    check_resolution,
    check_saturation,
    check_stuck,
)
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity, worst
from sysid.data.record import Record
from sysid.errors import DataError

Check = Callable[[LogFacts], Iterable[Finding]]

USABLE: tuple[tuple[Check, ...], ...] = ((check_length, check_finite), (check_constant,))
"""What a fit cannot do without; where one is fatal the later ones have nothing to stand on."""

SIGNALS: tuple[Check, ...] = (check_stuck, check_saturation, check_resolution, check_outliers)
"""What each signal shows by itself."""


def inspect_records(
    data: Sequence[Record] | LogFacts, order: int = 8, nonlinearity: bool = True
) -> tuple[Finding, ...]:
    """What reading found, then every check in a fixed order, each with a verdict in words.

    Length, missing samples and constant channels come first. Then stuck values, clipping,
    resolution and outliers, the robot's signs and units, excitation, sampling rate, delay,
    feedback, constancy and nonlinearity; these need an input, and see the line between their
    neighbours in place of outliers.

    Args:
        data: experiments with the same channels, or what is known of them.
        order: order the inputs should excite; the number of lags of the largest model wanted.
        nonlinearity: whether to run the one check that takes longer than a quick fit.
    """
    facts = LogFacts.of(data)
    if not facts.records:
        raise DataError("no record to inspect; name at least one log")
    excited: Check = partial(check_excitation, order=order)
    of_inputs: tuple[Check, ...] = (
        *(check_robot, check_levels, excited, check_integrals, check_sampling, check_delay),
        *(check_feedback, check_constancy, *[check_nonlinearity] * nonlinearity),
    )
    findings: list[Finding] = []
    for checks in (*USABLE, SIGNALS, of_inputs if facts.records[0].nu else ()):
        if worst(tuple(findings)) < Severity.FATAL:
            findings += [f for check in checks for f in check(facts)]
    return (*facts.reading, *_consistent(findings, facts.reading))


def _consistent(findings: Sequence[Finding], reading: Sequence[Finding]) -> list[Finding]:
    """The findings without those that all is well where another one says that it is not.

    A record stands on its uniform grid when it is checked, whatever was missing in the file; only
    the findings of reading know what was filled in.
    """
    faults = {f.code for f in (*reading, *findings) if f.severity > Severity.OK}
    faults |= {"missing"} if "gaps" in faults else set()
    ok_of_all = [f for f in findings if f.severity is Severity.OK and f.channel is None]
    return [f for f in findings if f not in ok_of_all or f.code not in faults]


def require_usable(records: Sequence[Record]) -> None:
    """Refuse records that no fit can use: too short, not finite, or with a constant channel."""
    if not records:
        raise DataError("no record to fit; name at least one log")
    facts = LogFacts(tuple(records))
    for check in (check for checks in USABLE for check in checks):
        for finding in check(facts):
            if finding.severity is Severity.FATAL:
                raise DataError(finding.text)
