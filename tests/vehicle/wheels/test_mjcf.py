"""A vehicle as a MuJoCo model moves as its kinematics say: two descriptions, one truth."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Capture, run

from sysid.errors import ModelError
from sysid.vehicle.wheels.description import load_vehicle
from sysid.vehicle.wheels.mjcf_writing import mjcf_text
from sysid.vehicle.wheels.vehicle import Vehicle

mujoco = pytest.importorskip("mujoco", reason="MuJoCo comes with the extra physics")

VEHICLES = Path(__file__).parents[3] / "datasets" / "vehicles"


def model(name: str) -> tuple[Vehicle, Any]:
    vehicle = load_vehicle(VEHICLES / f"{name}.yaml")
    return vehicle, mujoco.MjModel.from_xml_string(mjcf_text(vehicle))


def driven(vehicle: Vehicle, model: Any, twist: tuple[float, float, float]) -> list[float]:
    """The twist in the last tenth of a second of a drive with the wheels that belong to a twist."""
    data, wheels = mujoco.MjData(model), vehicle.inverse(twist).wheels
    for wheel in vehicle.wheels:
        if wheel.kind != "caster":
            data.ctrl[model.actuator(wheel.name).id] = wheels[wheel.name].speed
        if wheel.kind == "steerable":
            data.ctrl[model.actuator(f"{wheel.name}_steering").id] = wheels[wheel.name].angle
    for _ in range(1200):
        mujoco.mj_step(model, data)
    psi = yaw(data)
    vx, vy, turn = data.qvel[0], data.qvel[1], data.qvel[5]
    c, s = math.cos(psi), math.sin(psi)
    return [c * vx + s * vy, c * vy - s * vx, turn]


def yaw(data: Any) -> float:
    w, x, y, z = data.qpos[3:7]
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize(
    ("name", "twist"),
    [
        ("ackermann", (0.2, 0.0, 0.06)),
        ("devastator", (0.2, 0.0, 0.0)),
        ("differential", (0.2, 0.0, 0.5)),
        ("mecanum", (0.15, 0.1, 0.3)),
        ("omni", (0.15, 0.1, 0.3)),
        ("tricycle", (0.2, 0.0, 0.3)),
        ("two_steer", (0.2, 0.1, 0.2)),
    ],
)
def test_wheels_that_belong_to_a_twist_give_it(name: str, twist: tuple[float, ...]) -> None:
    """Within 4 %: contacts creep a little, and the barrels of rollers are not quite round.

    ``omni_steer`` has no place here: its casters are not driven, and its body swings freely.
    """
    vehicle, physics = model(name)
    possible = vehicle.inverse(twist).possible
    np.testing.assert_allclose(driven(vehicle, physics, twist), possible, atol=0.04 * 0.3)


def test_a_tracked_vehicle_turns_less_than_tracks_without_scrubbing_would() -> None:
    vehicle, physics = model("devastator")
    turn = driven(vehicle, physics, (0.0, 0.0, 0.5))[2]
    assert 0.4 < turn < 0.49


def test_it_stands_still_with_the_mass_and_inertia_that_the_vehicle_has() -> None:
    vehicle, physics = model("devastator")
    data = mujoco.MjData(physics)
    for _ in range(500):
        mujoco.mj_step(physics, data)
    assert np.abs(data.qpos[:2]).max() < 1e-6
    assert np.abs(data.qvel).max() < 1e-5
    assert physics.body_mass.sum() == pytest.approx(1.592)
    own = vehicle.body.inertia
    assert own is not None
    base = physics.body("base_link")
    assert base.mass[0] == pytest.approx(0.82573504)  # the base link as the thesis prints it
    np.testing.assert_allclose(np.sort(base.inertia), np.linalg.eigvalsh(own.tensor), rtol=1e-6)


def test_a_vehicle_without_mass_is_refused_in_one_sentence() -> None:
    vehicle = load_vehicle(VEHICLES / "devastator.yaml")
    bare = Vehicle(vehicle.wheels, body=vehicle.body.model_copy(update={"mass": None}))
    with pytest.raises(ModelError, match="needs the mass of the body"):
        mjcf_text(bare)


def test_the_command_writes_it(tmp_path: Path, capsys: Capture) -> None:
    target = tmp_path / "robot.xml"
    line = ("vehicle", VEHICLES / "differential.yaml", "--mjcf", target, "--json")
    assert json.loads(run(capsys, *line).out)["mjcf"] == str(target)
    assert mujoco.MjModel.from_xml_path(str(target)).nu == 2
