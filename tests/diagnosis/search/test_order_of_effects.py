"""What is told first."""

from sysid.diagnosis.assembly import in_order
from sysid.diagnosis.diagnosis import NamedEffect


def named(id: str, stage: str) -> NamedEffect:
    return NamedEffect(
        id=id,
        stage=stage,
        channels=("omega_l",),
        parameters=(),
        evidence=None,
        indistinguishable=(),
        sentence="",
    )


def test_what_spoils_readings_comes_before_what_was_fitted_to_them() -> None:
    found = (
        named("dead-zone", "actuator"),
        named("track-width", "vehicle"),
        named("quantisation", "sensor"),
        named("held-telemetry", "sensor"),
        named("dropouts", "sensor"),
    )
    assert [e.id for e in in_order(found)] == [
        "held-telemetry",
        "dropouts",
        "dead-zone",
        "track-width",
        "quantisation",
    ]
