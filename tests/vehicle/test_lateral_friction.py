"""Lateral friction that sticks or slides, against the resistance of tracks that slide."""

import math

import numpy as np
import pytest

from sysid.runners import floats
from sysid.vehicle.contact import nearest
from sysid.vehicle.ground.resistance import lateral_force, turning_moment
from sysid.vehicle.soil import Soil

Q, LENGTH = 100.0, 0.14


def sliding(side_speed: float, yaw_rate: float) -> tuple[float, float]:
    """Force against V_y and moment against ψ̇ of tracks that slide: (2.35), (2.36)."""
    soil = Soil(0.0, 0.5, 0.01, lateral=Q * LENGTH)  # of a weight of 1 N
    icr = -side_speed / yaw_rate if yaw_rate else -math.copysign(math.inf, side_speed)
    turn = yaw_rate or 1.0
    return (
        -float(lateral_force(soil, 1.0, icr, turn, LENGTH)),
        float(turning_moment(soil, 1.0, icr, turn, LENGTH)),
    )


@pytest.mark.parametrize("ease", [(1.0 / 1.6, 1.0 / 0.065), (1.0, 1.0 / 0.002), (1.0, 0.1)])
def test_the_nearest_point_leaves_a_motion_that_its_friction_belongs_to(ease) -> None:
    rng = np.random.default_rng(1)
    for force, moment in rng.normal(size=(200, 2)) * (20.0, 1.0):
        result = nearest((float(force), float(moment)), Q, LENGTH / 2.0, ease, floats)
        left = ease[0] * (force - result.side), ease[1] * (moment - result.turning)
        if result.sticks:
            assert left == (0.0, 0.0)
            continue
        side, turning = sliding(float(left[0]), float(left[1]))
        if abs(left[1]) * LENGTH / 2.0 < 1e-9 * abs(left[0]):
            assert abs(result.side) == pytest.approx(Q * LENGTH)
        assert result.side == pytest.approx(side, rel=1e-6, abs=1e-6)
        assert result.turning == pytest.approx(turning, rel=1e-6, abs=1e-6)


def test_nothing_is_taken_where_nothing_pushes_or_nothing_rubs() -> None:
    assert nearest((0.0, 0.0), Q, 0.07, (1.0, 10.0), floats) == (0.0, 0.0, True)
    ice = nearest((3.0, -2.0), 0.0, 0.07, (1.0, 10.0), floats)
    assert math.hypot(ice.side, ice.turning) < 1e-9
    assert ice.sticks is False
