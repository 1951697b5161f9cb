"""Ties between sensor and motor effects resolved by the pose.

The measured speeds cannot distinguish a lag of the sensor from one of the actuator, or a zero point
from a load. But speeds corrected for a sensor effect predict the path better if it is real.
"""

import math
from dataclasses import replace

from sysid.diagnosis.policies import RULE
from sysid.diagnosis.pose.correct_sensor import correct_sensor
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.search.selection import SelectedEffect, Selection
from sysid.diagnosis.session import SelectionResult
from sysid.effects.base import Place
from sysid.effects.catalogue import about
from sysid.vehicle.kinematics import Geometry


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
    floors = [c.noise_floor for c in like.whole.channels.values()]
    errors = [c.rmse_after for c in pose.whole.channels.values()]
    return math.sqrt(sum((e / f) ** 2 for e, f in zip(errors, floors, strict=True) if f > 0.0))
