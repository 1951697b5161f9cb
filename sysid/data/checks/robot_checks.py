"""Checks of a robot's log: signs, sides and units of PWM and ω."""

import math
from collections.abc import Sequence

import numpy as np

from sysid.data.column_words import meaning, words
from sysid.data.finding import Finding, Severity
from sysid.data.record import PWM_FULL_SCALE, Array, Record
from sysid.data.units import LEAST_PULSE
from sysid.errors import argument

TOP_OMEGA = 0.43 / 0.0215
"""Sprocket speed at top speed [rad/s]: 0.43 m/s over the sprocket radius of 0.0215 m."""
_SUSPECTS = (
    ("rpm", 60.0 / (2 * math.pi)),
    ("deg/s", 180.0 / math.pi),
    ("rev/s", 1.0 / (2 * math.pi)),
)
"""Unit -> what ω in rad/s is multiplied by when it is written in that unit."""


def check_robot(records: Sequence[Record]) -> list[Finding]:
    """Sign, side and unit of PWM and ω; nothing for a log that is not a robot's.

    A single motor whose names show no side may be a fan as well as a track: only the scale of its
    PWM and its sign are checked, in words that do not mention a robot.
    """
    if not all(r.is_robot_log for r in records):
        return []
    u = np.concatenate([r.u for r in records])
    y = np.concatenate([r.y for r in records])
    findings = _pwm_scale(records[0], u)
    if not _has_sides(records[0]):
        return findings + _signs(records)
    findings = findings or _omega_unit(records[0], u, y)
    findings += _signs(records)
    return findings or [
        Finding("robot", Severity.OK, "PWM and ω agree with the robot in sign, side and size.")
    ]


def _has_sides(record: Record) -> bool:
    """Whether the log is of a vehicle's two sides, or of one that its columns name."""
    names = (*record.input_names, *record.output_names)
    return (record.nu > 1 and record.ny > 1) or all(meaning(n).side for n in names)


def _pwm_scale(record: Record, u: Array) -> list[Finding]:
    top = float(np.max(np.abs(u)))
    if any(c.scale != 1.0 for c in record.inputs):
        return []
    if not all("pwm" in words(n) for n in record.input_names):
        return []  # a command of another scale, which nothing here says should be µs
    if top > 1.0001 * PWM_FULL_SCALE:
        guess, why = top, f"goes up to {top:.6g}, beyond ±20000 µs"
    elif 0 < top <= 1.0:
        guess, why = 1.0, f"stays within ±{top:.3g}, as a command in ±1 does"
    elif top <= 100.0:
        guess, why = 100.0, f"stays within ±{top:.4g}, as a command in percent does"
    elif top <= 255.0:
        guess, why = 255.0, f"stays within ±{top:.4g}, as an 8-bit command does"
    elif top <= LEAST_PULSE:
        guess, why = 1000.0, f"stays within ±{top:.5g}, where nothing moves in µs of ±20000"
    else:
        return []
    return [
        Finding(
            "pwm-scale",
            Severity.WARNING,
            f"The PWM {why}.",
            f"If full drive is {guess:g} there, give {argument(pwm_max=float(f'{guess:g}'))}"
            + (f"; on a board of ±255 {argument(pwm_max=255.0)}." if guess == 100.0 else "."),
            ", ".join(record.input_names),
        )
    ]


