"""The planar dynamics against a multibody simulation in three dimensions (MuJoCo), rigid floor."""

from functools import cache

import numpy as np
import pytest
from sysid_datasets.multibody import Drive, Machine, drive, schedule, scrub

from sysid.data.record import Array
from sysid.vehicle.dynamics import VehicleState, step, substeps_for
from sysid.vehicle.floor import Floor
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.motors import Bench
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import G, TrackedVehicle

pytest.importorskip("mujoco", reason="the extra physics is not installed")

DT = 0.02
MACHINE = Machine()
MOMENT, WIDTH = scrub(MACHINE)
MOTOR = Bench().motor(1.0)

RIGID = 1e-6
"""Shear displacement [m] of a floor that does not yield: slip stays under a thousandth."""

CLOSE = 0.01
"""Share of the largest value by which both may differ: the engine's wheels sink in by 0.1 mm of a
radius of 21.5 mm, and less where they slide, because its contacts lift them then."""

RUNS = {
    "straight": ((1.0, 5.0, 5.0), (0.5, 0.0, 0.0)),
    "spin": ((1.5, -5.0, 5.0),),
    "arc": ((1.5, 6.0, 3.0),),
    "tight arc": ((1.5, 1.0, 6.0),),
}
"""(duration [s], left, right [V]) one after the other."""


@cache
def ours() -> dict[str, Array]:
    """ω_L, ω_R, v, ψ̇, x of the planar dynamics, (N, 5), all runs side by side.

    Wheels that slide in all directions creep forward, too, which widens the vehicle from B to
    WIDTH. The same sprocket forces balance the same moments on that lever where moment and yaw
    inertia are larger by WIDTH/B.
    """
    volts = np.stack([schedule(pieces, DT) for pieces in RUNS.values()], axis=2)
    wider = WIDTH / MACHINE.B
    lateral = 4.0 * MOMENT * wider / (MACHINE.mass * G * MACHINE.L)
    angle = float(np.arctan(MACHINE.friction))
    soil = Soil(0.0, angle, RIGID, rolling=MACHINE.rolling, lateral=lateral)
    inertia = MACHINE.yaw_inertia * wider
    vehicle = TrackedVehicle(Geometry(MACHINE.r, WIDTH), MACHINE.L, 0.04, MACHINE.mass, inertia)
    none = np.zeros(len(RUNS))
    state = VehicleState(none, none, none, none, none, none, (none, none))
    rows = []
    for left, right in volts:
        rows.append((*state.omega, state.vx, state.yaw_rate, state.x))
        motors, scheme = (MOTOR, MOTOR), substeps_for(DT, 0.0025)
        state = step(state, (left, right), DT, vehicle, motors, Floor(soil), np, scheme)
    return dict(zip(RUNS, np.array(rows).transpose(2, 0, 1), strict=True))


@cache
def engine(name: str) -> Drive:
    """The same run in the engine."""
    return drive(MACHINE, schedule(RUNS[name], DT), DT)


def test_points_turn_as_a_uniform_pressure_does() -> None:
    """Mean distance L/4; friction that no direction has leaves less than Wong's μWL/4 for it."""
    assert np.mean(np.abs(MACHINE.places)) == pytest.approx(MACHINE.L / 4.0)
    wong = MACHINE.friction * MACHINE.mass * G * MACHINE.L / 4.0
    assert 0.9 * wong < MOMENT < wong


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_speeds_follow_the_multibody_simulation(name: str) -> None:
    """Acceleration, steady speed and coasting down; turns against scrub, on the spot and in arcs.

    While they change, by twice as much: steps of 2.5 ms and contacts of 7 ms come to 3 % of the
    lag.
    """
    theirs, mine = engine(name), ours()[name]
    columns = np.column_stack([theirs.omega, theirs.velocity[:, [0, 2]]])
    fastest = np.abs(np.concatenate(list(ours().values()))[:, :4]).max(axis=0)
    off = np.abs(columns - mine[:, :4]) / fastest
    assert off.max() < 2.0 * CLOSE
    assert off[-25:].max() < CLOSE


def test_it_coasts_down_as_far_and_stands() -> None:
    theirs, mine = engine("straight"), ours()["straight"]
    assert theirs.pose[-1, 0] == pytest.approx(mine[-1, 4], rel=CLOSE)


def test_turning_on_the_spot_takes_the_moment_of_the_scrub() -> None:
    """What the motors give beyond their own losses is r/B of the moment, at the speed it leaves."""
    done = engine("spin")
    m = MACHINE.motor
    speed = float(np.mean(np.abs(done.omega[-10:])))
    taken = m.torque * 5.0 - m.damping * speed - m.friction
    rolling = MACHINE.rolling * MACHINE.mass * G * MACHINE.r / 2.0
    assert (taken - rolling) * MACHINE.B / MACHINE.r == pytest.approx(MOMENT, rel=CLOSE)
    width = MACHINE.r * 2.0 * speed / float(np.mean(done.velocity[-10:, 2]))
    assert width == pytest.approx(WIDTH, rel=CLOSE)
    assert np.hypot(*done.pose[-1, :2]) < 1e-3  # on the spot


def test_a_drive_needs_a_whole_number_of_steps() -> None:
    with pytest.raises(ValueError, match="multiple"):
        drive(MACHINE, np.zeros((2, 2)), 0.0015)
