"""What can be shown of models and logs: a function for each word of ``sysid plot WHAT``.

Each takes the models with their names and the records, and gives panels. Bands are 95 %.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.estimation.assessment.figures import Start, figures, outputs, residual_tests
from sysid.estimation.assessment.responses import (
    ResponseCurve,
    frequency_curves,
    main_paths,
    root_clouds,
    static_curves,
    step_curves,
)
from sysid.estimation.assessment.spectra import Spectra, spectra
from sysid.report.panels import Curve, Panel
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


@dataclass(frozen=True, eq=False)
class Shown:
    """A model and what to call it."""

    label: str
    model: Model


Panels = tuple[Panel, ...]


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


RAD = "frequency [rad/s]"


def _coherence(found: Spectra, record: Record) -> Panel:
    curves = tuple(
        Curve(n, found.w, c, colour=k)
        for k, (n, c) in enumerate(zip(record.output_names, found.coherence.T, strict=True))
    )
    note = "Share of the output's power that depends linearly on the inputs."
    return Panel(
        "coherence", "Coherence", RAD, "γ²", curves, log_x=True, limits=(0.0, 1.05), note=note
    )


def step(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Responses to a step of each input."""
    return _responses(shown, "step", {id(s): step_curves(s.model) for s in shown})


def impulse(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Responses to one sample of each input."""
    return _responses(shown, "impulse", {id(s): step_curves(s.model, pulse=True) for s in shown})


def curve(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Outputs at rest over each input: statics, friction and limits."""
    return _responses(shown, "curve", {id(s): static_curves(s.model) for s in shown})


def _responses(
    shown: Sequence[Shown], kind: str, curves: Mapping[int, Sequence[ResponseCurve]]
) -> Panels:
    """A panel for each path that any of the models has; side paths that pass on little stay out."""
    wanted = {(c.input, c.output) for each in curves.values() for c in main_paths(each)}
    first = shown[0].model
    units = {c.name: c.unit for c in (*first.inputs, *first.outputs)}
    panels = []
    for key in [(c.input, c.output) for c in curves[id(shown[0])]]:
        if key not in wanted:
            continue
        lines = [
            (s, c, k)
            for k, s in enumerate(shown)
            for c in curves[id(s)]
            if (c.input, c.output) == key
        ]
        u, y = key
        notes = dict.fromkeys(c.note for _, c, _ in lines if c.note)
        per = "" if kind == "curve" or notes else f" per {labelled(u, units.get(u, ''))}"
        panels.append(
            Panel(
                f"{kind}-{u}-{y}",
                f"{u} → {y}" + "".join(f", {n}" for n in notes),
                labelled(u, units.get(u, "")) if kind == "curve" else "time [s]",
                labelled(y, units.get(y, "")) + per,
                tuple(_banded(s.label, c.x, c.y, c.error, k) for s, c, k in lines),
                rules=() if kind == "curve" else (0.0,),
            )
        )
    return tuple(panels)


def _banded(label: str, x: Array, y: Array, error: Array, colour: int) -> Curve:
    with np.errstate(invalid="ignore"):
        return Curve(label, x, y, y - NORMAL * error, y + NORMAL * error, colour=colour)


def bode(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Gain and phase of each path, over the measured frequency response where there is a log."""
    every = {id(s): {(c.input, c.output): c for c in frequency_curves(s.model)} for s in shown}
    found = spectra(records) if records else None
    panels = []
    for u, y in _paths(shown, every):
        gains, phases = [], []
        if found is not None:
            j, i = records[0].input_names.index(u), records[0].output_names.index(y)
            g, error = found.response[:, i, j], found.gain_error[:, i]
            size = np.abs(g)
            with np.errstate(over="ignore"):
                ends = size * np.exp(-NORMAL * error), size * np.exp(NORMAL * error)
            gains.append(Curve("measured", found.w, size, *ends, kind="dots", colour=-1))
            sure = found.coherence[:, i] > 0.5
            angle = np.degrees(np.unwrap(np.angle(g[sure])))
            phases.append(Curve("measured", found.w[sure], angle, kind="dots", colour=-1))
        for k, s in enumerate(shown):
            c = every[id(s)].get((u, y))
            if c is None:
                continue
            size, angle = np.abs(c.response), np.degrees(c.phase)
            with np.errstate(over="ignore"):
                ends = (size * np.exp(-NORMAL * c.gain_error), size * np.exp(NORMAL * c.gain_error))
            gains.append(Curve(s.label, c.w, size, *ends, colour=k))
            phases.append(_banded(s.label, c.w, angle, np.degrees(c.phase_error), k))
        sizes = np.concatenate([c.y for c in gains if c.colour >= 0])
        top = float(np.max(sizes))
        limits = (max(float(np.min(sizes)) / 3.0, top * 1e-5), 3.0 * top)
        name = f"{u} → {y}"
        panels += [
            Panel(
                f"gain-{u}-{y}",
                f"{name}: gain",
                RAD,
                "|G|",
                tuple(gains),
                log_x=True,
                log_y=True,
                limits=limits,
            ),
            Panel(f"phase-{u}-{y}", f"{name}: phase", RAD, "arg G [°]", tuple(phases), log_x=True),
        ]
    return tuple(panels)


def _paths(
    shown: Sequence[Shown], every: Mapping[int, Mapping[tuple[str, str], object]]
) -> list[tuple[str, str]]:
    return list(dict.fromkeys(key for s in shown for key in every[id(s)]))


def nyquist(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """G in the complex plane with 95 % ellipses at some frequencies."""
    every = {id(s): {(c.input, c.output): c for c in frequency_curves(s.model)} for s in shown}
    panels = []
    for u, y in _paths(shown, every):
        curves = []
        for k, s in enumerate(shown):
            c = every[id(s)].get((u, y))
            if c is None:
                continue
            curves.append(Curve(s.label, c.response.real, c.response.imag, colour=k))
            some = range(0, len(c.w), max(len(c.w) // 10, 1))
            curves += [_ellipse(c.response[at], c.root[at], k) for at in some]
        panels.append(
            Panel(f"nyquist-{u}-{y}", f"{u} → {y}", "Re G", "Im G", tuple(curves), equal=True)
        )
    return tuple(panels)


def _ellipse(centre: complex, root: Array, colour: int) -> Curve:
    """The 95 % ellipse of a point of the plane: χ² of two degrees of freedom is 5.99."""
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    if not np.isfinite(root).all():
        return Curve("", np.zeros(0), np.zeros(0), colour=colour)
    half, axes, _ = np.linalg.svd(root, full_matrices=False)
    points = half @ (axes[:, None] * np.array([np.cos(turn), np.sin(turn)])) * np.sqrt(5.991)
    return Curve("", centre.real + points[0], centre.imag + points[1], colour=colour)


def poles(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Poles (×) and zeros (○) in the z plane with 95 % ellipses."""
    every = {id(s): {(c.input, c.output): c for c in root_clouds(s.model)} for s in shown}
    panels = []
    for u, y in _paths(shown, every):
        curves = []
        for k, s in enumerate(shown):
            c = every[id(s)].get((u, y))
            if c is None:
                continue
            curves += [
                Curve(s.label, c.poles.real, c.poles.imag, kind="marks", colour=k),
                Curve("", c.zeros.real, c.zeros.imag, kind="dots", colour=k),
                *(_ellipse(p, r, k) for p, r in zip(c.poles, c.pole_root, strict=True)),
                *(
                    _ellipse(z, r, k)
                    for z, r in zip(c.zeros, c.zero_root, strict=True)
                    if abs(z) < 2.0
                ),
            ]
        panels.append(
            Panel(
                f"poles-{u}-{y}",
                f"{u} → {y}",
                "Re z",
                "Im z",
                tuple(curves),
                equal=True,
                circle=True,
                note="× pole, ○ zero, 95 % ellipses, unit circle",
            )
        )
    return tuple(panels)


def residuals(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Correlations of the residuals with their past and with the inputs; band 99 %."""
    panels = []
    for s in shown:
        fitted = {d.sha256 for d in s.model.provenance.data}
        seen = all(r.sha256 in fitted for r in records)
        report = residual_tests(s.model, records, fitted=seen)
        head = f"{s.label}: " if len(shown) > 1 else ""
        for tests, what in ((report.whiteness, "past residuals"), (report.independence, "inputs")):
            for test, channel in zip(tests, s.model.outputs, strict=True):
                if test.parts is None or not test.parts.values.size:
                    continue
                lags = np.array(test.parts.lags, dtype=np.float64)
                count = len(test.parts.signals)
                curves = tuple(
                    Curve(
                        n if count > 1 else "",
                        lags + 0.3 * (k - 0.5 * (count - 1)),
                        v,
                        kind="stems",
                        colour=k,
                    )
                    for k, (n, v) in enumerate(
                        zip(test.parts.signals, test.parts.values, strict=True)
                    )
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
    runs = {id(s): [outputs(s.model, r, None, Start.ESTIMATED) for r in records] for s in shown}
    panels = []
    first = shown[0]
    for i, channel in enumerate(first.model.outputs):
        axis = labelled(channel.name, channel.unit)
        fits = figures(first.model, records, "", None).fit_percent[channel.name]
        for k, r in enumerate(records):
            name = f"{channel.name}{f', {r.name}' if len(records) > 1 else ''}"
            lines = [Curve("measured", r.t, r.y[:, i], colour=-1)]
            lines += [
                Curve(s.label, r.t, runs[id(s)][k][:, i], colour=n) for n, s in enumerate(shown)
            ]
            panels.append(
                Panel(f"fit-{name}", f"{name}: {fits:.1f} % fit", "time [s]", axis, tuple(lines))
            )
            errors = [
                Curve(s.label, r.t, r.y[:, i] - runs[id(s)][k][:, i], colour=n)
                for n, s in enumerate(shown)
            ]
            panels.append(
                Panel(
                    f"residual-{name}",
                    f"{name}: measured less simulated",
                    "time [s]",
                    axis,
                    tuple(errors),
                    rules=(0.0,),
                )
            )
            error = r.y[:, i] - runs[id(first)][k][:, i]
            for at in worst_windows(error):
                part = slice(at, at + ZOOM)
                near = tuple(Curve(c.label, c.x[part], c.y[part], colour=c.colour) for c in lines)
                panels.append(
                    Panel(
                        f"zoom-{name}-{at}",
                        f"{name} at its worst, {r.t[at]:.4g} s",
                        "time [s]",
                        axis,
                        near,
                    )
                )
    return tuple(panels)


def worst_windows(error: Array) -> list[int]:
    """First samples of the windows with the largest squared error, none over another."""
    square = np.nan_to_num(error**2, nan=0.0)
    if len(square) <= 2 * ZOOM:
        return []
    sums = np.convolve(square, np.ones(ZOOM), "valid")
    starts: list[int] = []
    for _ in range(ZOOMS):
        at = int(np.argmax(sums))
        if sums[at] <= 0.0:
            break
        starts.append(at)
        sums[max(at - ZOOM, 0) : at + ZOOM] = 0.0
    return sorted(starts)


def horizon(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Fit against steps ahead; the free run is the line's end beyond them."""
    panels = []
    longest = max(map(len, records)) // 3
    ks = [k for k in HORIZONS if k <= max(longest, 1)]
    made = {
        id(s): [figures(s.model, records, "", k).fit_percent for k in ks]
        + [figures(s.model, records, "", None).fit_percent]
        for s in shown
    }
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
    """Fits of several models on one log, and fit against the number of parameters."""
    names = [c.name for c in shown[0].model.outputs]
    made = [figures(s.model, records, "", None).fit_percent for s in shown]
    places = np.arange(len(shown), dtype=np.float64)
    rows = tuple(s.label for s in shown)
    bars = tuple(
        Curve(n, places, np.array([m[n] for m in made]), kind="dots", colour=k)
        for k, n in enumerate(names)
    )
    sizes = np.array([len(s.model.theta) for s in shown], dtype=np.float64)
    pareto = tuple(
        Curve(n, sizes, np.array([m[n] for m in made]), kind="dots", colour=k)
        for k, n in enumerate(names)
    )
    return (
        Panel("ranking", "Fit in free run", "fit [%]", "", _lying(bars), names=rows),
        Panel("pareto", "Fit against size", "parameters", "fit [%]", pareto),
    )


def _lying(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """Dots over named rows: the value along, the row down."""
    return tuple(Curve(c.label, c.y, c.x, kind=c.kind, colour=c.colour) for c in curves)


WHAT: Mapping[str, Callable[[Sequence[Shown], Sequence[Record]], Panels]] = {
    "log": log,
    "step": step,
    "impulse": impulse,
    "bode": bode,
    "nyquist": nyquist,
    "poles": poles,
    "residuals": residuals,
    "fit": fit,
    "curve": curve,
    "horizon": horizon,
    "surface": surface,
    "ranking": ranking,
}
"""Word → what it shows."""

NEEDS_LOG = ("log", "residuals", "fit", "horizon", "ranking")
"""What cannot be shown without data."""


OF_LINEAR = ("bode", "nyquist", "poles")
"""What only linear models have."""


def panels_of(what: str, shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """The panels of a word.

    Raises:
        UsageError: there is no such word, or it needs a log.
        ModelError: a model has nothing of the kind.
    """
    if what not in WHAT:
        raise UsageError(f"{what!r} cannot be plotted; choose one of {', '.join(WHAT)}")
    if what in NEEDS_LOG and not records:
        raise UsageError(f"{what} needs a log, and that of the model is gone; name one")
    panels = WHAT[what](shown, records)
    if not panels:
        raise ModelError(f"there is nothing to show as {what}")
    return panels
