"""The power bench as a whole: battery, bridges, and their use in missions and diagnoses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.documents import plain_object
from sysid.data.finding import Finding, Severity
from sysid.data.reading.read_options import ReadOptions
from sysid.data.yaml_files.source import read_yaml
from sysid.effects.measured import Measured
from sysid.errors import UsageError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tuning.written import rewritten
from sysid.testbench.power.battery import HOUR, Battery, fit_battery
from sysid.testbench.power.bridge import Bridge, fit_bridge
from sysid.testbench.power.power_log import ANY_FILE, PowerLog, read_power_log

DISAGREE = 3.0
"""Standard errors by which two batteries' or bridges' numbers differ before that is said."""
STICKS = 1.5
"""Ratio of the command that starts a motor to the one at which it stops from which dry friction of
standstill is seen."""


@dataclass(frozen=True, eq=False)
class PowerBench:
    """Results from files of the power bench.

    Attributes:
        batteries: one for each log of rests and loads.
        bridges: one for each staircase and side.
        full_current: current of both motors at full drive [A]: given, or the largest of the logs.
    """

    batteries: tuple[Battery, ...]
    bridges: tuple[Bridge, ...]
    full_current: float | None
    findings: tuple[Finding, ...]

    def supply(self) -> dict[str, Measured]:
        """Keys of a mission's ``vehicle.supply``, each with its value and standard error."""
        measured: dict[str, Measured] = {}
        if self.batteries:
            measured |= self._of_battery()
        voltages = [b for b in self.bridges if b.quantity == "voltage"]
        every = [d for b in voltages or self.bridges for d in b.directions().items()]
        for name in ("forward", "backward"):
            bands = [(d.dead_band, d.dead_band_std_error) for n, d in every if n == name]
            if bands:
                measured[f"dead_band_{name}"] = _mean(bands)
        jumps = [(d.jump, d.jump_std_error) for _, d in every]
        if any(j > DISAGREE * e and j > 0.0 for j, e in jumps):
            measured["dead_band_jump"] = _mean(jumps)
        if voltages:  # the dead band is taken off the command before
            measured["voltage"] = _mean([(d.gain, d.gain_std_error) for _, d in every])
        return measured

    def _of_battery(self) -> dict[str, Measured]:
        """Voltage, sag at full drive and loss by discharge."""
        b = _joined(self.batteries)
        E, current = b["open"], self.full_current or 0.0
        measured = {"voltage": E}
        if current > 0.0:
            ratio = b["settled"].value * current / E.value
            relative = b["settled"].std_error / max(b["settled"].value, 1e-12)
            error = ratio * math.hypot(relative, E.std_error / E.value)
            measured["sag"] = Measured(ratio, error)
        if "slope" in b and current > 0.0:
            mean = float(np.mean([x.currents[0] for x in self.batteries]))
            each = mean / HOUR / E.value
            measured["loss"] = Measured(b["slope"].value * each, b["slope"].std_error * each)
        return measured

    def sentences(self) -> tuple[str, ...]:
        """What the numbers mean, in words; ± is half of a 95 % interval."""
        return (*map(self._battery_words, self.batteries), *_bridges_words(self.bridges))

    def _battery_words(self, b: Battery) -> str:
        text = (
            f"{b.name}: {b.open_voltage:.4g} ± {NORMAL * b.open_std_error:.2g} V without load, "
            f"{1e3 * b.resistance:.4g} ± {1e3 * NORMAL * b.std_error:.2g} mΩ immediately"
        )
        for branch in b.branches:
            reach = 1e3 * NORMAL * branch.std_error
            text += (
                f", {1e3 * branch.resistance:.3g} ± {reach:.2g} mΩ more after "
                f"{branch.tau:.3g} ± {NORMAL * branch.tau_std_error:.2g} s"
            )
        if b.branches:
            text += f"; {1e3 * b.settled:.4g} mΩ under a lasting load"
        if b.slope is not None and b.slope_std_error is not None:
            text += f"; {b.slope:.3g} ± {NORMAL * b.slope_std_error:.2g} V less for each Ah"
        return text + "."

    def summary(self) -> dict[str, Any]:
        """All of it as a JSON object, which a diagnosis can read from a file."""
        supply = self.supply()
        return plain_object(
            {
                "battery": self.batteries,
                "bridge": self.bridges,
                "full_current_A": self.full_current,
                "vehicle": {"supply": {k: m.value for k, m in supply.items()}},
                "measured": supply,
                "sentences": self.sentences(),
                "findings": self.findings,
            }
        )


