"""Missions in MuJoCo: the vehicle's contacts, what is refused, and that nothing is random."""

import builtins
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot, goal
from plant_models import robot_model
from sysid_datasets.multibody import scrub

from sysid.cosim.multibody.engine import MISSING, engine
from sysid.cosim.multibody.machine import Machine
from sysid.cosim.multibody.motion import STAND_IN, Multibody
from sysid.errors import DataError, ModelError
from sysid.export.package import write_package
from sysid.robot.mission.batch.runner import why_not_at_once
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import MotionInputs
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.vehicle.kinematics import Geometry

pytest.importorskip("mujoco", reason="the extra physics is not installed")

AHEAD = {"goal": (0.3, 0.0), "motion": {"kind": "multibody"}}


def test_a_mission_by_kind_is_driven_from_the_command_line(tmp_path: Path, capsys: Capture) -> None:
    write_package(robot_model(), tmp_path / "plant", formats=["json"])
    mission, log = tmp_path / "m.yaml", tmp_path / "m.csv"
    mission.write_text("goal: [0.3, 0]\nmotion: {kind: multibody}\n")
    done = run(
        capsys, "simulate", mission, "--plant", tmp_path / "plant", "-o", log, "--json"
    ).document
    assert done["outcome"] == "arrived"
    assert any("the mass 1.5 kg" in w for w in done["warnings"])
    assert log.read_text().partition("\n")[0].endswith("rho_goal,v_y,touching")


def test_runs_are_the_same_to_the_last_bit() -> None:
    mission = Mission.model_validate(AHEAD)
    first, again = (simulate(mission, Robot()).log for _ in range(2))
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_a_step_depends_on_its_arguments_alone() -> None:
    law, scene = Multibody(), Mission.model_validate(AHEAD).scene()
    state = law.start(scene, np)
    given = MotionInputs(0.1, 4.0, 8.0, scene)
    (after, body), _, (other, twin) = (law.step(state, given, 0.1, np) for _ in range(3))
    assert body == twin
    assert np.array_equal(after.vector, other.vector)


def test_a_turn_on_the_spot_is_that_of_points_with_friction() -> None:
    """On its servos, at the friction of the thesis's simulation: width and speed of the wheels."""
    mujoco = engine(STAND_IN)
    state, turning = mujoco.start, 6.0
    for part in (0.5, 1.0, 1.0, 1.0, 1.0):
        row = turning * part * np.array([-1.0, 1.0])
        state, result, _ = mujoco.advance(state, np.tile(row, (200, 1)), 0.0)
    # the bench's judge allows the engine a hundredth, too
    assert 2.0 * STAND_IN.r * turning / result.yaw_rate == pytest.approx(
        scrub(STAND_IN)[1], rel=0.01
    )
    assert mujoco.speeds == pytest.approx((-turning, turning), rel=2e-3)
    assert math.hypot(*result.pose[:2]) < 1e-3


def test_wheels_that_speed_up_faster_than_friction_allows_spin() -> None:
    mujoco = engine(STAND_IN)
    state, early, _ = mujoco.advance(mujoco.start, np.full((100, 2), 20.0), 0.0)
    _, late, _ = mujoco.advance(state, np.full((200, 2), 20.0), 0.0)
    gained = (late.speed - early.speed) / 0.2
    assert gained == pytest.approx(STAND_IN.friction * 9.81, rel=0.02)  # springs sway
    assert late.speed < 0.7 * 20.0 * STAND_IN.r


def test_machines_of_all_masses_move_alike() -> None:
    light, heavy = (
        engine(replace(STAND_IN, mass=m)).advance(
            engine(replace(STAND_IN, mass=m)).start, np.tile([3.0, 6.0], (300, 1)), 0.0
        )[1]
        for m in (0.3, 30.0)
    )
    assert (*light.pose, *light[1:]) == pytest.approx((*heavy.pose, *heavy[1:]), abs=1e-4)


