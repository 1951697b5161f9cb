"""The pendulum experiment as a whole: from logs of swings, or a period, to the inertia."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc

from sysid.data.documents import plain_object
from sysid.data.finding import Finding, Severity
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError
from sysid.testbench.pendulum.crossings import FreeSwing, free_swing
from sysid.testbench.pendulum.inertia import (
    BOX,
    UNITS,
    Hanging,
    box_inertia,
    root_sum_square,
    small_swing_period,
)
from sysid.testbench.pendulum.oscillation import DEGREES, Oscillation, fit_oscillation
from sysid.testbench.pendulum.swing import Swing, read_swing

RESOLUTION = 0.005
"""Standard error of a period given by hand [s]: a sample of the thesis's 200 Hz, since it took the
time between two peaks."""
AMPLITUDE = math.radians(10.0)
"""Amplitude that goes with a period given by hand [rad]: the thesis's."""
DISAGREE = 3.0
"""Standard errors by which counted and fitted periods may differ …"""
AT_LEAST = 2e-4
"""… and share of the period below which that does not matter (1 µs in 5 ms)."""
FEW_PERIODS = 10.0
"""Periods below which a log is called short: a count of them is good to 1/10 of an instant's."""
WILD_SHARE = 0.05
"""Share of measurements left out from which that is worth a warning."""
ODD = 0.01
"""Significance below which logs that differ are said to differ by more than their errors."""
FAR = 2.0
"""Ratio to a box's inertia beyond which a body's is unlikely to be its own."""


@dataclass(frozen=True, eq=False)
class LogResult:
    """One log: what swung and what was read off it."""

    swing: Swing
    free: FreeSwing
    oscillation: Oscillation

    def summary(self) -> dict[str, Any]:
        o, free = self.oscillation, self.free
        return {
            "name": self.swing.name,
            "period_s": o.period,
            "period_std_error": o.period_std_error,
            "small_swing_period_s": o.small_period,
            "small_swing_period_std_error": o.small_std_error,
            "counted": {"passages": free.from_passages, "turning_points": free.from_turns},
            "periods": float(free.passages[-1] - free.passages[0]) / o.period,
            "amplitude_deg": dict(
                zip(("first", "rms", "last"), (a / DEGREES for a in o.amplitudes), strict=True)
            ),
            "damping_ratio": o.damping_ratio,
            "dry_friction_deg": o.friction / DEGREES,
            "noise_deg": o.noise / DEGREES,
            "model": o.kind,
            "left_out": o.left_out,
        }


