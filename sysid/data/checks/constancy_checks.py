"""What changes within a log, in sentences: gains, time constants, levels."""

from collections.abc import Sequence

from sysid.data.checks.constancy import Change, Part
from sysid.data.finding import Finding, Severity
from sysid.data.operating_point import value_with_error
from sysid.data.record import Array, Channel, Record


def check_constancy(
    records: Sequence[Record], changes: Sequence[Change], drifts: Array, tested: bool
) -> list[Finding]:
    """What changes within the log, and when; nothing where no process shows it.

    Args:
        records: with the channels' names and units.
        changes: of gains and time constants.
        drifts: ranges of the drifts of levels, (ny,).
        tested: whether a process stands for any output.
    """
    findings = [
        Finding(
            "change", Severity.WARNING, change_sentence(c, records[0]), _ADVICE[c.is_step], c.output
        )
        for c in changes
    ]
    changed = {c.output for c in changes}
    for channel, drift in zip(records[0].outputs, drifts.tolist(), strict=False):
        if not drift or channel.name in changed:
            continue
        span = drift / channel.scale
        unit = channel.file_words or channel.unit
        text = f"The level of {channel.name} drifts by {span:.2g} {unit}".strip()
        findings.append(
            Finding(
                "drift",
                Severity.WARNING,
                f"{text} within the log, whatever the inputs do.",
                "`remove_drift=True` takes it out, so that it biases no gain or time constant.",
                channel.name,
            )
        )
    if findings or not tested:
        return findings
    return [Finding("change", Severity.OK, "Gains, time constants and levels are constant.")]


def change_sentence(change: Change, record: Record) -> str:
    """``speed: gain from volts falls by 24.0 ± 0.3 % (…) at 61.3 ± 0.4 s.``"""
    inputs = {c.name: c for c in record.inputs}
    output = next(c for c in record.outputs if c.name == change.output)
    parts = " and ".join(_part(p, inputs[p.input], output) for p in change.parts)
    when = (
        f"at {value_with_error(change.at, change.error)} s"
        if change.is_step
        else "from the first to the last sample"
    )
    return f"{change.record}: {parts} {when}."


def _part(part: Part, u: Channel, y: Channel) -> str:
    verb = "falls" if part.change < 0.0 else "rises"
    by = value_with_error(100.0 * abs(part.change), 100.0 * part.error)
    if not part.is_gain:
        numbers = f"{part.before:.3g} to {part.after:.3g} s"
        return f"the time constant of {y.name} {verb} by {by} % ({numbers})"
    factor = u.scale / y.scale
    unit = f" {y.file_words or y.unit or y.name} per {u.file_words or u.unit or u.name}"
    numbers = f"{factor * part.before:.4g} to {factor * part.after:.4g}{unit}"
    return f"the gain from {u.name} to {y.name} {verb} by {by} % ({numbers})"


_ADVICE = {
    True: "One model does not describe both parts: cut the log there (`trim`) and fit each.",
    False: "A model of the whole log is an average: warming, an emptying battery or wear?",
}
"""What to do, by whether it changes at one time."""
