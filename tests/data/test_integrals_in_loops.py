"""What integrates in a position loop, where dry friction looks like a pull of the level."""

import numpy as np
import pytest

from sysid.data.checks.integral import integrals
from sysid.data.record import Channel, Record

DT = 0.01
PART = 10
"""Steps of the simulation a sample."""


def axis(seed: int) -> Record:
    """A motor with dry friction follows set points: τ v̇ = k (u − f sign v) − v, u = K (r − y)."""
    rng = np.random.default_rng(seed)
    n, hold = 3000, int(rng.integers(80, 300))
    if seed % 2:
        wanted = np.repeat(rng.uniform(-2.0, 2.0, n // hold + 1), hold)[:n]
    else:
        pace = np.repeat(rng.uniform(0.4, 2.4, n // 200 + 1), 200)[:n]
        wanted = 1.5 * np.sin(np.cumsum(pace) * DT)
    k, f, tau, controller = rng.uniform([3.0, 0.2, 0.03, 2.0], [8.0, 1.5, 0.15, 6.0])
    angle = speed = 0.0
    u, y = np.empty(n), np.empty(n)
    for i, goal in enumerate(wanted):
        y[i] = angle + 0.001 * rng.standard_normal()
        u[i] = np.clip(controller * (goal - y[i]), -12.0, 12.0)
        for _ in range(PART):
            way = np.sign(speed) or np.sign(u[i])
            free = speed + (k * (u[i] - f * way) - speed) * DT / PART / tau
            held = abs(u[i]) < f and speed * free <= 0.0
            speed = 0.0 if held else free
            angle += speed * DT / PART
    return Record(u[:, None], y[:, None], DT, (Channel("volts", "V"),), (Channel("angle", "rad"),))


def tank(seed: int) -> Record:
    """A level in a loop: ḣ = b u − a √h, u by a PI controller; the outflow pulls it back."""
    rng = np.random.default_rng(seed)
    n, hold = 2500, int(rng.integers(150, 400))
    wanted = np.repeat(rng.uniform(0.2, 0.8, n // hold + 1), hold)[:n]
    a, b = rng.uniform([0.004, 0.01], [0.02, 0.03])
    level, summed = 0.5, 0.0
    u, y = np.empty(n), np.empty(n)
    for i, goal in enumerate(wanted):
        y[i] = level + 0.004 * rng.standard_normal()
        summed += 0.01 * (goal - y[i])
        u[i] = np.clip(2.0 * (goal - y[i]) + summed + 0.4, 0.0, 1.0)
        change = b * u[i] - a * np.sqrt(level) + 0.0006 * rng.standard_normal()
        level = max(level + change, 0.0)
    return Record(u[:, None], y[:, None], 1.0, (Channel("pump", ""),), (Channel("level", "m"),))


@pytest.mark.parametrize("seed", range(8))
def test_an_axis_in_a_position_loop_integrates(seed: int) -> None:
    assert [s.input for s in integrals([axis(seed)])] == ["volts"]


def test_a_level_in_a_loop_does_not_integrate() -> None:
    assert [seed for seed in range(8) if integrals([tank(seed)])] == []
