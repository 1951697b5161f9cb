"""An effect that says how it is undone is undone by it: at rest, in steady motion, with others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sysid.effects.base import Context, Effect, Place
from sysid.effects.catalogue import catalogue, effect
from sysid.effects.compensation import Identified, can_be_compensated

INVERTIBLE = [e for e in catalogue().values() if e.inverse is not None]

KEPT = 0.8
"""Share of its speed that a track keeps in a sample."""


def numbers(e: Effect, k: int) -> dict[str, np.ndarray]:
    """One of the starting values of an effect, a little apart on both tracks unless shared."""
    apart = np.array([1.0, 1.0 if e.shared else 1.1])
    found = {p.name: p.starts[k % len(p.starts)] * apart for p in e.parameters}
    return found | (e.constants(np, found, 0.05, np.full(2, KEPT)) if e.constants else {})


def steady(e: Effect, motion: np.ndarray, torque: np.ndarray) -> Context:
    """Both tracks in steady motion."""
    return Context(
        dt=0.05, t=np.float64(4.0), w=motion, w_free=KEPT * motion, b=np.full(2, 1.0 - KEPT),
        torque=torque, torque_other=torque[::-1], drive=torque, turned=motion, counted=motion,
        holds=np.zeros(2), driven=torque,
    )  # fmt: skip


def test_all_of_those_can_be_compensated() -> None:
    assert set(can_be_compensated()) == {e.id for e in INVERTIBLE}
    assert {"dead-zone", "coulomb-friction", "input-saturation", "direction-asymmetry"} <= {
        e.id for e in INVERTIBLE
    }
    # who makes up for effects knows no states; the charge that a battery lacks is then none
    assert [e.id for e in INVERTIBLE if e.memory.states] == ["battery-discharge"]


@pytest.mark.parametrize("e", INVERTIBLE, ids=lambda e: e.id)
def test_an_inverse_leaves_what_is_wanted(e: Effect) -> None:
    """What an effect makes of some command, its inverse and the effect make again."""
    rng = np.random.default_rng(7)
    moved = 0
    for k in range(60):
        p = numbers(e, k)
        wanted = rng.uniform(-0.9, 0.9, 2) if k else np.zeros(2)
        context = steady(e, wanted, wanted)
        if e.place is Place.COMMAND:  # whatever a command can reach
            wanted = e.step(np, wanted, (), p, context)[0]
        front = e.inverse(np, wanted, p, context)  # type: ignore[misc]
        behind = e.step(np, front, (), p, steady(e, context.w, front))[0]
        # A dead zone is left by a billionth, so that rounding does not keep the command in it.
        np.testing.assert_allclose(behind, wanted, rtol=0, atol=1e-8)
        moved += bool(np.any(np.abs(front - wanted) > 1e-3))
    assert moved or e.id in (
        "input-saturation",
        "twist-limit",
    )  # nothing makes up for what is not there


def held(*ids: str) -> Identified:
    return Identified(
        ids, {id: numbers(effect(id), 0) for id in ids}, np.array([12.0, 14.0]), np.full(2, 2e4)
    )


def test_friction_is_made_up_for_against_the_motion_and_at_rest_for_the_torque() -> None:
    known = held("coulomb-friction")
    lift = known.parameters["coulomb-friction"]["level"] / known.gain
    for wanted, speed, sense in (
        ((0.3, -0.3), (0.0, 0.0), (1, -1)),  # to break away
        ((0.3, -0.3), (8.0, -8.0), (1, -1)),
        ((-0.3, 0.3), (8.0, -8.0), (1, -1)),  # braking: friction helps
        ((0.0, 0.0), (8.0, 0.0), (0, 0)),  # nothing is wanted
    ):
        d, added = known.undone(known.effects, np.array(wanted), np.array(speed), 0.0, np)
        np.testing.assert_allclose(d - wanted, lift * sense)
        np.testing.assert_allclose(added, lift * sense)


def test_several_effects_are_undone_against_their_order_and_compiled_alike() -> None:
    known = held("dead-zone", "direction-asymmetry", "coulomb-friction")
    wanted, speed = np.array([0.4, -0.2]), np.array([5.0, -3.0])
    d, added = known.undone(known.effects, wanted, speed, 0.0, np)
    np.testing.assert_allclose(
        known.done(known.effects, d, added, speed, 0.0, np), wanted, atol=1e-8
    )
    some, _ = known.undone(("dead-zone",), wanted, speed, 0.0, np)
    plus, minus = (known.parameters["dead-zone"][n] for n in ("plus", "minus"))
    np.testing.assert_allclose(some, [0.4 + plus[0], -0.2 - minus[1]], atol=1e-8)

    jax.config.update("jax_enable_x64", True)
    many = jax.jit(jax.vmap(lambda w: known.undone(known.effects, w, speed, 0.0, jnp)[0]))
    wanteds = np.random.default_rng(1).uniform(-1, 1, (20, 2))
    one_by_one = [known.undone(known.effects, w, speed, 0.0, np)[0] for w in wanteds]
    np.testing.assert_allclose(many(wanteds), one_by_one, rtol=0, atol=1e-12)


def test_what_a_saturated_drive_cannot_give_is_known() -> None:
    known = held("input-saturation")
    d, added = known.undone(known.effects, np.array([0.9, 0.3]), np.zeros(2), 0.0, np)
    limit = known.parameters["input-saturation"]["plus"][0]
    np.testing.assert_allclose(
        known.done(known.effects, d, added, np.zeros(2), 0.0, np), [limit, 0.3]
    )