def bench_power(
    paths: Sequence[str | Path],
    units: Mapping[str, str] | None = None,
    pwm_max: float | None = None,
    full_current: float | None = None,
    bags: ReadOptions = ANY_FILE,
) -> PowerBench:
    """Characterise battery and H-bridge from logs or tables.

    Args:
        paths: of rests and loads (battery's voltage and current), of a staircase of PWM (with the
            motor's voltage, speed or current), or both in one file.
        units: column → its unit in the file.
        pwm_max: command of full drive, where it is neither a duty nor ± 20000 µs.
        full_current: current of both motors together at full drive [A]; None for the largest of
            the logs.
        bags: of bags, what is which column, their stamps and their latencies.

    Raises:
        DataError: a file describes neither, or has too few rows.
    """
    if not paths:
        raise UsageError("no file is named: give logs of rests and loads, or of a staircase of PWM")
    if full_current is not None and not (math.isfinite(full_current) and full_current > 0.0):
        raise UsageError(f"`full_current` is {full_current:g}: give a current above 0 in A")
    batteries, bridges, said = [], [], []
    for path in paths:
        log = read_power_log(path, units, pwm_max, bags)
        said += [f for f in log.findings if f.severity > Severity.NOTE]
        if log.voltage is not None and log.current is not None:
            batteries.append(fit_battery(log.name, log.t, log.voltage, log.current))
            said += _battery_findings(batteries[-1], log)
        for side, (quantity, answer) in log.answers.items():
            drive = log.drives[side]
            made = fit_bridge(
                log.name, side, drive, quantity, answer, log.voltage, log.t is not None
            )
            bridges.append(made)
            said += _bridge_findings(made)
    largest = max((b.currents[1] for b in batteries), default=None)
    if batteries and full_current is None:
        said.append(
            Finding(
                "full-current",
                Severity.NOTE,
                f"The sag is that of {largest:.3g} A, the largest current of the logs.",
                "Give the current of both motors at full drive with `full_current`.",
            )
        )
    current = largest if full_current is None else full_current
    return PowerBench(tuple(batteries), tuple(bridges), current, tuple(said))


def write_supply(mission: Path, bench: PowerBench) -> Path:
    """Write what was measured into the section ``vehicle.supply`` of a mission; the rest stays."""
    load_mission(mission)  # refused before it is touched
    values = read_yaml(mission).values
    keys = {k: float(f"{m.value:.4g}") for k, m in bench.supply().items()}
    if not keys:
        raise UsageError("no measured value belongs to a mission's vehicle.supply")
    vehicle = {**(values.get("vehicle") or {})}
    vehicle["supply"] = {**(vehicle.get("supply") or {}), **keys}
    rewritten(mission, None, {"vehicle": vehicle})
    return mission


def _mean(pairs: Sequence[tuple[float, float]]) -> Measured:
    """Mean of several; the error is their scatter's or their own, whichever is larger."""
    values = np.array([v for v, _ in pairs])
    error = math.sqrt(sum(e * e for _, e in pairs)) / len(pairs)
    scatter = float(np.std(values, ddof=1)) if len(pairs) > 1 else 0.0
    return Measured(float(values.mean()), max(error, scatter))


