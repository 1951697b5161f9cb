"""A servo whose log holds its set point and its position: friction is named, and by its level."""

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.diagnose import diagnose
from sysid.effects.catalogue import chain_effects

DT, PARTS = 0.02, 200
STIFF, DAMPED, INERTIA = 4.0, 0.5, 0.02
"""Torque a rad, torque a rad/s and kg m² of a loop that is as stiff as it is damped."""


def turned(set_point: Array, friction: float) -> Array:
    """J θ̈ = k (r − θ) − d θ̇ − c sign θ̇, by steps of 0.1 ms, semi-implicit."""
    angle, speed, found, h = 0.0, 0.0, [], DT / PARTS
    for r in set_point:
        found.append(angle)
        for _ in range(PARTS):
            pushed = speed + h * (STIFF * (r - angle) - DAMPED * speed) / INERTIA
            most = h * friction / INERTIA
            speed = pushed - min(max(pushed, -most), most)  # friction takes what there is
            angle += h * speed
    return np.array(found)


def logged(seed: int, friction: float) -> Record:
    """30 s of steps, each held for a second or less."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1.0, 1.0, 60).repeat(25)
    steps[:25] = 0.0
    y = turned(steps, friction) + rng.normal(0.0, 5e-4, len(steps))
    goal, read = Channel("goal_rad", "rad"), Channel("angle_rad", "rad")
    return Record(steps[:, None], y[:, None], DT, inputs=(goal,), outputs=(read,))


@pytest.mark.slow
@pytest.mark.parametrize("stays", [0.05, 0.2])
def test_it_stays_short_of_its_set_point(stays: float) -> None:
    """Position after position within k Δ = c is held; the level is found in rad of set point."""
    friction = stays * STIFF
    found = diagnose([logged(1, friction)], [logged(2, friction)])
    (entry,) = found.to_json()["effects"]
    assert entry["id"] == "coulomb-friction"
    numbers = {p["name"]: p["value"] for p in entry["parameters"]}
    # a gain of 1 and a stiffness that is the same for command and friction
    assert numbers["level[angle_rad]"] == pytest.approx(stays, rel=0.05)
    assert found.to_json()["gap"]["closed_percent"] > 97.0


def test_nothing_of_torque_or_speed_is_offered() -> None:
    base = fit_baseline([logged(1, 0.2)], [logged(2, 0.2)], chain_effects())
    offered = {e.id for e in base.search.model.effects}
    assert {"dead-time", "freewheel", "backlash", "stiction", "actuator-lag"}.isdisjoint(offered)
    assert {"coulomb-friction", "dead-zone", "rate-limit"} <= offered
