"""Several logs compared: which effect each shows, which estimates agree, and which differ.

A parameter is the same in all logs if its values of the logs alone scatter as their standard errors
say: Q = Σ ((θ_k − θ̄)/s_k)² is χ² with one degree less than logs, θ̄ weighted by 1/s_k².
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Record
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.diagnosis import NamedEffect
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.rules.final_model import final_evidence
from sysid.diagnosis.search.prepared import Logs
from sysid.diagnosis.search.selection import SelectedEffect, Selection
from sysid.diagnosis.session import DiagnosisSession
from sysid.diagnosis.several.results import (
    ABSENT,
    INCONCLUSIVE,
    SIGNIFICANT,
    Constancy,
    Difference,
    LogEffect,
    LogParameter,
    LogView,
    SeveralLogs,
    chance,
)
from sysid.diagnosis.several.single_log_fits import LogFit, fits_of_logs
from sysid.effects.by_log import BY_LOG, GAIN_BY_LOG, parameter_of_log
from sysid.effects.catalogue import CHANGED, about, effect
from sysid.fitting.profile import NORMAL
from sysid.vehicle.kinematics import Geometry

SEEN = 3.0
"""A log whose standard error is so many times smaller than the value of all logs would have shown
the effect."""

DIFFERENT = 0.01
"""Parameters differ between logs when chance makes as much in fewer cases, over all tested."""

SLIGHT = 0.02
"""A scatter of less than this share of the parameter is no difference that a person acts on: no law
is that exact."""

BASE = "base"


def several_logs(session: DiagnosisSession, selection: Selection) -> SeveralLogs:
    """What the logs of a diagnosis say together; empty for one log."""
    base = session.base
    if len(base.search.logs.names) < 2:
        return SeveralLogs()
    views = tuple(_view(base, selection, f) for f in fits_of_logs(base, selection))
    differences = tuple(
        _difference(base, selection, n) for n in selection.selected if n.id in BY_LOG
    )
    return SeveralLogs(views, constancies(views, [n.id for n in selection.effects]), differences)


def _view(base: Base, selection: Selection, fit: LogFit) -> LogView:
    logs, k = base.search.logs, fit.log
    every = (*base.parts.estimation, *base.parts.holdout)
    of = (*logs.estimation, *logs.holdout)
    noise = base.parts.facts_of([r for r, i in zip(every, of, strict=True) if i == k]).noise
    names = base.parts.estimation[0].output_names
    return LogView(
        logs.names[k],
        k in logs.validation,
        tuple(_shown(base, selection, n, fit) for n in selection.effects),
        _base_parameters(base, fit),
        dict(zip(names, noise.tolist(), strict=True)),
    )


def _shown(base: Base, selection: Selection, n: SelectedEffect, fit: LogFit) -> LogEffect:
    """What a log shows of an effect, by its parameters and its errors with and without it."""
    model, final = base.search.model, selection.final
    of_effect = [] if n.id == CHANGED.id else [k for k in model.of(n.id) if k in final.free]
    known = [k for k in of_effect if k in fit.std_errors]
    away = [abs(fit.q[k] - model.parameters[k].null) > NORMAL * fit.std_errors[k] for k in known]
    seen = [abs(final.q[k] - model.parameters[k].null) > SEEN * fit.std_errors[k] for k in known]
    at = np.flatnonzero(n.touched)
    ratio = float(np.sqrt(np.mean((fit.rms[at] / (fit.without[n.id][at] + 1e-300)) ** 2)))
    if (any(away) or not of_effect) and ratio < RULE.own_part:
        state = SIGNIFICANT
    elif any(seen) and (not any(away) or n.id in fit.lacks):
        state = ABSENT
    else:
        state = INCONCLUSIVE
    return LogEffect(n.id, state, tuple(_parameter(base, fit, k) for k in of_effect), ratio)


def _parameter(base: Base, fit: LogFit, k: int) -> LogParameter:
    """A number of an effect as the log alone has it."""
    p, first = base.search.model.parameters[k], base.search.estimation[0]
    name = p.name if p.track < 0 else f"{p.name}[{first.output_names[p.track]}]"
    unit = p.of.unit.replace("speed", first.outputs[max(p.track, 0)].unit)
    error = fit.std_errors.get(k)
    return LogParameter(name, None if error is None else float(fit.q[k]), error, unit)


def _base_parameters(base: Base, fit: LogFit) -> tuple[LogParameter, ...]:
    """Gain at full drive and, of a first order, the time constant, −Δt/ln(−f₁)."""
    model, first, values = base.search.model, base.search.estimation[0], []
    for i, c in enumerate(first.outputs):
        k = model.index["core", "gain", i]
        own_gain = model.index.get((GAIN_BY_LOG.id, parameter_of_log(fit.log), i))
        factor = 1.0 if own_gain is None else 1.0 + float(fit.q[own_gain])
        error = None if k not in fit.std_errors else factor * fit.std_errors[k]
        value = None if error is None else factor * float(fit.q[k])
        values.append(LogParameter(f"gain[{c.name}]", value, error, c.unit))
        k = model.index["core", "f1", i]
        pole = -float(fit.q[k])
        if model.order == 1 and 0.0 < pole < 1.0:
            time, error = -model.dt / np.log(pole), fit.std_errors.get(k)
            slope = time**2 / (model.dt * pole)
            value = None if error is None else float(time)
            error = None if error is None else float(slope * error)
            values.append(LogParameter(f"time_constant[{c.name}]", value, error, "s"))
    return tuple(values)


def constancies(views: Sequence[LogView], ids: Sequence[str]) -> tuple[Constancy, ...]:
    """Every parameter that two logs determine, of the effects and of the base."""
    rows: dict[tuple[str, str], list[tuple[str, LogParameter]]] = {}
    for v in views:
        every = [(e.id, n) for e in v.effects for n in e.parameters]
        for owner, n in (*every, *((BASE, n) for n in v.base)):
            if n.value is not None:
                rows.setdefault((owner, n.name), []).append((v.name, n))
    tested = [(owner, values) for (owner, _), values in rows.items() if len(values) > 1]
    tested.sort(key=lambda row: [*ids, BASE].index(row[0]))
    return tuple(_constancy(owner, values, len(tested)) for owner, values in tested)


def _constancy(owner: str, log_values: Sequence[tuple[str, LogParameter]], tests: int) -> Constancy:
    from scipy.special import chdtrc

    values = np.array([n.value for _, n in log_values], dtype=np.float64)
    errors = np.array([n.std_error for _, n in log_values], dtype=np.float64)
    weights = errors**-2.0
    mean = float(np.sum(weights * values) / np.sum(weights))
    statistic = float(np.sum(weights * (values - mean) ** 2))
    p = float(chdtrc(len(log_values) - 1, statistic))
    scatter = float(np.ptp(values))
    same = p * tests > DIFFERENT or scatter < SLIGHT * abs(mean)
    first = log_values[0][1]
    error = float(np.sum(weights) ** -0.5)
    title = first.name if owner == BASE else f"{owner} {first.name}"
    if same:
        all_ = LogParameter(first.name, mean, error, first.unit).words
        logs = "both logs" if len(log_values) == 2 else f"{len(log_values)} logs"
        text = f"The estimates of {title} agree across {logs}: {all_} ({chance(p)})."
    else:
        each = ", ".join(f"{n.words} in {name}" for name, n in log_values)
        text = f"The estimates of {title} differ between logs: {each} ({chance(p)})."
    return Constancy(
        owner, first.name, first.unit, mean, error, statistic, len(log_values) - 1, p, same, text
    )


def _difference(base: Base, selection: Selection, n: SelectedEffect) -> Difference:
    """What differs and is no effect, with the parameters of each log."""
    model, logs, first = base.search.model, base.search.logs, base.search.estimation[0]
    q = base.search.in_phase(selection.final.q, selection.final.effects)
    names = [c for c, touched in zip(first.output_names, n.touched, strict=True) if touched]
    by_log: dict[str, tuple[LogParameter, ...]] = {}
    for k, log in enumerate(logs.names):
        values = []
        for i in np.flatnonzero(n.touched).tolist():
            parameter = model.index.get((n.id, parameter_of_log(k), i))
            value = 0.0 if parameter is None else float(q[parameter])
            c = first.outputs[i]
            gain = (f"gain[{c.name}]", 1.0 + value, None, "1")
            load = (f"load[{c.name}]", value, None, c.unit)
            values.append(LogParameter(*(gain if n.id == GAIN_BY_LOG.id else load)))
        by_log[log] = tuple(values)
    said = "; ".join(
        f"{log} {', '.join(f'{m.value:.3g}' for m in values)}" for log, values in by_log.items()
    )
    what = "gain relative to the first log" if n.id == GAIN_BY_LOG.id else "load"
    sentence = f"{about(n.id).texts.sentence} The {what}, of {', '.join(names)}: {said}."
    evidence = final_evidence(base, selection, n)
    return Difference(n.id, tuple(names), by_log, evidence.p_value, 1.0 / evidence.ratio, sentence)


CLEARLY = 2.0
"""A log that would show so small a share of the effect of all logs, and does not, speaks against
it: half as large is found in nearly all logs."""


def with_ground(
    several: SeveralLogs,
    records: Sequence[Record],
    logs: Logs,
    pose: PoseDiagnosis | None,
    geometry: Geometry | None,
) -> SeveralLogs:
    """The findings with the effects between tracks and ground that all logs show together.

    Args:
        records: those of all logs, as ``logs`` has them: first those that were searched on.
    """
    if not several.logs or pose is None or not pose.effects:
        return several
    if geometry is None:
        geometry = Geometry() if pose.geometry is None else pose.geometry.geometry
    of = (*logs.estimation, *logs.holdout)
    views = []
    for k, view in enumerate(several.logs):
        of_log = {id(r): r for r, i in zip(records, of, strict=False) if i == k}
        alone = diagnose_pose(tuple(of_log.values()), (), geometry)
        shown = tuple(_shown_on_ground(e, alone) for e in pose.effects)
        views.append(replace(view, effects=(*view.effects, *shown)))
    ids = [e.id for e in views[0].effects]
    return replace(several, logs=tuple(views), constancy=constancies(views, ids))


def _shown_on_ground(e: NamedEffect, alone: PoseDiagnosis | None) -> LogEffect:
    """What one log shows of an effect; parameters where it names the same one."""
    effects = () if alone is None else alone.effects
    same = next((f for f in effects if f.id == e.id), None)
    if same is not None:
        own = tuple(LogParameter(v.name, v.value, v.std_error, v.unit) for v in same.parameters)
        return LogEffect(e.id, SIGNIFICANT, own)
    names = {e.id, *e.indistinguishable}
    if any(names & {f.id, *f.indistinguishable} for f in effects):
        return LogEffect(e.id, SIGNIFICANT, ())
    least = None if alone is None else alone.detectable.get(e.id)
    null = {p.name: p.null for p in effect(e.id).parameters}
    first = e.parameters[0]
    size = abs(first.value - null[first.name.partition("[")[0]])
    seen = least is not None and CLEARLY * least < size
    return LogEffect(e.id, ABSENT if seen else INCONCLUSIVE, ())
