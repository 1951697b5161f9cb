"""What several logs say together: which effect each shows, what is the same in all, what differs.

A number is the same in all logs if its values of the logs alone scatter as their standard errors
say: Q = Σ ((θ_k − θ̄)/s_k)² is χ² with one degree less than logs, θ̄ weighted by 1/s_k².
"""

from collections.abc import Sequence

import numpy as np

from sysid.diagnosis.base_model import Base
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import noise_floor
from sysid.diagnosis.search.named_sets import Named, Naming
from sysid.diagnosis.several.alone import LogFit, fits_of_logs
from sysid.diagnosis.several_logs import (
    ABSENT,
    HIDDEN,
    PRESENT,
    Constancy,
    Difference,
    LogEffect,
    LogNumber,
    LogView,
    SeveralLogs,
    chance,
)
from sysid.diagnosis.study import Study
from sysid.diagnosis.validation.acceptance import final_evidence
from sysid.effects.by_log import BY_LOG, GAIN_BY_LOG, number_of
from sysid.effects.catalogue import CHANGED, NOT_NAMED, about
from sysid.fitting.profile import NORMAL

SEEN = 3.0
"""A log that tells a number so well that the value of all is so many errors away from nothing
would have shown the effect."""

DIFFERENT = 0.01
"""Numbers differ between logs when chance makes as much in fewer cases, over all tested."""

SLIGHT = 0.02
"""A scatter of less than this share of the number is no difference that a person acts on: no law
is that exact."""

BASE = "base"


def several_logs(study: Study, naming: Naming) -> SeveralLogs:
    """What the logs of a diagnosis say together; empty for one log."""
    base = study.base
    if len(base.search.logs.names) < 2:
        return SeveralLogs()
    fits = fits_of_logs(base, naming)
    named = [n for n in naming.named if n.id not in NOT_NAMED]
    views = tuple(_view(base, naming, named, f) for f in fits)
    differences = tuple(_difference(study, naming, n) for n in naming.named if n.id in BY_LOG)
    return SeveralLogs(views, constancies(views, [n.id for n in named]), differences)


def _view(base: Base, naming: Naming, named: Sequence[Named], fit: LogFit) -> LogView:
    logs, k = base.search.logs, fit.log
    effects = tuple(_shown(base, naming, n, fit) for n in named)
    every = (*base.parts.estimation, *base.parts.held)
    of = (*logs.estimation, *logs.held)
    noise = noise_floor([r for r, i in zip(every, of, strict=True) if i == k])
    names = base.parts.estimation[0].output_names
    return LogView(
        logs.names[k],
        k in logs.judging,
        effects,
        _base_numbers(base, fit),
        {name: float(v) for name, v in zip(names, noise, strict=True)},
    )


def _shown(base: Base, naming: Naming, n: Named, fit: LogFit) -> LogEffect:
    """What a log shows of an effect: by its numbers, else by what the effect does to its errors."""
    model, node = base.search.model, naming.final
    mine = [] if n.id == CHANGED.id else [k for k in model.of(n.id) if k in node.free]
    told = [k for k in mine if k in fit.std_errors]
    away = [abs(fit.q[k] - model.slots[k].null) > NORMAL * fit.std_errors[k] for k in told]
    seen = [abs(node.q[k] - model.slots[k].null) > SEEN * fit.std_errors[k] for k in told]
    at = np.flatnonzero(n.touched)
    ratio = float(np.sqrt(np.mean((fit.rms[at] / (fit.without[n.id][at] + 1e-300)) ** 2)))
    if (any(away) or not mine) and ratio < RULE.own_part:
        state = PRESENT
    elif any(seen) and (not any(away) or n.id in fit.lacks):
        state = ABSENT
    else:
        state = HIDDEN
    return LogEffect(n.id, state, tuple(_number(base, fit, k) for k in mine), ratio)


def _number(base: Base, fit: LogFit, k: int) -> LogNumber:
    """A number of an effect as the log alone has it."""
    slot, first = base.search.model.slots[k], base.search.estimation[0]
    unit = next((p.unit for p in about(slot.owner).parameters if p.name == slot.name), "")
    tag = "" if slot.track < 0 else f"[{first.output_names[slot.track]}]"
    unit = unit.replace("speed", first.outputs[max(slot.track, 0)].unit)
    if k not in fit.std_errors:
        return LogNumber(f"{slot.name}{tag}", None, None, unit)
    return LogNumber(f"{slot.name}{tag}", float(fit.q[k]), fit.std_errors[k], unit)


