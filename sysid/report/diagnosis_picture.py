"""What the pictures of a diagnosis show, computed from its traces."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array, Record
from sysid.diagnosis.diagnosis import Diagnosis, Trace
from sysid.diagnosis.validation.localise import regimes
from sysid.report.diagnosis_words import held_out

BINS = 26
MIN_SAMPLES_IN_BIN = 8
"""A bin of a profile is shown from this many samples on."""
SMOOTH = 5
"""Samples over which an acceleration is taken."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Residuals of one output against one variable, in bins.

    Attributes:
        variable: name and unit.
        x: middle of each bin.
        before, after: rows lower decile, mean, upper decile of measured − simulated, (3, bins).
    """

    variable: str
    x: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class RegimeLine:
    """RMS error of one output in one regime before and after, and its share of the samples."""

    regime: str
    share: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Window:
    """A stretch of a record where the original model was worst: signals of one output."""

    output: str
    unit: str
    record: str
    t: Array
    measured: Array
    before: Array
    after: Array
    command: Array
    command_name: str


def full_drive(record: Record) -> Array:
    """Full drive of each command, (nu,)."""
    if record.full_drive_is_known:
        return np.full(record.nu, PWM_FULL_SCALE)
    largest: Array = np.maximum(np.max(np.abs(record.u), axis=0), 1e-12)
    return largest


def profiles(result: Diagnosis, i: int) -> tuple[Profile, ...]:
    """Residuals of output ``i`` on held-out data against every regime variable."""
    traces = held_out(result)
    names = list(_variables(traces[0].record, i))
    drawn = []
    for name in names:
        x = np.concatenate([_variables(t.record, i)[name] for t in traces])
        kept = np.concatenate([t.counted > 0 for t in traces])
        before = np.concatenate([t.record.y[:, i] - t.before[:, i] for t in traces])
        after = np.concatenate([t.record.y[:, i] - t.after[:, i] for t in traces])
        kept &= np.isfinite(before) & np.isfinite(after)
        found_profile = _binned(name, x[kept], before[kept], after[kept])
        if len(found_profile.x) > 1:
            drawn.append(found_profile)
    return tuple(drawn)


def _variables(record: Record, i: int) -> dict[str, Array]:
    """Regime variables of output ``i`` by label, (N,) each."""
    input_, dt = min(i, record.nu - 1), record.dt
    channel, y = record.outputs[i], record.y[:, i]
    drive = record.u / full_drive(record)
    smooth = np.convolve(np.pad(y, SMOOTH // 2, mode="edge"), np.ones(SMOOTH) / SMOOTH, "valid")
    command = record.inputs[input_]
    unit = channel.unit
    slope = f"{unit}²" if unit.endswith("/s") else f"{unit or '1'}/s"
    variables = {
        f"{command.name} [{command.unit or '–'}]": record.u[:, input_],
        f"{channel.name} [{unit or '–'}]": y,
        f"its slope [{slope}]": np.gradient(smooth, dt),
    }
    if record.nu > 1 and record.nu == record.ny:
        other = record.inputs[(input_ + 1) % record.nu]
        variables[f"{other.name} [{other.unit or '–'}]"] = record.u[:, (input_ + 1) % record.nu]
    variables["time [s]"] = record.t - record.t0
    variables["energy spent [s of full drive]"] = np.cumsum(np.mean(drive**2, axis=1)) * dt
    return variables


def _binned(name: str, x: Array, before: Array, after: Array) -> Profile:
    low, high = (float(v) for v in np.quantile(x, [0.002, 0.998])) if len(x) else (0.0, 0.0)
    bins = int(np.clip(len(x) // 30, 6, BINS))
    edges = np.linspace(low, high, bins + 1)
    index = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    inside = (x >= low) & (x <= high)
    rows = []
    for k in range(bins):
        members = inside & (index == k)
        if np.count_nonzero(members) >= MIN_SAMPLES_IN_BIN:
            rows.append(
                (float(x[members].mean()), *_spread(before[members]), *_spread(after[members]))
            )
    table = np.array(rows, dtype=np.float64).reshape(-1, 7).T
    return Profile(name, table[0], table[1:4], table[4:7])


def _spread(e: Array) -> tuple[float, float, float]:
    low, high = np.quantile(e, [0.1, 0.9])
    return float(low), float(e.mean()), float(high)


def regime_lines(result: Diagnosis, i: int, most: int = 14) -> tuple[RegimeLine, ...]:
    """RMS errors of output ``i`` by regime on held-out data, those of most excess first."""
    traces = held_out(result)
    masks = [regimes(t.record, i, full_drive(t.record)) for t in traces]
    kept = np.concatenate([t.counted > 0 for t in traces])
    before = np.concatenate([(t.record.y[:, i] - t.before[:, i]) ** 2 for t in traces])
    after = np.concatenate([(t.record.y[:, i] - t.after[:, i]) ** 2 for t in traces])
    kept &= np.isfinite(before) & np.isfinite(after)
    lines = []
    for name in masks[0]:
        inside = np.concatenate([m[name] for m in masks]) & kept
        share = float(np.count_nonzero(inside)) / max(int(np.count_nonzero(kept)), 1)
        if share >= 0.01:
            rms = (float(np.sqrt(np.mean(e[inside]))) for e in (before, after))
            lines.append(RegimeLine(name, share, *rms))
    return tuple(sorted(lines, key=lambda line: -line.before)[:most])


def worst_windows(result: Diagnosis, i: int, count: int = 2) -> tuple[Window, ...]:
    """The stretches of held-out data in which the original model errs most on output ``i``."""
    ranked: list[tuple[float, int, int, int]] = []
    traces = held_out(result)
    for number, trace in enumerate(traces):
        size = _window(trace.record)
        squares = (trace.record.y[:, i] - trace.before[:, i]) ** 2
        squares = np.where((trace.counted > 0) & np.isfinite(squares), squares, 0.0)
        sums = np.convolve(squares, np.ones(size), "valid")
        ranked += _peaks(sums, size, number, count)
    ranked.sort(reverse=True)
    return tuple(_cut(traces[n], i, start, size) for _, n, start, size in ranked[:count])


def _window(record: Record) -> int:
    """About eight seconds of a robot, a twentieth of other records."""
    wanted = round(8.0 / record.dt) if record.is_robot_log else len(record) // 15
    return max(min(max(wanted, 60), len(record)), 1)


def _peaks(sums: Array, size: int, number: int, count: int) -> list[tuple[float, int, int, int]]:
    """The highest sums whose windows do not overlap."""
    remaining, peaks = sums.copy(), []
    for _ in range(count):
        k = int(np.argmax(remaining))
        if not remaining[k] > 0.0:
            break
        peaks.append((float(remaining[k]), number, k, size))
        remaining[max(k - size, 0) : k + size] = -1.0
    return peaks


def _cut(trace: Trace, i: int, start: int, size: int) -> Window:
    r, input_ = trace.record, min(i, trace.record.nu - 1)
    part = slice(start, start + size)
    return Window(
        r.outputs[i].name,
        r.outputs[i].unit,
        r.name,
        r.t[part],
        r.y[part, i],
        trace.before[part, i],
        trace.after[part, i],
        r.u[part, input_],
        f"{r.inputs[input_].name} [{r.inputs[input_].unit}]"
        if r.inputs[input_].unit
        else r.inputs[input_].name,
    )