@dataclass(frozen=True, eq=False)
class PendulumStudy:
    """The inertia of what hangs, with what its error comes from.

    Attributes:
        hanging: masses, arms and their errors.
        period, period_std_error: mean over the logs, at the amplitude they had [s].
        small_period, small_std_error: period of small swings [s].
        amplitude: root mean square over the logs, or as given [rad].
        size: length and width of the box that the inertia is compared with [m]; None for none.
    """

    hanging: Hanging
    period: float
    period_std_error: float
    small_period: float
    small_std_error: float
    amplitude: float
    size: tuple[float, float] | None = None
    logs: tuple[LogResult, ...] = ()
    findings: tuple[Finding, ...] = field(default=())

    @property
    def inertia(self) -> float:
        """(2.51) with the period as it was [kg m²]."""
        return self.hanging.inertia(self.period)

    @property
    def corrected(self) -> float:
        """(2.51) with the period of small swings [kg m²]."""
        return self.hanging.inertia(self.small_period)

    @property
    def contributions(self) -> dict[str, float]:
        """What each measured quantity adds to the error [kg m²], the largest first."""
        return self.hanging.contributions(self.period, self.period_std_error)

    @property
    def std_error(self) -> float:
        """Of the inertia [kg m²]."""
        return root_sum_square(self.contributions)

    @property
    def corrected_std_error(self) -> float:
        """Of the corrected inertia [kg m²]."""
        return root_sum_square(self.hanging.contributions(self.small_period, self.small_std_error))

    @property
    def interval(self) -> tuple[float, float]:
        """Inertias that the period less and plus its standard error means [kg m²]."""
        low, high = (
            self.hanging.inertia(self.period + sign * self.period_std_error) for sign in (-1, 1)
        )
        return low, high

    @property
    def box(self) -> float | None:
        """Inertia of a box of the body's mass and size [kg m²]; None where no size is known."""
        return None if self.size is None else box_inertia(self.hanging.m, *self.size)

    def sentences(self) -> tuple[str, ...]:
        """What the numbers mean, in words."""
        low, high = self.interval
        error = 1e3 * self.period_std_error
        return (
            f"J = {self.inertia:.4f} kg m² uncorrected, between {low:.4f} and "
            f"{high:.4f} for ± {error:.3g} ms; {self.corrected:.4f} kg m² corrected for the "
            "amplitude of "
            f"{self.amplitude / DEGREES:.3g}° (T₀ = {self.small_period:.5g} s).",
            self._driver(),
            self._against_box(),
        )

    def _driver(self) -> str:
        parts = self.contributions
        (first, most), (second, next_most) = list(parts.items())[:2]
        error = self.period_std_error if first == "period" else self.hanging.std_error(first)
        share = 100.0 * (most / max(self.std_error, 1e-300)) ** 2
        return (
            f"The error is dominated by {first}: ± {error:.3g} {UNITS[first]} of it moves J by "
            f"{most:.2g} kg m², {share:.0f} % of the variance; next is {second} with "
            f"{next_most:.2g} kg m²."
        )

    def _against_box(self) -> str:
        if self.box is None or self.size is None:
            return "Give the body's length and width with `size` to compare J with that of a box."
        ratio, would = self.corrected / self.box, self.hanging.period(self.box)
        a, b = self.size
        beside = (
            f"a box of {a:g} m × {b:g} m and {self.hanging.m:g} kg has m/12 (a² + b²) = "
            f"{self.box:.4f} kg m²"
        )
        if 1.0 / FAR < ratio < FAR:
            return f"That is {ratio:.2g} times the value from mass and size: {beside}."
        short = 1e3 * (self.small_period - would)
        arm = (self.corrected - self.box) / -self.hanging.sensitivities(self.small_period)["l"]
        return (
            f"That is {ratio:.2g} times the value from mass and size: {beside}. To agree, the "
            f"period would have to be {abs(short):.0f} ms {'shorter' if short > 0 else 'longer'} "
            f"or the arm l {1e3 * abs(arm):.0f} mm {'longer' if arm > 0 else 'shorter'}: measure "
            "both again before using the inertia."
        )

    def summary(self) -> dict[str, Any]:
        h = self.hanging
        slopes = h.sensitivities(self.period)
        return plain_object(
            {
                "period_s": self.period,
                "period_std_error": self.period_std_error,
                "inertia_kg_m2": self.inertia,
                "std_error": self.std_error,
                "interval_kg_m2": self.interval,
                "corrected_kg_m2": self.corrected,
                "corrected_std_error": self.corrected_std_error,
                "small_swing_period_s": self.small_period,
                "small_swing_period_std_error": self.small_std_error,
                "amplitude_deg": self.amplitude / DEGREES,
                "sensitivities": slopes,
                "contributions_kg_m2": self.contributions,
                "driver": next(iter(self.contributions)),
                "box_inertia_kg_m2": self.box,
                "hanging": {
                    n: {"value": getattr(h, n), "std_error": h.std_error(n), "unit": UNITS[n]}
                    for n in slopes
                    if n != "period"
                },
                "logs": [log.summary() for log in self.logs],
                "sentences": self.sentences(),
                "findings": self.findings,
            }
        )


