"""What battery and bridge do with a current, against equations of their own in small steps."""

from collections.abc import Callable

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.effects.motor import AT_ZERO, ONE_WAY
from sysid.structures.augmented.structure import Augmented

TAU, GAIN, PARTS = 0.25, 20.0, 40
LEVELS = np.random.default_rng(7).uniform(-1.0, 1.0, (30, 2))
LEVELS[0] = LEVELS[7] = LEVELS[12] = LEVELS[13] = 0.0

Torque = Callable[[Array, Array], Array]
"""(drives, speeds) of both tracks → torques in units of steady speed."""


def open_at_zero(d: Array, w: Array) -> Array:
    """All switches open at a command of zero: a tenth of the viscous term is the bearings'."""
    return np.where(d == 0.0, 0.9 * w, GAIN * d)


def one_way(d: Array, w: Array) -> Array:
    """The current has the sign of the command, or there is none."""
    side = np.sign(d)
    return 0.9 * w + side * np.maximum(side * (GAIN * d - 0.9 * w), 0.0)


def one_way_through_a_diode(d: Array, w: Array) -> Array:
    """The same; the diode takes 4 % of the supply while the switch does not conduct."""
    side = np.sign(d)
    free = GAIN * (d - 0.04 * side * (1.0 - np.abs(d)))
    return 0.9 * w + side * np.maximum(side * (free - 0.9 * w), 0.0)


def driven(effect: str, numbers: list[float], dt: float) -> tuple[Array, Array]:
    """(drives, speeds) of two equal tracks with an effect that both have, (N, 2)."""
    u = np.repeat(LEVELS, round(0.5 / dt), axis=0)
    each = numbers if effect == "supply-sag" else numbers * 2
    theta = np.array([GAIN, -float(np.exp(-dt / TAU))] * 2 + each)
    return u, Augmented(1, 1, (1.0, 1.0), dt, (effect,)).simulate(theta, u)


def fine(torque: Torque, u: Array, dt: float) -> Array:
    """Speeds at the samples from τ ω̇ = T − ω in steps of dt/40, (N, 2)."""
    w, found, h = np.zeros(2), [], dt / PARTS
    for d in u:
        found.append(w)
        for _ in range(PARTS):
            w = w + h / TAU * (torque(d, w) - w)
    return np.array(found)


def limited(d: Array, w: Array) -> Array:
    """A winding whose current is held at 5 rad/s worth of torque; 0.9 of ω is the emf's."""
    return 0.9 * w + np.clip(GAIN * d - 0.9 * w, -5.0, 5.0)


def waiting(d: Array, w: Array) -> Array:
    """Legs that take 8 % of the supply by the current's sign, less below a ripple of 2 %."""
    free = GAIN * d - 0.85 * w
    lost = 0.08 * GAIN * np.clip(free / (0.10 * GAIN), -1.0, 1.0)
    return np.where(d == 0.0, GAIN * d, GAIN * d - lost)


def sagging(d: Array, w: Array) -> Array:
    """A battery of 0.3/0.7 of a motor's resistance over two: v = 1 − R Σ d i, i = v d − ε ω/K."""
    wrong = [v - 1.0 + 0.3 / 0.7 * np.mean(d * (v * d - 0.9 * w / GAIN)) for v in (0.0, 1.0)]
    return wrong[0] / (wrong[0] - wrong[1]) * GAIN * d  # a line in v


