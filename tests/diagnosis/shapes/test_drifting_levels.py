"""A level that drifts whatever the inputs do is told before what follows from the commands."""

import numpy as np

import sysid
from sysid.data.record import Channel, Record

DT, ROWS, PART = 0.02, 6000, 3


def climbing(seed: int, falls: float) -> Record:
    """Climb of a multirotor in a loop of its altitude: v̇ = 2 g s − g − 0.3 v |v|, s the thrust.

    Args:
        falls: share by which the battery, and with it the thrust, falls within the log.
    """
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.uniform(0.5, 3.0, ROWS // 200), 200)
    height, speed, thrust, summed = 0.5, 0.0, 0.5, 0.0
    u, y = np.empty(ROWS), np.empty(ROWS)
    for i, goal in enumerate(wanted):
        error = goal - height + 0.004 * rng.standard_normal()
        summed += 0.05 * error * DT
        y[i] = speed + 0.02 * rng.standard_normal()
        u[i] = 0.5 + 0.12 * np.clip(error, -1.0, 1.0) - 0.11 * y[i] + summed
        for _ in range(PART):
            thrust += (u[i] - thrust) * DT / PART / 0.06
            supply = 1.0 - falls * i / ROWS
            speed += (19.62 * thrust * supply - 9.81 - 0.3 * speed * abs(speed)) * DT / PART
            height += speed * DT / PART
    inputs, outputs = (Channel("throttle", ""),), (Channel("climb", "m/s"),)
    return Record(u[:, None], y[:, None], DT, inputs, outputs)


def test_a_battery_that_falls_in_a_loop_is_a_level_that_drifts() -> None:
    found = sysid.diagnose(climbing(1, falls=0.12))
    assert [s.id for s in found.shapes] == ["load-drift"]
    assert found.shapes[0].share > 0.8


def test_no_drift_is_told_without_one() -> None:
    assert "load-drift" not in [s.id for s in sysid.diagnose(climbing(3, falls=0.0)).shapes]