def inertia_of_period(
    period: float,
    hanging: Hanging | None = None,
    *,
    std_error: float = RESOLUTION,
    amplitude: float = AMPLITUDE,
    size: tuple[float, float] | None = None,
) -> PendulumStudy:
    """The inertia that a measured period means (thesis 2.51).

    Args:
        period: T [s].
        hanging: masses and arms; the thesis's unless given.
        std_error: of the period [s].
        amplitude: of the swing whose period it is [rad].
        size: length and width of the body [m]; the thesis's where the mass is, too.

    Raises:
        DataError: no inertia has that period.
    """
    hanging = hanging or Hanging()
    if not (math.isfinite(period) and period > 0.0):
        raise UsageError(f"`period` is {period:g}: give seconds above 0")
    if not (math.isfinite(std_error) and std_error >= 0.0):
        raise UsageError(f"the period's standard error is {std_error:g}: give seconds above 0")
    if not 0.0 <= amplitude < math.pi:
        raise UsageError(
            f"`amplitude` is {amplitude / DEGREES:g}°: a pendulum swings by 0 to less than 180°"
        )
    small = small_swing_period(period, amplitude)
    made = PendulumStudy(
        hanging, period, std_error, small, std_error, amplitude, _size(size, hanging)
    )
    return _possible(made)


def inertia_of_logs(
    paths: Sequence[str | Path],
    hanging: Hanging | None = None,
    options: ReadOptions | None = None,
    *,
    trim: tuple[float, float] = (0.0, 0.0),
    size: tuple[float, float] | None = None,
) -> PendulumStudy:
    """The inertia from logs of free swings of one body, each fitted, together.

    Args:
        paths: CSV or Parquet: time, and an angle, a quaternion or a position.
        hanging: masses and arms; the thesis's unless given.
        options: how to read them; ``outputs`` names the angle.
        trim: seconds left out at the head and the tail of each.
        size: length and width of the body [m]; the thesis's where the mass is, too.

    Raises:
        DataError: a log does not oscillate, or no inertia has its period.
    """
    if not paths:
        raise UsageError("no log of a swing is named: give at least one CSV or Parquet file")
    hanging = hanging or Hanging()
    logs = []
    for path in paths:
        swing = read_swing(path, options or ReadOptions(), hanging.l, trim)
        free = free_swing(swing.t, swing.angle, swing.name)
        fit = fit_oscillation(swing.t, swing.angle, free, swing.in_radians, swing.name)
        logs.append(LogResult(swing, free, fit))
    fits = [log.oscillation for log in logs]
    small, small_error, odd = _together(
        [o.small_period for o in fits], [o.small_std_error for o in fits]
    )
    if len(fits) == 1:
        period, error = fits[0].period, fits[0].period_std_error
    else:  # of one body at other amplitudes: the mean of what these make of it
        longer = float(np.mean([o.period / o.small_period for o in fits]))
        period, error = longer * small, longer * small_error
    amplitude = float(np.sqrt(np.mean([o.amplitudes[1] ** 2 for o in fits])))
    findings = (
        *(f for log in logs for f in (*log.swing.findings, *_said(log))),
        *_scatter(logs, odd),
    )
    made = PendulumStudy(
        hanging, period, error, small, small_error, amplitude, _size(size, hanging),
        tuple(logs), findings,
    )  # fmt: skip
    return _possible(made)


def _size(size: tuple[float, float] | None, hanging: Hanging) -> tuple[float, float] | None:
    """The size given, checked, or the thesis's robot's where it is that which hangs."""
    if size is not None:
        box_inertia(hanging.m, *size)
        return size
    return BOX if hanging.m == Hanging().m else None


def _possible(study: PendulumStudy) -> PendulumStudy:
    """Refuse a period that not even a point at the arm's end would have."""
    if study.inertia <= 0.0:
        least = study.hanging.period(0.0)
        raise DataError(
            f"a period of {study.period:.5g} s is shorter than the {least:.5g} s of a body without "
            "inertia of its own on these arms: check l, l1 and the masses, and that the log is "
            "sampled at least four times a period"
        )
    return study


