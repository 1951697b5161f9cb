"""Panels of the runs of a diagnosis: errors by regime, over a variable, where they are worst."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import full_drive
from sysid.diagnosis.diagnosis import Diagnosis, Trace
from sysid.diagnosis.validation.localise import regimes as masks_of
from sysid.report.data_panels import worst_windows
from sysid.report.diagnosis_panels import AFTER, BEFORE, GREY
from sysid.report.diagnosis_words import held_out
from sysid.report.panels import Curve, Kind, Panel, Panels
from sysid.report.style import labelled

BINS = 26
MIN_SAMPLES_IN_BIN = 8
"""A bin of a profile is shown from this many samples on."""
SMOOTH = 5
"""Samples over which an acceleration is taken."""

NOISE_80 = 1.28
"""Half of the middle 80 % of a normal distribution, in standard deviations."""

MOST_REGIMES = 14

RegimeLine = tuple[str, float, float, float]
"""A regime, its share of the samples, and the RMS error of one output in it before and after."""


def _residuals(traces: Sequence[Trace], i: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Measured less simulated of output ``i`` before and after, which samples count, (N,)."""
    before = np.concatenate([t.record.y[:, i] - t.before[:, i] for t in traces])
    after = np.concatenate([t.record.y[:, i] - t.after[:, i] for t in traces])
    counted = np.concatenate([t.counted > 0 for t in traces])
    return before, after, counted & np.isfinite(before) & np.isfinite(after)


def profiles(result: Diagnosis, i: int, unit: str, floor: float) -> Panels:
    """Residuals of output ``i`` on held-out data against each regime variable.

    Mean and the middle 80 % of both models, beside those of noise.
    """
    traces = held_out(result)
    before, after, kept = _residuals(traces, i)
    variables = [_variables(t.record, i) for t in traces]
    panels = []
    for name in variables[0]:
        x = np.concatenate([v[name] for v in variables])[kept]
        x, *bands = _binned(x, before[kept], after[kept])
        if len(x) < 2:
            continue
        noise = np.full(len(x), NOISE_80 * floor)
        curves = [
            Curve("noise", x, 0.0 * noise, -noise, noise, colour=GREY),
            Curve("before", x, bands[1], bands[0], bands[2], colour=BEFORE),
        ]
        if result.grown:
            curves.append(Curve("after", x, bands[4], bands[3], bands[5], colour=AFTER))
        title, y = f"Residual over {name}", labelled("residual", unit)
        panels.append(Panel(f"profile-{name}", title, name, y, tuple(curves)))
    return tuple(panels)


def _variables(record: Record, i: int) -> dict[str, Array]:
    """Regime variables of output ``i`` by label, (N,) each."""
    input_, dt = min(i, record.nu - 1), record.dt
    channel, y = record.outputs[i], record.y[:, i]
    drive = record.u / full_drive([record])
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


def _binned(x: Array, before: Array, after: Array) -> Array:
    """Mean of each bin; lower decile, mean and upper decile before, and after, (7, bins)."""
    low, high = (float(v) for v in np.quantile(x, [0.002, 0.998])) if len(x) else (0.0, 0.0)
    bins = int(np.clip(len(x) // 30, 6, BINS))
    edges = np.linspace(low, high, bins + 1)
    index = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    inside = (x >= low) & (x <= high)
    rows = []
    for k in range(bins):
        members = inside & (index == k)
        if np.count_nonzero(members) >= MIN_SAMPLES_IN_BIN:
            rows.append([x[members].mean(), *_spread(before[members]), *_spread(after[members])])
    return np.array(rows, dtype=np.float64).reshape(-1, 7).T


def _spread(e: Array) -> tuple[float, float, float]:
    low, high = np.quantile(e, [0.1, 0.9])
    return float(low), float(e.mean()), float(high)


def regime_lines(result: Diagnosis, i: int) -> tuple[RegimeLine, ...]:
    """RMS errors of output ``i`` by regime on held-out data, the largest first."""
    traces = held_out(result)
    masks = [masks_of(t.record, i, full_drive([t.record])) for t in traces]
    before, after, kept = _residuals(traces, i)
    lines = []
    for name in masks[0]:
        inside = np.concatenate([m[name] for m in masks]) & kept
        share = float(np.count_nonzero(inside)) / max(int(np.count_nonzero(kept)), 1)
        if share >= 0.01:
            first, last = (float(np.sqrt(np.mean(e[inside] ** 2))) for e in (before, after))
            lines.append((name, share, first, last))
    return tuple(sorted(lines, key=lambda line: -line[2])[:MOST_REGIMES])


def regimes(lines: Sequence[RegimeLine], unit: str, floor: float, *, changed: bool) -> Panels:
    """The RMS error of an output in each regime before and after, over the noise floor."""
    k = np.arange(float(len(lines)))
    before, after = (np.array([line[at] for line in lines]) for at in (2, 3))
    way = Curve("", k, after, np.minimum(before, after), np.maximum(before, after), kind="dots",
                colour=GREY)  # fmt: skip
    curves = (way, *_both(k, before, after, changed=changed, kind="dots"))
    names = tuple(f"{name} · {100 * share:.0f} %" for name, share, *_ in lines)
    note = "Behind a name: its share of the samples. Upright line: the noise floor."
    return (Panel("regimes", "RMS error by regime", labelled("RMS error", unit), "", curves,
                  rules=(0.0, floor), names=names, note=note),)  # fmt: skip


def _both(
    x: Array, before: Array, after: Array, *, changed: bool, kind: Kind = "line"
) -> tuple[Curve, ...]:
    first = Curve("before" if changed else "simulated", x, before, kind=kind, colour=BEFORE)
    return (first, Curve("after", x, after, kind=kind, colour=AFTER)) if changed else (first,)


def worst(result: Diagnosis, i: int, count: int = 2) -> Panels:
    """The stretches of held-out data in which the original model errs most on output ``i``.

    Measured and simulated, then the command of each.
    """
    ranked = []
    for t in held_out(result):
        squares = (t.record.y[:, i] - t.before[:, i]) ** 2
        squares = np.where((t.counted > 0) & np.isfinite(squares), squares, 0.0)
        size = _window(t.record)
        starts = worst_windows(np.sqrt(squares), size, count)
        ranked += [(-float(np.sum(squares[at : at + size])), t, at, size) for at in starts]
    ranked.sort(key=lambda found: found[0])
    drawn = [stretch(t, i, slice(at, at + size), changed=result.grown)
             for _, t, at, size in ranked[:count]]  # fmt: skip
    return tuple(panels[k] for k in (0, 1) for panels in drawn)


def _window(record: Record) -> int:
    """About eight seconds of a robot, a twentieth of other records."""
    wanted = round(8.0 / record.dt) if record.is_robot_log else len(record) // 15
    return max(min(max(wanted, 60), len(record)), 1)


def stretch(trace: Trace, i: int, part: slice, *, changed: bool) -> tuple[Panel, Panel]:
    """Output ``i`` measured and simulated in a part of a record, and its command."""
    r, t = trace.record, trace.record.t[part]
    y, u = r.outputs[i], r.inputs[min(i, r.nu - 1)]
    time = f"time in {r.name} [s]"
    curves = (
        Curve("measured", t, r.y[part, i], colour=GREY),
        *_both(t, trace.before[part, i], trace.after[part, i], changed=changed),
    )
    command = Curve("", t, r.u[part, min(i, r.nu - 1)], kind="steps", colour=3)
    return (
        Panel("worst", y.name, time, labelled(y.name, y.unit), curves),
        Panel("command", "Its command", time, labelled(u.name, u.unit), (command,)),
    )
