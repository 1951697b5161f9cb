"""A motor integrated from its physics, followed: gain, time constant, dead zone, excitation."""

import numpy as np
import pytest
from sysid_cli.live.view import change_sentence
from turning_motor import TurningMotor, steps_of

from sysid.data.record import Array, Channel
from sysid.errors import DataError, UsageError
from sysid.estimation.online.dead_zone import dead_zone
from sysid.estimation.online.live_fit import LiveFit
from sysid.estimation.online.live_state import LivePair

LEVELS = (-10.0, -7.0, -5.0, -3.0, 0.0, 3.0, 5.0, 7.0, 10.0)
DT = 0.02


def live_motor(volts: Array, speeds: Array, **options: object) -> LiveFit:
    """A motor followed through these rows."""
    live = LiveFit((Channel("volts", "V"),), (Channel("speed", "rad/s"),), DT, **options)  # type: ignore[arg-type]
    live.update(volts[:, None], speeds[:, None])
    return live


def only(live: LiveFit) -> LivePair:
    """Its one pair."""
    (pair,) = live.state().pairs
    return pair


@pytest.mark.parametrize(
    ("motor", "law", "truth"),
    [
        (TurningMotor(bridge=1.5), "command", 1.5),
        (TurningMotor(friction=1.5), "friction", 1.5),
        (TurningMotor(friction=0.6, bridge=1.0), "both", 1.6),
    ],
)
def test_the_dead_zone_of_a_motor(motor: TurningMotor, law: str, truth: float) -> None:
    u = steps_of(LEVELS, 900, 15, 3)
    y = motor.speeds(u, DT) + 0.2 * np.random.default_rng(1).standard_normal(len(u))
    pair = only(live_motor(u, y))
    zone = pair.dead_zone
    assert zone is not None
    assert zone.seen
    assert zone.law == law
    assert abs(zone.value - truth) < 4.0 * zone.std_error + 0.01 * truth
    # a sensor's white noise biases an ARX by some of its errors: within 1 and 2 %
    assert pair.gain.value == pytest.approx(motor.gain, rel=0.01)
    assert pair.time_constant.value == pytest.approx(0.15, rel=0.02)
    assert pair.settled


def test_errors_of_a_dead_zone_hold_the_truth() -> None:
    motor, held = TurningMotor(bridge=1.5), 0
    for seed in range(20):
        u = steps_of(LEVELS, 400, 15, seed)
        # noise of the process: what the equation that is fitted assumes
        e = 0.5 * np.random.default_rng(seed).standard_normal(len(u))
        a = np.exp(-DT / motor.time_constant)
        y = motor.speeds(u, DT)
        for k in range(1, len(e)):
            e[k] += a * e[k - 1]
        zone = dead_zone([np.column_stack([y + e, u])], 0, 1, [(0, 1), (1, 1)])
        assert zone is not None
        held += abs(zone.value - 1.5) <= 1.96 * zone.std_error
    assert held >= 17  # 95 % of 20 less two standard deviations


def test_no_dead_zone_is_seen_where_there_is_none() -> None:
    seen = 0
    for seed in range(6):
        u = steps_of(LEVELS, 500, 15, seed)
        y = TurningMotor().speeds(u, DT)
        y = y + 0.5 * np.random.default_rng(seed).standard_normal(len(u))
        zone = dead_zone([np.column_stack([y, u])], 0, 1, [(0, 1), (0, 2), (1, 1), (1, 2)])
        assert zone is not None
        seen += zone.seen
    assert seen == 0


def test_a_change_of_the_plant_is_told_with_numbers() -> None:
    motor = TurningMotor()
    u = steps_of(LEVELS, 1400, 15, 5)
    weaker = np.where(np.arange(1400) < 1000, 1.0, 0.8)
    y = motor.speeds(u, DT, weaker) + 0.3 * np.random.default_rng(2).standard_normal(1400)
    live = live_motor(u, y)
    state = live.state()
    (change,) = state.changes
    assert abs(change.time - 1000 * DT) <= 2 * change.within
    (numbers,) = change.numbers
    assert numbers.gain_before.value == pytest.approx(motor.gain, rel=0.02)
    assert numbers.gain_after is not None
    assert numbers.gain_after.value == pytest.approx(0.8 * motor.gain, rel=0.02)
    assert state.since_change < 420
    # what is said is what the numbers say
    assert "gain falls by 20 % (18." in change_sentence(change)
    assert "time constant not significantly changed (0.15" in change_sentence(change)
    assert state.rows == 1400


