"""Other machines of the physics twin, its suites, and the marks of its study."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sysid_datasets.physics.logs import (
    PERIOD,
    _on_ground,
    csv_of,
    excess,
    floor,
    make,
    pose_excess,
    shows,
)
from sysid_datasets.physics.others import MACHINES, OUTSIDE
from sysid_datasets.physics.processes import GRAVITY, Heater, Tanks
from sysid_datasets.physics.suites import FRESH, NOTHINGS, SUITES, case

from studies import physics_diagnose as study
from sysid import read_log


def test_a_heater_settles_where_watts_are_lost() -> None:
    plate = Heater(watts=60.0, capacity=100.0, loss=1.0)
    read = plate.run(np.full((500, 1), 0.5), 2.0)[:, 0]
    exact = 20.0 + 30.0 * (1.0 - np.exp(-np.arange(500) * 2.0 / 100.0))
    assert read == pytest.approx(exact, abs=1e-6)
    assert replace(plate, fuse=0.25).run(np.ones((500, 1)), 2.0)[-1, 0] == pytest.approx(35.0, 1e-3)
    late = replace(plate, late=6.0).run(np.full((500, 1), 0.5), 2.0)[:, 0]
    assert late[3:] == pytest.approx(read[:-3], abs=1e-9)
    assert replace(plate, radiating=0.1).run(np.ones((500, 1)), 2.0)[-1, 0] < 79.0


def test_tanks_settle_where_the_outflow_is_the_pump() -> None:
    made = Tanks(area=0.002)
    level = made.run(np.full((1500, 1), 0.6), 2.0)[-1, 0]
    assert level == pytest.approx(100.0 * (0.6 * 5e-5 / 3e-5) ** 2 / (2.0 * GRAVITY), rel=1e-3)


@pytest.mark.parametrize("seed", range(len(MACHINES)), ids=list(MACHINES))
def test_logs_of_other_machines_are_read_without_help(seed: int, tmp_path: Path) -> None:
    made = replace(case("machines", seed), duration=100.0 * PERIOD if seed in (2, 4) else 15.0)
    log = make(made).val
    file = tmp_path / "log.csv"
    assert made.columns is not None
    file.write_text(csv_of(log, made.columns), encoding="ascii")
    record = read_log(file)
    assert (record.nu, record.ny) == (1, 1)
    assert float(record.u[:, 0].std()) > 0.0


def test_what_is_outside_the_catalogue_bends_the_log() -> None:
    for seed, name in enumerate(OUTSIDE):
        if name in ("tanks", "rhythm"):  # the one has no wheels, the other no mean
            continue
        made = case("outside", seed)
        assert made.outside
        assert not made.hidden
        log = make(replace(made, duration=10.0)).est
        misses, noise = excess(log), floor(log)
        assert max(m / n for m, n in zip(misses, noise, strict=True)) > 1.0


@pytest.mark.parametrize(("seed", "hidden", "seen"), [(3, 1, 0), (15, None, 1)])
def test_of_several_causes_it_is_told_how_far_each_shows(
    seed: int, hidden: int | None, seen: int
) -> None:
    """Of pair 3 a current limit is never reached; in pair 15 both show."""
    made = make(replace(case("pairs", seed), duration=20.0))
    sizes = shows(made)
    assert [size is None for size in sizes] == [h.id == "dropouts" for h in made.case.hidden]
    if hidden is None:
        assert min(size or 0.0 for size in sizes) > 1.0
    else:
        assert sizes[hidden] == pytest.approx(0.0, abs=0.05)
    assert sizes[seen] is None or (sizes[seen] or 0.0) > 1.0
    assert shows(make(replace(case("nothing", 0), duration=5.0))) == []


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["heavy body on soft feet", "scrubbing"])
def test_on_ground_that_gives_bodies_slide_outwards_so_that_name_is_right(cause: str) -> None:
    """v_y = −(a + β v) ψ̇ in the pose that the log holds: β is far from none."""
    made = next(
        c
        for c in (case("singles", k) for k in range(300))
        if [h.cause for h in c.hidden] == [cause]
    )
    assert "lateral-slip" in made.hidden[0].also
    log = make(made).est
    assert log.pose is not None
    rows, dt = 4, float(log.t[1] - log.t[0])
    change = (log.pose[rows:] - log.pose[:-rows]) / (rows * dt)
    heading = 0.5 * (log.pose[rows:, 2] + log.pose[:-rows, 2])
    along = change[:, 0] * np.cos(heading) + change[:, 1] * np.sin(heading)
    across = change[:, 1] * np.cos(heading) - change[:, 0] * np.sin(heading)
    X = np.column_stack([change[:, 2], along * change[:, 2]])
    numbers = np.linalg.lstsq(X, -across, rcond=None)[0]
    left = across + X @ numbers  # neighbours share three of four rows
    error = np.sqrt(rows * np.var(left) * np.linalg.inv(X.T @ X)[1, 1])
    assert numbers[1] > 5.0 * error


def test_a_curve_of_a_command_with_one_level_does_not_show() -> None:
    """Speeds without it differ by more than a gain where friction is there, but so they do under
    other commands."""
    pair = next(
        c
        for c in (case("pairs", k) for k in range(200))
        if any(h.id == "concave-gain" for h in c.hidden)
    )
    at = [h.id for h in pair.hidden].index("concave-gain")
    binary, steps = (
        shows(make(replace(pair, style=style, duration=20.0))) for style in ("binary", "steps")
    )
    assert binary[at] == 0.0
    assert (steps[at] or 0.0) > 0.0


def test_more_speed_on_the_same_ground_does_not_show_in_the_pose() -> None:
    """A curve of the command makes the robot faster; how it slips for its speed stays."""
    made = case("pairs", 3)
    logs = make(replace(made, duration=20.0))
    way = np.cumsum(np.ones((400, 1)) * [0.004, 0.0, 0.0], axis=0)
    slow = replace(logs.val, clean=np.ones((400, 2)), pose=way)
    fast = replace(logs.val, clean=2.0 * np.ones((400, 2)), pose=way * 2.0)
    straight = replace(made, rig=replace(made.rig, lengths=(0.1, 0.3)))
    assert pose_excess(fast, (0.1, 0.3))[0] == pytest.approx(0.08)  # a fifth of .4 m
    assert _on_ground(straight, fast, slow) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_wheels_that_roll_as_drawn_leave_the_noise_of_the_pose() -> None:
    made = replace(case("nothing", list(NOTHINGS).index("pose")), duration=20.0)
    assert made.rig.lengths is not None
    way, turn = pose_excess(make(made).val, made.rig.lengths)
    assert way < 2.0 * 0.002 * np.sqrt(2.0)
    assert turn < 2.0 * 0.002 * np.sqrt(2.0)


def test_the_realistic_robot_has_everything() -> None:
    made = case("realistic", 1)
    names = {h.id for h in made.hidden}
    assert {"backlash", "stiction", "supply-sag", "input-delay", "quantisation"} <= names


def test_every_suite_draws_seeds_of_both_kinds() -> None:
    for suite in SUITES:
        for seed in (7, FRESH + 7):
            assert case(suite, seed).key == f"{suite}-{seed}"
        assert case(suite, 3).rig != case(suite, FRESH + 3).rig
    with pytest.raises(ValueError, match="negative"):
        case("singles", -1)


def test_two_causes_for_which_either_name_is_right_ask_for_one_entry() -> None:
    motor = {"id": "direction-asymmetry", "also": ["viscous-asymmetry"]}
    friction = {"id": "viscous-asymmetry", "also": ["direction-asymmetry"]}
    late = {"id": "input-delay", "also": []}
    play = {"id": "backlash", "also": ["direction-asymmetry"]}
    truth = {"hidden": [motor, late, friction, play], "shows": [5.0, None, 5.0, 5.0]}
    assert study._shown(truth) == ("direction-asymmetry", "input-delay", "backlash")
    assert study._shown({"hidden": [motor, late], "shows": [0.5, 2.0]}) == ("input-delay",)


def test_a_share_of_the_largest_command_is_judged_in_volts() -> None:
    """The log never went beyond 11 of 12 V: 0.8116 of that is 0.744 of full drive."""
    same = {"plus": 0.744}
    hidden = [{"id": "input-saturation", "also": [], "same_meaning": same, "spread": 0.0}]
    number = {"name": "plus[speed]", "value": 0.8116, "std_error": 5e-4, "unit": "drive"}
    in_file = {"value": 8.928, "std_error": 0.006, "unit": "V"}
    entry = {"id": "input-saturation", "indistinguishable": []}
    told = [{**entry, "parameters": [{**number, "in_file": in_file}]}]
    assert study._numbers(hidden, told, 12.0) == (1, [])
    plain = [{**entry, "parameters": [number]}]
    believed, wrong = study._numbers(hidden, plain, 20000.0)
    assert believed == 0
    assert "0.8116" in wrong[0]


def test_a_number_of_a_tie_of_two_that_are_both_there_is_of_both() -> None:
    zero = {"id": "sensor-bias", "also": ["load-bias"], "same_meaning": {"bias": 1.0}}
    load_ = {"id": "load-bias", "also": ["sensor-bias"], "same_meaning": {}, "spread": 0.0}
    number = {"name": "bias[omega_l]", "value": 5.0, "std_error": 0.1, "unit": "speed"}
    entry = {"id": "sensor-bias", "indistinguishable": ["load-bias"], "parameters": [number]}
    assert study._numbers([{**zero, "spread": 0.0}, load_], [entry], 1.0) == (0, [])
    assert study._numbers([{**zero, "spread": 0.0}], [entry], 1.0)[1]


def test_a_number_with_a_true_value_of_its_own_output_is_judged_by_that() -> None:
    same = {"plus": 0.2, "plus[omega_r]": 0.15}
    hidden = [{"id": "dead-zone", "also": [], "same_meaning": same, "spread": 0.0}]
    numbers = [
        {"name": f"plus[{name}]", "value": value, "std_error": 1e-3, "unit": "drive"}
        for name, value in (("omega_l", 0.2), ("omega_r", 0.15))
    ]
    told = [{"id": "dead-zone", "indistinguishable": [], "parameters": numbers}]
    assert study._numbers(hidden, told, 1.0) == (2, [])


def test_a_name_that_is_also_right_counts_once() -> None:
    gap = {"id": "backlash", "also": ["coulomb-friction"]}
    lag = {"id": "actuator-lag", "also": ["sensor-lag"]}
    said = [("coulomb-friction",), ("backlash",), ("sensor-lag", "input-delay"), ("dead-zone",)]
    assert study.translated([gap, lag], said) == (
        ("coulomb-friction", "backlash"),
        ("sensor-lag", "input-delay", "actuator-lag"),
        ("dead-zone",),
    )
    assert study.translated([], said) == tuple(said)


def test_a_study_that_is_stopped_has_run_its_share_of_every_suite() -> None:
    wanted = study.interleaved({"singles": 40, "pairs": 20, "realistic": 2}, 500)
    assert len(set(wanted)) == len(wanted) == 62
    for share in (0.25, 0.5, 0.8):
        some = wanted[: round(share * len(wanted))]
        for suite, runs in (("singles", 40), ("pairs", 20), ("realistic", 2)):
            assert abs(sum(s == suite for s, _ in some) - share * runs) <= 1.0
    assert sorted(k for s, k in wanted if s == "pairs") == list(range(500, 520))
