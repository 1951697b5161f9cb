"""Wheel speeds corrected for the selected effects of the sensor.

A sensor that clips, lags or loses the sign would look like slip or another radius, since the
measured speeds drive the vehicle. The corrected speeds are

    ω̂ = y + (run without the sensor's effects − run with them).

Lost or repeated measurements take the model's speed and the error of their neighbours.

The measured speeds cannot distinguish a lag of the sensor from one of the actuator, or a zero point
from a load. But speeds corrected for a sensor effect predict the path better if it is real.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.samples import inspect_samples
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.selection import SelectedEffect, Selection
from sysid.diagnosis.session import SelectionResult
from sysid.effects.base import Place
from sysid.effects.catalogue import about
from sysid.vehicle.kinematics import Geometry

Parts = tuple[tuple[Record, ...], tuple[Record, ...]]
"""Estimation records, and held-out records."""


def correct_sensor(base: Base, selection: Selection) -> Parts:
    """The records of both parts, their outputs as speeds.

    Effects of the sensor that may as well be the motor's (a bias, a load) change nothing here.
    """
    parts = (base.parts.facts, base.parts.holdout_facts)
    both = parts[0].records, parts[1].records
    sensors = [
        n.id
        for n in selection.selected
        if all(about(id).place is Place.READING for id in (n.id, *n.ties))
    ]
    lost = tuple(inspect_samples(part).weights for part in parts)
    if base.on_rate or not (sensors or any(np.any(w == 0.0) for part in lost for w in part)):
        return both
    search, candidate = base.search, selection.final
    holdout_q = search.in_phase(candidate.q, candidate.effects)
    return (
        _corrected(base, both[0], lost[0], candidate.q, search.data, sensors),
        _corrected(base, both[1], lost[1], holdout_q, search.holdout_data, sensors),
    )


def _corrected(
    base: Base,
    records: tuple[Record, ...],
    weights: Sequence[Array],
    q: Array,
    data: Data,
    sensors: Sequence[str],
) -> tuple[Record, ...]:
    model, plain = base.search.model, q.copy()
    for id in sensors:
        indices = list(model.of(id))
        plain[indices] = model.null[indices]
    read, moved = (data.split(run) for run in model.run(np.array([q, plain]), data))
    return tuple(
        replace(r, y=m + _bridged(r.y - a, w))
        for r, a, m, w in zip(records, read, moved, weights, strict=True)
    )


def _bridged(errors: Array, weights: Array) -> Array:
    """Errors (N, ny), along straight lines where a reading has no weight."""
    out = errors.copy()
    rows = np.arange(len(errors))
    for column, good in zip(out.T, (weights > 0.0).T, strict=True):
        if good.any() and not good.all():
            column[~good] = np.interp(rows[~good], rows[good], column[good])
    return out


def resolve_ties_by_pose(
    result: SelectionResult, geometry: Geometry | None
) -> tuple[SelectionResult, PoseDiagnosis | None]:
    """The result with ties resolved by the pose, and what is missing on the ground."""
    if result.session.base.parts.estimation[0].pose is None:
        return result, None
    pose, fitted = _examined(result, result.selection, geometry), result.selection.final
    for n in result.selection.selected if pose is not None else ():
        sensors = tuple(id for id in (n.id, *n.ties) if about(id).place is Place.READING)
        motors = tuple(id for id in (n.id, *n.ties) if id not in sensors)
        if not (sensors and motors) or result.session.base.on_rate:
            continue
        if result.selection.final is not fitted:
            break  # the rivals of a further tie were fitted beside the name that was exchanged
        by_sensor = _as(result.selection, n, sensors)
        other = _examined(result, by_sensor, geometry)
        if pose is None or other is None:
            continue
        ratio = _error(other, pose) / max(_error(pose, pose), 1e-300)
        if ratio < RULE.held_out:
            result, pose = replace(result, selection=by_sensor), other
        elif ratio > 1.0 / RULE.held_out:
            result = replace(result, selection=_as(result.selection, n, motors))
    return result, pose


def _examined(
    result: SelectionResult, selection: Selection, geometry: Geometry | None
) -> PoseDiagnosis | None:
    base = result.session.base
    estimation, holdout = correct_sensor(base, selection)
    return diagnose_pose(
        estimation, () if base.parts.holdout is base.parts.estimation else holdout, geometry
    )


def _as(selection: Selection, n: SelectedEffect, ids: tuple[str, ...]) -> Selection:
    """The selection with one of these names for an effect, the others of them its ties."""
    id = n.id if n.id in ids else ids[0]
    renamed = replace(n, id=id, ties=tuple(other for other in ids if other != id))
    selected = tuple(renamed if other is n else other for other in selection.selected)
    return (
        replace(selection, final=n.rivals[id], selected=selected)
        if id != n.id
        else replace(selection, selected=selected)
    )


def _error(pose: PoseDiagnosis, like: PoseDiagnosis) -> float:
    """Error of way and turn that the effects leave on held-out data, over the noise of another."""
    floors = [c.noise_floor for c in like.gap.channels.values()]
    errors = [c.rmse_after for c in pose.gap.channels.values()]
    return math.sqrt(sum((e / f) ** 2 for e, f in zip(errors, floors, strict=True) if f > 0.0))
