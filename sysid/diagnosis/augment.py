"""From a node of the search to an ordinary model: saved, compared, exported, simulated."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.criteria.information import information_criteria
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base, full_drive
from sysid.diagnosis.named_effects import Value
from sysid.diagnosis.search.admission import on_bound
from sysid.diagnosis.search.batched_search import information
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.named_sets import Interval, Node
from sysid.effects.by_log import BY_LOG
from sysid.effects.catalogue import CHANGED, LEVEL, effect
from sysid.effects.sensor import SAMPLING
from sysid.errors import Termination
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model, Provenance, Source
from sysid.version import __version__


def effects_of(base: Base, node: Node) -> tuple[str, ...]:
    """The effects of the augmented structure: those of the base, then the accepted ones."""
    own = (LEVEL.id,) * base.level + (SAMPLING.id,) * base.sampled
    return (*own, *(id for id in node.effects if id != CHANGED.id and id not in BY_LOG))


def slots_of(base: Base, node: Node) -> list[int]:
    """The slots of a node in the order of ``Augmented``'s θ."""
    m = base.search.model
    found = [k for k, s in enumerate(m.slots) if s.owner == "core"]
    for id in effects_of(base, node):
        e = effect(id)
        for track in (-1,) if e.shared else range(m.tracks):
            found += [m.place[id, p.name, track] for p in e.parameters]
    return found


def covariance_of(base: Base, node: Node) -> Array:
    """Covariance of the free slots, (n, n): σ²(JᵀJ)⁻¹ with σ² widened by N/N_eff track by track."""
    H = information(base.search.model, node.q, node.free, base.search.data)
    errors = np.concatenate(node.errors.estimation)
    variance = float(np.nanmean(errors**2))
    counted = np.maximum(np.isfinite(errors).sum(axis=0), 1)
    share = float(np.min(effective_samples(node.errors.estimation) / counted))
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True) / max(min(share, 1.0), 1e-3))


def values_of(
    base: Base, node: Node, id: str, intervals: Mapping[int, Interval] | None = None
) -> tuple[Value, ...]:
    """The numbers of an effect with standard errors; None where nothing was estimated.

    Args:
        base: of the diagnosis.
        node: the model with the effect.
        id: of the effect.
        intervals: of numbers whose standard error no slope tells, by slot.
    """
    m = base.search.model
    names = base.search.estimation[0].output_names
    unit = base.search.estimation[0].outputs[0].unit
    covariance = covariance_of(base, node) if node.free else np.zeros((0, 0))
    at = {slot: i for i, slot in enumerate(node.free)}
    numbers = {p.name: p for p in effect(id).parameters} if id != CHANGED.id else {}
    acting = _acting(base, node, id)
    found = []
    for k in m.of(id):
        slot = m.slots[k]
        if acting and slot.name not in acting:
            continue
        tag = "" if slot.track < 0 else f"[{names[slot.track]}]"
        if k not in at and id != CHANGED.id and node.q[k] == slot.null and slot.track >= 0:
            continue
        number = numbers.get(slot.name)
        value, words = float(node.q[k]), number.unit.replace("speed", unit) if number else ""
        interval = (intervals or {}).get(k)
        if interval is None:
            error = float(np.sqrt(max(covariance[at[k], at[k]], 0.0))) if k in at else None
            found.append(Value(f"{slot.name}{tag}", value, error, words))
        else:
            error = interval.std_error(value)
            found.append(_interval_value(f"{slot.name}{tag}", value, interval, words))
        ended = replace(found[-1], bounded=k in at and on_bound(slot, value))
        found[-1] = replace(ended, in_file=_in_file(base, ended, slot.track))
        if not found[-1].visited:
            continue
        if number is not None and number.as_command:
            # as the command that just overcomes it: what a person with a robot turns up
            full = float(full_drive(base.parts.estimation)[slot.track]) / abs(
                node.q[m.place["core", "gain", slot.track]]
            )
            channel = base.search.estimation[0].inputs[slot.track]
            name = f"{slot.name}_command{tag}"
            if interval is not None:
                found.append(
                    _interval_value(name, value * full, interval.times(full), channel.unit)
                )
            else:
                scaled = None if error is None else error * full
                found.append(Value(name, value * full, scaled, channel.unit))
    return tuple(found)


def _acting(base: Base, node: Node, id: str) -> tuple[str, ...]:
    """Parameters of the law that acts; none where an effect has but one."""
    if id == CHANGED.id or not effect(id).laws:
        return ()
    chosen = base.search.model.chosen(effect(id), node.q)
    return (*chosen, *effect(id).searched(chosen))