def test_a_dead_zone_is_no_change_of_the_plant() -> None:
    alarms = 0
    motor = TurningMotor(friction=1.0, bridge=1.5)
    for seed in range(5):
        u = steps_of(LEVELS, 700, 15, seed)
        y = motor.speeds(u, DT) + 0.3 * np.random.default_rng(seed).standard_normal(700)
        alarms += len(live_motor(u, y, orders={"na": 1, "nb": 1, "nk": 1}).state().changes)
    assert alarms == 0


def two_tracks(u: Array, seed: int) -> LiveFit:
    """A robot whose tracks are two motors."""
    motors = (TurningMotor(), TurningMotor(time_constant=0.2))
    y = np.column_stack([m.speeds(c / 2000.0, DT) for m, c in zip(motors, u.T, strict=True)])
    y += 0.2 * np.random.default_rng(seed).standard_normal(y.shape)
    live = LiveFit(
        (Channel("pwm_l", "µs"), Channel("pwm_r", "µs")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        DT,
    )
    live.update(u, y)
    return live


def test_two_tracks_and_which_lacks_what() -> None:
    left, right = (2000.0 * steps_of(LEVELS, 800, 15, seed) for seed in (1, 2))
    both = two_tracks(np.column_stack([left, right]), 3).state()
    assert both.enough
    own = {(p.input, p.output): p for p in both.pairs}
    gain = TurningMotor().gain / 2000.0
    assert own["pwm_l", "omega_l"].gain.value == pytest.approx(gain, rel=0.02)
    assert own["pwm_r", "omega_r"].time_constant.value == pytest.approx(0.2, rel=0.05)
    assert abs(own["pwm_r", "omega_l"].gain.value) < 0.02 * gain

    alone = two_tracks(np.column_stack([left, np.zeros(800)]), 3).state()
    assert not alone.enough
    assert "pwm_r stays at 0" in alone.excitation[0].why
    unknown = [p for p in alone.parameters if "pwm_r" in p.name]
    assert all(p.std_error is None and p.information == 0.0 for p in unknown)

    together = two_tracks(np.column_stack([left, left]), 3).state()
    assert "pwm_l and pwm_r move together" in together.excitation[0].why


@pytest.mark.parametrize("command", [0.0, 6.0])
def test_a_constant_command_is_not_enough(command: float) -> None:
    rng = np.random.default_rng(4)
    y = TurningMotor().gain * command + 0.3 * rng.standard_normal(3000)
    state = live_motor(np.full(3000, command), y).state()
    assert not state.enough
    assert f"volts stays at {command:g}" in state.excitation[0].why


def test_an_operating_point_away_from_zero() -> None:
    u = steps_of((-3.0, -1.0, 2.0, 4.0), 600, 15, 6)
    y = TurningMotor().speeds(u, DT) + 40.0
    y += 0.2 * np.random.default_rng(5).standard_normal(600)
    pair = only(live_motor(u + 20.0, y, level=True, orders={"na": 1, "nb": 1, "nk": 1}))
    assert pair.gain.value == pytest.approx(TurningMotor().gain, rel=0.02)


@pytest.mark.parametrize("nk", [0, 1, 5])
def test_orders_and_dead_time_are_chosen(nk: int) -> None:
    """0: each row holds the speed at the end of its command, as many loggers write it."""
    u = steps_of(LEVELS, 500, 15, 7)
    y = TurningMotor().speeds(u, DT)
    late = np.roll(y, nk - 1)
    late[: max(nk - 1, 0)] = 0.0
    live = live_motor(u[:499], (late + 0.05 * np.random.default_rng(6).standard_normal(500))[:499])
    state = live.state()
    assert np.ravel(state.orders["nk"]).tolist() == [nk]
    assert state.pairs[0].settled
    assert state.pairs[0].gain.value == pytest.approx(TurningMotor().gain, rel=0.01)
    early = live_motor(u[:150], late[:150]).state().pairs[0]
    assert not early.settled  # as long as the dead time is not chosen


def test_what_cannot_be_followed_is_refused() -> None:
    with pytest.raises(DataError, match="sample time"):
        LiveFit((Channel("u"),), (Channel("y"),), 0.0)
    with pytest.raises(DataError, match="an input"):
        LiveFit((), (Channel("y"),), 0.1)
    live = LiveFit((Channel("u"),), (Channel("y"),), 0.1)
    with pytest.raises(UsageError, match="2 rows of inputs"):
        live.update([[1.0], [2.0]], [[1.0]])
    empty = live.state()
    assert not empty.enough
    assert empty.rows == 0
