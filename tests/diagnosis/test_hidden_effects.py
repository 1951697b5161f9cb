"""Logs with a hidden effect: each is the equation it claims, shows, and the truth tells it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hidden_effect_cases import DT, TAU, Array, K
from numpy.typing import NDArray
from sysid_datasets.driving import STYLES
from sysid_datasets.effect_robot import DISTANCE, PWM_FULL, RADIUS, Robot, Track
from sysid_datasets.effect_twin import Chance, Run, simulate, table

DAY = 8.0
"""A time by which everything has settled: 32 time constants [s]."""


def held(*parts: tuple[float, float]) -> NDArray[np.int64]:
    """Equal drives on both tracks: (drive, seconds) one after the other."""
    runs = [np.full((round(s / DT), 2), round(PWM_FULL * d), dtype=np.int64) for d, s in parts]
    return np.concatenate(runs)


def driven(pwm: NDArray[np.int64], *tracks: Track, **shared: float) -> Run:
    """A noise-free run of tracks with K 20 rad/s and τ 0.25 s; one track stands for both."""
    pair = (tracks[0], tracks[-1])
    return simulate(Robot(pair, **shared), table(pwm), DT, Chance.none(len(pwm)))


def with_(**values: float) -> Track:
    return Track(gain=K, time_constant=TAU, **values)


def settled(drive: float, track: Track) -> float:
    """Speed long after a step from rest, at full resolution."""
    return float(driven(held((drive, DAY)), track).omega[-1, 0])


# ------------------ each effect is its equation


def test_without_effects_a_track_is_first_order_and_linear_to_rounding() -> None:
    pwm = STYLES["steps"](np.random.default_rng(1), 400, DT)
    omega = driven(pwm, with_()).omega
    a = math.exp(-DT / TAU)
    expected = a * omega[:-1] + (1.0 - a) * K * pwm[:-1] / PWM_FULL
    np.testing.assert_allclose(omega[1:], expected, atol=1e-10)


@pytest.mark.parametrize(
    ("values", "drive", "speed"),
    [
        ({"dead_forward": 0.2, "dead_backward": 0.1}, 0.19, 0.0),
        ({"dead_forward": 0.2, "dead_backward": 0.1}, 0.5, K * 0.3),
        ({"dead_forward": 0.2, "dead_backward": 0.1}, -0.5, -K * 0.4),
        ({"dead_forward": 0.2, "dead_jump": 0.1}, 0.5, K * 0.4),
        ({"saturation": 0.6}, 0.5, K * 0.5),
        ({"saturation": 0.6}, 0.9, K * 0.6),
        ({"saturation": 0.6}, -0.9, -K * 0.6),
        ({"concavity": 0.4}, 0.5, K * 0.5 * 0.8),
        ({"backward_gain": 0.7}, -0.5, -K * 0.35),
        ({"backward_gain": 0.7}, 0.5, K * 0.5),
        ({"coulomb": 3.0}, 0.14, 0.0),
        ({"coulomb": 3.0}, 0.5, 7.0),
        ({"coulomb": 3.0}, -0.5, -7.0),
        ({"coulomb": 2.0, "breakaway": 3.0}, 0.24, 0.0),
        # Far above the Stribeck speed sliding friction alone is left.
        ({"coulomb": 2.0, "breakaway": 3.0}, 0.5, 8.0),
        # ω + q ω² = 10 with q = 0.05.
        ({"drag": 0.05}, 0.5, (math.sqrt(3.0) - 1.0) / 0.1),
        ({"load": 2.0}, 0.5, 8.0),
        ({"load": 2.0}, 0.0, -2.0),
        ({"backward_viscous": 1.5}, -0.6, -8.0),
        ({"backward_viscous": 1.5}, 0.6, 12.0),
        ({"coupling": 0.2}, 0.5, 8.0),
        ({"gain_factor": 0.8}, 0.5, 8.0),
        ({"delay": 0.15}, 0.5, 10.0),
        ({"backlash": 1.0}, 0.5, 10.0),
    ],
)
def test_steady_speeds(values: dict[str, float], drive: float, speed: float) -> None:
    # 1e-3: eight seconds are 32 time constants (e^-32); the steps of 2 ms leave no steady error.
    assert settled(drive, with_(**values)) == pytest.approx(speed, abs=1e-3)


@pytest.mark.parametrize(
    ("values", "drive", "shown"),
    [
        ({"sensor_bias": 1.5}, 0.5, 11.5),
        ({"sensor_limit": 8.0}, -0.5, -8.0),
        ({"unsigned": 1.0}, -0.5, 10.0),
        ({"quantum": 1.5}, 0.5, 10.5),
        ({"ripple": 0.0}, 0.5, 10.0),
    ],
)
def test_the_sensor_changes_the_reading_and_not_the_wheel(
    values: dict[str, float], drive: float, shown: float
) -> None:
    run = driven(held((drive, DAY)), with_(**values))
    assert run.reading[-1, 0] == pytest.approx(shown, abs=1e-3)
    assert run.omega[-1, 0] == pytest.approx(K * drive, abs=1e-3)


def test_a_delay_shifts_the_answer_by_fractions_of_a_sample() -> None:
    pwm = held((0.0, 0.5), (0.5, 2.0))
    late, prompt = driven(pwm, with_(delay=0.13)).omega[:, 0], driven(pwm, with_()).omega[:, 0]
    t = DT * np.arange(len(pwm)) - 0.5 - 0.13
    expected = np.where(t > 0.0, 10.0 * (1.0 - np.exp(-t / TAU)), 0.0)
    # Half a step of 2 ms at the steepest slope, 10/0.25 rad/s².
    np.testing.assert_allclose(late, expected, atol=0.001 * 40.0 + 1e-9)
    whole = driven(pwm, with_(delay=3 * DT)).omega[:, 0]
    np.testing.assert_allclose(whole[3:], prompt[:-3], atol=1e-9)


def test_a_rate_limit_makes_a_ramp() -> None:
    # Behind a ramp of slope r a first-order lag trails by K r τ once e^(-t/τ) is gone.
    omega = driven(held((1.0, 2.0)), with_(rate_limit=0.5)).omega[:, 0]
    t = DT * np.arange(len(omega))
    expected = K * 0.5 * (t - TAU * (1.0 - np.exp(-t / TAU)))
    # 1e-3: steps of 2 ms with the middle of each ramp leave (h/τ)² = 6e-5 of the speed.
    np.testing.assert_allclose(omega, expected, atol=1e-3)


@pytest.mark.parametrize("where", ["actuator_lag", "sensor_lag"])
def test_a_lag_makes_the_second_order_answer(where: str) -> None:
    run = driven(held((0.5, 2.0)), with_(**{where: 0.1}))
    t = DT * np.arange(len(run.t))
    expected = 10.0 * (1.0 - (TAU * np.exp(-t / TAU) - 0.1 * np.exp(-t / 0.1)) / (TAU - 0.1))
    # 1e-3: steps of 2 ms with the middle of each leave (h/λ)² = 4e-4 of the slope times λ.
    np.testing.assert_allclose(run.reading[:, 0], expected, atol=1e-3)


def test_supply_sag_takes_from_both_what_either_draws() -> None:
    pwm = held((0.8, DAY))
    pwm[:, 1] = round(0.4 * PWM_FULL)
    run = driven(pwm, with_(), sag=0.5)
    np.testing.assert_allclose(run.omega[-1], K * np.array([0.8, 0.4]) * 0.7, atol=1e-3)


def test_inertia_of_the_body_ties_the_tracks_together() -> None:
    # Equal tracks: their sum moves with τ (1 + μ), their difference with τ (1 − μ).
    pwm = held((0.8, 2.0))
    pwm[:, 1] = 0
    omega = driven(pwm, with_(), inertia=0.4).omega
    t = DT * np.arange(len(omega))
    slow, fast = (K * 0.8 * (1.0 - np.exp(-t / (TAU * (1.0 + s)))) for s in (0.4, -0.4))
    # Steps of 2 ms against τ (1 − μ) = 0.15 s: half a step's change of the change, 16·0.002/0.15/2.
    np.testing.assert_allclose(omega[:, 0], 0.5 * (slow + fast), atol=0.11)
    np.testing.assert_allclose(omega[:, 1], 0.5 * (slow - fast), atol=0.11)


def test_a_limited_current_caps_acceleration_and_no_speed() -> None:
    omega = driven(held((0.5, DAY)), with_(current_limit=4.0)).omega[:, 0]
    # dω/dt = l/τ = 16 rad/s² until T − ω = 4, then the plain motor's way
    np.testing.assert_allclose(np.diff(omega[:7]), 16.0 * DT, rtol=1e-2)
    assert omega[-1] == pytest.approx(K * 0.5)
    small = held((0.19, 2.0))
    np.testing.assert_array_equal(
        driven(small, with_(current_limit=4.0)).omega, driven(small, with_()).omega
    )


def test_dead_time_takes_its_share_by_the_sign_of_the_current() -> None:
    late = with_(dead_time=0.1)
    assert settled(0.09, late) == 0.0
    assert settled(0.5, late) == pytest.approx(K * 0.4)
    # driven down the current has the other sign: it stays above what it was driven up to
    omega = driven(held((0.9, DAY), (0.5, DAY)), late).omega[-1, 0]
    assert omega == pytest.approx(K * 0.6)


def test_a_battery_loses_its_share_each_second() -> None:
    run = driven(held((0.5, 40.0)), with_(), discharge=0.01)
    # A ramp down of K d b is followed τ late.
    assert run.omega[-1, 0] == pytest.approx(10.0 * (1.0 - 0.01 * (run.t[-1] - TAU)), abs=1e-3)


def test_backlash_pauses_a_reversal_by_about_the_gap_over_the_speed() -> None:
    # After a rest the motor runs up alone: ∫ 10(1 − e^(−t/τ)) dt = g, here 1 rad after 0.27 s.
    pwm = held((0.5, 2.0), (0.0, 3.0), (-0.5, 2.0))
    omega = driven(pwm, with_(backlash=1.0)).omega[:, 0]
    first = int(np.argmax(omega < -0.05)) * DT - 5.0
    assert first == pytest.approx(0.27, abs=DT)
    # Neither the rest nor the same direction again costs anything.
    again = held((0.5, 2.0), (0.0, 3.0), (0.5, 2.0))
    np.testing.assert_array_equal(
        driven(again, with_(backlash=1.0)).omega, driven(again, with_()).omega
    )


def test_friction_stops_a_track_for_good_and_in_finite_time() -> None:
    pwm = held((0.5, 3.0), (0.0, 2.0))
    omega = driven(pwm, with_(coulomb=3.0)).omega[:, 0]
    stop = 3.0 + TAU * math.log(1.0 + 7.0 / 3.0)
    still = DT * np.arange(len(omega)) > stop + DT
    assert not omega[still].any()
    assert omega[math.floor(stop / DT) - 1] > 0.0
    # Torque within the breakaway level, either way, never moves it.
    assert not driven(held((0.14, 2.0), (-0.14, 2.0)), with_(coulomb=3.0)).omega.any()


def test_a_stuck_track_needs_more_to_start_than_to_keep_going() -> None:
    sticky = with_(coulomb=2.0, breakaway=2.0, stribeck_speed=1.0)
    pushed = driven(held((0.19, 3.0), (0.4, 2.0), (0.19, 3.0)), sticky).omega[:, 0]
    assert not pushed[: round(3.0 / DT)].any()
    # Sliding on: ω = 3.8 − 2 − 2 e^(−ω²) has its fast root at 1.68 rad/s.
    assert pushed[-1] == pytest.approx(1.68, abs=0.01)


@pytest.mark.parametrize(("ratio", "tau"), [(2.0, 0.5), (0.5, 0.125)])
def test_coasting_has_its_own_time_constant(ratio: float, tau: float) -> None:
    omega = driven(held((0.5, DAY), (0.0, 1.0)), with_(coast_ratio=ratio)).omega[:, 0]
    down = omega[round(DAY / DT) :]
    np.testing.assert_allclose(down, 10.0 * np.exp(-DT * np.arange(len(down)) / tau), atol=1e-6)
    np.testing.assert_array_equal(
        omega[: round(DAY / DT)], driven(held((0.5, DAY)), with_()).omega[:, 0]
    )


@pytest.mark.parametrize(("overrun", "after"), [(0.0, 2.3), (1.0, 7.0)])
def test_a_driver_that_lets_go_leaves_a_straight_decay(overrun: float, after: float) -> None:
    track = with_(freewheel=1.0, freewheel_decay=6.0, freewheel_overrun=overrun)
    rolling = driven(held((0.5, DAY), (0.0, 3.0)), track).omega[round(DAY / DT) :, 0]
    t = DT * np.arange(len(rolling))
    np.testing.assert_allclose(rolling, np.maximum(10.0 - 6.0 * t, 0.0), atol=0.02)
    # A step down to 0.1: let go for one sample (9.7), then braked; or until it is overtaken.
    lower = driven(held((0.5, DAY), (0.1, 3.0)), track).omega[round((DAY + 0.5) / DT), 0]
    braked = 2.0 + 7.7 * math.exp(-0.45 / TAU)
    assert lower == pytest.approx(braked if overrun == 0.0 else after, abs=0.1)
    # Reversing is driving, not letting go.
    turned = driven(held((0.5, DAY), (-0.5, 1.0)), track).omega[round(DAY / DT) :, 0]
    t = DT * np.arange(len(turned))
    np.testing.assert_allclose(turned, -10.0 + 20.0 * np.exp(-t / TAU), atol=1e-6)


def test_heat_fades_the_gain() -> None:
    omega = driven(held((0.6, 60.0)), with_(fade=0.3, fade_time=10.0)).omega[:, 0]
    # h → d² = 0.36 with h₀ = 0.3, and e^-6 of it is missing after a minute.
    assert omega[-1] == pytest.approx(12.0 * (1.0 - 0.3 * 0.36 / 0.3), abs=0.02)
    assert omega[round(10.0 / DT)] == pytest.approx(12.0 * (1.0 - 0.36 * (1 - math.exp(-1))), 0.01)


@pytest.mark.parametrize("from_reading", [0.0, 1.0])
def test_ripple_is_bound_to_the_angle(from_reading: float) -> None:
    track = with_(ripple=1.0, ripple_lines=2.0, ripple_from_reading=from_reading)
    run = driven(held((0.5, 20.0)), track)
    off = run.reading[:, 0] - run.omega[:, 0]
    # At 10 rad/s two periods a turn are 20 rad/s: peaks of the spectrum within one bin of it.
    spectrum = np.abs(np.fft.rfft(off[-256:]))
    bins = 2.0 * math.pi * np.fft.rfftfreq(256, DT)
    assert bins[np.argmax(spectrum)] == pytest.approx(20.0, abs=bins[1])
    assert np.abs(off).max() == pytest.approx(1.0, abs=0.01)


def test_dropouts_come_in_short_bursts_with_their_share() -> None:
    pwm = held((0.5, 200.0))
    rng = np.random.default_rng(5)
    chance = replace(Chance.none(len(pwm)), events=rng.random((len(pwm), 2)))
    robot = Robot((with_(dropout_share=0.05), with_(dropout_share=0.05, dropout_holds=1.0)))
    run = simulate(robot, table(pwm), DT, chance)
    lost = run.reading[100:, 0] == 0.0
    # 3900 samples in bursts of 2.5: three standard errors, each 0.05·sqrt(2.5·2/(0.05·3900)).
    assert lost.mean() == pytest.approx(0.05, abs=0.024)
    lengths = np.diff(np.flatnonzero(np.diff(np.r_[0, lost.astype(int), 0])))[::2]
    assert set(lengths.tolist()) <= set(range(1, 9))
    assert run.reading[100:, 1].min() > 9.0


def turned(left: float, right: float, **changes: float) -> Array:
    """The last pose of two seconds at steady tracks, from rest."""
    pwm = np.tile([round(left * PWM_FULL), round(right * PWM_FULL)], (round(2.0 / DT), 1))
    side = {k: v for k, v in changes.items() if k == "radius_ratio"}
    shared = {k: v for k, v in changes.items() if k != "radius_ratio"}
    return driven(pwm, with_(), with_(**side), **shared).pose[-1]


# ------------------ the pose


def test_slip_shortens_turns_and_leaves_straight_ways_alone() -> None:
    np.testing.assert_array_equal(turned(0.5, 0.5, slip=0.3), turned(0.5, 0.5))
    assert turned(-0.5, 0.5, slip=0.3)[2] == pytest.approx(0.7 * turned(-0.5, 0.5)[2], rel=1e-9)
    # |ω_R − ω_L|/(|ω_R| + |ω_L|) = 1/3 in an arc of 1 : 2.
    assert turned(0.3, 0.6, slip=0.3)[2] == pytest.approx(0.9 * turned(0.3, 0.6)[2], rel=1e-9)


def test_a_wider_track_turns_less_and_goes_as_far() -> None:
    assert turned(-0.5, 0.5, width_ratio=1.25)[2] == pytest.approx(turned(-0.5, 0.5)[2] / 1.25)
    np.testing.assert_array_equal(turned(0.5, 0.5, width_ratio=1.25), turned(0.5, 0.5))


def test_a_smaller_sprocket_pulls_to_its_side() -> None:
    way = float(turned(0.5, 0.5)[0])
    assert turned(0.5, 0.5, radius_ratio=0.9)[2] == pytest.approx(-0.1 * way / DISTANCE, rel=1e-9)


def test_the_pose_of_equal_tracks_is_their_way() -> None:
    run = driven(held((0.5, 4.0)), with_())
    expected = RADIUS * 10.0 * (run.t[-1] - TAU * (1.0 - math.exp(-run.t[-1] / TAU)))
    # Trapezoids of 2 ms: h²/12 of the change of the slope, 40 rad/s², is 1e-5 rad.
    assert run.pose[-1, 0] == pytest.approx(expected, abs=RADIUS * 2e-5)
    assert not run.pose[:, 1:].any()