def _in_file(base: Base, value: Value, track: int) -> Value | None:
    """A share of the log's largest command as a command of the file; None where it is none."""
    first = base.parts.estimation[0]
    if "drive" not in value.unit or track < 0 or first.full_drive_is_known:
        return None
    channel = first.inputs[track]
    full = float(full_drive(base.parts.estimation)[track]) / channel.scale
    factor = 1.0 / full if value.unit.startswith("1/") else full
    ends = value.interval and tuple(None if v is None else factor * v for v in value.interval)
    return Value(
        value.name,
        factor * value.value,
        None if value.std_error is None else abs(factor) * value.std_error,
        value.unit.replace("drive", channel.file_words or channel.unit or channel.name),
        (ends[0], ends[1]) if ends else None,
        bounded=value.bounded,
    )


def _interval_value(name: str, value: float, interval: Interval, unit: str) -> Value:
    if not interval.visited:
        return Value(name, math.nan, None, unit)
    return Value(name, value, interval.std_error(value), unit, (interval.low, interval.high))


def model_of(base: Base, node: Node, intervals: Mapping[int, Interval] | None = None) -> Model:
    """The node as a Model with values, standard errors, figures and provenance.

    Args:
        base: of the diagnosis.
        node: what to make a model of.
        intervals: of numbers whose standard error no slope tells, by slot. One that the log never
            visits does nothing in the model, and its variance is infinite.
    """
    search = base.search
    records = search.estimation
    first = records[0]
    structure = Augmented(
        search.model.order,
        base.delay,
        tuple(float(s) for s in base.scales),
        first.dt,
        effects_of(base, node),
        base.given,
    )
    slots = slots_of(base, node)
    covariance = np.zeros((len(slots), len(slots)))
    if node.free:
        free = covariance_of(base, node)
        at = {slot: i for i, slot in enumerate(node.free)}
        inside = [k for k, slot in enumerate(slots) if slot in at]
        index = [at[slots[k]] for k in inside]
        covariance[np.ix_(inside, inside)] = free[np.ix_(index, index)]
    parameters = structure.parameters(first.inputs, first.outputs)
    theta, unseen = node.q[slots], []
    for k, slot in enumerate(slots):
        interval = (intervals or {}).get(slot)
        if interval is None:
            continue
        if not interval.visited:
            theta[k] = search.model.slots[slot].null
            unseen.append(k)
        covariance = _with_error(covariance, k, interval.std_error(float(theta[k])))
    parts = _rows_together(node.errors.estimation)
    errors = np.concatenate(parts)
    values = [np.concatenate([r.u for r in records]), np.concatenate([r.y for r in records])]
    return Model(
        structure=structure,
        theta=theta,
        covariance=covariance,
        parameters=parameters,
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        detrend=Detrend.none(first.nu, first.ny),
        noise_covariance=errors.T @ errors / len(errors),
        n_estimated=len(node.free),
        null_directions=tuple({parameters[k].name: 1.0} for k in unseen),
        criteria=information_criteria(parts, len(node.free)),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(c.min(), c.max()) for block in values for c in block.T]),
        provenance=Provenance(_sources(records), {"made_by": "diagnose"}, __version__),
    )


def _rows_together(errors: Sequence[Array]) -> list[Array]:
    """Errors of all outputs in rows of their own, (M, ny) a record.

    Slow sensors whose readings never share a row are put side by side in their order.
    """
    parts = [e[np.isfinite(e).all(axis=1)] for e in errors]
    if sum(map(len, parts)) > errors[0].shape[1]:
        return parts
    found = []
    for e in errors:
        columns = [c[np.isfinite(c)] for c in e.T]
        shortest = min(len(c) for c in columns)
        found.append(np.column_stack([c[:shortest] for c in columns]))
    return found


def _with_error(covariance: Array, k: int, error: float | None) -> Array:
    """Another standard error of one number, its correlations kept; None is an infinite one."""
    out = covariance.copy()
    old = float(np.sqrt(max(covariance[k, k], 0.0)))
    if error is None or old == 0.0:
        out[k, :] = out[:, k] = 0.0
        out[k, k] = np.inf if error is None else error**2
        return out
    out[k, :] *= error / old
    out[:, k] *= error / old
    return out


def _sources(records: Sequence[Record]) -> tuple[Source, ...]:
    return tuple(Source(r.name, r.sha256, r.t0, len(r)) for r in records)
