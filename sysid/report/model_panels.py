"""What can be shown of models: a function for each word of ``sysid plot WHAT``, and their table.

Each takes the models with their names and the records, and gives panels. Bands are 95 %.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.estimation.assessment.responses import (
    CHI_SQUARED,
    FrequencyCurve,
    ResponseCurve,
    RootCloud,
    frequency_curves,
    main_paths,
    root_clouds,
    static_curves,
    step_curves,
)
from sysid.estimation.assessment.spectra import spectra
from sysid.estimation.look.summary import look as look_at
from sysid.report.data_panels import fit, horizon, log, ranking, residuals, surface
from sysid.report.look_panels import look_panels
from sysid.report.panels import RAD, Curve, Panel, Panels, Shown
from sysid.report.style import labelled
from sysid.structures.state_space.subspace import subspace


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
    every = [frequency_curves(s.model) for s in shown]
    found = spectra(records) if records else None
    panels = []
    for (u, y), models in _by_path(shown, every).items():
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
        for k, s, c in models:
            size, angle = np.abs(c.response), np.degrees(c.phase)
            of_gain, of_phase = c.bands()
            gains.append(Curve(s.label, c.w, size, *of_gain, colour=k))
            back, ahead = np.degrees(of_phase)
            phases.append(Curve(s.label, c.w, angle, back, ahead, colour=k))
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


OfPath = TypeVar("OfPath", FrequencyCurve, RootCloud)


def _by_path(
    shown: Sequence[Shown], every: Sequence[Sequence[OfPath]]
) -> dict[tuple[str, str], list[tuple[int, Shown, OfPath]]]:
    """Input and output → number, model and what it has of this path, of the models that have it."""
    paths: dict[tuple[str, str], list[tuple[int, Shown, OfPath]]] = {}
    for k, (s, each) in enumerate(zip(shown, every, strict=True)):
        for c in each:
            paths.setdefault((c.input, c.output), []).append((k, s, c))
    return paths


def nyquist(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """G in the complex plane with 95 % ellipses at some frequencies."""
    every = [frequency_curves(s.model) for s in shown]
    panels = []
    for (u, y), models in _by_path(shown, every).items():
        curves = []
        for k, s, c in models:
            curves.append(Curve(s.label, c.response.real, c.response.imag, colour=k))
            some = range(0, len(c.w), max(len(c.w) // 10, 1))
            curves += [_ellipse(c.response[at], c.root[at], k) for at in some]
        panels.append(
            Panel(f"nyquist-{u}-{y}", f"{u} → {y}", "Re G", "Im G", tuple(curves), equal=True)
        )
    return tuple(panels)


UNKNOWN = 2.0
"""A pole or zero with a larger standard error lies anywhere in the unit circle."""


def _ellipse(centre: complex, root: Array, colour: int) -> Curve:
    """The 95 % ellipse of a point of the plane."""
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    if not np.isfinite(root).all():
        return Curve("", np.zeros(0), np.zeros(0), colour=colour)
    half, axes, _ = np.linalg.svd(root, full_matrices=False)
    if not np.max(axes, initial=0.0) < UNKNOWN:  # it would leave nothing else to be seen
        return Curve("", np.zeros(0), np.zeros(0), colour=colour)
    points = half @ (axes[:, None] * np.array([np.cos(turn), np.sin(turn)])) * np.sqrt(CHI_SQUARED)
    return Curve("", centre.real + points[0], centre.imag + points[1], colour=colour)


def poles(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """Poles (×) and zeros (○) in the z plane with 95 % ellipses."""
    every = [root_clouds(s.model) for s in shown]
    panels = []
    for (u, y), models in _by_path(shown, every).items():
        curves = []
        for k, s, c in models:
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


def look(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """What the log shows before any model."""
    return look_panels(look_at(records))


def singular(shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """What the past says of future outputs, direction by direction: as many states as stand out."""
    u, y = (np.concatenate([getattr(r, s) for r in records]).mean(axis=0) for s in ("u", "y"))
    looked = subspace([(r.u - u, r.y - y) for r in records], False, DIRECTIONS // 2)
    if looked is None:
        raise ModelError("the log is too short for singular values; record more")
    values = looked.singular[:DIRECTIONS]
    values = values / np.sqrt(1.0 + values**2)
    curves = [Curve("log", np.arange(1.0, len(values) + 1), values, kind="dots", colour=-1)]
    for k, s in enumerate(shown):
        n = s.model.structure.order_values().get("n")
        if s.model.structure.name == "ss" and n is not None and n <= len(values):
            curves.append(
                Curve(s.label, np.array([float(n)]), values[[n - 1]], kind="marks", colour=k)
            )
    note = "Correlation of future outputs with the past, weights of CVA; × order of a model."
    axes = ("number of states", "canonical correlation")
    return (Panel("singular", "Singular values", *axes, tuple(curves), note=note),)


WHAT: Mapping[str, Callable[[Sequence[Shown], Sequence[Record]], Panels]] = {
    "log": log,
    "look": look,
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
    "singular": singular,
    "ranking": ranking,
}
"""Word → what it shows."""

OF_LOG = ("log", "look")
"""What needs no model."""

NEEDS_LOG = (*OF_LOG, "residuals", "fit", "horizon", "singular", "ranking")
"""What cannot be shown without data."""


DIRECTIONS = 20
"""Singular values that are shown."""

OF_LINEAR = ("bode", "nyquist", "poles")
"""What only linear models have."""


def panels_of(what: str, shown: Sequence[Shown], records: Sequence[Record]) -> Panels:
    """The panels of a word."""
    if what not in WHAT:
        raise UsageError(f"{what!r} cannot be plotted; choose one of {', '.join(WHAT)}")
    if what in NEEDS_LOG and not records:
        raise UsageError(f"{what} needs a log, and that of the model is gone; name one")
    panels = WHAT[what](shown, records)
    if not panels:
        raise ModelError(f"there is nothing to show as {what}")
    return panels
