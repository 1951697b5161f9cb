"""The estimated path with its ellipses in the picture of a mission."""

from pathlib import Path

import numpy as np
from mission_cases import Robot, goal

from sysid.report.missions.drives import draw_mission
from sysid.report.missions.outlines import ellipse
from sysid.robot.mission.registry import law_class
from sysid.robot.mission.simulator import simulate


def test_an_ellipse_holds_95_percent() -> None:
    xx, xy, yy = 0.04, 0.018, 0.01
    outline = ellipse(np.array([1.0, 2.0]), np.array([xx, xy, yy])) - (1.0, 2.0)
    inverse = np.linalg.inv([[xx, xy], [xy, yy]])
    # Every point of the outline lies at the same χ², −2 ln 0.05.
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", outline, inverse, outline), 5.99146, 1e-5)


def test_a_mission_with_a_filter_is_drawn_with_its_estimate(tmp_path: Path) -> None:
    mission = goal(1, 0, navigation=law_class("navigation", "kf")())
    draw_mission(tmp_path / "m.svg", "m", mission, simulate(mission, Robot()))
    assert "95 % of its error" in (tmp_path / "m.svg").read_text(encoding="utf-8")
    plain = goal(1, 0)
    draw_mission(tmp_path / "p.svg", "p", plain, simulate(plain, Robot()))
    assert "of its error" not in (tmp_path / "p.svg").read_text(encoding="utf-8")
