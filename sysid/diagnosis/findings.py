"""Results of a search as effects, sentences and traces of a diagnosis."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.augment import std_errors, values_of
from sysid.diagnosis.base_model import Base, full_drive
from sysid.diagnosis.diagnosis import NamedEffect, Trace, Value
from sysid.diagnosis.samples import SampleEffects
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.selection import SelectedEffect, Selection
from sysid.effects.base import Effect
from sysid.effects.catalogue import about
from sysid.effects.samples import DROPOUTS, HELD_TELEMETRY, QUANTISATION

NEAR, APART = 0.005, 0.02
"""Shares of full drive: what an end of an interval is rounded to, and a gap between commands that
matters."""

ABSORBED = (5.0, 0.05)
"""A number of the base counts as having absorbed an effect when it moves by more standard errors,
and by a larger share of itself, once the effect is added."""


def named_effect(
    base: Base, selection: Selection, n: SelectedEffect, evidence: Evidence, remains: str
) -> NamedEffect:
    """An accepted effect of the chain."""
    e = about(n.id)
    names = base.parts.estimation[0].output_names
    values = values_of(base, selection.final, n.id, selection.intervals)
    return NamedEffect(
        n.id,
        e.stage,
        tuple(names[i] for i in np.flatnonzero(n.touched)),
        values,
        evidence,
        n.ties,
        sentence_of(e, values, n.ties),
        remains,
    )


def sentence_of(e: Effect, values: Sequence[Value], ties: Sequence[str]) -> str:
    """What an effect is, how large it is, and its ties; the sign of its parameter decides."""
    text = " ".join(s for s in (_by_sign(e, values), _law_in_words(e, values)) if s)
    values = [v.in_log_units for v in values]
    known = [v for v in values if v.std_error is not None or v.interval is not None][:4]
    shown = [v for v in (*known, *(v for v in values if not v.visited)) if v.words]
    if shown:
        text += f" Here {', '.join(f'{v.name} {v.shown}' for v in shown)}."
    return text + (f" This log cannot distinguish it from {', '.join(ties)}." if ties else "")


def _law_in_words(e: Effect, values: Sequence[Value]) -> str:
    """The law that acts; a choice that is not among the values is at its null value."""
    chosen = {p.name: p.null for p in e.parameters if p.choice}
    law = e.law(chosen | {v.name.partition("[")[0]: v.value for v in values if v.visited})
    return "" if law is None else law.sentence


def _by_sign(e: Effect, values: Sequence[Value]) -> str:
    """What the effect is; where its first parameter has the other sign, what that is. Where its law
    has not that parameter, the sentence of the law says all."""
    if not e.texts.opposite or not e.parameters:
        return e.texts.sentence
    first = e.parameters[0]
    first_values = [v for v in values if v.name.partition("[")[0] == first.name and v.visited]
    if not first_values:
        return ""
    below = [v for v in first_values if v.value < first.null]
    if not below:
        return e.texts.sentence
    if len(below) == len(first_values):
        return e.texts.opposite
    where = ", ".join(v.name.partition("[")[2].rstrip("]") for v in below)
    opposite = e.texts.opposite
    return f"{e.texts.sentence} On {where} the opposite: {opposite[:1].lower()}{opposite[1:]}"


def indistinct_edges(
    base: Base, selection: Selection, records: Sequence[Record]
) -> tuple[str, ...]:
    """What an edge on the command's axis lacks where no command lies between its possible places.

    Of a dead zone only jump less width is then known, by commands beyond the edge.
    """
    model, warnings = base.search.model, []
    scales = base.search.scales
    u = np.concatenate([r.u for r in records]) / scales
    for k, interval in selection.intervals.items():
        p = model.parameters[k]
        sign = p.of.edge
        if not sign or not interval.visited or interval.low is None or interval.high is None:
            continue
        d = np.unique(np.round(sign * u[:, min(max(p.side, 0), u.shape[1] - 1)], 6))
        inside = d[(d > interval.low + NEAR) & (d < interval.high - NEAR)]
        if len(inside) or interval.high - interval.low < APART:
            continue
        below, above = d[d <= interval.low + NEAR], d[d >= interval.high - NEAR]
        if not len(below) or not len(above) or above[0] - below[-1] < APART:
            continue
        i = min(max(p.side, 0), len(records[0].inputs) - 1)
        name, unit = records[0].inputs[i].name, records[0].inputs[i].unit
        ends = " and ".join(f"{sign * v * scales[i]:.4g}" for v in (below[-1], above[0]))
        warnings.append(
            f"{name} has no command between {ends}{f' {unit}' if unit else ''}, so this log does "
            f"not determine {about(p.owner).texts.between_edges}"
        )
    return tuple(warnings)


def sample_effects(inspected: SampleEffects) -> tuple[NamedEffect, ...]:
    """Coarse, repeated and lost measurements: seen in the samples, they lower no error."""
    seen = (
        (QUANTISATION, "", [(c, "step", c.step) for c in inspected.coarse]),
        (HELD_TELEMETRY, "s", [(c, "period", c.seconds) for c in inspected.stale]),
        (DROPOUTS, "", [(c, "share", c.share) for c in inspected.lost]),
    )
    return tuple(
        NamedEffect(
            id=effect.id,
            stage=effect.stage,
            channels=tuple(dict.fromkeys(c.output for c, _, _ in each)),
            parameters=tuple(Value(f"{n}[{c.output}]", v, None, unit) for c, n, v in each),
            evidence=None,
            indistinguishable=(),
            sentence=" ".join(c.sentence for c, _, _ in each),
        )
        for effect, unit, each in seen
        if each
    )


def absorbed(base: Base, selection: Selection) -> tuple[str, ...]:
    """Alarms: parameters of the base that had taken over a part of a missing effect."""
    if not selection.effects or not base.search.core:
        return ()
    errors = std_errors(base, selection.final)
    model, moves = base.search.model, []
    names = base.parts.estimation[0].output_names
    for k, error in errors.items():
        if model.parameters[k].owner != "core" or k not in selection.base.free:
            continue
        old, new = float(selection.base.q[k]), float(selection.final.q[k])
        error, moved = max(error, 1e-150), abs(new - old)
        if moved > ABSORBED[0] * error and moved > ABSORBED[1] * abs(new):
            p = model.parameters[k]
            factor, unit = _per_command(base, p.side) if p.name == "gain" else (1.0, "")
            moves.append(
                f"{p.name} of {names[p.track]} goes from {factor * old:.4g} to "
                f"{factor * new:.4g}{unit} ({moved / error:.0f} standard errors)"
            )
    if not moves:
        return ()
    ids = ", ".join(n.id for n in selection.effects)
    return (f"The original model had absorbed part of {ids}: {'; '.join(moves)}.",)


def _per_command(base: Base, i: int) -> tuple[float, str]:
    """From a gain over full drive to the file's units: factor, and the unit with a blank before."""
    first = base.parts.estimation[0]
    y, u = first.outputs[min(i, first.ny - 1)], first.inputs[at := min(i, first.nu - 1)]
    full = float(full_drive(base.parts.estimation)[at])
    top, bottom = y.file_words or y.unit or y.name, u.file_words or u.unit or u.name
    return u.scale / (y.scale * full), f" {top} per {bottom}"


def traces(base: Base, selection: Selection) -> tuple[Trace, ...]:
    """Records with the runs of both models; what does not count is marked.

    Measurements of a slow sensor are joined by lines: in a row of its own fresh reading another
    output has none.
    """
    search, traces = base.search, []
    for role, facts, data, holdout in (
        ("estimation", base.parts.facts, search.data, False),
        ("held-out", base.parts.holdout_facts, search.holdout_data, True),
    ):
        runs = (search.simulated(n, holdout) for n in (selection.base, selection.final))
        counted = (np.asarray(w.max(axis=1) > 0.0, float) for w in data.split(data.weight))
        each = zip(facts.without_repeats.records, *runs, counted, strict=True)
        traces += [Trace(r, before, after, role, counts) for r, before, after, counts in each]
    return tuple(traces)


def two_levels(records: Sequence[Record], scales: Array) -> tuple[str, ...]:
    """Inputs whose commands have but two sizes: no static curve can be distinguished from them."""
    everything = np.concatenate([r.u for r in records]) / scales
    return tuple(
        name
        for name, column in zip(records[0].input_names, everything.T, strict=True)
        if len(np.unique(np.round(np.abs(column), 3))) <= 2
    )
