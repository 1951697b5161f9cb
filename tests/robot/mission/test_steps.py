"""References over time, as a mission gives them to a controller."""

from pathlib import Path

import numpy as np
import pytest
from mission_cases import Robot

from sysid.errors import DataError
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission


def test_each_reference_holds_from_its_instant_until_the_next(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(
        "goal: [9, 9]\n"
        "guidance: {kind: steps, speed: [[0, 0.1], [2, 0.2]], yaw: [[1, -4]], until: 3}\n"
    )
    result = simulate(load_mission(path), Robot())
    t, log = result.log["t"], result.log
    np.testing.assert_array_equal(log["v_ref"], np.where(t >= 2, 0.2, 0.1))
    # The first value counts from the start; angles are wrapped.
    np.testing.assert_allclose(log["psi_ref"], 2 * np.pi - 4, rtol=1e-12)
    assert (result.outcome, result.time_s) == ("arrived", pytest.approx(3.0))


def test_instants_that_fall_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("goal: [9, 9]\nguidance:\n  kind: steps\n  speed: [[2, 0.1], [1, 0.2]]\n")
    with pytest.raises(DataError, match=r"m\.yaml:\d: .*the instants of speed must rise"):
        load_mission(path)
