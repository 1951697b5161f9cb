"""Within the torque: drive, then loads, then friction; judged by a simulator of its own.

The simulator integrates inertia, weight and dry friction in steps of a hundredth of a sample and
knows nothing of the chain.
"""

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.effects.base import Place, TorquePart
from sysid.effects.catalogue import effect, in_chain
from sysid.effects.compensation import Identified
from sysid.structures.augmented.structure import Augmented

DT, TAU = 0.02, 0.2
KEPT = float(np.exp(-DT / TAU))
PARTS = 100


def chain(u: Array, gain: float, **numbers: dict[str, float]) -> Array:
    """Speeds of one track of the chain with these effects; what is not given is at its null."""
    ids = tuple(name.replace("_", "-") for name in numbers)
    theta = [gain, -KEPT]
    for id, own in zip(ids, numbers.values(), strict=True):
        theta += [own.get(p.name, p.null) for p in effect(id).parameters]
    structure = Augmented(1, 1, (1.0,), DT, ids)
    return structure.simulate(np.array(theta), u[:, None])[:, 0]


def shaft(u: Array, gain: float, weight: float, dry: float, of_load: float = 0.0) -> Array:
    """τ ω̇ = M − L − friction, M = K u − ω, L = weight sin(angle + 1).

    Friction: c + s |M + L| against the motion, or against M − L where it holds the shaft.
    """
    speeds, w, angle, h = [], 0.0, 0.0, DT / PARTS
    for d in u:
        speeds.append(w)
        for _ in range(PARTS):
            motor, load = gain * d - w, weight * np.sin(angle + 1.0)
            most = dry + of_load * abs(motor + load)
            free = w + h / TAU * (motor - load)
            stop = h / TAU * most
            after = 0.0 if abs(free) <= stop else free - np.sign(free) * stop
            angle += 0.5 * h * (w + after)
            w = after
    return np.array(speeds)


def weight(size: float) -> dict[str, float]:
    """``size`` sin(angle + 1) as a wave."""
    return {"cosine": size * np.sin(1.0), "sine": size * np.cos(1.0), "per_turn": 1.0}


def test_friction_holds_a_weight_that_is_lighter() -> None:
    rest = np.zeros(500)
    assert np.all(chain(rest, 5.0, gravity_load=weight(1.0), coulomb_friction={"level": 3.0}) == 0)
    falls = chain(rest, 5.0, gravity_load=weight(3.0), coulomb_friction={"level": 1.0})
    # it falls until friction holds it: |sin(angle)| <= 1/3, 1 rad from where it hung free
    assert np.max(np.abs(falls)) > 0.3
    assert -1.0 - np.arcsin(1 / 3) < np.sum(falls) * DT < -1.0 + np.arcsin(1 / 3)
    assert falls[-1] == 0.0


@pytest.mark.parametrize("of_load", [0.0, 0.28])
def test_a_lifted_weight_is_that_of_small_steps(of_load: float) -> None:
    """Both ways, at rest and turning over: friction by load feels motor and weight together."""
    u = np.repeat([0.0, 0.35, 0.2, -0.3, 0.1, 0.9, -0.9, 0.0], 60)
    friction = {"level": 0.3, "of_load": of_load, "by_load": float(of_load > 0.0)}
    found = chain(u, 8.0, gravity_load=weight(2.0), coulomb_friction=friction)
    truth = shaft(u, 8.0, 2.0, 0.3, of_load)
    # angles of a sample (0.02 s at 5 rad/s) are taken in its middle: some mrad/s beside 5 rad/s
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.01 * np.std(truth)
    other = shaft(u, 8.0, 2.0, 0.3, 0.5 * of_load + 0.1)
    assert np.sqrt(np.mean((other - truth) ** 2)) > 0.05 * np.std(truth)


def test_a_weight_does_not_fade_with_the_winding() -> None:
    """Warm to the end, 30 % weaker: held against the weight the drive falls short by its share."""
    u = np.full(3000, 0.5)
    fade = {"loss": 1.2, "time": 5.0}
    found = chain(u, 8.0, thermal_fade=fade, load_bias={"load": 1.0})
    assert found[-1] == pytest.approx(8.0 * 0.5 * (1.0 - 1.2 * 0.25) - 1.0, abs=1e-3)


def test_every_effect_on_the_torque_has_its_part() -> None:
    ids = (
        "stiction",
        "gravity-load",
        "coulomb-friction",
        "thermal-fade",
        "load-bias",
        "gain-by-log",
        "load-by-log",
        "cross-coupling",
        "supply-sag",
    )
    ordered = in_chain(effect(id) for id in ids)
    parts = [list(TorquePart).index(e.part) for e in ordered]
    assert all(e.place is Place.TORQUE for e in ordered)
    assert parts == sorted(parts)
    assert {e.id for e in ordered if e.part is TorquePart.DRIVE} == {
        "thermal-fade",
        "gain-by-log",
        "supply-sag",
    }
    assert [e.id for e in ordered if e.part is TorquePart.FRICTION] == [
        "stiction",
        "coulomb-friction",
    ]


def test_friction_by_load_is_undone_with_the_load_beside_it() -> None:
    """The drive that is made up for holds the speed that was wanted, with load and friction."""
    friction = {"level": 0.4, "of_load": 0.25, "by_load": 1.0}
    load = {"load": 0.9}
    ids = ("load-bias", "coulomb-friction")
    numbers = [{p.name: own.get(p.name, p.null) for p in effect(id).parameters}
               for id, own in zip(ids, (load, friction), strict=True)]  # fmt: skip
    values = {
        id: {k: np.array([v]) for k, v in n.items()} for id, n in zip(ids, numbers, strict=True)
    }
    known = Identified(ids, values, np.array([8.0]), np.array([1.0]))
    for speed in (3.0, -2.0):
        wanted = np.array([speed / 8.0])
        d, added = known.undone(ids, wanted, np.array([speed]), 0.0, np)
        assert abs(added[0]) > 0.02
        found = chain(np.full(400, d[0]), 8.0, load_bias=load, coulomb_friction=friction)
        assert found[-1] == pytest.approx(speed, rel=1e-6)
