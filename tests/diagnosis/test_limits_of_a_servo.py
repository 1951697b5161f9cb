"""Play behind a servo, and the speed that it can reach: named from its set points and positions.

The simulator integrates a motor and its loop in steps of 0.2 ms and knows nothing of the chain.
"""

from collections.abc import Callable

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.diagnose import diagnose
from sysid.effects.catalogue import chain_effects

DT, PARTS = 0.02, 100
DEGREE = np.pi / 180.0
GAP, FASTEST = 6.0 * DEGREE, 350.0 * DEGREE
LATE = 2
"""Samples that a set point needs to the servo."""


def behind_play(set_point: Array) -> Array:
    """θ̈ = k (r − θ) − d θ̇ of the servo; an arm with much friction moves only where it is pushed."""
    stiff, damped, h = 1600.0, 72.0, DT / PARTS
    angle, speed, arm, found = 0.0, 0.0, 0.0, []
    for r in set_point:
        found.append(arm)
        for _ in range(PARTS):
            speed += h * (stiff * (r - angle) - damped * speed)
            angle += h * speed
            arm = min(max(arm, angle - 0.5 * GAP), angle + 0.5 * GAP)
    return np.array(found)


def at_full_voltage(set_point: Array) -> Array:
    """τ θ̈ = v u − θ̇, the voltage u = (r − θ)/e within ±1, full speed v."""
    time, beyond, h = 0.03, 45.0 * DEGREE, DT / PARTS
    angle, speed, found = 0.0, 0.0, []
    for r in set_point:
        found.append(angle)
        for _ in range(PARTS):
            voltage = min(max((r - angle) / beyond, -1.0), 1.0)
            speed += h / time * (FASTEST * voltage - speed)
            angle += h * speed
    return np.array(found)


def logged(turned: Callable[[Array], Array], seed: int, late: int = 0) -> Record:
    """30 s of steps within ±60 degrees, each held for half a second, read with 0.05 degrees."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-60.0, 60.0, 60).repeat(25) * DEGREE
    steps[:25] = 0.0
    y = turned(np.concatenate([np.zeros(late), steps])[: len(steps)])
    y = y + rng.normal(0.0, 0.05 * DEGREE, len(y))
    goal, read = Channel("goal_rad", "rad"), Channel("angle_rad", "rad")
    return Record(steps[:, None], y[:, None], DT, inputs=(goal,), outputs=(read,))


def named(turned: Callable[[Array], Array], seed: int, late: int = 0) -> dict[str, float]:
    """Parameters of the only effect that a diagnosis names, by effect.parameter."""
    found = diagnose([logged(turned, seed, late)], [logged(turned, seed + 100, late)]).to_json()
    (entry,) = found["effects"]
    assert found["gap"]["closed_percent"] > 97.0
    return {f"{entry['id']}.{p['name'].split('[')[0]}": p["value"] for p in entry["parameters"]}


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "late"), [(1, 0), (3, LATE)])
def test_play_is_no_friction(seed: int, late: int) -> None:
    """Both fall short by half the gap; only friction slows the motion down."""
    # with the slope of a run jumping at every pick-up, the search ends within a hundredth or so
    assert named(behind_play, seed, late)["position-play.gap"] == pytest.approx(GAP, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        1,
        pytest.param(
            2, marks=pytest.mark.xfail(reason="its fit ends far from the truth", strict=True)
        ),
        3,
    ],
)
def test_full_voltage_is_a_speed(seed: int) -> None:
    """The set point is not slowed down, as by a limit of its rate: that came out twice as fast."""
    numbers = named(at_full_voltage, seed)
    # the edge of full voltage within a sample is taken in its middle: a percent of both
    assert numbers["servo-speed-limit.speed"] == pytest.approx(FASTEST, rel=0.02)
    assert numbers["servo-speed-limit.error"] == pytest.approx(45.0 * DEGREE, rel=0.02)


def positioned(play: float, friction: float) -> Record:
    """An axis at 300 to 400 mm, moved to and fro by up to 20 mm at 40 mm/s, read to 5 µm.

    Its loop swings at 120 rad/s (ζ = .5); play and what friction holds are distances [m].
    """
    rng, stiff, damped, parts, dt = np.random.default_rng(8), 14400.0, 120.0, 10, 0.005
    goals = np.repeat(0.35 + 0.01 * rng.uniform(-1.0, 1.0, 30), 100)
    set_point = np.zeros(len(goals))
    angle = arm = at = goals[0]
    speed, y = 0.0, np.zeros(len(goals))
    for k, goal in enumerate(goals):
        at += float(np.clip(goal - at, -0.04 * dt, 0.04 * dt))
        set_point[k], y[k] = at, arm
        for _ in range(parts):
            pushed = stiff * (at - angle) - damped * speed
            if speed == 0.0 and abs(pushed) <= stiff * friction:
                continue
            way = np.sign(speed) if speed else np.sign(pushed)
            after = speed + dt / parts * (pushed - stiff * friction * way)
            speed = 0.0 if friction and speed * after < 0.0 else after
            angle += dt / parts * speed
            arm = min(max(arm, angle - 0.5 * play), angle + 0.5 * play)
    y = 5e-6 * np.round((y + 3e-6 * rng.standard_normal(len(y))) / 5e-6)
    goal_, read = Channel("target_m", "m"), Channel("actual_m", "m")
    return Record(set_point[:, None], y[:, None], dt, inputs=(goal_,), outputs=(read,))


@pytest.mark.parametrize(("play", "friction"), [(60e-6, 0.0), (0.0, 20e-6)])
def test_what_is_small_against_the_travel_is_still_named(play: float, friction: float) -> None:
    """Play of 60 µm at 350 mm: its size is that of the servo's errors, not of its positions."""
    (entry,) = diagnose([positioned(play, friction)]).to_json()["effects"]
    assert entry["id"] == ("position-play" if play else "coulomb-friction")
    assert entry["parameters"][0]["value"] == pytest.approx(play or friction, rel=0.05)


@pytest.mark.parametrize("late", [0, LATE])
def test_waiting_in_the_play_is_no_dead_time(late: int) -> None:
    base = fit_baseline([logged(behind_play, 1, late)], None, chain_effects())
    assert base.search.delay == 1 + late


def test_a_motor_is_offered_no_effect_of_a_servo() -> None:
    rng = np.random.default_rng(1)
    u = rng.uniform(-1.0, 1.0, 60).repeat(10)[:, None]
    y = np.cumsum(u, axis=0) * 0.02
    log = Record(u, y, DT, inputs=(Channel("u_V", "V"),), outputs=(Channel("angle_rad", "rad"),))
    offered = {e.id for e in fit_baseline([log], None, chain_effects()).search.model.effects}
    assert {"position-play", "servo-speed-limit"}.isdisjoint(offered)
    assert "rate-limit" in offered
