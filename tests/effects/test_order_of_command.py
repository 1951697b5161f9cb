"""Within the command: delay, remote control, ramps and filters, then limits and dead zones.

Judged by loops of a controller and a bridge that know nothing of the chain.
"""

from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import LIMITS_BEFORE_RAMPS
from sysid.effects.catalogue import effect
from sysid.structures.augmented.structure import Augmented

DT, TAU, GAIN = 0.02, 0.2, 8.0
KEPT = float(np.exp(-DT / TAU))
RATE, ZONE, EXPO = 1.5, 0.2, 0.3


def steps() -> Array:
    """Commands of many levels, each for 0.6 s."""
    return np.repeat(np.random.default_rng(5).uniform(-1.0, 1.0, 40), 30)


def chain(u: Array, **numbers: dict[str, float]) -> tuple[Augmented, Array]:
    """A model of one track with these effects, and its parameters."""
    ids = tuple(name.replace("_", "-") for name in numbers)
    theta = [GAIN, -KEPT]
    for id, own in zip(ids, numbers.values(), strict=True):
        theta += [own.get(p.name, p.null) for p in effect(id).parameters]
    return Augmented(1, 1, (1.0,), DT, ids), np.array(theta)


def machine(u: Array, expo: float, ramp_first: bool) -> Array:
    """Speed of a motor behind a stick with expo, a ramp of a controller and a bridge without torque
    at small duties."""

    def bridge(d: float) -> float:
        return float(np.sign(d)) * max(abs(d) - ZONE, 0.0)

    speeds, w, ramp = [], 0.0, 0.0
    for d in u:
        speeds.append(w)
        wanted = d - expo * d**3
        if not ramp_first:
            wanted = bridge(wanted)
        ramp += float(np.clip(wanted - ramp, -RATE * DT, RATE * DT))
        w = KEPT * w + (1.0 - KEPT) * GAIN * (bridge(ramp) if ramp_first else ramp)
    return np.array(speeds)


def test_a_ramp_passes_through_a_dead_zone_and_follows_a_stick() -> None:
    u = steps()
    s, theta = chain(
        u,
        concave_gain={"kappa": EXPO, "cubic": 1.0},
        rate_limit={"rate": RATE, "fall": RATE},
        dead_zone={"plus": ZONE, "minus": ZONE},
    )
    y = s.simulate(theta, u[:, None])[:, 0]
    # a sample of the ramp more or less, and one of the response, as the chain dates them
    np.testing.assert_allclose(y, machine(u, EXPO, ramp_first=True), atol=2.0 * RATE * DT * GAIN)
    size = float(np.std(y - machine(u, EXPO, ramp_first=True)))
    wrong = float(np.std(y - machine(u, EXPO, ramp_first=False)))
    assert size < 0.1 * wrong


def test_a_model_of_the_older_order_keeps_it() -> None:
    u = steps()
    numbers = {"rate_limit": {"rate": RATE}, "dead_zone": {"plus": ZONE, "minus": ZONE}}
    s, theta = chain(u, **numbers)
    older = replace(s, chain=LIMITS_BEFORE_RAMPS)
    y = older.simulate(theta, u[:, None])[:, 0]
    right, wrong = (float(np.std(y - machine(u, 0.0, first))) for first in (False, True))
    assert right < 0.1 * wrong
    assert np.std(s.simulate(theta, u[:, None])[:, 0] - y) > 0.1
