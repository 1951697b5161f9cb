"""What can be shown of logs, and of models on logs: data, spectra, fits, residuals, horizons."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.criteria.fit import fit_percent
from sysid.criteria.verdicts import ResidualReport
from sysid.data.record import Array, Record
from sysid.errors import ModelError
from sysid.estimation.assessment.figures import Start, figures, outputs, residual_tests
from sysid.estimation.assessment.forecast import Forecast
from sysid.estimation.assessment.spectra import Spectra, spectra
from sysid.estimation.information.sensitivity import MOST, Sensitivity
from sysid.plant.replay import Replay
from sysid.report.panels import RAD, Curve, Panel, Panels, Shown, draw_panels
from sysid.report.style import labelled
from sysid.structures.model import Model

LIMIT_99 = 2.576
"""Half-width of the band that holds a standard normal value with 99 %."""

HORIZONS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)
"""Steps ahead that a fit is shown for, before the free run."""

ZOOMS, ZOOM = 3, 60
"""Windows in which a fit is shown enlarged, where it is worst, and their length [samples]."""

GRID = 41
"""Levels on each side of a surface."""


def log(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Raw data, sampling interval, spectra and coherence."""
    first = records[0]
    panels = []
    for names, signals, kind in (
        (first.inputs, [r.u for r in records], "steps"),
        (first.outputs, [r.y for r in records], "line"),
    ):
        for i, channel in enumerate(names):
            curves = tuple(
                Curve(
                    r.name if len(records) > 1 else "",
                    r.t,
                    s[:, i],
                    kind="steps" if kind == "steps" else "line",
                    colour=k,
                )
                for k, (r, s) in enumerate(zip(records, signals, strict=True))
            )
            axis = labelled(channel.name, channel.unit)
            panels.append(Panel(f"log-{channel.name}", channel.name, "time [s]", axis, curves))
    found = spectra(records)
    powers = [*zip(first.input_names, found.inputs.T, strict=True)]
    powers += [*zip(first.output_names, found.outputs.T, strict=True)]
    curves = tuple(
        Curve(n, found.w, p / max(float(p.max()), 1e-300), colour=k)
        for k, (n, p) in enumerate(powers)
    )
    panels.append(
        Panel(
            "spectra", "Power spectra", RAD, "share of the largest", curves, log_x=True, log_y=True
        )
    )
    if first.nu:
        panels.append(_coherence(found, first))
    return tuple(panels)


def _coherence(found: Spectra, record: Record) -> Panel:
    curves = tuple(
        Curve(n, found.w, c, colour=k)
        for k, (n, c) in enumerate(zip(record.output_names, found.coherence.T, strict=True))
    )
    note = "Share of the output's power that depends linearly on the inputs."
    return Panel(
        "coherence", "Coherence", RAD, "γ²", curves, log_x=True, limits=(0.0, 1.05), note=note
    )