def _joined(batteries: Sequence[Battery]) -> dict[str, Measured]:
    """Open-circuit voltage, settled resistance and slope of one or several logs."""
    joined = {
        "open": _mean([(b.open_voltage, b.open_std_error) for b in batteries]),
        "settled": _mean([(b.settled, b.settled_std_error) for b in batteries]),
    }
    slopes = [(b.slope, b.slope_std_error or 0.0) for b in batteries if b.slope is not None]
    if slopes:
        joined["slope"] = _mean(slopes)
    return joined


def _battery_findings(b: Battery, log: PowerLog) -> list[Finding]:
    findings = []

    def say(code: str, severity: Severity, sentence: str, advice: str = "") -> None:
        findings.append(Finding(code, severity, f"{b.name}: {sentence}", advice, record=b.name))

    if b.turned:
        say("current-sign", Severity.NOTE, "drawn current is negative in this log.")
    if not b.rests:
        say(
            "no-rest",
            Severity.WARNING,
            "the battery never rests, so the open-circuit voltage is extrapolated.",
            "Record it without load before and after.",
        )
    if log.t is None:
        say(
            "steady-table",
            Severity.NOTE,
            "a table without time: its resistance includes slow recovery at these load durations.",
        )
    elif b.slope is None:
        say(
            "no-slope",
            Severity.NOTE,
            f"{1e3 * (b.charge or 0.0):.3g} mAh are too little to measure the fall of the "
            "open-circuit voltage.",
        )
    if b.resistance <= 0.0:
        say(
            "no-resistance",
            Severity.WARNING,
            "the voltage does not drop immediately when current is drawn.",
            "Record voltage and current at the same instants, and faster than the load changes.",
        )
    return findings


def _bridge_findings(bridge: Bridge) -> list[Finding]:
    findings = []
    where = f"{bridge.name}{' ' + bridge.side if bridge.side else ''}"

    def say(code: str, severity: Severity, sentence: str, advice: str = "") -> None:
        findings.append(Finding(code, severity, f"{where}: {sentence}", advice, record=bridge.name))

    if bridge.quantity != "voltage":
        say(
            "not-the-bridge-alone",
            Severity.NOTE,
            f"the response was measured by {bridge.quantity}, so the dead band includes the "
            "motor's friction.",
            "Measure the voltage at the motor's leads to distinguish the two.",
        )
    if bridge.turned:
        say("answer-sign", Severity.NOTE, "positive commands give negative responses.")
    missing = [n for n in ("forward", "backward") if n not in bridge.directions()]
    if missing:
        say("one-direction", Severity.NOTE, f"no step reaches far enough {missing[0]}.")
    for name, d in bridge.directions().items():
        if d.starts is not None and d.stops is not None and d.starts > STICKS * d.stops:
            say(
                "sticks",
                Severity.NOTE,
                f"{name} it starts at {100 * d.starts:.3g} % of full drive and stops at "
                f"{100 * d.stops:.3g} %: friction at standstill.",
            )
        if d.bends:
            say(
                "bends",
                Severity.WARNING,
                f"{name} the response is nonlinear.",
                "The gain is a mean: fit a Hammerstein–Wiener model, or diagnose for a soft gain.",
            )
    return findings


def _bridges_words(bridges: Sequence[Bridge]) -> tuple[str, ...]:
    sentences = []
    for b in bridges:
        for name, d in b.directions().items():
            reach = 100 * NORMAL * d.dead_band_std_error
            text = (
                f"{b.name}{' ' + b.side if b.side else ''}, {name}: nothing up to "
                f"{100 * d.dead_band:.3g} ± {reach:.2g} % of full drive"
            )
            if d.jump:
                text += f", then a jump worth {100 * d.jump:.3g} %"
            text += f", {d.at_full:.4g} ± {NORMAL * d.at_full_std_error:.2g} {b.unit} at full drive"
            drop = b.drop(d)
            if drop is not None:
                text += f", {drop[0]:.3g} ± {NORMAL * drop[1]:.2g} V less than the supply"
            sentences.append(text + ".")
    return tuple(sentences)
