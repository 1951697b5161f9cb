"""The panels of a diagnosis: where the model errs, what was tried, and what it came to."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.diagnosis.diagnosis import Diagnosis, Experiment
from sysid.diagnosis.isolability import Isolability
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.diagnosis.validation.localise import Region
from sysid.report import diagnosis_words as words
from sysid.report.panels import Curve, Kind, Panel, Panels

BEFORE, AFTER, GREY, TIED = 1, 0, -1, 5
"""Colours."""

MOST = 14
"""Candidates drawn."""

MOST_EFFECTS = 24
"""Effects whose look-alikes are drawn: those that would show best."""


def regions(shown: Sequence[Region]) -> Panels:
    """The share of the excess error in a regime over the share of the samples."""
    k = np.arange(float(len(shown)))
    low, high = (
        100.0 * np.array([np.clip(r.interval[j], 0.0, 1.2) for r in shown]) for j in (0, 1)
    )
    excess = 100.0 * np.array([r.share_of_excess for r in shown])
    samples = 100.0 * np.array([r.share_of_samples for r in shown])
    curves = (
        Curve("samples", k + 0.12, samples, kind="stems", colour=GREY),
        Curve("excess error", k - 0.12, excess, low, high, kind="dots", colour=BEFORE),
    )
    names = tuple(r.region for r in shown)
    return (Panel("regions", "Excess error by regime", "share, 95 % interval [%]", "", curves,
                  rules=(0.0, 100.0), names=names),)  # fmt: skip


def candidates(diagnosis: Diagnosis) -> Panels:
    """The best effects tried first by their score, and every accepted one."""
    accepted = [e.id for e in diagnosis.effects]
    tied = {i for e in diagnosis.effects for i in e.indistinguishable}
    scores = dict(diagnosis.candidates)
    late = [(id, np.nan) for id in accepted if id not in scores]  # tried beside others only
    more = [c for c in diagnosis.candidates[MOST:] if c[0] in accepted] + late
    shown = [*diagnosis.candidates[: max(MOST - len(more), 0)], *more]
    kinds = [0 if id in accepted else 1 if id in tied else 2 for id, _ in shown]
    curves = []
    for kind, (label, colour) in enumerate((("accepted", AFTER), ("tied", TIED), ("others", GREY))):
        at = [k for k, of in enumerate(kinds) if of == kind]
        falls = np.nan_to_num(np.array([shown[k][1] for k in at], dtype=np.float64))
        if at:
            curves.append(Curve(label, np.array(at, float), falls, kind="stems", colour=colour))
    names = tuple(
        f"{id} {words.score_words(v) if np.isfinite(v) else '(not alone)'}" for id, v in shown
    )
    return (Panel("candidates", "Effects tried in the first round",
                  "fall of BIC by each alone [1]", "", tuple(curves), names=names),)  # fmt: skip


def gap(lines: Sequence[words.ChannelLine]) -> Panels:
    """RMSE before and after over the noise floor, in per cent of the larger one."""
    whole = np.array([max(c.rmse_before, c.rmse_after, 1e-300) for c in lines])
    k = np.arange(float(len(lines)))
    before, after, floor = (
        100.0 * np.array(v) / whole
        for v in zip(*((c.rmse_before, c.rmse_after, c.noise_floor) for c in lines), strict=True)
    )
    curves = (
        Curve("before", k - 0.2, before, kind="stems", colour=BEFORE),
        Curve("after", k + 0.2, after, kind="stems", colour=AFTER),
        Curve("noise floor", k, floor, kind="marks", colour=GREY),
    )
    return (Panel("gap", "RMSE on held-out data", "of the larger [%]", "", curves,
                  names=tuple(c.name for c in lines)),)  # fmt: skip


def paths(path: Mapping[str, Any]) -> Panels:
    """The replayed paths under ``traces`` over the plane: measured, before and after."""
    panels = []
    for trace in path.get("traces") or ():
        curves = tuple(
            Curve(name, way[:, 0], way[:, 1], colour=colour)
            for name, colour in (("measured", GREY), ("before", BEFORE), ("after", AFTER))
            for way in (np.array(trace.get(name) or (), dtype=np.float64),)
            if len(way) > 1
        )
        if curves:
            title = f"Path of {trace.get('record', '')}"
            panels.append(Panel("path", title, "x [m]", "y [m]", curves, equal=True))
    return tuple(panels)


def shape(found: FoundShape) -> Panels:
    """The curve of a shape with its band; none where its sentence says all."""
    c = found.curve
    if c is None:
        return ()
    title = f"{getattr(found, 'effect', '') or found.id}: {found.output}"
    kind: Kind = "steps" if c.steps else "line"
    return (Panel("shape", title, c.x_label, c.y_label,
                  (Curve("", c.x, c.y, c.low, c.high, kind=kind),)),)  # fmt: skip


def schedule(e: Experiment) -> Panels:
    """Commands of an experiment over time, held between the rows."""
    if len(e.schedule) < 2:
        return ()
    rows = np.array(e.schedule, dtype=np.float64)
    curves = tuple(
        Curve(name, rows[:, 0], rows[:, j + 1], kind="steps", colour=j)
        for j, name in enumerate(e.columns[1:])
    )
    return (
        Panel("schedule", f"Schedule for {', '.join(e.effects)}", "time [s]", "command", curves),
    )


def isolability(found: Isolability) -> Panels:
    """The angle from each effect to the one most like it: a small one is no difference."""
    n = min(len(found.ids), MOST_EFFECTS)
    if n < 2:
        return ()
    angles = np.where(np.eye(n, dtype=bool), np.inf, found.angles[:n, :n])
    nearest = np.argmin(angles, axis=1)
    one_entry = {id for p in found.pairs for id in p.effects}
    ids = [id if shown else f"({id})" for id, shown in zip(found.ids, found.shown, strict=True)]
    curves = []
    for label, colour, inside in (("distinguished", AFTER, False), ("one entry", BEFORE, True)):
        at = np.array([k for k in range(n) if (found.ids[k] in one_entry) is inside], dtype=int)
        if len(at):
            size = angles[at, nearest[at]]
            rows = at.astype(np.float64)
            curves.append(Curve(label, rows, size, 0.0 * size, size, kind="dots", colour=colour))
    names = tuple(f"{ids[k]} – {found.ids[j]}" for k, j in zip(range(n), nearest, strict=False))
    return (Panel("isolability", "Each effect and the one most like it",
                  "angle between signatures [°]", "", tuple(curves), rules=(0.0, 90.0), names=names,
                  note="In brackets: effects that would not show in this log."),)  # fmt: skip