def _together(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float, float]:
    """Mean of logs, its standard error, and how likely they would differ so much by chance.

    Weights 1/(σ² + τ²), τ² the variance between logs (DerSimonian and Laird 1986): hung up anew,
    a body does not hang as before.
    """
    y, variance = np.array(values), np.maximum(np.array(errors) ** 2, 1e-24)
    w = 1.0 / variance
    mean = float(w @ y / w.sum())
    q = float(w @ (y - mean) ** 2)
    between = max((q - (len(y) - 1)) / max(w.sum() - (w**2).sum() / w.sum(), 1e-300), 0.0)
    if len(y) > 1 and between > 0.0:
        w = 1.0 / (variance + between)
        mean = float(w @ y / w.sum())
    chance = float(chdtrc(len(y) - 1, q)) if len(y) > 1 else 1.0
    return mean, float(1.0 / math.sqrt(w.sum())), chance


def _scatter(logs: Sequence[LogResult], chance: float) -> tuple[Finding, ...]:
    if chance >= ODD:
        return ()
    periods = [log.oscillation.small_period for log in logs]
    text = (
        f"The {len(logs)} logs differ by more than their errors: their small-swing periods spread "
        f"by {1e3 * (max(periods) - min(periods)):.3g} ms; the standard error includes that."
    )
    advice = "Suspend the body the same way each time, in one plane of swing."
    return (Finding("logs-differ", Severity.WARNING, text, advice),)


def _said(log: LogResult) -> tuple[Finding, ...]:
    """What a person should know of one log."""
    o, free, name = log.oscillation, log.free, log.swing.name
    findings = []

    def say(code: str, severity: Severity, sentence: str, advice: str = "") -> None:
        findings.append(Finding(code, severity, f"{name}: {sentence}", advice, record=name))

    for what, counted in (("passages", free.from_passages), ("turning points", free.from_turns)):
        apart = abs(counted.period - o.period)
        allowed = DISAGREE * math.hypot(counted.std_error, o.period_std_error)
        if apart > max(allowed, AT_LEAST * o.period):
            say(
                "periods-disagree",
                Severity.WARNING,
                f"the {counted.instants} {what} give a period of {counted.period:.5g} s, the fit "
                f"{o.period:.5g} s, {apart / max(allowed, 1e-300) * DISAGREE:.1f} standard errors "
                "apart.",
                "See the picture: the log contains more than one free swing.",
            )
    count = float(free.passages[-1] - free.passages[0]) / o.period
    if count < FEW_PERIODS:
        say(
            "few-periods",
            Severity.WARNING,
            f"only {count:.1f} periods swing freely.",
            "Record twenty periods; the error falls as n^(-3/2).",
        )
    if o.left_out > WILD_SHARE * len(o.t):
        share = 100.0 * o.left_out / len(o.t)
        say(
            "wild-readings",
            Severity.WARNING,
            f"{share:.0f} % of the measurements are outliers, left out.",
        )
    elif o.left_out:
        say("wild-readings", Severity.NOTE, f"{o.left_out} outliers left out.")
    if not log.swing.in_radians:
        _say_unit(o, say)
    if o.kind == "sine":
        say(
            "not-a-pendulum",
            Severity.WARNING,
            "the period does not grow with the amplitude as a pendulum's does; T₀ was still "
            f"computed from the mean period and the amplitude of {o.amplitudes[1] / DEGREES:.3g}°.",
            "Check the unit of the angle, and that the hinge has no spring.",
        )
    return tuple(findings)


def _say_unit(o: Oscillation, say: Any) -> None:
    """How an angle of an untold unit was taken."""
    unit = "radians" if o.scale == 1.0 else "degrees"
    how = f"the angle is taken to be in {unit} (first amplitude {o.amplitudes[0] / DEGREES:.3g}°)"
    if o.kind == "pendulum" and o.unit_identified:
        say("angle-unit", Severity.NOTE, f"{how}: its period changes as expected in that unit.")
        return
    say(
        "angle-unit",
        Severity.WARNING,
        f"{how}, which the log does not confirm; it affects the amplitude correction only.",
        "Name the unit with `units`.",
    )
