"""Checks of a robot's log: signs, sides and units of PWM and ω."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sysid.data.column_words import meaning, words
from sysid.data.facts import LogFacts
from sysid.data.finding import Finding, Severity, ok_unless
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


@ok_unless("robot", "PWM and ω agree with the robot in sign, side and size.")
def _check_vehicle(records: Sequence[Record]) -> Iterator[Finding]:
    scale = _pwm_scale(records)
    yield from scale or _omega_unit(records)
    yield from _signs(records)


def check_robot(facts: LogFacts) -> list[Finding]:
    """Sign, side and unit of PWM and ω; nothing for a log that is not a robot's.

    A single motor whose names show no side may be a fan as well as a track: only the scale of its
    PWM and its sign are checked, in words that do not mention a robot.
    """
    records = facts.outliers.records
    if not all(r.is_robot_log for r in records):
        return []
    if not _has_sides(records[0]):
        return [*_pwm_scale(records), *_signs(records)]
    return _check_vehicle(records)


def _has_sides(record: Record) -> bool:
    """Whether the log is of a vehicle's two sides, or of one that its columns name."""
    names = (*record.input_names, *record.output_names)
    return (record.nu > 1 and record.ny > 1) or all(meaning(n).side for n in names)


_SCALES = (
    (1.0, 1.0, "stays within ±{:.3g}, as a command in ±1 does"),
    (100.0, 100.0, "stays within ±{:.4g}, as a command in percent does"),
    (255.0, 255.0, "stays within ±{:.4g}, as an 8-bit command does"),
    (LEAST_PULSE, 1000.0, "stays within ±{:.5g}, where nothing moves in µs of ±20000"),
)
"""Largest command, what full drive then is likely to be, and why."""


def _pwm_scale(records: Sequence[Record]) -> list[Finding]:
    first = records[0]
    top = float(np.max([np.max(np.abs(r.u)) for r in records]))
    # a command of another scale, which nothing here says should be µs
    others = any(c.scale != 1.0 or "pwm" not in words(c.name) for c in first.inputs)
    guess, why = next(((g, why) for most, g, why in _SCALES if 0 < top <= most), (0.0, ""))
    if top > 1.0001 * PWM_FULL_SCALE:
        guess, why = top, "goes up to {:.6g}, beyond ±20000 µs"
    if others or not why:
        return []
    advice = f"If full drive is {guess:g} there, give {argument(pwm_max=float(f'{guess:g}'))}"
    advice += f"; on a board of ±255 {argument(pwm_max=255.0)}." if guess == 100.0 else "."
    text = f"The PWM {why.format(top)}."
    return [Finding("pwm-scale", Severity.WARNING, text, advice, ", ".join(first.input_names))]


def _omega_unit(records: Sequence[Record]) -> Iterator[Finding]:
    """Compare the largest |ω| with what the largest |PWM| can give."""
    # The 97th percentile of both: a burst of outliers must not pass for another unit.
    first = records[0]
    driven, measured = (
        float(np.percentile(np.concatenate([np.max(np.abs(x), axis=1) for x in of_all]), 97))
        for of_all in ([r.u for r in records], [r.y for r in records])
    )
    drive = min(1.0, driven / PWM_FULL_SCALE)
    converted = any(c.scale != 1.0 for c in first.outputs)
    if not first.is_in_pulse_widths or drive < 0.1 or measured == 0 or converted:
        return
    expected = TOP_OMEGA * drive
    ratio = measured / expected
    if 0.25 <= ratio <= 2.0:
        return
    distance, unit = min((abs(math.log(ratio / factor)), unit) for unit, factor in _SUSPECTS)
    hint = ""
    if distance > math.log(2.0):
        unit = "ticks/360" if ratio > 2 else "rev/s"
        hint = " (with your encoder's ticks per turn)" if ratio > 2 else ""
    text = (
        f"Is {first.output_names[0]} in rad/s? It reaches {measured:.4g}, the bundled robot's "
        f"{expected:.3g} at {100 * drive:.0f} % drive."
    )
    advice = (
        "If the log is not in rad/s, give its unit, for example "
        f"{argument(units={first.output_names[0]: unit})}{hint}."
    )
    yield Finding("omega-unit", Severity.WARNING, text, advice, ", ".join(first.output_names))


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


def _signs(records: Sequence[Record]) -> Iterator[Finding]:
    first = records[0]
    c, names = _correlations(records), first.input_names
    if _exchanged(records, c):
        c, names = c[:, ::-1], names[::-1]
        text = "The left ω follows the right PWM and the right ω the left PWM."
        advice = (
            "Swap two columns or two plugs: left and right are mixed up. Until then give "
            f"{argument(inputs=list(names))}."
        )
        yield Finding("side", Severity.WARNING, text, advice)
    for j, y in enumerate(first.outputs[: min(first.nu, first.ny)]):
        if c[j, j] < -0.3:
            text = f"{y.name} runs against {names[j]} (correlation {c[j, j]:.2f}): "
            turns = "positive PWM turns that track backward."
            text += turns if _has_sides(first) else f"where {names[j]} rises it falls."
            unit = {y.name: f"-{y.file_unit or y.unit or 1}"}
            advice = (
                "Swap the motor's two leads or the encoder's two channels, or change the sign of "
                f"the column: {argument(units=unit)}."
            )
            yield Finding("sign", Severity.WARNING, text, advice, y.name)


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
