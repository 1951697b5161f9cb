"""References stay within what the plant can do; the published ones are as published."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mission_cases import Robot, check_law, goal

from sysid.errors import DataError
from sysid.robot.mission.contracts import Limits
from sysid.robot.mission.guidance.around_law import Feasible, limited_rate
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import scene_of, simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tracks.settling import limits_of
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry

ROBOT = Robot(dt=0.01, difference=0.0)


def test_the_limits_of_a_first_order_robot_are_those_of_its_equation() -> None:
    """0.43 m/s at full drive after a lag of 0.2 s; opposite drives turn at 2·0.43/B."""
    limits = limits_of(ROBOT, Geometry())
    yaw = 2 * 0.43 / Geometry().B
    # A time is read to one sample of 0.01 s in 0.2 s.
    expected = (0.43, 0.43 / 0.2, yaw, yaw / 0.2)
    assert limits == pytest.approx(expected, rel=0.06)
    assert limits_of(replace(ROBOT, top_speed=0.0), Geometry()) == Limits()


@pytest.mark.parametrize("kind", ["field", "harmonic", "pure-pursuit"])
def test_references_change_no_faster_than_the_plant(kind: str) -> None:
    limits = {"speed": 0.2, "acceleration": 0.1, "yaw_rate": 0.4, "yaw_acceleration": 0.5}
    mission = goal(0, 2, guidance={"kind": kind}, limits=limits, obstacles=[(0.3, 1.0)])
    log = simulate(mission, Robot()).log
    speed, psi = log["v_ref"], np.unwrap(log["psi_ref"])
    slack = 1 + 1e-9
    assert speed.max() <= 0.2 * slack
    assert np.abs(np.diff(speed)).max() <= 0.1 * 0.1 * slack
    rate = np.diff(psi) / 0.1
    assert np.abs(rate).max() <= 0.4 * slack
    assert np.abs(np.diff(rate)).max() <= 0.5 * 0.1 * slack + 1e-9
    assert np.abs(rate).max() > 0.39  # the goal lies to the side: the limit is used


def test_a_reference_that_turns_stops_where_it_should() -> None:
    limits, psi, rate = Limits(yaw_rate=1.0, yaw_acceleration=0.5), 0.0, 0.0
    turned = [psi]
    for _ in range(100):
        rate = limited_rate(1.0 - psi, rate, limits, 0.1, floats)
        psi += rate * 0.1
        turned.append(psi)
    assert turned[-1] == pytest.approx(1.0, abs=1e-6)
    assert max(turned) < 1.0 + 0.005  # one step at what is left of the braking, 0.5·0.1²


def test_the_law_fulfils_the_contract() -> None:
    check_law("guidance", Feasible(PotentialField()))


def test_published_references_are_as_published_unless_it_is_asked_for() -> None:
    assert goal(1, 0).complete_guidance == PotentialField()
    assert scene_of(goal(1, 0), ROBOT).limits == Limits()
    asked = goal(1, 0, limits="plant")
    assert asked.complete_guidance == Feasible(PotentialField())
    assert scene_of(asked, ROBOT).limits.speed == pytest.approx(0.43, rel=1e-3)
    own = goal(1, 0, guidance={"kind": "pure-pursuit"}, limits={"speed": 0.1})
    assert scene_of(own, ROBOT).limits[:2] == pytest.approx((0.1, 0.43 / 0.2), rel=0.06)
    free = goal(1, 0, guidance={"kind": "pure-pursuit"}, limits="none")
    assert not isinstance(free.complete_guidance, Feasible)


def test_a_slow_plant_is_not_asked_for_more_than_it_has() -> None:
    slow = Robot(top_speed=0.1)
    result = simulate(goal(1, 0, limits="plant"), slow)
    assert result.outcome is Outcome.ARRIVED
    assert result.log["v_ref"].max() <= 0.1 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("limits: fast", r"m.yaml:2: limits is the text 'fast': write plant, none or a section"),
        ("limits: {speed: 0}", r"m.yaml:2: limits.speed is 0: give a number above 0"),
        ("limits: {sped: 1}", r"m.yaml:2: unknown key 'sped' in limits: did you mean 'speed'"),
    ],
)
def test_limits_that_cannot_be_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"goal: [1, 0]\n{text}\n")
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert re.search(words, str(caught.value)), caught.value
    assert math.isinf(Limits().speed)
