"""The pose tells an effect of the sensor from one of the motor that looks the same in the speeds.

A lag of the sensor and one of the actuator, a zero point and a load, cannot be told apart by the
speeds that are read. But the vehicle goes by the speeds there are: put right for what only the
sensor does, the readings foretell its way better where it is the sensor, and worse where it is not.
"""

import math
from dataclasses import replace

from sysid.diagnosis.policies import RULE
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.pose.readings import put_right
from sysid.diagnosis.search.named_sets import Named, Naming
from sysid.diagnosis.study import Outcome
from sysid.effects.base import Place
from sysid.effects.catalogue import about
from sysid.vehicle.kinematics import Geometry


def with_pose(found: Outcome, geometry: Geometry | None) -> tuple[Outcome, PoseDiagnosis | None]:
    """What was found, ties resolved that the pose can tell, and what is missing on the ground."""
    if found.study.base.parts.estimation[0].pose is None:
        return found, None
    pose, fitted = _examined(found, found.naming, geometry), found.naming.final
    for n in found.naming.named if pose is not None else ():
        sensors = tuple(id for id in (n.id, *n.ties) if about(id).place is Place.READING)
        motors = tuple(id for id in (n.id, *n.ties) if id not in sensors)
        if not (sensors and motors) or found.study.base.on_rate:
            continue
        if found.naming.final is not fitted:
            break  # the rivals of a further tie were fitted beside the name that was exchanged
        by_sensor = _as(found.naming, n, sensors)
        other = _examined(found, by_sensor, geometry)
        if pose is None or other is None:
            continue
        ratio = _error(other, pose) / max(_error(pose, pose), 1e-300)
        if ratio < RULE.held_out:
            found, pose = replace(found, naming=by_sensor), other
        elif ratio > 1.0 / RULE.held_out:
            found = replace(found, naming=_as(found.naming, n, motors))
    return found, pose


def _examined(found: Outcome, naming: Naming, geometry: Geometry | None) -> PoseDiagnosis | None:
    base = found.study.base
    estimation, held = put_right(base, naming)
    return diagnose_pose(
        estimation, () if base.parts.held is base.parts.estimation else held, geometry
    )


def _as(naming: Naming, n: Named, ids: tuple[str, ...]) -> Naming:
    """The naming with one of these names for an effect, the others of them its ties."""
    id = n.id if n.id in ids else ids[0]
    mine = replace(n, id=id, ties=tuple(other for other in ids if other != id))
    named = tuple(mine if other is n else other for other in naming.named)
    return (
        replace(naming, final=n.rivals[id], named=named)
        if id != n.id
        else replace(naming, named=named)
    )


def _error(pose: PoseDiagnosis, like: PoseDiagnosis) -> float:
    """Error of way and turn that the effects leave on held-out data, over the noise of another."""
    floors = [c.noise_floor for c in like.whole.channels.values()]
    left = [c.rmse_after for c in pose.whole.channels.values()]
    return math.sqrt(sum((e / f) ** 2 for e, f in zip(left, floors, strict=True) if f > 0.0))
