"""All causes by the effect that they are, in one table."""

from sysid_datasets.physics import actuator_causes, motor_causes, sensor_causes
from sysid_datasets.physics.hidden import Cause


def _joined() -> dict[str, tuple[Cause, ...]]:
    joined: dict[str, tuple[Cause, ...]] = {}
    for table in (actuator_causes.CAUSES, motor_causes.CAUSES, sensor_causes.CAUSES):
        for effect, some in table.items():
            joined[effect] = joined.get(effect, ()) + some
    return joined


CAUSES: dict[str, tuple[Cause, ...]] = _joined()
"""Each effect with the physical causes that make it."""

WITH_POSE = frozenset({"track-width", "radius-mismatch", "longitudinal-slip", "scrub-lag"})
"""Effects that only a pose shows."""

WITH_BODY = frozenset({"cross-coupling", "inertial-coupling"}) | WITH_POSE
"""Effects that put a body on the tracks: one of them in a machine."""