def _omega_unit(record: Record, u: Array, y: Array) -> list[Finding]:
    """Compare the largest |ω| with what the largest |PWM| can give."""
    # The 97th percentile of both: a burst of outliers must not pass for another unit.
    drive = min(1.0, float(np.percentile(np.max(np.abs(u), axis=1), 97)) / PWM_FULL_SCALE)
    measured = float(np.percentile(np.max(np.abs(y), axis=1), 97))
    expected = TOP_OMEGA * drive
    if (
        not record.is_in_pulse_widths
        or drive < 0.1
        or measured == 0
        or any(c.scale != 1.0 for c in record.outputs)
    ):
        return []
    ratio = measured / expected
    if 0.25 <= ratio <= 2.0:
        return []
    near = [(abs(math.log(ratio / factor)), unit) for unit, factor in _SUSPECTS]
    distance, unit = min(near)
    hint = ""
    if distance > math.log(2.0):
        unit = "ticks/360" if ratio > 2 else "rev/s"
        hint = " (with your encoder's ticks per turn)" if ratio > 2 else ""
    return [
        Finding(
            "omega-unit",
            Severity.WARNING,
            f"ω reaches {measured:.4g}, but the robot's sprockets turn at about {expected:.3g} "
            f"rad/s at {100 * drive:.0f} % drive.",
            "If the log is not in rad/s, give its unit, for example "
            f"{argument(units={record.output_names[0]: unit})}{hint}.",
            ", ".join(record.output_names),
        )
    ]


def wrong_wires(records: Sequence[Record]) -> tuple[Finding, ...]:
    """What ``check_robot`` says of the sides and signs of a vehicle; nothing where they agree."""
    if not (records[0].is_robot_log and records[0].ny > 1 and _has_sides(records[0])):
        return ()
    return tuple(_signs(records))


def exchanged_inputs(records: Sequence[Record]) -> tuple[str, ...]:
    """Inputs in the order of the outputs that follow them; empty where they are in this order."""
    first, c = records[0], _correlations(records)
    if not (first.is_robot_log and _exchanged(records, c)):
        return ()
    return first.input_names[::-1]


def _exchanged(records: Sequence[Record], c: Array) -> bool:
    """Whether each of two outputs follows the other one's command, given ``_correlations``."""
    if c.shape != (2, 2):
        return False
    together = np.abs(np.corrcoef(np.concatenate([r.u for r in records]).T))[0, 1] > 0.95
    return bool(not together and all(abs(c[j, 1 - j]) > abs(c[j, j]) + 0.2 for j in (0, 1)))


def _signs(records: Sequence[Record]) -> list[Finding]:
    first = records[0]
    c, names = _correlations(records), first.input_names
    findings = []
    if _exchanged(records, c):
        c, names = c[:, ::-1], names[::-1]
        findings.append(
            Finding(
                "side",
                Severity.WARNING,
                "The left ω follows the right PWM and the right ω the left PWM.",
                "Swap two columns or two plugs: left and right are mixed up. Until then give "
                f"{argument(inputs=list(names))}.",
            )
        )
    return findings + [
        Finding(
            "sign",
            Severity.WARNING,
            f"{y.name} runs against {names[j]} (correlation {c[j, j]:.2f}): "
            + (
                "positive PWM turns that track backward."
                if _has_sides(first)
                else f"where {names[j]} rises it falls."
            ),
            "Swap the motor's two leads or the encoder's two channels, or change the sign of the "
            f"column: {argument(units={y.name: f'-{y.file_unit or y.unit or 1}'})}.",
            y.name,
        )
        for j, y in enumerate(first.outputs[: min(first.nu, first.ny)])
        if c[j, j] < -0.3
    ]


def _correlations(records: Sequence[Record], lags: int = 6) -> Array:
    """Correlation of each ω with each PWM at the lag of largest size, shape (ny, nu)."""
    best = np.zeros((records[0].ny, records[0].nu))
    for lag in range(lags):
        u = np.concatenate([r.u[: max(len(r) - lag, 0)] for r in records])
        y = np.concatenate([r.y[lag:] for r in records])
        u, y = u - u.mean(axis=0), y - y.mean(axis=0)
        norm = np.outer(np.linalg.norm(y, axis=0), np.linalg.norm(u, axis=0))
        c = (y.T @ u) / np.where(norm > 0, norm, 1.0)
        best = np.where(np.abs(c) > np.abs(best), c, best)
    return best
