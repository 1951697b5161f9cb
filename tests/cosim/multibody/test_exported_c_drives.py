"""The exported C of plant and laws drives the vehicle in MuJoCo, as Python does."""

from pathlib import Path

import numpy as np
import pytest
from c_programs import COMPILER, needs_compiler
from mission_cases import goal
from plant_models import robot_model

from studies import compiled_loop
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.tracks.mapping import as_robot

pytest.importorskip("mujoco", reason="the extra physics is not installed")

MULTIBODY = {"kind": "multibody"}


@needs_compiler
def test_the_exported_c_drives_mission_1_to_its_goal(tmp_path: Path) -> None:
    """Plant, guidance, control and command module are C; MuJoCo moves the body."""
    model, mission = robot_model(), goal(1.0, 0.0, motion=MULTIBODY)
    parts = compiled_loop.compiled(model, mission, tmp_path, COMPILER)
    result = compiled_loop.drive(model, mission, parts)
    assert result.outcome is Outcome.ARRIVED
    alone = simulate(mission, as_robot(model.plant(), mission)[0])
    assert result.time_s == alone.time_s
    for column in ("x", "y", "psi", "omega_l", "omega_r", "v_y"):
        # the tolerance of the closed loop in C, of signals of the order of 1 to 10
        np.testing.assert_allclose(result.log[column], alone.log[column], rtol=0.0, atol=1e-9)
