"""The catalogue of effects and the chain they act on."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.linalg import expm

from sysid.data.record import Array
from sysid.effects.base import Context, Effect, Place
from sysid.effects.catalogue import catalogue, chain_effects, effect
from sysid.errors import UsageError
from sysid.structures.augmented.chain import (
    ChainState,
    Core,
    Parameters,
    Sample,
    rest_state,
    step_with,
    with_constants,
)
from sysid.structures.augmented.structure import Augmented
from sysid.structures.registry import structure_from_json, structure_to_json

DT, TAU, GAIN = 0.05, 0.25, 20.0
POLE = float(np.exp(-DT / TAU))
IDS = (
    "dead-zone",
    "input-saturation",
    "twist-limit",
    "concave-gain",
    "direction-asymmetry",
    "input-delay",
    "rate-limit",
    "actuator-lag",
    "supply-sag",
    "dead-time",
    "current-limit",
    "battery-discharge",
    "backlash",
    "coulomb-friction",
    "stiction",
    "quadratic-drag",
    "load-bias",
    "coast-asymmetry",
    "freewheel",
    "viscous-asymmetry",
    "cross-coupling",
    "inertial-coupling",
    "thermal-fade",
    "gravity-load",
    "speed-ripple",
    "position-play",
    "servo-speed-limit",
    "track-slip",
    "radius-mismatch",
    "track-width",
    "longitudinal-slip",
    "scrub-lag",
    "lateral-slip",
    "sensor-lag",
    "sensor-saturation",
    "sensor-bias",
    "unsigned-speed",
)


def core(tracks: int = 2) -> Core:
    return Core(
        np.full(tracks, GAIN), np.full((1, tracks), -POLE), np.full((1, tracks), 1.0 - POLE)
    )


def nulls(e: Effect, tracks: int = 2) -> dict[str, Array]:
    return {p.name: np.full(tracks, p.null) for p in e.parameters}


def chain_step(
    effects: Sequence[Effect],
    core: Core,
    parameters: Parameters,
    state: ChainState,
    drive: Array,
    t: float,
    dt: float,
) -> tuple[ChainState, Array]:
    """One sample of the chain, its wheels at zero angle."""
    now = np.float64(t)
    sample = Sample(drive, drive, now, 0.0 * drive, 0.0 * drive)
    whole = with_constants(np, effects, core, parameters, dt)
    return step_with(np, effects, core, whole, state, sample, dt)


def run(effects: dict[str, dict[str, Array]], drive: Array) -> Array:
    """Readings of the chain with these effects, (N, tracks)."""
    active = tuple(e for e in chain_effects() if e.id in effects)
    state = rest_state(np, active, core(), np.zeros(2))
    out = []
    for k, d in enumerate(drive):
        state, y = chain_step(active, core(), effects, state, d, k * DT, DT)
        out.append(y)
    return np.array(out)


def commands(seed: int = 1, samples: int = 400) -> Array:
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1.0, 1.0, size=(samples // 20, 2))
    levels[0] = 0.0
    return np.repeat(levels, 20, axis=0)


def held(level: float, samples: int = 200) -> Array:
    return np.full((samples, 2), level)


def test_every_effect_of_the_catalogue_is_there() -> None:
    assert set(IDS) == set(catalogue())
    assert effect("dead-zone").stage == "actuator"
    with pytest.raises(UsageError, match="dead-zone"):
        effect("deadzone")


@pytest.mark.parametrize("e", chain_effects(), ids=lambda e: e.id)
def test_at_its_null_value_an_effect_does_nothing(e: Effect) -> None:
    drive = commands()
    # a rate limit of 1e6 a second, a lag of 0 and the like leave rounding behind, no more
    np.testing.assert_allclose(run({e.id: nulls(e)}, drive), run({}, drive), atol=1e-9 * GAIN)


@pytest.mark.parametrize("e", chain_effects(), ids=lambda e: e.id)
def test_its_starts_lie_within_its_bounds(e: Effect) -> None:
    for p in e.parameters:
        assert p.lower < p.upper
        assert all(p.lower <= s <= p.upper for s in p.starts)


def both(value: float) -> Array:
    return np.full(2, value)


STEADY = {
    "dead-zone": ({"plus": 0.2, "minus": 0.1, "jump": 0.05}, 0.5, GAIN * 0.35),
    "input-saturation": ({"plus": 0.4, "minus": 0.4}, 0.9, GAIN * 0.4),
    "concave-gain": ({"kappa": 0.3, "cubic": 0.0, "power": 0.0}, 0.5, GAIN * 0.5 * 0.85),
    "direction-asymmetry": ({"rho": 0.8}, -0.5, -GAIN * 0.4),
    "position-play": ({"gap": 4.0}, 0.5, GAIN * 0.5 - 2.0),
    "servo-speed-limit": ({"error": 1.0}, 0.5, GAIN * 0.5),
    "supply-sag": ({"sag": 0.2, "emf": 0.0, "current": 0.0}, 0.5, GAIN * 0.5 * 0.9),
    "coulomb-friction": (
        {"level": 3.0, "of_load": 0.2, "of_servo": 0.0},
        0.5,
        GAIN * 0.5 - 3.0 / 0.8,
    ),
    "quadratic-drag": ({"drag": 0.1}, 0.5, (np.sqrt(1.0 + 4 * 0.1 * 10.0) - 1.0) / 0.2),
    "load-bias": ({"load": 1.0}, 0.5, GAIN * 0.5 - 1.0),
    "viscous-asymmetry": (
        {"ratio": 0.8, "emf": 0.9, "by_constant": 1.0},
        -0.5,
        -GAIN * 0.4 / (0.1 + 0.9 * 0.64),
    ),
    "cross-coupling": (
        {"share": 0.1, "turning": 0.5, "sliding": 1.0, "of_rate": 0.0},
        0.5,
        GAIN * 0.5 * 0.9,
    ),
    "sensor-bias": ({"bias": 0.7}, 0.5, GAIN * 0.5 + 0.7),
    "sensor-saturation": ({"limit": 6.0}, 0.5, 6.0),
    "unsigned-speed": ({"on": 1.0}, -0.5, GAIN * 0.5),
}


@pytest.mark.parametrize("id", STEADY)
def test_steady_speed_is_that_of_the_equation(id: str) -> None:
    numbers, level, expected = STEADY[id]
    found = run({id: {k: both(v) for k, v in numbers.items()}}, held(level))[-1]
    # 200 samples are 40 time constants
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_cubic_gain_bends_by_the_square_of_the_command() -> None:
    numbers = {"kappa": both(0.3), "cubic": both(1.0), "power": both(0.0)}
    found = run({"concave-gain": numbers}, held(0.5))[-1]
    # 200 samples are 40 time constants
    np.testing.assert_allclose(found, GAIN * 0.5 * (1.0 - 0.3 * 0.25), rtol=1e-6)


@pytest.mark.parametrize("power", [1.0, -0.4])
def test_a_power_of_the_command_keeps_its_sign_and_nothing_for_nothing(power: float) -> None:
    numbers = {"concave-gain": {"kappa": both(0.0), "cubic": both(2.0), "power": both(power)}}
    found = [run(numbers, held(d))[-1] for d in (0.5, -0.5, 0.0)]
    # 200 samples are 40 time constants
    wanted = GAIN * 0.5 ** (1.0 + power) * np.array([1.0, -1.0, 0.0])
    np.testing.assert_allclose(found, np.repeat(wanted[:, None], 2, axis=1), rtol=1e-6)


def test_dry_friction_holds_the_track_still_and_lets_it_go() -> None:
    friction = {
        "coulomb-friction": {"level": both(3.0), "of_load": both(0.0), "of_servo": both(0.0)}
    }
    assert np.all(run(friction, held(0.149)) == 0.0)
    assert np.all(run(friction, held(0.16))[-1] > 0.0)
    braked = run(friction, np.vstack([held(0.5, 60), held(0.0, 60)]))
    assert np.all(braked[-1] == 0.0)
    assert np.all(braked[60:] >= 0.0)


def test_a_delay_shifts_and_backlash_pauses_after_a_reversal() -> None:
    drive = commands(3)
    late = run({"input-delay": {"delay": both(3 * DT)}}, drive)
    np.testing.assert_allclose(late[3:], run({}, drive)[:-3], atol=1e-9)
    swing = np.vstack([held(0.4, 60), held(-0.4, 60)])
    numbers = {"gap": both(0.5), "inertia": both(1.0), "coast": both(1.0), "rub": both(0.0)}
    gap = run({"backlash": numbers}, swing)
    plain = run({}, swing)
    assert gap[62, 0] > plain[62, 0] + 0.1
    np.testing.assert_allclose(gap[-1], plain[-1], rtol=1e-3)


def test_freewheel_decays_in_a_straight_line() -> None:
    drive = np.vstack([held(0.8, 80), held(0.0, 60)])
    numbers = {"rate": 5.0, "released": 0.0, "viscous": 0.0, "diode": 0.0}
    y = run({"freewheel": {k: both(v) for k, v in numbers.items()}}, drive)[:, 0]
    falling = y[(y < 12.0) & (np.arange(len(y)) > 82)]
    np.testing.assert_allclose(np.diff(falling[:20]), -5.0 * DT, rtol=1e-9)


@pytest.mark.parametrize("share", [0.4, -0.3])
def test_inertial_coupling_is_the_exact_answer_of_the_coupled_equations(share: float) -> None:
    kept = np.array([0.6, 0.8])
    tau = -DT / np.log(kept)
    off = share * np.sqrt(tau[0] * tau[1])
    inverse = np.linalg.inv(np.array([[tau[0], off], [off, tau[1]]]))
    E = expm(-inverse * DT)
    # one track alone first: without friction the other one is moved from standstill
    drive = np.vstack([np.tile([0.5, 0.0], (20, 1)), commands(4)])
    two = Core(np.array([20.0, 15.0]), -kept[None], 1.0 - kept[None])
    active = (effect("inertial-coupling"),)
    numbers = nulls(active[0]) | {"share": both(share)}
    state, w = rest_state(np, active, two, np.zeros(2)), np.zeros(2)
    for d in drive:
        state, y = chain_step(active, two, {"inertial-coupling": numbers}, state, d, 0.0, DT)
        # rounding of exp and of 1 − e^(−2x) in cosh and sinh
        np.testing.assert_allclose(y, w, atol=1e-9)
        w = E @ w + (np.eye(2) - E) @ (two.gain * d)


@pytest.mark.parametrize("share", [0.4, -0.5])
def test_a_body_on_ground_that_gives_is_the_exact_answer_of_its_equations(share: float) -> None:
    """Both tracks (ω) and the body above them (z), by modes: straight on and turning."""
    wheel, lag, tau = 0.4, 3.0 * DT, -DT / np.log(0.8)
    own = wheel * (1.0 - abs(share))
    straight, turning = (tau * (1.0 + s * share - own) for s in (1.0, -1.0))
    damper = max(straight, turning) / lag
    A = np.zeros((4, 4))
    A[:2, :2] = -(1.0 + damper) / (own * tau) * np.eye(2)
    A[:2, 2:] = damper / (own * tau) * np.eye(2)
    mean, apart = 0.5 * (straight + turning), 0.5 * (straight - turning)
    masses = np.array([[mean, apart], [apart, mean]])
    A[2:, :2] = damper * np.linalg.inv(masses)
    A[2:, 2:] = -A[2:, :2]
    E, x = expm(A * DT), np.zeros(4)
    active = (effect("inertial-coupling"),)
    given = {"share": share, "wheel": wheel, "lag": lag, "soft": 1.0}
    two = Core(np.full(2, GAIN), np.full((1, 2), -0.8), np.full((1, 2), 0.2))
    state = rest_state(np, active, two, np.zeros(2))
    for d in commands(4):
        numbers = {"inertial-coupling": {k: both(v) for k, v in given.items()}}
        state, y = chain_step(active, two, numbers, state, d, 0.0, DT)
        np.testing.assert_allclose(y, x[:2], atol=1e-9)
        steady = GAIN * np.concatenate([d, d])
        x = steady + E @ (x - steady)


def test_a_body_that_follows_at_once_is_tied_rigidly() -> None:
    drive, rigid = commands(5), nulls(effect("inertial-coupling")) | {"share": both(0.4)}
    soft = rigid | {"soft": both(1.0), "lag": both(1e-3 * DT)}
    found, expected = (run({"inertial-coupling": numbers}, drive) for numbers in (soft, rigid))
    # the damper is held to a hundredth of a sample
    np.testing.assert_allclose(found, expected, atol=0.02 * GAIN)
    assert np.abs(found - run({}, drive)).max() > 0.1 * GAIN


def test_a_track_that_sticks_does_not_feel_the_other_ones_inertia() -> None:
    dry = {"level": both(3.0), "of_load": both(0.0), "of_servo": both(0.0)}
    coupled = nulls(effect("inertial-coupling")) | {"share": both(0.4)}
    numbers = {"inertial-coupling": coupled, "coulomb-friction": dry}
    drive = np.column_stack([np.full(60, 0.1), np.full(60, 0.5)])
    found = run(numbers, drive)
    alone = run({"coulomb-friction": dry}, drive)
    assert not found[:, 0].any()
    np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize("sliding", [0.01, 1.0, 8.0])
def test_resistance_to_turning_of_tracks_that_slide(sliding: float) -> None:
    """ω = T − v ω/(1 + |ω|/s) on both sides of a turn on the spot."""
    given = {"turning": 2.0, "sliding": sliding, "of_rate": 2.0}
    numbers = nulls(effect("cross-coupling")) | {k: both(v) for k, v in given.items()}
    torque = GAIN * 0.5
    left, right = run({"cross-coupling": numbers}, held(0.5) * np.array([1.0, -1.0]))[-1]
    assert left == -right
    assert left + 2.0 * left / (1.0 + left / sliding) == pytest.approx(torque, rel=1e-6)
    straight = run({"cross-coupling": numbers}, held(0.5))
    np.testing.assert_allclose(straight, run({}, held(0.5)), rtol=1e-12)


def test_slip_shortens_turns_only() -> None:
    slip = effect("track-slip")
    context = Context(DT, *(np.zeros(2),) * 10)
    turned, _ = slip.step(np, np.array([-5.0, 5.0]), (), {"share": np.array(0.2)}, context)
    straight, _ = slip.step(np, np.array([5.0, 5.0]), (), {"share": np.array(0.2)}, context)
    np.testing.assert_allclose(turned, [-4.0, 4.0])
    np.testing.assert_allclose(straight, [5.0, 5.0])
    assert slip.place is Place.POSE


def test_an_augmented_structure_steps_as_it_simulates_and_survives_json() -> None:
    s = Augmented(1, 2, (20000.0, 20000.0), DT, ("dead-zone", "supply-sag"))
    theta = np.array([GAIN, -POLE, 21.0, -POLE, 0.1, 0.12, 0.0, 0.15, 0.1, 0.02, 0.2, 0.0, 0.0])
    u = 20000.0 * commands(5)
    run_all = s.simulate(theta, u)
    again = structure_from_json(structure_to_json(s))
    assert again == s
    assert again.simulate(theta, u).tobytes() == run_all.tobytes()
    x, step = np.zeros(s.n_states(theta)), s.step(theta)
    for k in range(len(u)):
        x, y = step(x, u[k])
        np.testing.assert_array_equal(y, run_all[k])


def fine(
    advance: Callable[[float, float, float], tuple[float, ...]], drive: Array, dt: float
) -> Array:
    """Speeds of one track at the samples, from its own equations in steps of dt/400."""
    state, out, h = (0.0, 0.0, 0.0), [], dt / 400
    for d in drive:
        out.append(state[0])
        for _ in range(400):
            state = advance(state, GAIN * d, h)
    return np.array(out)


def test_a_wheel_that_outruns_its_drive_rolls_until_the_drive_catches_it() -> None:
    rate, viscous = 12.0, 0.1

    def advance(state: tuple[float, ...], torque: float, h: float) -> tuple[float, ...]:
        w = state[0]
        if w * torque >= 0.0 and abs(w) > abs(torque):
            rolled = max(abs(w) - h * (rate + viscous * abs(w) / TAU), abs(torque))
            return (np.copysign(rolled, w), 0.0, 0.0)
        return (w + h / TAU * (torque - w), 0.0, 0.0)

    drive = np.repeat([0.8, 0.5, 0.1, 0.0, -0.6, -0.55, 0.3, 0.0], 12)
    numbers = {"rate": rate, "released": 2.0, "viscous": viscous, "diode": 0.0}
    found = run({"freewheel": {k: both(v) for k, v in numbers.items()}}, np.tile(drive, (2, 1)).T)
    # within a sample the viscous part is averaged: (β dt/τ)²/24 of 16 rad/s, and steps of h
    np.testing.assert_allclose(found[:, 0], fine(advance, drive, DT), atol=0.02)


def test_a_winding_warms_by_its_current_and_resists_it() -> None:
    loss, time, emf = 6.0, 8.0, 0.8

    def advance(state: tuple[float, ...], torque: float, h: float) -> tuple[float, ...]:
        w, heat, _ = state
        resists = 1.0 + loss * heat
        current = (torque - emf * w) / resists
        heat += h / time * (resists * (current / GAIN) ** 2 - heat)
        return (w + h / TAU * (current + emf * w - w), heat, 0.0)

    drive = np.repeat([0.9, -0.9, 0.5, 0.9, 0.0, -0.7, 0.8, -0.8], 12)
    numbers = {"loss": loss, "time": time, "emf": emf, "by_current": 1.0}
    numbers_of_both = {k: both(v) for k, v in numbers.items()}
    found = run({"thermal-fade": numbers_of_both}, np.tile(drive, (2, 1)).T)[:, 0]
    expected = fine(advance, drive, DT)
    # the warmth at a sample's beginning is taken for all of it: at stall the resistance grows by
    # l dt/θ = 4 % in one, in which a reversal changes the speed by some 6 rad/s
    np.testing.assert_allclose(found, expected, atol=0.04 * 6.0)
    assert np.max(np.abs(expected - run({}, np.tile(drive, (2, 1)).T)[:, 0])) > 1.0


def test_what_a_supply_is_switched_to_warms_by_the_share_of_time() -> None:
    loss, time, d = 0.4, 8.0, 0.5
    numbers = {"loss": loss, "time": time, "emf": 0.0, "by_current": -1.0}
    drive = np.full((600, 2), d)
    found = run({"thermal-fade": {k: both(v) for k, v in numbers.items()}}, drive)[:, 0]
    warm = 1.0 - np.exp(-DT * np.arange(len(drive)) / time)
    expected = GAIN * d * (1.0 - loss * d * warm)
    # behind five time constants of the motor the speed lags the falling torque by τ/θ of a slope
    late = DT * np.arange(len(drive)) > 5.0 * TAU
    np.testing.assert_allclose(found[late], expected[late], atol=2.0 * GAIN * d * loss * TAU / time)


@pytest.mark.slow
@pytest.mark.parametrize("rub", [0.0, 1.5])
@pytest.mark.parametrize("dt", [0.02, 0.1])
def test_a_gap_between_two_masses_is_crossed_in_their_time(dt: float, rub: float) -> None:
    gap, share, wheel_viscous = 0.8, 0.55, 0.13

    def slowed(speed: float, torque: float, inertia: float, h: float) -> float:
        """A step of a mass with dry friction, which ends where it stands."""
        if speed == 0.0:
            beyond = max(abs(torque) - rub, 0.0)
            return float(h / (TAU * inertia) * np.copysign(beyond, torque))
        found = speed + h / (TAU * inertia) * (torque - np.copysign(rub, speed))
        return found if found * speed > 0.0 else 0.0

    def advance(state: tuple[float, ...], torque: float, h: float) -> tuple[float, ...]:
        wheel, motor, place = state
        if place == 0.0 and motor == 0.0:
            place = 0.5 * gap
        touching = abs(place) >= 0.5 * gap and abs(motor - wheel) < 1e-9
        resists = wheel_viscous * wheel + np.copysign(rub, wheel) * (wheel != 0.0)
        push = (1.0 - share) * (torque - (1.0 - wheel_viscous) * wheel) + share * resists
        if touching and push * place >= 0.0:
            wheel = slowed(wheel, torque - wheel, 1.0, h)
            return (wheel, wheel, place)
        motor += h / (TAU * share) * (torque - (1.0 - wheel_viscous) * motor)
        wheel = slowed(wheel, -wheel_viscous * wheel, 1.0 - share, h)
        place += h * (motor - wheel)
        if abs(place) >= 0.5 * gap:
            place = float(np.copysign(0.5 * gap, place))
            wheel = motor = share * motor + (1.0 - share) * wheel
        return (wheel, motor, place)

    levels = np.random.default_rng(5).uniform(-0.9, 0.9, 40)
    levels[0] = 0.4
    drive = np.repeat(levels, round(0.6 / dt))
    kept = float(np.exp(-dt / TAU))
    track = Core(np.array([GAIN]), np.array([[-kept]]), np.array([[1.0 - kept]]))
    coast = wheel_viscous / (1.0 - share)
    numbers = {"gap": gap, "inertia": share, "coast": coast, "rub": rub}
    active = (effect("backlash"),)
    parameters = {"backlash": {k: np.array([v]) for k, v in numbers.items()}}
    state, found = rest_state(np, active, track, np.zeros(1)), []
    for d in drive:
        state, y = chain_step(active, track, parameters, state, np.array([d]), 0.0, dt)
        found.append(float(y[0]))
    error = np.array(found) - fine(advance, drive, dt)
    # a reading between two contacts in slightly another order is far off, the others are not
    assert np.median(np.abs(error)) < 0.01
    assert np.sqrt(np.mean(error**2)) < 0.03 * np.sqrt(np.mean(np.square(found)))


def test_resistance_to_turning_slows_what_turns_and_nothing_else() -> None:
    """ω = T − v ω on both sides of a turn on the spot."""
    numbers = nulls(effect("cross-coupling")) | {"turning": both(0.5), "of_rate": both(1.0)}
    found = run({"cross-coupling": numbers}, held(0.5) * np.array([1.0, -1.0]))[-1]
    np.testing.assert_allclose(found, GAIN * 0.5 / 1.5 * np.array([1.0, -1.0]), rtol=1e-9)
    straight = run({"cross-coupling": numbers}, held(0.5))
    np.testing.assert_allclose(straight, run({}, held(0.5)), rtol=1e-12)