def _base_numbers(base: Base, fit: LogFit) -> tuple[LogNumber, ...]:
    """Gain at full drive and, of a first order, the time constant, −Δt/ln(−f₁)."""
    model, first, found = base.search.model, base.search.estimation[0], []
    for i, c in enumerate(first.outputs):
        k = model.place["core", "gain", i]
        own = model.place.get((GAIN_BY_LOG.id, number_of(fit.log), i))
        factor = 1.0 if own is None else 1.0 + float(fit.q[own])
        error = None if k not in fit.std_errors else factor * fit.std_errors[k]
        value = None if error is None else factor * float(fit.q[k])
        found.append(LogNumber(f"gain[{c.name}]", value, error, c.unit))
        k = model.place["core", "f1", i]
        pole = -float(fit.q[k])
        if model.order == 1 and 0.0 < pole < 1.0:
            time, error = -model.dt / np.log(pole), fit.std_errors.get(k)
            slope = time**2 / (model.dt * pole)
            value = None if error is None else float(time)
            error = None if error is None else float(slope * error)
            found.append(LogNumber(f"time_constant[{c.name}]", value, error, "s"))
    return tuple(found)


def constancies(views: Sequence[LogView], ids: Sequence[str]) -> tuple[Constancy, ...]:
    """Every number that two logs tell, of the effects and of the base."""
    rows: dict[tuple[str, str], list[tuple[str, LogNumber]]] = {}
    for v in views:
        every = [(e.id, n) for e in v.effects for n in e.numbers]
        for owner, n in (*every, *((BASE, n) for n in v.base)):
            if n.value is not None:
                rows.setdefault((owner, n.name), []).append((v.name, n))
    tested = [(owner, told) for (owner, _), told in rows.items() if len(told) > 1]
    tested.sort(key=lambda row: [*ids, BASE].index(row[0]))
    return tuple(_constancy(owner, told, len(tested)) for owner, told in tested)


def _constancy(owner: str, told: Sequence[tuple[str, LogNumber]], tests: int) -> Constancy:
    from scipy.stats import chi2

    values = np.array([n.value for _, n in told], dtype=np.float64)
    errors = np.array([n.std_error for _, n in told], dtype=np.float64)
    weights = errors**-2.0
    mean = float(np.sum(weights * values) / np.sum(weights))
    statistic = float(np.sum(weights * (values - mean) ** 2))
    p = float(chi2.sf(statistic, len(told) - 1))
    scatter = float(np.ptp(values))
    same = p * tests > DIFFERENT or scatter < SLIGHT * abs(mean)
    first = told[0][1]
    error = float(np.sum(weights) ** -0.5)
    title = first.name if owner == BASE else f"{owner} {first.name}"
    if same:
        all_ = LogNumber(first.name, mean, error, first.unit).words
        logs = "both logs" if len(told) == 2 else f"all {len(told)} logs that tell it"
        text = f"{title} is the same in {logs}: {all_} ({chance(p)})."
    else:
        each = ", ".join(f"{n.words} in {name}" for name, n in told)
        text = f"{title} differs between logs: {each} ({chance(p)})."
    return Constancy(
        owner, first.name, first.unit, mean, error, statistic, len(told) - 1, p, same, text
    )


def _difference(study: Study, naming: Naming, n: Named) -> Difference:
    """What differs and is no effect, with the numbers of each log."""
    base, model = study.base, study.base.search.model
    logs, first = base.search.logs, base.search.estimation[0]
    q = base.search.in_phase(naming.final.q, naming.final.effects)
    names = [c for c, touched in zip(first.output_names, n.touched, strict=True) if touched]
    numbers: dict[str, tuple[LogNumber, ...]] = {}
    for k, log in enumerate(logs.names):
        mine = []
        for i in np.flatnonzero(n.touched):
            slot = model.place.get((n.id, number_of(k), int(i)))
            value = 0.0 if slot is None else float(q[slot])
            c = first.outputs[i]
            if n.id == GAIN_BY_LOG.id:
                mine.append(LogNumber(f"gain[{c.name}]", 1.0 + value, None, "1"))
            else:
                mine.append(LogNumber(f"load[{c.name}]", value, None, c.unit))
        numbers[log] = tuple(mine)
    said = "; ".join(
        f"{log} {', '.join(f'{m.value:.3g}' for m in mine)}" for log, mine in numbers.items()
    )
    what = "gain, over that of the first log" if n.id == GAIN_BY_LOG.id else "load"
    sentence = f"{about(n.id).sentence} The {what}, of {', '.join(names)}: {said}."
    return Difference(
        n.id,
        tuple(names),
        numbers,
        final_evidence(base, naming, n).p_value,
        study.explained_by(naming, n)[0],
        sentence,
    )
