"""The page of a diagnosis: where the model errs, what is missing, what was added, what is left."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sysid.diagnosis.diagnosis import Diagnosis, NamedEffect
from sysid.diagnosis.several.results import sentences, table_of_logs
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.report import diagnosis_panels as panels
from sysid.report import diagnosis_words as words
from sysid.report import style, trace_panels
from sysid.report.page import Check, Page, Section
from sysid.report.panels import Panels

REGIONS = 10
"""Regimes drawn."""

NONE = "–"

Rows = tuple[tuple[str, ...], ...]


def diagnosis_page(diagnosis: Diagnosis, before: str, after: str) -> Page:
    """The page.

    Args:
        diagnosis: the diagnosis, its experiments with the names of their files.
        before, after: ids of the models in the workspace.
    """
    base = f"Original model: {diagnosis.base_words}."
    if diagnosis.against:
        base += f" {diagnosis.against.sentence(diagnosis.gap)}"
    size = "" if diagnosis.excess_error is None else diagnosis.excess_error.sentence
    text = (words.story(diagnosis), size, base, *diagnosis.reading)
    return Page(
        words.headline(diagnosis),
        " · ".join(["Diagnosis", *_logs(diagnosis)]),
        tuple(_checks(diagnosis)),
        (
            *_where(diagnosis),
            *_what(diagnosis),
            *_each_log(diagnosis),
            *_added(diagnosis, before, after),
            *_shrunk(diagnosis),
            *_next(diagnosis),
        ),
        tuple(_tiles(diagnosis)),
        tuple(line for line in text if line),
    )


def _logs(diagnosis: Diagnosis) -> list[str]:
    """Role and names of the records."""
    roles = dict.fromkeys(t.role for t in diagnosis.traces)
    names = {r: [t.record.name for t in diagnosis.traces if t.role == r] for r in roles}
    return [f"{role}: {', '.join(dict.fromkeys(each))}" for role, each in names.items()]


def _checks(diagnosis: Diagnosis) -> Iterator[Check]:
    if diagnosis.geometry:
        yield "note", diagnosis.geometry.sentence
    for sentence in (*diagnosis.changes, *diagnosis.warnings):
        yield "bad", sentence


def _tiles(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    """How much is closed, and the fit of each output."""
    gap, grown = diagnosis.gap, diagnosis.grown
    if grown:
        low, high = (words.percent(v) for v in gap.interval)
        yield (
            words.percent(gap.closed_percent),
            f"of the error beyond the noise closed on held-out data; 95 % interval {low} to {high}",
        )
    for c in words.channel_lines(diagnosis):
        if np.isfinite(c.fit_before):
            after = f" → {style.percent(c.fit_after)}" if grown else ""
            told = f"fit of {c.name} in free run on held-out data"
            yield f"{style.percent(c.fit_before)}{after}", told
        elif f"{c.rmse_before:.2g}" != f"{c.rmse_after:.2g}":
            sizes = f"{_number(c.rmse_before, 3)} → {_number(c.rmse_after, 3)} {c.unit}"
            yield sizes, f"RMSE of the increments of {c.name} on held-out data"


def _where(diagnosis: Diagnosis) -> Iterator[Section]:
    shown = words.leading_regions(diagnosis, REGIONS)
    title = "Where model and log disagree"
    if shown:
        note = (
            "A regime whose share of the excess error (squared error above the noise floor) is far "
            "larger than its share of the samples is where the model fails. Intervals by block "
            "bootstrap."
        )
        said = tuple(words.region_sentence(r) for r in shown[:3])
        yield Section(title, panels.regions(shown), said, note=note)
    else:
        yield Section(title, text=("There is no excess error above the noise floor.",))
    note = "The stretches of held-out data in which the original model errs most."
    for i, name in enumerate(_outputs(diagnosis)):
        drawn = trace_panels.worst(diagnosis, i)
        if drawn:
            yield Section(f"{name} at its worst", drawn, note=note, pairs=True, within=True)


def _outputs(diagnosis: Diagnosis) -> tuple[str, ...]:
    traces = words.held_out(diagnosis)
    return traces[0].record.output_names if traces else ()


def _what(diagnosis: Diagnosis) -> Iterator[Section]:
    none = () if diagnosis.effects else (words.nothing_named(diagnosis),)
    yield Section("What is missing", text=none)
    for e in diagnosis.effects:
        title = f"{e.id}: {', '.join((e.stage, *e.channels))}"
        text = (words.plain_sentence(e), words.evidence_sentence(e), words.tie_sentence(e))
        yield Section(title, text=tuple(filter(None, text)), within=True)
    yield from _tried(diagnosis)
    shapes = [p for s in (*diagnosis.shapes, *diagnosis.curves) for p in panels.shape(s)]
    if diagnosis.shapes or shapes:
        said = tuple(words.shape_sentence(s) for s in diagnosis.shapes)
        note = "The curve that the log gives, without a law of an effect, with its 95 % band."
        title = "Shapes of what remains" if said else "Shapes at the places of the effects"
        yield Section(title, tuple(shapes), said, note=note if shapes else "", within=True)
    if diagnosis.description:
        title = "What remains, as an equation"
        yield Section(title, code=(diagnosis.description,), within=True)
    if diagnosis.isolability:
        said = tuple(p.sentence for p in diagnosis.isolability.pairs[:3])
        drawn = panels.isolability(diagnosis.isolability)
        if drawn:
            yield Section("What this log can distinguish", drawn, said, within=True)


def _tried(diagnosis: Diagnosis) -> Iterator[Section]:
    text = [f"Rejected: {d.id}, because {d.reason} (rule {d.rule})." for d in diagnosis.rejected]
    if diagnosis.minor:
        text.append(f"Minor or not significant, not added: {', '.join(diagnosis.minor)}.")
    drawn = panels.candidates(diagnosis) if diagnosis.candidates else ()
    if drawn or text:
        yield Section("What was tried", drawn, tuple(text), within=True)


def _each_log(diagnosis: Diagnosis) -> Iterator[Section]:
    if diagnosis.several.logs:
        heads, rows = table_of_logs(diagnosis.several)
        yield Section(
            "What each log shows",
            text=sentences(diagnosis.several),
            heads=tuple(heads),
            rows=tuple(map(tuple, rows)),
        )


def _added(diagnosis: Diagnosis, before: str, after: str) -> Iterator[Section]:
    title = "What was added"
    if not diagnosis.grown:
        kept = f", kept as {before}" if before else ""
        yield Section(title, text=(f"Nothing: the model stays as it is{kept}.",))
        return
    original = f", the original model as {before}" if before else ""
    said = (
        f"The model with its effects is kept as {after}{original}. It is compared, exported and "
        "simulated like any other."
    )
    yield Section(
        title,
        text=(said,),
        heads=("effect", "parameter", "value", "95 % interval", "relative", "unit"),
        rows=tuple(row for e in diagnosis.effects for row in _values(e)),
        code=words.equations(diagnosis),
    )
    moved = tuple(
        (m.name, _number(m.before, 5), _number(m.after, 5), _number(NORMAL * m.std_error, 2),
         words.steps_words(m.steps), m.unit)
        for m in words.moved(diagnosis)
    )  # fmt: skip
    if moved:
        yield Section(
            "Parameters of the base",
            heads=("parameter", "before", "after", "± 95 %", "moved by", "unit"),
            rows=moved,
            note="A parameter that moves by many standard errors had absorbed part of what was "
            "missing.",
            within=True,
        )


def _values(e: NamedEffect) -> Iterator[tuple[str, ...]]:
    for k, p in enumerate(e.parameters):
        v = p.in_log_units
        name, ends = "" if k else e.id, v.words or NONE
        yield name, p.name, _number(v.value, 5), ends, words.relative(p), v.unit


def _shrunk(diagnosis: Diagnosis) -> Iterator[Section]:
    grown, lines = diagnosis.grown, words.channel_lines(diagnosis)
    if grown:
        title = "How far the gap shrank"
        parts = diagnosis.gap.parts if len(diagnosis.gap.parts) > 1 else {}
        closed = ", ".join(f"{of} {words.percent(share)}" for of, share in parts.items())
        said = (
            "The gap is RMSE² − noise floor²; the floor comes from the data, not from the model."
            + (f" Closed of it: {closed}." if closed else "")
        )
        heads: tuple[str, ...] = ("output", "RMSE before", "RMSE after", "noise floor",
                                  "fit before", "fit after", "gap closed", "unit")  # fmt: skip
        rows: Rows = tuple(
            (c.name, _number(c.rmse_before), _number(c.rmse_after), _number(c.noise_floor),
             style.percent(c.fit_before), style.percent(c.fit_after),
             words.percent(c.closed_percent), c.unit)
            for c in lines
        )  # fmt: skip
    else:
        title = "How large the gap is"
        said = "Nothing was added, so nothing shrank. The gap is RMSE² − noise floor²."
        heads = ("output", "RMSE", "noise floor", "fit", "unit")
        rows = tuple(
            (c.name, _number(c.rmse_before), _number(c.noise_floor),
             style.percent(c.fit_before), c.unit)
            for c in lines
        )  # fmt: skip
    yield Section(title, panels.gap(lines) if grown else (), (said,), heads, rows)
    if diagnosis.residuals:
        yield Section(
            "Residual tests on held-out data",
            heads=("model", "correlated with inputs and outputs", "p", "predictable share"),
            rows=tuple(
                ({"before": "original", "after": "augmented"}[r.model],
                 "yes" if r.p_value < words.CLEAR else "not significant",
                 words.p_words(r.p_value).removeprefix("p = ").removeprefix("p "),
                 words.percent(100.0 * r.share))
                for r in diagnosis.residuals
            ),
            within=True,
        )  # fmt: skip
    if diagnosis.path:
        yield _mission(diagnosis)
    for i, name in enumerate(_outputs(diagnosis)):
        drawn, note = _regimes(diagnosis, i)
        yield Section(f"{name} by regime", drawn, note=note, within=True)


def _mission(diagnosis: Diagnosis) -> Section:
    path = diagnosis.path
    return Section(
        f"On the mission {path.get('mission', '')}".rstrip(),
        panels.paths(path),
        (*filter(None, (path.get("sentence"),)), *(path.get("warnings") or ())),
        ("", "measured", "before", "after"),
        tuple(
            (what, *(v if isinstance(v, str) else _number(v) for v in values))
            for what, *values in _path_table(path)
        ),
        within=True,
    )


def _path_table(path: Mapping[str, Any]) -> tuple[tuple[str, Any, Any, Any], ...]:
    """(what, measured, before, after) of a mission: driven again, and replayed."""
    rows: list[tuple[str, Any, Any, Any]] = []
    runs = path.get("closed_loop") or {}
    for key, label in _DRIVEN.items():
        measured, old, new = (
            (runs.get(name) or {}).get(key) for name in ("measured", "before", "after")
        )
        if (measured, old, new) != (None, None, None):
            rows.append((f"closed loop: {label}", measured, old, new))
    for log in path.get("open_loop") or ():
        for key, label in _REPLAYED.items():
            if f"{key}_before_m" in log:
                old, new = log[f"{key}_before_m"], log[f"{key}_after_m"]
                rows.append((f"{log['record']} replayed: {label}", None, old, new))
    return tuple(rows)


_DRIVEN = {
    "outcome": "outcome",
    "time_s": "time [s]",
    "path_length_m": "path length [m]",
    "min_clearance_m": "clearance [m]",
    "path_error_rms_m": "path error, RMS [m]",
}
_REPLAYED = {"rms": "path error, RMS [m]", "end": "path error at the end [m]"}


def _regimes(diagnosis: Diagnosis, i: int) -> tuple[Panels, str]:
    """The panels of one output by regime, and what they show; a short log has no profiles."""
    channel = words.held_out(diagnosis)[0].record.outputs[i]
    known = diagnosis.gap.channels.get(channel.name)  # a gap of the path knows no wheel speeds
    facts = channel.unit, known.noise_floor if known is not None else 0.0
    profiles = trace_panels.profiles(diagnosis, i, *facts)
    note = (
        "Residuals are measured less simulated: mean (line), middle 80 % (band), and the middle "
        "80 % of noise alone (grey)."
    )
    by_regime = trace_panels.regime_lines(diagnosis, i)
    lines = trace_panels.regimes(by_regime, *facts, changed=diagnosis.grown)
    return (*lines, *profiles), note if profiles else ""


def _next(diagnosis: Diagnosis) -> Iterator[Section]:
    title = "What this log cannot show"
    asked = diagnosis.next_experiments
    yield Section(title, text=() if asked else ("No further experiment is proposed.",))
    for e in asked:
        files = (e.file,) if e.file else ()
        drawn = panels.schedule(e)
        yield Section(", ".join(e.effects), drawn, (e.purpose,), files=files, within=True)
    sizes = words.detectable(diagnosis)
    if sizes:
        cells = [cell for line in sizes for cell in line]
        cells += [""] * (-len(cells) % 6)
        yield Section(
            "Could this log have shown it?",
            text=("The smallest size of each effect that this log would have revealed; a dash "
                  "where it could not show the effect at any size.",),
            heads=("effect", "smallest size") * 3,
            rows=tuple(tuple(cells[k : k + 6]) for k in range(0, len(cells), 6)),
            note=f"{diagnosis.seconds:.1f} s. The same figures in diagnosis.json beside this page.",
            within=True,
        )  # fmt: skip


def _number(value: float | bool | None, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or not np.isfinite(value):
        return NONE
    return f"{value:.{digits}g}".replace("-", "−")
