"""All checks of a log that need no model, in a fixed order."""

from collections.abc import Sequence

import numpy as np

from sysid.data.checks.dynamics_checks import (
    check_constancy,
    check_delay,
    check_excitation,
    check_feedback,
    check_nonlinearity,
    check_sampling,
)
from sysid.data.checks.integral import check_integrals
from sysid.data.checks.robot_checks import check_robot
from sysid.data.checks.signal_checks import (
    check_constant,
    check_finite,
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

MIN_SAMPLES = 20
"""Records with fewer samples in all are too short for any of the fits."""

INCOMPLETE = frozenset(("missing", "gaps"))
"""Codes of findings of reading after which nobody may say that no sample is missing."""


def inspect_records(
    data: Sequence[Record] | LogFacts, order: int = 8, nonlinearity: bool = True
) -> tuple[Finding, ...]:
    """What reading found, then every check in a fixed order, each with a verdict in words.

    A record stands on its uniform grid when it is checked, whatever was missing in the file; only
    the findings of reading know what was filled in, and no check may say the opposite.

    Length, missing samples and constant channels come first; where one of them is fatal the other
    checks have nothing to stand on and are left out. Then stuck values, clipping, resolution and
    outliers, the robot's signs and units, excitation, sampling rate, delay, feedback, constancy and
    nonlinearity; these need an input, and see the line between their neighbours in place of
    outliers.

    Args:
        data: experiments with the same channels, or what is known of them.
        order: order the inputs should excite; the number of lags of the largest model wanted.
        nonlinearity: whether to run the one check that takes longer than a quick fit.
    """
    facts = LogFacts.of(data)
    records, reading = facts.records, facts.reading
    if not records:
        raise DataError("no record to inspect; name at least one log")
    findings = [*_check_length(records), *check_finite(records)]
    if any(f.code in INCOMPLETE for f in reading):
        findings = [f for f in findings if (f.code, f.severity) != ("missing", Severity.OK)]
    if worst(tuple(findings)) < Severity.FATAL:
        findings += check_constant(records)
    if worst(tuple(findings)) < Severity.FATAL:
        findings += [*check_stuck(records), *check_saturation(records), *check_resolution(records)]
        findings += check_outliers(records, facts.outliers)
    if worst(tuple(findings)) < Severity.FATAL and records[0].nu:
        records = facts.outliers.records
        findings += [*check_robot(records), *check_levels(records)]
        findings += check_excitation(records, order)
        findings = _with_stops(findings, [*check_integrals(facts.integrals)])
        # the controller's speed is none of the plant, and an integrator never settles
        without = {t.output for t in facts.feedback or () if t.law}
        without |= {s.output for s in facts.integrals}
        speeds = [s for s in facts.speeds if s.output not in without]
        findings += check_sampling(records[0].dt, speeds, facts.delays)
        set_points = [f.channel for f in reading if f.code == "set-point" and f.channel]
        findings += [*check_delay(facts.delays, set_points), *check_feedback(facts.feedback)]
        findings += check_constancy(
            records, facts.changes, facts.drifts, any(facts.processes), facts.changes_or_curves
        )
        if nonlinearity:
            findings += check_nonlinearity(facts.nonlinearity)
    return (*reading, *findings)


def require_usable(records: Sequence[Record]) -> None:
    """Refuse records that no fit can use: too short, not finite, or with a constant channel."""
    if not records:
        raise DataError("no record to fit; name at least one log")
    for check in (_check_length, check_finite, check_constant):
        for finding in check(records):
            if finding.severity is Severity.FATAL:
                raise DataError(finding.text)


def _with_stops(findings: list[Finding], more: list[Finding]) -> list[Finding]:
    """More findings; where they name end stops it is not said that nothing is clipped."""
    stops = {f.code for f in more} & {"saturation"}
    return [f for f in findings if f.severity > Severity.OK or f.code not in stops] + more


def _check_length(records: Sequence[Record]) -> list[Finding]:
    n = sum(len(r) for r in records)
    seconds = float(np.sum([len(r) * r.dt for r in records]))
    several = "" if len(records) == 1 else f" in {len(records)} experiments"
    text = f"{n} samples{several}, {seconds:.4g} s at {records[0].dt:.4g} s."
    if n < MIN_SAMPLES:
        return [Finding("length", Severity.FATAL, text, f"Record at least {MIN_SAMPLES} samples.")]
    if n < 100:
        return [Finding("length", Severity.NOTE, text, "Few: keep the orders low.")]
    return [Finding("length", Severity.OK, text)]
