"""Candidate models as ordinary models that can be saved, compared, exported and simulated."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.criteria.information import information_criteria
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base, full_drive
from sysid.diagnosis.diagnosis import Value
from sysid.diagnosis.search.admission import on_bound
from sysid.diagnosis.search.batched_search import information
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.selection import CandidateModel, Interval
from sysid.effects.base import Place
from sysid.effects.by_log import BY_LOG
from sysid.effects.catalogue import CHANGED, LEVEL, about, effect
from sysid.effects.sensor import SAMPLING
from sysid.errors import Termination
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model, Provenance, Source
from sysid.version import __version__

MOST_STEPS, SETTLED = 1000, 1e-4
"""Samples in which a servo settles to a speed, and the change in one below which it has."""


def effects_of(base: Base, candidate: CandidateModel) -> tuple[str, ...]:
    """The effects of the augmented structure: those of the base, then the accepted ones."""
    first = (LEVEL.id,) * base.search.level + (SAMPLING.id,) * base.sampled
    return (*first, *(id for id in candidate.effects if id != CHANGED.id and id not in BY_LOG))


def parameter_indices(base: Base, candidate: CandidateModel) -> list[int]:
    """The parameters of a candidate model in the order of ``Augmented``'s θ."""
    m = base.search.model
    indices = [k for k, s in enumerate(m.parameters) if s.owner == "core"]
    for id in effects_of(base, candidate):
        e = effect(id)
        indices += [m.index[id, p.name, side] for side in m.sides(e) for p in e.parameters]
    return indices


def covariance_of(base: Base, candidate: CandidateModel) -> Array:
    """Covariance of the free parameters, (n, n): σ²(JᵀJ)⁻¹, widened by N/N_eff track by track.

    A parameter whose slopes overflow, in a run that grows without end, has none: 0, as where slopes
    say nothing.
    """
    H = information(base.search.model, candidate.q, candidate.free, base.search.data)
    known = np.isfinite(np.diag(H))
    H = np.where(np.outer(known, known), H, 0.0)
    errors = np.concatenate(candidate.errors.estimation)
    variance = float(np.nanmean(errors**2))
    samples = np.maximum(np.isfinite(errors).sum(axis=0), 1)
    share = float(np.min(effective_samples(candidate.errors.estimation) / samples))
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True) / max(min(share, 1.0), 1e-3))


def std_errors(base: Base, candidate: CandidateModel) -> dict[int, float]:
    """Standard errors of the free parameters by slopes; 0 where these say nothing."""
    errors = np.sqrt(np.maximum(np.diag(covariance_of(base, candidate)), 0.0))
    return dict(zip(candidate.free, errors.tolist(), strict=True))


def values_of(
    base: Base, candidate: CandidateModel, id: str, intervals: Mapping[int, Interval] | None = None
) -> tuple[Value, ...]:
    """The parameters of an effect with standard errors; None where nothing was estimated."""
    m = base.search.model
    first = base.search.estimation[0]
    sided = first.nu > first.ny and about(id).place is Place.COMMAND
    names = first.input_names if sided else first.output_names
    unit = base.search.estimation[0].outputs[0].unit
    errors, acting = std_errors(base, candidate), _acting(base, candidate, id)
    values = []
    for k in m.of(id):
        p = m.parameters[k]
        if acting and p.name not in acting:
            continue
        tag = "" if p.track < 0 else f"[{names[p.side]}]"
        idle = candidate.q[k] == p.null and p.track >= 0
        if idle and k not in errors and id != CHANGED.id:
            continue
        value, words = float(candidate.q[k]), p.of.unit.replace("speed", unit)
        interval = (intervals or {}).get(k)
        shown = _value(f"{p.name}{tag}", value, errors.get(k), interval, words)
        shown = replace(shown, bounded=k in errors and on_bound(p, value))
        values.append(replace(shown, in_file=_in_file(base, shown, p.side)))
        if shown.visited and p.of.as_command:
            # as the command that just overcomes it: what a person with a robot turns up
            gain = abs(candidate.q[m.index["core", "gain", p.track]])
            at = min(p.track, first.nu - 1)
            full = float(full_drive(base.parts.estimation)[at]) / gain
            command = shown.times(full, first.inputs[at].unit, f"{p.name}_command{tag}")
            factor, of_file = first.inputs[at].to_file
            same = None if factor == 1.0 else command.times(factor, of_file)
            values.append(replace(command, in_file=same))
        if shown.visited and p.of.as_rate:
            speed = value * _speed_of_error(base, candidate, p.track)
            held = Value(f"speed{tag}", speed, None, f"{words}/s")  # its error is the core's, too
            values.append(replace(held, in_file=_in_file(base, held, p.track)))
    return tuple(values)


