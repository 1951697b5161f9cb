"""The headline of the gap covers outputs and path; what has no name is told with its size."""

import numpy as np
import pytest

from sysid.data.documents import plain
from sysid.data.record import Channel, Record
from sysid.diagnosis.gap import ChannelGap, Gap, with_path
from sysid.diagnosis.pose.evidence import pose_gap
from sysid.diagnosis.validation.excess_error import excess_error
from sysid.diagnosis.validation.localise import Region, leading
from sysid.vehicle.kinematics import Geometry

FLOOR = 0.01


def gap_of(closed: float, **channels: ChannelGap) -> Gap:
    return Gap(1.0, 1.0 - closed / 100.0, 0.1, closed, (closed - 2.0, closed + 1.0), channels)


def channel(before: float, closed: float) -> ChannelGap:
    whole = before**2 - FLOOR**2
    return ChannelGap(before, float(np.sqrt(whole * (1 - closed / 100) + FLOOR**2)), FLOOR)


def test_the_headline_is_no_better_than_the_path() -> None:
    speeds = gap_of(99.8, omega_l=channel(1.0, 99.8), omega_r=channel(0.5, 99.8))
    path = gap_of(24.0, x=channel(0.3, 24.0), y=channel(0.2, 24.0))
    whole = with_path(speeds, path)
    assert whole.parts == pytest.approx({"outputs": 99.8, "path": 24.0}, abs=0.1)
    # two channels of each, all far above their floors: the mean
    assert whole.closed_percent == pytest.approx((99.8 + 24.0) / 2.0, abs=0.2)
    assert whole.interval[0] < whole.closed_percent < whole.interval[1]
    assert set(whole.channels) == {"omega_l", "omega_r", "x", "y"}
    assert plain(whole)["parts"]["path"] == whole.parts["path"]


def test_a_path_at_its_noise_neither_flatters_nor_spoils_the_headline() -> None:
    speeds = gap_of(90.0, omega=channel(1.0, 90.0))
    path = gap_of(0.0, x=ChannelGap(FLOOR, FLOOR, FLOOR))
    whole = with_path(speeds, path)
    assert whole.closed_percent == pytest.approx(90.0, abs=0.1)
    assert set(whole.parts) == {"outputs"}
    still = gap_of(0.0, omega=ChannelGap(FLOOR, FLOOR, FLOOR))
    assert with_path(still, path) is still


def test_windows_that_an_effect_leaves_alone_count_for_the_path() -> None:
    rng = np.random.default_rng(0)
    old = 5.0 * rng.standard_normal((400, 3))
    new = old.copy()
    new[:40] = rng.standard_normal((40, 3))  # the effect is_redundant one turn
    pairs = [(old, new)]
    assert pose_gap(pairs, np.ones(3)).closed_percent == pytest.approx(10.0, abs=5.0)


def driven(error: float, samples: int = 3000) -> tuple[Record, np.ndarray]:
    """A robot that drives at 10 rad/s for a minute, with a constant error of its model."""
    names = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
    speeds = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
    record = Record(np.full((samples, 2), 8000.0), np.full((samples, 2), 10.0), 0.02, names, speeds)
    return record, np.full((samples, 2), error)


def test_a_thousandth_of_the_speed_is_told_with_what_it_does_to_a_mission() -> None:
    record, errors = driven(0.01)
    left = excess_error([record], [errors], np.array([0.0, 0.0]), Geometry(0.03, 0.2))
    assert left.outputs[0] == ("omega_l", "rad/s", pytest.approx(0.01), pytest.approx(0.1))
    assert left.after_time == pytest.approx(0.03 * 0.01 * 60.0)  # r e t
    assert left.after_way == pytest.approx(10.0 * 0.001)  # the share of the way
    assert "0.1 % of the typical output" in left.sentence
    assert "0.018 m off after 60 s, and 0.01 m after 10 m" in left.sentence
    assert left.to_json()["after_10_m_m"] == left.after_way


def test_the_size_is_in_the_unit_of_the_file() -> None:
    speed = Channel("v", "m/s", 1.0 / 3.6, "km/h")
    train = Record(np.ones(50), np.full(50, 20.0), 1.0, (Channel("u"),), (speed,))
    (size,) = excess_error([train], [np.full((50, 1), 0.5)], np.zeros(1), None).outputs
    assert size == ("v", "km/h", pytest.approx(1.8), pytest.approx(2.5))


def test_lost_samples_and_noise_are_no_part_of_the_size_and_an_oven_drives_nowhere() -> None:
    record, errors = driven(0.01)
    errors[::2] = np.nan
    left = excess_error([record], [errors], np.array([0.01, 0.02]), None)
    assert left.outputs[0][2] == pytest.approx(0.0, abs=1e-9)
    assert left.outputs[1][2] == 0.0
    oven = Record(np.ones(50), np.full(50, 60.0), 1.0, (Channel("u"),), (Channel("temp", "C"),))
    warm = excess_error([oven], [np.full((50, 1), 0.6)], np.zeros(1), None)
    assert warm.after_time is None
    assert "robot" not in warm.sentence


def test_where_something_remains_is_where_it_surely_stands_out() -> None:
    sure = Region("omega_l: it runs backward", 0.8, 0.3, (0.6, 0.9))
    unsure = Region("omega_l: it is at standstill", 0.9, 0.3, (0.2, 0.99))
    assert leading([unsure, sure], ["omega_l"]) == "it runs backward"
    assert leading([unsure, sure], ["omega_r"]) == ""
    late = Region("omega_l: the last third of the log", 0.9, 0.33, (0.8, 0.95))
    assert leading([sure, late], ["omega_l"]) == "it is the last third of the log"