@pytest.mark.parametrize(
    ("effect", "numbers", "torque"),
    [
        ("current-limit", [5.0, 0.9], limited),
        ("dead-time", [0.08, 0.85, 0.02], waiting),
        ("supply-sag", [0.3, 0.9, 1.0], sagging),
        ("freewheel", [0.0, 0.1, AT_ZERO, 0.0], open_at_zero),
        ("freewheel", [0.0, 0.1, ONE_WAY, 0.0], one_way),
        ("freewheel", [0.0, 0.1, ONE_WAY, 0.04], one_way_through_a_diode),
    ],
)
@pytest.mark.parametrize("dt", [0.02, 0.05])
def test_it_is_the_answer_of_the_circuit(
    effect: str, numbers: list[float], torque: Torque, dt: float
) -> None:
    u, found = driven(effect, numbers, dt)
    exact, plain = fine(torque, u, dt), fine(lambda d, w: GAIN * d, u, dt)
    # one speed stands for those of the whole sample, and a limit is met within it
    assert np.max(np.abs(found - exact)) < 0.04 * np.max(np.abs(plain - exact))


def test_a_limit_on_the_current_caps_acceleration_and_no_speed() -> None:
    _, held = driven("current-limit", [5.0, 1.0], 0.02)
    u, free = driven("current-limit", [1e6, 1.0], 0.02)
    rise = np.max(np.abs(np.diff(held, axis=0)))
    assert rise == pytest.approx(5.0 * 0.02 / TAU, rel=0.01)
    assert np.max(np.abs(np.diff(free, axis=0))) > 3.0 * rise
    small = 0.2 * u
    theta = np.array([GAIN, -float(np.exp(-0.02 / TAU)), GAIN, -float(np.exp(-0.02 / TAU))])
    limited_too = Augmented(1, 1, (1.0, 1.0), 0.02, ("current-limit",))
    plain = Augmented(1, 1, (1.0, 1.0), 0.02)
    # steps of less than the limit are the plain motor's
    np.testing.assert_allclose(
        limited_too.simulate(np.array([*theta, 9.0, 1.0, 9.0, 1.0]), small),
        plain.simulate(theta, small),
        atol=1e-9,
    )


def test_dead_time_does_nothing_at_rest_and_holds_a_motor_under_small_commands() -> None:
    u = np.repeat([0.0, 0.05, 0.5, 0.0], 100)
    dt, kept = 0.05, float(np.exp(-0.05 / TAU))
    motor = Augmented(1, 1, (1.0,), dt, ("dead-time",))
    y = motor.simulate(np.array([GAIN, -kept, 0.08, 0.9, 0.0]), u[:, None])[:, 0]
    plain = Augmented(1, 1, (1.0,), dt).simulate(np.array([GAIN, -kept]), u[:, None])[:, 0]
    np.testing.assert_allclose(y[:200], 0.0, atol=1e-12)
    # in steady motion the current is what is left of the viscous share: all of it, or the dead time
    assert y[299] == pytest.approx(0.5 * GAIN - 0.08 * GAIN, rel=1e-3)
    # the short at a command of zero has no dead time: it falls as the plain motor does
    fall = y[301:320] / y[300]
    np.testing.assert_allclose(fall, plain[301:320] / plain[300], atol=1e-9)


def test_a_battery_empties_by_the_charge_that_both_motors_take() -> None:
    """v = 1 − b (exp(c q) − 1)/c, q the integral of the mean of d²: nothing while both rest."""
    dt, loss, bend = 0.05, 0.02, 0.05
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 1.0, (30, 2)), 20, axis=0)
    u[200:400] = 0.0
    core = [GAIN, -float(np.exp(-dt / TAU))] * 2
    theta = np.array([*core, loss, bend, 2.0])
    found = Augmented(1, 1, (1.0, 1.0), dt, ("battery-discharge",)).simulate(theta, u)
    q = dt * (np.cumsum(np.mean(u**2, axis=1)) - np.mean(u**2, axis=1))[:, None]
    plain = Augmented(1, 1, (1.0, 1.0), dt)
    weaker = plain.simulate(np.array(core), u * (1.0 - loss * np.expm1(bend * q) / bend))
    np.testing.assert_allclose(found, weaker, atol=1e-9)
    assert q[200, 0] == pytest.approx(q[399, 0])
    fresh = plain.simulate(np.array(core), u)
    assert np.max(np.abs(found - fresh)) > 0.05 * np.max(np.abs(fresh))
