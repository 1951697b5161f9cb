"""Plans: where guidance leads before anything drives, and what its field looks like."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import AROUND, goal

from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.plan import plan


def test_the_force_is_the_slope_of_the_potential() -> None:
    law, scene, step = PotentialField(), AROUND.scene(), 1e-6
    places = np.random.default_rng(3).uniform((0, 0), (6, 4), (300, 2))
    clear = [min(np.hypot(x - o.x, y - o.y) for o in scene.obstacles) > 0.15 for x, y in places]
    x, y = places[np.array(clear)].T
    fx, fy = law.force(x, y, scene.goal, scene.obstacles)
    for force, dx, dy in ((fx, step, 0.0), (fy, 0.0, step)):
        up = law.potential(x + dx, y + dy, scene, np)
        down = law.potential(x - dx, y - dy, scene, np)
        # Central differences of step h err by h²·U‴/6, with U‴ up to 1e5 near an obstacle, and by
        # rounding, 1e-16·U/h.
        np.testing.assert_allclose(force, -(up - down) / (2 * step), rtol=1e-6, atol=1e-7)


def test_a_free_way_is_straight_and_takes_the_time_of_its_references() -> None:
    route = plan(goal(5, 0))
    assert route.arrives
    assert route.min_clearance_m is None
    assert route.ends == ()
    assert route.length_m == pytest.approx(4.9, abs=0.02)  # to the tolerance, within one step
    rho = np.linspace(0.1, 5.0, 2001)
    slowness = 1 / PotentialField().v_max * (1 + 0.4 / rho / 2)  # 1/V_d of (4.31), h = 1
    time = float(np.sum(np.diff(rho) * (slowness[1:] + slowness[:-1]) / 2))
    assert route.time_s == pytest.approx(time, rel=0.01)  # steps of 2 cm along 1/ρ


def test_two_obstacles_close_together_hold_the_way_between_start_and_goal() -> None:
    route = plan(goal(3, 0, obstacles=[(1.5, 0.25), (1.5, -0.25)]))
    assert not route.arrives
    assert route.time_s is None
    assert route.arriving_share < 1
    (end,) = route.ends
    # On the axis both forces vanish where attraction and repulsion cancel, before the gap.
    assert end[1] == pytest.approx(0.0, abs=0.05)
    assert 0.9 < end[0] < 1.4
    np.testing.assert_allclose(route.way[-1], end, atol=0.15)


def test_the_curves_are_those_of_the_formulas() -> None:
    route = plan(goal(5, 0))
    assert route.attraction is not None
    assert route.repulsion is not None
    own = len(route.attraction.values) // 2
    at = np.interp([1.0, 3.0], route.attraction.distance, route.attraction.quantity[own])
    np.testing.assert_allclose(at, [0.15, 0.30], rtol=1e-6)
    push = np.interp(0.5, route.repulsion.distance, route.repulsion.quantity[own])
    assert push == pytest.approx(0.05 * (1 / 0.5 - 1 / 0.7) / 0.25, rel=1e-3)
    assert [c.gain for c in route.speeds] == ["theta", "h", "Kg"]
    kg = route.speeds[2]
    # K_g 0.4 with θ = 2, h = 1: half the speed at 0.2 m, as the thesis chose it.
    half = np.interp(0.2, kg.distance, kg.quantity[own])
    assert half == pytest.approx(0.15, rel=1e-6)


@pytest.mark.slow
def test_the_command_draws_where_it_is_told_or_in_the_workspace(
    tmp_path: Path, capsys: Capture
) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text("goal: [3, 0]\nobstacles: [[1.5, 0.25], [1.5, -0.25]]\n")
    place = ["--workspace", str(tmp_path / "w")]
    facts = run(capsys, "plan", mission, "--plot", "--json", *place).document
    assert facts["way"]["arrives"] is False
    assert facts["plot"] == str(tmp_path / "w" / "missions" / "m_plan.svg")
    assert "<svg" in Path(facts["plot"]).read_text()
    picture = tmp_path / "p.png"
    said = run(capsys, "plan", mission, "--plot", picture).out
    assert "no farther" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