def test_an_obstacle_stops_the_body_before_its_middle_gets_there() -> None:
    mission = goal(
        1.0,
        0.0,
        obstacles=[(0.45, 0.0)],
        guidance={"kind": "steps", "speed": [[0, 0.3]], "yaw": [[0, 0]], "until": 3},
        motion={"kind": "multibody"},
    )
    done = simulate(mission, Robot(difference=0.0))
    assert done.log["touching"][-1] > 0
    front = done.log["x"][-1] + 0.5 * STAND_IN.size[0]
    assert front == pytest.approx(0.45 - 0.15, abs=5e-3)  # soft contacts give by millimetres
    assert done.outcome is not Outcome.COLLISION


def test_walls_and_obstacles_that_move_are_there() -> None:
    mission = goal(
        1.0,
        0.0,
        obstacles=[{"at": (0.6, 0.0), "velocity": (-0.2, 0.0)}],
        walls=[[(-0.2, -0.5), (-0.2, 0.5)]],
        guidance={"kind": "steps", "speed": [[0, 0.0]], "yaw": [[0, 0]], "until": 2.5},
        motion={"kind": "multibody"},
    )
    done = simulate(mission, Robot())
    assert done.log["touching"][-1] > 0
    assert done.log["x"][-1] < -0.01  # pushed back


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ("{kind: multibody, soil: clay}", "m.yaml:2: motion of kind multibody needs a level"),
        ("{kind: multibody, wheels: 3}", "m.yaml:2: wheels is 3: write an even number"),
        ("{kind: multibody, part: 0.1}", "m.yaml:2: motion.part is 0.1"),
        ("{kind: multibody, friction: 0}", "m.yaml:2: motion.friction is 0"),
    ],
)
def test_keys_are_refused_with_their_line(tmp_path: Path, keys: str, sentence: str) -> None:
    (tmp_path / "m.yaml").write_text(f"goal: [1, 0]\nmotion: {keys}\n")
    with pytest.raises(DataError, match=sentence):
        load_mission(tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"centre": 0.06, "friction": 1.0}, "the vehicle has tipped over at t = 0"),
        ({"height": 5.0}, "the vehicle has tipped over"),
    ],
)
def test_a_vehicle_that_falls_over_is_one_sentence(keys: dict[str, float], sentence: str) -> None:
    mission = goal(1.0, 0.0, motion={"kind": "multibody", **keys})
    with pytest.raises(ModelError, match=sentence):
        simulate(mission, Robot())


def test_an_engine_that_loses_the_vehicle_says_so(capfd: Capture) -> None:
    mujoco = engine(STAND_IN)
    with pytest.raises(ModelError, match=r"MuJoCo has lost the vehicle at t = 0.3 s"):
        mujoco.advance(1e30 * mujoco.start, np.zeros((300, 2)), 0.3)
    assert capfd.readouterr() == ("", "")
    assert not Path("MUJOCO_LOG.TXT").exists()


def test_without_the_extra_one_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    mission = goal(1.0, 0.0, motion={"kind": "multibody", "mass": 1.234})
    with pytest.raises(ModelError) as refused:
        simulate(mission, Robot())
    assert str(refused.value) == MISSING
    assert "sysid-workbench[physics]" in MISSING


def test_many_runs_go_one_after_the_other() -> None:
    setup = Setup.of(Mission.model_validate(AHEAD), [robot_model()], ())  # tracing, not driving
    assert "one mission at a time" in why_not_at_once(setup)


def test_the_vehicle_of_the_mission_is_the_one_that_is_driven() -> None:
    mission = goal(1.0, 0.0, vehicle={"B": 0.3, "mass": 2.0}, motion={"kind": "multibody"})
    assert (mission.car.mass, mission.car.geometry) == (2.0, Geometry(B=0.3))
    solid = replace(STAND_IN, mass=2.0).moment
    assert mission.car.yaw_inertia == solid


def test_a_drawing_library_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """What ``MUJOCO_GL`` names is loaded with MuJoCo, and its absence is no missing extra."""

    def broken(name: str, *more: object) -> object:
        if name == "mujoco":
            raise AttributeError("'NoneType' object has no attribute 'glGetError'")
        return load(name, *more)

    load = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", broken)
    with pytest.raises(ModelError, match="unset the environment variable MUJOCO_GL"):
        engine(Machine(mass=1.234))