def residuals(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Correlations of the residuals with their past and with the inputs; lines at 99 %."""
    panels: list[Panel] = []
    for s in shown:
        fitted = {d.sha256 for d in s.model.provenance.data}
        seen = all(r.sha256 in fitted for r in records)
        report = residual_tests(s.model, records, fitted=seen)
        panels += residual_panels(report, s.model, f"{s.label}: " if len(shown) > 1 else "")
    return tuple(panels)


def residual_panels(report: ResidualReport, model: Model, head: str = "") -> Panels:
    """Those of one report.

    Args:
        head: what titles begin with.
    """
    panels = []
    for tests, what in ((report.whiteness, "past residuals"), (report.independence, "inputs")):
        for test, channel in zip(tests, model.outputs, strict=True):
            if test.parts is None or not test.parts.values.size:
                continue
            lags = np.array(test.parts.lags, dtype=np.float64)
            count = len(test.parts.signals)
            beside = [0.3 * (k - 0.5 * (count - 1)) for k in range(count)]
            curves = tuple(
                Curve(n if count > 1 else "", lags + beside[k], v, kind="stems", colour=k)
                for k, (n, v) in enumerate(zip(test.parts.signals, test.parts.values, strict=True))
            )
            verdict = "pass" if test.passed else "FAIL" if test.judged else "not judged"
            panels.append(
                Panel(
                    f"residuals-{what.replace(' ', '-')}-{channel.name}",
                    f"{head}{channel.name}, {what}: {verdict}",
                    "lag [samples]",
                    "correlation / its error",
                    curves,
                    rules=(0.0, -LIMIT_99, LIMIT_99),
                    note=f"p = {test.p_value:.2g}; lines: 99 %",
                )
            )
    return tuple(panels)


def fit(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Measured and simulated, whole and enlarged where the first model is worst, and residuals."""
    panels: list[Panel] = []
    for r in records:
        runs = {s.label: outputs(s.model, r, None, Start.ESTIMATED) for s in shown}
        panels += run_panels(r, runs, f", {r.name}" if len(records) > 1 else "")
    return tuple(panels)


def run_panels(record: Record, runs: Mapping[str, Array], which: str = "") -> Panels:
    """Measured outputs under runs, and what is between them.

    Args:
        runs: name → (N, ny).
        which: what names of outputs end with, where there are several records.
    """
    panels = []
    first = next(iter(runs.values()))
    fits = fit_percent([record.y], [first])
    for i, channel in enumerate(record.outputs):
        name, axis = f"{channel.name}{which}", labelled(channel.name, channel.unit)
        y = record.y[:, i]
        lines = [Curve("measured", record.t, y, colour=-1)]
        lines += [
            Curve(n, record.t, run[:, i], colour=k) for k, (n, run) in enumerate(runs.items())
        ]
        title = f"{name}: {fits[i]:.1f} % fit" if np.isfinite(fits[i]) else name
        panels.append(Panel(f"fit-{name}", title, "time [s]", axis, tuple(lines)))
        with np.errstate(invalid="ignore", over="ignore"):
            errors = tuple(replace(c, y=y - c.y) for c in lines[1:])
        words = f"{name}: measured less simulated"
        panels.append(Panel(f"residual-{name}", words, "time [s]", axis, errors, rules=(0.0,)))
        for at in worst_windows(errors[0].y) if len(y) > 2 * ZOOM else ():
            part = slice(at, at + ZOOM)
            near = tuple(replace(c, x=c.x[part], y=c.y[part]) for c in lines)
            words = f"{name} at its worst, {record.t[at]:.4g} s"
            panels.append(Panel(f"zoom-{name}-{at}", words, "time [s]", axis, near))
    return tuple(panels)


def draw_replay(path: Path, result: Replay) -> None:
    """Draw the measured outputs of a log beside the plant's."""
    record = result.record
    panels = run_panels(record, {"plant": result.simulated})
    title = f"The exported plant on {record.name}"
    draw_panels(path, title, "free run from rest", panels)


def worst_windows(error: Array, size: int = ZOOM, most: int = ZOOMS) -> list[int]:
    """First samples of the windows with the largest squared error, none over another."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.nan_to_num(error**2, nan=0.0, posinf=0.0)
    sums = np.convolve(square, np.ones(size), "valid")
    starts: list[int] = []
    for _ in range(most):
        at = int(np.argmax(sums))
        if sums[at] <= 0.0:
            break
        starts.append(at)
        sums[max(at - size, 0) : at + size] = 0.0
    return sorted(starts)


def _fits_by_horizon(
    model: Model, records: Sequence[Record], ks: Sequence[int]
) -> list[Mapping[str, float]]:
    """Fit percent at each horizon, the free run's behind them; one run where all are that run."""
    free = figures(model, records, "", None).fit_percent
    if not model.structure.traits.has_noise_model:
        return [free] * (len(ks) + 1)
    return [*(figures(model, records, "", k).fit_percent for k in ks), free]


def horizon(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Fit against steps ahead; the free run is the line's end beyond them."""
    panels = []
    longest = max(map(len, records)) // 3
    ks = [k for k in HORIZONS if k <= max(longest, 1)]
    made = {id(s): _fits_by_horizon(s.model, records, ks) for s in shown}
    x = np.array([*ks, 1.6 * ks[-1]], dtype=np.float64)
    for c in shown[0].model.outputs:
        lines = []
        for k, s in enumerate(shown):
            y = np.array([p[c.name] for p in made[id(s)]])
            lines += [
                Curve(s.label, x[:-1], y[:-1], colour=k),
                Curve("", x[-1:], y[-1:], kind="dots", colour=k),
            ]
        panels.append(
            Panel(
                f"horizon-{c.name}",
                c.name,
                "steps ahead",
                "fit [%]",
                tuple(lines),
                log_x=True,
                note="Dot at the right: free run.",
            )
        )
    return tuple(panels)


def surface(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """The next output over the one at rest before it, at several constant inputs: one-step maps."""
    panels = []
    for s in shown:
        model = s.model
        if not model.inputs or len(model.ranges) < len(model.inputs) + len(model.outputs):
            raise ModelError(f"{s.label} does not know the ranges of its signals; fit it again")
        length = model.structure.first_sample() + 1
        for i, out in enumerate(model.outputs):
            low, high = model.ranges[len(model.inputs) + i]
            y = np.linspace(float(low), float(high), GRID)
            j = min(i, len(model.inputs) - 1)
            curves = []
            for k, level in enumerate(np.linspace(model.ranges[j][0], model.ranges[j][1], 5)):
                u = np.zeros((length, len(model.inputs)))
                u[:, j] = level
                nexts = np.array([_next(model, u, i, v, length) for v in y])
                unit = model.inputs[j].unit
                curves.append(Curve(f"{level:.3g} {unit}".strip(), y, nexts, colour=k))
            if all(np.ptp(c.y) == 0.0 for c in curves):
                raise ModelError(
                    f"{s.label} computes no output from measured ones, so it has no surface; that "
                    "is for narx-wavelet, narmax and arx"
                )
            axis = labelled(out.name, out.unit)
            panels.append(
                Panel(
                    f"surface-{s.label}-{out.name}",
                    f"{s.label}: next {out.name} by {model.inputs[j].name}",
                    f"{axis} held",
                    f"next {axis}",
                    tuple(curves),
                )
            )
    return tuple(panels)


def _next(model: Model, u: Array, i: int, held: float, length: int) -> float:
    y = np.zeros((length, len(model.outputs)))
    y[:, i] = held
    record = Record(u, y, model.dt, model.inputs, model.outputs)
    return float(model.predict(record, 1, 0)[-1, i])


def ranking(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Fits of several models on one log, the best first, and fit against size and cost."""
    names = [c.name for c in shown[0].model.outputs]
    made = {s.label: figures(s.model, records, "", None).fit_percent for s in shown}
    shown = sorted(shown, key=lambda s: -float(np.mean([made[s.label][n] for n in names])))
    fits = {n: np.array([made[s.label][n] for s in shown]) for n in names}

    def over(x: Array) -> tuple[Curve, ...]:
        return tuple(Curve(n, x, y, kind="dots", colour=k) for k, (n, y) in enumerate(fits.items()))

    places = np.arange(len(shown), dtype=np.float64)
    sizes = np.array([len(s.model.theta) for s in shown], dtype=np.float64)
    rows = tuple(s.label for s in shown)
    panels: Panels = (
        Panel("ranking", "Fit in free run", "fit [%]", "", over(places), names=rows),
        Panel("pareto", "Fit against size", "parameters", "fit [%]", over(sizes)),
    )
    cost = np.array([1e6 * (s.cost or np.nan) for s in shown])
    if np.isfinite(cost).all():
        panels += (
            Panel("cost", "Fit against cost", "time of a step [µs]", "fit [%]", over(cost),
                  log_x=True),
        )  # fmt: skip
    return panels


SHOWN_BEFORE = 1.0
"""Of the log so much is shown before a forecast, in lengths of that, and at least 50 samples."""


def forecast_panels(f: Forecast) -> Panels:
    """One panel an output."""
    r = f.record
    head = slice(max(f.first - max(int(SHOWN_BEFORE * len(f.t)), 50), 0), f.first)
    panels = []
    for i, channel in enumerate(r.outputs):
        t = np.concatenate([r.t[head], f.t])
        y = np.concatenate([r.y[head, i], f.measured[:, i]])
        seen = np.isfinite(y)
        curves = (
            Curve("measured", t[seen], y[seen], colour=-1),
            Curve("forecast", f.t, f.y[:, i], f.low[:, i], f.high[:, i]),
        )
        axis = labelled(channel.name, channel.unit)
        note = f"Nothing after {r.t[f.first - 1]:.6g} s was used; band: 95 %."
        panels.append(
            Panel(f"forecast-{channel.name}", channel.name, "time [s]", axis, curves, note=note)
        )
    return tuple(panels)


def sensitivity_panels(found: Sensitivity, record: Record) -> Panels:
    """The inputs over time, and when each parameter shows."""
    inputs = tuple(
        Curve(c.name, record.t, u, kind="steps", colour=k)
        for k, (c, u) in enumerate(zip(record.inputs, record.u.T, strict=True))
    )
    shown = [(p, p.when) for p in found.parameters if p.when is not None]
    names = tuple(f"{p.name} ± {196 * p.relative:.2g} %" if p.value else p.name for p, _ in shown)
    low, high = np.array([when for _, when in shown]).reshape(-1, 2).T
    within = Curve("", np.arange(float(len(shown))), 0.5 * (low + high), low, high, kind="dots")
    return (
        Panel("inputs", "Inputs", "time [s]", "", inputs),
        Panel("information", f"Time with {100 * MOST:.0f} % of its information", "time [s]", "",
              (within,), names=names, large=True),
    )  # fmt: skip
