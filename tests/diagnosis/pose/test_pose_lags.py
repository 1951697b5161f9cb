"""Effects of the vehicle with a memory, and slip in straight drive, from the pose of physics."""

import numpy as np
import pytest
from pose_cases import DT
from skid_cases import SkidSteer, logged, stepping

from sysid.data.record import Array
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.effects.ground import Ground
from sysid.robot.calibration.windows import path_of
from sysid.vehicle.kinematics import Geometry

HEAVY = SkidSteer(inertia=0.4)
"""Turns late, drives at once."""

SPEEDS = {seed: stepping(300, seed) for seed in (5, 6)}


ROBOT = Geometry()


def told(poses: dict[int, Array], geometry: Geometry | None = ROBOT) -> PoseDiagnosis:
    first, second = (logged(SPEEDS[s], poses[s], s) for s in (5, 6))
    found = diagnose_pose([first], [second], geometry)
    assert found is not None
    return found


def late(pose: Array, delay: float, heading: float = 0.0) -> Array:
    """The pose read late, its heading later still."""
    t = DT * np.arange(len(pose))
    behind = (delay, delay, delay + heading)
    return np.column_stack([np.interp(t - d, t, pose[:, i]) for i, d in enumerate(behind)])


def rolling() -> dict[int, Array]:
    return {s: path_of(w, DT, Ground(), Geometry()) for s, w in SPEEDS.items()}


def lost(**numbers: float) -> dict[int, Array]:
    values = {k: np.full(2, numbers.get(k, 0.0)) for k in ("share", "growth", "lag")}
    ground = Ground(("longitudinal-slip",), {"longitudinal-slip": values})
    return {s: path_of(w, DT, ground, Geometry()) for s, w in SPEEDS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_a_body_that_is_slow_to_turn_is_named_whatever_the_latency(delay: float) -> None:
    found = told({s: late(HEAVY.pose(w), delay) for s, w in SPEEDS.items()})
    values = {e.id: e.parameters[0].value for e in found.effects}
    # sides that resist to the side turn the body less, too
    assert set(values) == {"scrub-lag", "track-width"}
    resists = HEAVY.stiffness * HEAVY.geometry.B**2 / 2.0 + HEAVY.scrubbing
    # of 4 kg on two sides of 100 N s/m the way lags by 0.02 s itself: an eighth of the turn's lag
    assert values["scrub-lag"] == pytest.approx(HEAVY.inertia / resists, rel=0.15)
    assert found.gap.closed_percent > 95.0
    (sentence,) = [e.sentence for e in found.effects if e.id == "scrub-lag"]
    assert "Turning follows the wheels with a lag" in sentence
    assert any("pose comes" in w for w in found.warnings) == (delay > 0.0)


@pytest.mark.parametrize(
    ("delay", "heading"),
    [
        (0.1, 0.1),
        *(
            pytest.param(*p, marks=pytest.mark.slow)
            for p in ((0.12, 0.0), (-0.12, 0.0), (0.0, 0.15))
        ),
    ],
)
def test_readings_that_come_late_are_no_effect(delay: float, heading: float) -> None:
    found = told({s: late(p, delay, heading) for s, p in rolling().items()})
    assert not found.effects
    assert any("s later" in w or "s earlier" in w for w in found.warnings)


def test_a_pose_that_is_filtered_is_no_effect() -> None:
    def filtered(pose: Array) -> Array:
        out, keep = pose.copy(), np.exp(-DT / 0.15)
        for k in range(1, len(out)):
            out[k] = keep * out[k - 1] + (1.0 - keep) * pose[k]
        return out

    found = told({s: filtered(p) for s, p in rolling().items()})
    assert not found.effects
    assert any("its measurements are smoothed" in w for w in found.warnings)


def test_a_light_vehicle_with_grip_has_no_effect() -> None:
    light = SkidSteer(mass=1.0, inertia=0.01, stiffness=200.0, scrubbing=0.0)
    found = told({s: light.pose(w) for s, w in SPEEDS.items()})
    assert not found.effects
    assert not found.warnings


@pytest.mark.slow
def test_a_share_of_the_way_is_slip_where_the_radius_is_given_only() -> None:
    found = told(lost(share=0.15))
    (named,) = found.effects
    assert (named.id, named.parameters[0].name) == ("longitudinal-slip", "share")
    # noise of the speeds: a hundredth of a rad/s in ten
    assert named.parameters[0].value == pytest.approx(0.15, abs=0.003)
    assert any("another radius on both sides" in w for w in found.warnings)
    assumed = told(lost(share=0.15), None)
    assert not assumed.effects
    (warning,) = assumed.warnings
    assert "they slip and lose 15" in warning
    assert "slip changes with it, a radius does not" in warning


def test_a_share_that_a_tyre_may_sit_lower_is_no_slip() -> None:
    assert not told(lost(share=0.02)).effects


@pytest.mark.parametrize(("name", "value"), [("growth", 0.01), ("lag", 0.25)])
def test_slip_that_no_radius_does_is_named_without_one(name: str, value: float) -> None:
    found = told(lost(**{name: value}), None)
    (named,) = found.effects
    assert (named.id, named.parameters[0].name) == ("longitudinal-slip", name)
    # 4 standard errors, and 2 % for noise of the speeds, which the fit takes for true
    allowed = 4.0 * (named.parameters[0].std_error or 0.0) + 0.02 * value
    assert named.parameters[0].value == pytest.approx(value, abs=allowed)
    assert "no radius does that" in named.sentence


@pytest.mark.slow
def test_a_heavy_body_on_soft_sides_slips_under_load() -> None:
    heavy = SkidSteer(mass=20.0, stiffness=40.0)
    found = told({s: heavy.pose(w) for s, w in SPEEDS.items()}, None)
    loads = [e for e in found.effects if e.id == "longitudinal-slip"]
    assert [e.parameters[0].name for e in loads] == ["lag"]
    # m v̇ = 2 C (r ω − v): m/2C, read with turning that lags, too
    assert loads[0].parameters[0].value == pytest.approx(20.0 / 80.0, rel=0.1)