def _speed_of_error(base: Base, candidate: CandidateModel, track: int) -> float:
    """Speed at which a servo settles that answers to an error of 1 for ever [1/s].

    Stepped from rest; the closed form by the slopes of B and F at 1 fails where a pole and a zero
    cancel there.
    """
    _, f, tail = base.search.model.core(candidate.q, track)
    b = np.concatenate([[1.0 + f.sum() - tail.sum()], tail])
    x, speed, slope = np.zeros(len(f)), 0.0, 0.0
    for _ in range(MOST_STEPS):
        following = np.append(x[1:], 0.0) - f * x[0]
        torque = (0.5 * (x[0] + following[0]) + 1.0) / (1.0 - 0.5 * b[0])
        following = following + b * torque
        before, slope = slope, float(following[0] - x[0])
        x, speed = following, slope / base.search.estimation[0].dt
        if abs(slope - before) < SETTLED * abs(slope):
            break
    return speed


def _acting(base: Base, candidate: CandidateModel, id: str) -> tuple[str, ...]:
    """Parameters of the law that acts; none where an effect has but one."""
    if id == CHANGED.id or not effect(id).laws:
        return ()
    chosen = base.search.model.chosen(effect(id), candidate.q)
    return (*chosen, *effect(id).searched(chosen))


def _in_file(base: Base, value: Value, track: int) -> Value | None:
    """A speed in the file's unit, and a share of the log's largest command as one of the file.

    None where the value is neither, or was not converted.
    """
    first = base.parts.estimation[0]
    channel = first.outputs[min(max(track, 0), first.ny - 1)]
    size, unit = channel.to_file
    known = track >= 0 or first.nu == 1
    if "drive" in value.unit and known and not first.full_drive_is_known:
        track = min(max(track, 0), first.nu - 1)
        channel = first.inputs[track]
        size = float(full_drive(base.parts.estimation)[track]) / channel.scale
        unit = value.unit.replace("drive", channel.file_words or channel.unit or channel.name)
    elif (
        channel.unit
        and value.unit in (channel.unit, f"1/{channel.unit}", f"{channel.unit}/s")
        and size != 1.0
    ):
        unit = value.unit.replace(channel.unit, unit)
    else:
        return None
    return value.times(1.0 / size if value.unit.startswith("1/") else size, unit)


def _value(
    name: str, value: float, error: float | None, interval: Interval | None, unit: str
) -> Value:
    if interval is None:
        return Value(name, value, error, unit)
    if not interval.visited:
        return Value(name, math.nan, None, unit)
    return Value(name, value, interval.std_error(value), unit, (interval.low, interval.high))


def model_of(
    base: Base, candidate: CandidateModel, intervals: Mapping[int, Interval] | None = None
) -> Model:
    """The candidate model as a Model with values, standard errors, figures and provenance.

    Args:
        intervals: of parameters without a standard error from gradients, by index. One that the log
            never visits does nothing in the model, and its variance is infinite.
    """
    search = base.search
    records = search.estimation
    first = records[0]
    structure = Augmented(
        search.model.order,
        base.search.delay,
        tuple(float(s) for s in base.search.scales),
        first.dt,
        effects_of(base, candidate),
        base.given,
        outputs=first.ny if first.ny != first.nu else 0,
        later=search.later,
    )
    indices = parameter_indices(base, candidate)
    covariance = np.zeros((len(indices), len(indices)))
    inside = [k for k, index in enumerate(indices) if index in candidate.free]
    of_free = [candidate.free.index(indices[k]) for k in inside]
    covariance[np.ix_(inside, inside)] = covariance_of(base, candidate)[np.ix_(of_free, of_free)]
    parameters = structure.parameters(first.inputs, first.outputs)
    theta, unseen = candidate.q[indices], []
    for k, index in enumerate(indices):
        interval = (intervals or {}).get(index)
        if interval is None:
            continue
        if not interval.visited:
            theta[k] = search.model.parameters[index].null
            unseen.append(k)
        covariance = _with_error(covariance, k, interval.std_error(float(theta[k])))
    parts = _rows_together(candidate.errors.estimation)
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
        n_estimated=len(candidate.free),
        null_directions=tuple({parameters[k].name: 1.0} for k in unseen),
        criteria=information_criteria(parts, len(candidate.free)),
        termination=Termination.CONVERGED_COST,
        ranges=np.array([(c.min(), c.max()) for block in values for c in block.T]),
        provenance=Provenance(_sources(records), {"made_by": "diagnose"}, __version__),
    )


def _rows_together(errors: Sequence[Array]) -> list[Array]:
    """Errors of all outputs in rows of their own, (M, ny) a record.

    Slow sensors whose measurements never share a row are put side by side in their order.
    """
    parts = [e[np.isfinite(e).all(axis=1)] for e in errors]
    if sum(map(len, parts)) > errors[0].shape[1]:
        return parts
    rows = []
    for e in errors:
        columns = [c[np.isfinite(c)] for c in e.T]
        shortest = min(len(c) for c in columns)
        rows.append(np.column_stack([c[:shortest] for c in columns]))
    return rows


def _with_error(covariance: Array, k: int, error: float | None) -> Array:
    """Another standard error of one parameter, its correlations kept; None is an infinite one."""
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
