"""Traps of the field are noticed, named and left; where there is no way, the mission says so."""

import json
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mission_cases import Robot, goal, leaves

from sysid.robot.mission.contracts import Body, GuidanceInputs, Pose
from sysid.robot.mission.guidance.escape import leading_out
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.result import MissionResult, Outcome, StuckReason
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.traits import Hold
from sysid.runners import floats

TRAPS: dict[str, dict[str, Any]] = {
    "two close obstacles": {"obstacles": [(1.5, 0.25), (1.5, -0.25)]},
    "cup": {"obstacles": [(1.6, 0), (1.6, 0.4), (1.6, -0.4), (1.3, 0.7), (1.3, -0.7)]},
    "U": {"walls": [[(1.0, 0.6), (2.0, 0.6), (2.0, -0.6), (1.0, -0.6)]]},
}
WALLED_OFF = {"walls": [[(2.3, -0.7), (3.7, -0.7), (3.7, 0.7), (2.3, 0.7), (2.3, -0.7)]]}


def trapped(trap: dict[str, Any], escape: str) -> Mission:
    return goal(3, 0, guidance={"escape": escape}, **trap)


def driven(trap: dict[str, Any], escape: str) -> MissionResult:
    return simulate(trapped(trap, escape), Robot(difference=0.05))


@pytest.mark.parametrize("trap", TRAPS.values(), ids=TRAPS)
def test_the_published_field_is_held_and_says_by_what(trap: dict[str, Any]) -> None:
    result = driven(trap, "none")
    assert result.outcome is Outcome.STUCK
    assert result.stuck is not None
    assert result.stuck.reason is StuckReason.LOCAL_MINIMUM
    assert result.stuck.place == (result.final.x, result.final.y)
    assert "set guidance.escape to wall" in result.sentence
    document = json.loads(json.dumps(result.summary()))
    x, y = result.stuck.place
    assert document["stuck"] == {"reason": "local-minimum", "place": {"x": x, "y": y}}


@pytest.mark.parametrize("trap", TRAPS.values(), ids=TRAPS)
def test_along_the_wall_every_trap_is_left(trap: dict[str, Any]) -> None:
    result = driven(trap, "wall")
    assert (result.outcome, result.stuck) == (Outcome.ARRIVED, None)
    assert result.min_clearance_m is not None
    assert result.min_clearance_m > 0.1  # half the width of the body


@pytest.mark.parametrize("trap", ["two close obstacles", "cup"])
def test_a_virtual_obstacle_fills_a_shallow_trap(trap: str) -> None:
    assert driven(TRAPS[trap], "virtual-obstacle").outcome is Outcome.ARRIVED


def test_a_goal_that_is_walled_off_ends_with_the_reason_and_the_place() -> None:
    result = driven(WALLED_OFF, "wall")
    assert result.outcome is Outcome.STUCK
    assert result.stuck is not None
    assert result.stuck.reason is StuckReason.NO_WAY_THROUGH
    assert "found no way to the goal" in result.sentence
    # It has been all around: on each side of the walls, at the distance at which it follows them.
    x, y = result.log["x"], result.log["y"]
    assert min(x.max() - 3.7, 2.3 - x[x > 1].min(), y.max() - 0.7, -0.7 - y.min()) > 0.2


@pytest.mark.parametrize("escape", ["virtual-obstacle", "wall"])
def test_where_nothing_holds_the_robot_the_field_is_as_published(escape: str) -> None:
    free = {"obstacles": [(1.5, 0.6)]}
    as_published, led = driven(free, "none"), driven(free, escape)
    for name, values in as_published.log.items():
        np.testing.assert_array_equal(values, led.log[name], err_msg=name)


@pytest.mark.parametrize("escape", ["virtual-obstacle", "wall"])
def test_ways_out_are_the_same_on_every_namespace(escape: str) -> None:
    """Along a mission that needs them: compiled and plain numbers give the same references."""
    law = leading_out(PotentialField(escape=escape))  # type: ignore[arg-type]
    jax.config.update("jax_enable_x64", True)
    scene = trapped(TRAPS["two close obstacles"], escape).scene()
    log = driven(TRAPS["two close obstacles"], escape).log
    step = jax.jit(
        lambda state, t, x, y, psi, v: law.step(
            state, GuidanceInputs(t, Body(Pose(x, y, psi), v, 0.0), scene), 0.1, jnp
        )
    )
    plain, traced = law.start(scene, floats), law.start(scene, jnp)
    led = 0
    for row in zip(*(log[n].tolist() for n in ("t", "x", "y", "psi", "v")), strict=True):
        t, x, y, psi, v = row
        seen = GuidanceInputs(t, Body(Pose(x, y, psi), v, 0.0), scene)
        plain, wanted = law.step(plain, seen, 0.1, floats)
        traced, compiled = step(traced, *row)
        # Sums over 300 steps, rounded by another library each.
        np.testing.assert_allclose(leaves(compiled), leaves(wanted), rtol=0, atol=1e-9)
        led += bool(wanted.detour)
    assert led > 10


def test_a_minimum_is_told_from_an_oscillation_by_the_force_in_its_middle() -> None:
    field, scene = PotentialField(), trapped(TRAPS["two close obstacles"], "none").scene()
    # Before the gap both obstacles push back as hard as the goal pulls; 0.5 m aside nothing does.
    assert field.hold_at(1.1, 0.0, scene, 0.0, floats) == Hold.LOCAL_MINIMUM
    assert field.hold_at(1.1, 1.0, scene, 0.0, floats) == Hold.OSCILLATION
    assert math.hypot(1.1 - 1.5, 1.0 - 0.25) > field.rho0


@pytest.mark.parametrize(
    ("around", "held", "way_out"),
    [
        (
            {"walls": [[(1.5, 2.0), (1.5, 0.3)], [(1.5, -0.3), (1.5, -2.0)]]},
            StuckReason.LOCAL_MINIMUM,
            {"kind": "field", "escape": "wall"},
        ),
        ({"obstacles": [(3.3, 0.0)]}, StuckReason.PAST_GOAL, {"kind": "harmonic"}),
    ],
    ids=["narrow passage", "obstacle at the goal"],
)
def test_what_holds_the_published_field_is_no_trap_for_another_law(
    around: dict[str, Any], held: StuckReason, way_out: dict[str, str]
) -> None:
    published = simulate(goal(3, 0, **around), Robot())
    assert published.stuck is not None
    assert published.stuck.reason is held
    other = simulate(goal(3, 0, guidance=way_out, **around), Robot())
    assert other.outcome is Outcome.ARRIVED
