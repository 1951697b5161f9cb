"""Guidance and robot as two halves, joined by queues: the run of one process, and its endings."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.cosim.connection import Asked, Ended, Level, QueuePort, Seen, SilenceError, joined
from sysid.cosim.guiding import guide
from sysid.cosim.robot import Pace, play_robot
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body, Pose
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission

LOCK = Pace(lock_step=True, patience=20.0)
"""Threads of a busy machine may wait long for their turn; a failing half still ends the test."""


def both(
    mission: Mission, level: Level = Level.REFERENCES, pace: Pace = LOCK, **facts: Any
) -> tuple[MissionResult, MissionResult]:
    """What the guidance half and the robot half came to."""
    here, there = joined()
    with ThreadPoolExecutor(2) as pool:
        guiding = pool.submit(guide, mission, here, level, Robot(), 20.0)
        driving = pool.submit(play_robot, mission, Robot(), there, pace, level, **facts)
        return guiding.result(30.0), driving.result(30.0)


GUIDED = {"a filter and its sensors": 0.1, "slower commands": 0.1, "faster commands": 1e-6}
"""Where guidance ends elsewhere: it knows the estimate, and that at control instants only."""

CASES = {
    "mission 1": goal(1, 0),
    "obstacles": goal(3, 1, obstacles=[(2.0, 0.0)]),
    "slower commands": goal(1, 0, control={"period": 0.3}),
    "faster commands": goal(1, 0, control={"period": 0.05}),
    "a filter and its sensors": goal(
        1, 0, navigation={"kind": "ekf"}, sensors={"gyroscope": {}, "encoders": {}}
    ),
    "a model of the plant": goal(1, 0, control={"speed": {"kind": "p"}, "yaw": {"kind": "p"}}),
    "waypoints": goal(2, 0, waypoints=[(1.0, 0.5)]),
    "collision": goal(2, 0, obstacles=[(1.0, 0.0)], guidance={"kind": "pure-pursuit"}),
    "stuck": goal(6, 0, obstacles=[(2.0, 0.0)]),
    "timeout": goal(5, 0, timeout=2.0),
}


@pytest.mark.parametrize("level", list(Level))
@pytest.mark.parametrize("name", list(CASES))
def test_in_lock_step_it_is_the_run_of_one_process(name: str, level: Level) -> None:
    mission = CASES[name]
    alone = simulate(mission, Robot())
    guided, driven = both(mission, level)
    assert driven.outcome is alone.outcome
    assert guided.outcome is alone.outcome
    assert driven.time_s == alone.time_s
    # what was asked at the last instant is not said any more: it says that it is over
    thought = {"v_ref", "psi_ref", "v_cmd", "psi_cmd", "pwm_l", "pwm_r"}
    unknown = {"v_ref", "psi_ref", "v_cmd", "psi_cmd"} if level is Level.PWM else set()
    for column in alone.log.keys() & driven.log.keys() - unknown:
        until = -1 if column in thought else None
        # PWM goes over as mean and half difference, and time as nanoseconds: rounding only
        expected, result = alone.log[column][:until], driven.log[column][:until]
        np.testing.assert_allclose(result, expected, rtol=0.0, atol=1e-6, err_msg=column)
    assert guided.final == pytest.approx(alone.final, abs=GUIDED.get(name, 1e-6))


def test_free_running_a_sample_late() -> None:
    """The robot does not wait: every answer is that to the sample before."""
    mission = goal(1, 0)
    alone = simulate(mission, Robot())

    def answered(seconds: float) -> None:  # the other half is through long before the next sample
        time.sleep(0.01)

    guided, driven = both(mission, pace=Pace(patience=20.0), wait=answered)
    for result in (guided, driven):
        assert result.outcome is Outcome.ARRIVED
        assert result.time_s == pytest.approx(alone.time_s, abs=0.3)
        assert result.final[:2] == pytest.approx(alone.final[:2], abs=0.05)


def test_a_half_that_is_silent_or_breaks_off_ends_the_other() -> None:
    mission = goal(1, 0)
    here, there = joined()
    with pytest.raises(SilenceError, match=r"sent nothing for 0\.05 s"):
        guide(mission, here, patience=0.05)
    assert there.receive(0.1) == Ended("broken off")
    with pytest.raises(SilenceError, match=r"sent nothing for 0\.05 s"):
        play_robot(mission, Robot(), there, Pace(lock_step=True, patience=0.05))
    with pytest.raises(SilenceError, match=r"the robot received no reference for 0\.05 s"):
        play_robot(mission, Robot(), joined()[0], Pace(patience=0.05, speed=50.0))
    here, there = joined()
    here.send(Ended("broken off"))
    with pytest.raises(ModelError, match="interrupted; start both again"):
        play_robot(mission, Robot(), there, LOCK)


def said(*messages: Seen | Asked | Ended) -> QueuePort:
    here, there = joined()
    for message in messages:
        there.send(message)
    return here


def test_a_robot_of_another_kind() -> None:
    """Its time begins anywhere, does not fit the period, and may be said twice; never go back."""
    at = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    times = [100.0 + 0.03 * k for k in range(40)]
    port = said(*(Seen(t, at) for t in (*times, times[-1])), Ended("collision"))
    result = guide(goal(1, 0), port)
    assert (result.outcome, len(result.log["t"])) == (Outcome.COLLISION, 40)
    assert result.log["t"][-1] == pytest.approx(39 * 0.03)
    with pytest.raises(ModelError, match=r"time went back from 0\.5 s to 0\.1 s: two robots share"):
        guide(goal(1, 0), said(*(Seen(t, at) for t in (0.0, 0.5, 0.1))))
    with pytest.raises(ModelError, match="ended before it began"):
        guide(goal(1, 0), said(Ended("stuck")))
    with pytest.raises(ModelError, match="which are not numbers"):
        play_robot(goal(1, 0), Robot(), said(Asked(float("nan"), 0.0)), LOCK)
    with pytest.raises(ModelError, match=r"model of the plant; name a `plant`"):
        guide(goal(1, 0, control={"speed": {"kind": "p"}}), said())
