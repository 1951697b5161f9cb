"""Sensors, clocks, suites and files of the physics twin."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sysid_datasets.physics import compiled
from sysid_datasets.physics.__main__ import main
from sysid_datasets.physics.commands import SCHEDULES
from sysid_datasets.physics.hidden import Hidden
from sysid_datasets.physics.logs import _as_read, excess, floor, make, write
from sysid_datasets.physics.noises import NOISES
from sysid_datasets.physics.parameters import (
    ANGLE,
    PERIOD,
    TICKS,
    Controller,
    Drive,
    Firmware,
    Machine,
    Sensor,
)
from sysid_datasets.physics.robots import figures
from sysid_datasets.physics.simulate import Telemetry, simulate
from sysid_datasets.physics.suites import EFFECTS, NOTHINGS, case
from sysid_datasets.physics.wire import PoseSensor, Wire


def sensed(sensor: Sensor, telemetry: Telemetry | None = None, duty: float = 0.5, rows: int = 100):
    machine = Machine((Drive(sensor=sensor),))
    return simulate(machine, np.full((rows, 1), duty), telemetry, rng=np.random.default_rng(0))


def test_ticks_add_up_to_the_angle() -> None:
    run = sensed(Sensor(kind=TICKS, lines=48.0))
    turned = np.cumsum(run.reading[:, 0]) * 0.05
    # a tick is 2π/48, and the first one may be nearly there
    assert np.abs(turned - run.truth["angle"][:, 0]).max() < 2.0 * np.pi / 48.0 + 1e-9
    assert np.unique(np.round(run.reading * 0.05 * 48.0 / (2.0 * np.pi), 6) % 1.0) == 0.0


def test_periods_between_ticks_are_the_speed() -> None:
    run = sensed(Sensor(kind=PERIOD, lines=48.0))
    # the mean over a tick of 7 ms at 18 rad/s, well within the settled half of the log
    assert run.reading[50:, 0] == pytest.approx(run.truth["speed"][50:, 0], rel=1e-3)
    assert sensed(Sensor(kind=PERIOD, lines=48.0), duty=0.0).reading.max() == 0.0


def test_an_eccentric_encoder_ripples_once_a_turn() -> None:
    run = sensed(Sensor(lines=0.0, eccentricity=0.1), Telemetry(rate=200.0), rows=600)
    w, angle = run.truth["speed"][:, 0], run.truth["angle"][:, 0]
    assert run.reading[:, 0] == pytest.approx(w * (1.0 + 0.1 * np.cos(angle)), abs=1e-9)


def test_latency_shows_the_past_and_refresh_holds_it() -> None:
    plain = sensed(Sensor()).reading[:, 0]
    late = sensed(Sensor(), Telemetry(latency=0.1)).reading[:, 0]
    assert np.array_equal(late[2:], plain[:-2])
    slow = sensed(Sensor(), Telemetry(refresh=0.2)).reading[:, 0]
    assert np.array_equal(slow, np.repeat(plain[::4], 4))


def test_commands_arrive_late_and_jitter_does_not_overtake() -> None:
    plain = sensed(Sensor()).truth["speed"][:, 0]
    late = sensed(Sensor(), Telemetry(command_delay=0.1)).truth["speed"][:, 0]
    assert late[2:] == pytest.approx(plain[:-2], abs=1e-12)
    shaken = sensed(Sensor(), Telemetry(command_jitter=0.2)).truth["speed"][:, 0]
    assert np.all(shaken <= plain + 1e-9)
    with pytest.raises(ValueError, match="randomness"):
        simulate(Machine((Drive(),)), np.zeros((5, 1)), Telemetry(command_jitter=0.1))


def test_a_true_delay_is_that_of_command_and_reading() -> None:
    """Ticks of a sample of 50 ms are 25 ms old, and of a jitter half is always there."""
    made = case("realistic", 0)
    late = next(h for h in made.hidden if h.id == "input-delay")
    told = _as_read(late, made)["delay"]
    assert told == pytest.approx(late.sizes["delay_s"] + 0.025 + 0.0025 + 0.001)
    plain = replace(made, rig=replace(made.rig, telemetry=Telemetry(latency=0.02)))
    drives = tuple(replace(d, sensor=Sensor()) for d in made.rig.machine.drives)
    machine = replace(made.rig.machine, drives=drives)
    plain = replace(plain, rig=replace(plain.rig, machine=machine))
    assert _as_read(late, plain)["delay"] == pytest.approx(late.sizes["delay_s"] + 0.02)


def test_an_edge_behind_a_curve_of_the_command_lies_where_the_command_shows_it() -> None:
    """0.15 + 0.3 (0.15 − 0.15³) = 0.194: the duty at which a pulse gets through."""
    made = case("singles", 0)
    bent = replace(Drive(), firmware=Firmware(expo=0.3))
    drives = (Drive(), bent)
    made = replace(made, rig=replace(made.rig, machine=Machine(drives)), columns=None)
    duty = 0.15 + 0.3 * (0.15 - 0.15**3)
    edges = Hidden("dead-zone", "", {}, (), (0, 1), {"plus": duty, "minus": duty})
    told = _as_read(edges, made)
    assert told["plus"] == duty
    assert told["plus[omega_r]"] == pytest.approx(0.15)
    assert "plus[omega_l]" not in told


def test_a_speed_loop_reaches_its_reference() -> None:
    machine = Machine((Drive(),), controller=Controller(proportional=0.005, integral=0.1))
    run = simulate(machine, np.full((200, 1), 12.0))
    assert run.truth["speed"][-1, 0] == pytest.approx(12.0, rel=1e-3)
    assert np.abs(run.command).max() <= 1.0


def test_the_wire_loses_what_it_says() -> None:
    rng = np.random.default_rng(3)
    ramp = np.linspace(0.0, 10.0, 2001)[:, None]
    assert np.array_equal(Wire().carry(ramp, rng), ramp)
    assert Wire(largest=4.0).carry(ramp, rng).max() == 4.0
    assert np.ptp(Wire(step=0.5).carry(ramp, rng) - ramp) <= 0.5 + 1e-12
    lost = Wire(lost=0.1).carry(ramp, rng)
    assert 0.07 < np.mean(lost != ramp) < 0.13
    assert np.all(np.diff(lost, axis=0) >= 0.0)
    turning = np.linspace(0.0, 2.0 * np.pi * 100.0, 1001)[:, None]
    counted = Wire(counter=1000).carry(turning, rng)
    assert counted.min() >= -(2**15)
    assert counted.max() < 2**15
    assert np.ptp(np.unwrap(counted[:, 0], period=2.0**16)) == pytest.approx(1e5, abs=1.0)


def test_a_camera_off_the_axle_sees_its_own_place() -> None:
    pose = np.column_stack([np.zeros(1001), np.zeros(1001), np.linspace(0.0, np.pi, 1001)])
    quiet = PoseSensor(ahead=0.1, position_noise=0.0, heading_noise=0.0, lag=0.1)
    seen = quiet.measure(np.array([0.1, 1.0]), pose, 1e-3, np.random.default_rng(0))
    angle = np.array([0.0, 0.9 * np.pi])
    exact = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), angle])
    assert seen == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("style", SCHEDULES)
def test_every_schedule_rests_first_and_stays_within_full_drive(style: str) -> None:
    for rate, drives in ((20.0, 2), (1000.0, 1)):
        made = SCHEDULES[style](np.random.default_rng(5), round(20 * rate), 1.0 / rate, drives)
        assert made.shape == (20 * rate, drives)
        assert np.all(made[: round(rate)] == 0.0)
        assert 0.3 < np.abs(made).max() <= 1.0


@pytest.mark.parametrize("kind", NOISES)
def test_noise_has_unit_variance(kind: str) -> None:
    made = NOISES[kind](np.random.default_rng(1), (20000, 2), 0.05)
    assert made.std() == pytest.approx(1.0, abs=0.1)


def test_nothing_hidden_is_a_line_of_first_order_to_the_noise() -> None:
    for name, seconds in (("white", 20.0), ("kilohertz", 4.0)):
        made = case("nothing", list(NOTHINGS).index(name))
        val = make(replace(made, duration=seconds)).val
        assert max(excess(val)) < 0.3 * max(floor(val))


def test_every_effect_of_the_singles_is_drawn_and_changes_the_log() -> None:
    found = {case("singles", seed).hidden[0].id for seed in range(len(EFFECTS))}
    assert found == set(EFFECTS)
    made = case("singles", EFFECTS.index("current-limit"))
    short = make(replace(made, duration=10.0, style="steps"))
    assert max(excess(short.val)) > 0.1 * figures(made.rig.machine).speed * 0.05


def test_pairs_and_triples_hide_different_effects() -> None:
    for suite, count in (("pairs", 2), ("triples", 3)):
        for seed in range(30):
            assert len({h.id for h in case(suite, seed).hidden}) == count


def test_the_same_seed_writes_the_same_bytes(tmp_path: Path) -> None:
    backlash = replace(case("small", EFFECTS.index("backlash")), duration=10.0)
    for folder in ("a", "b"):
        write(make(backlash), tmp_path / folder)
    for name in ("est.csv", "val.csv", "truth.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    truth = json.loads((tmp_path / "a" / "truth.json").read_text(encoding="utf-8"))
    assert truth["hidden"][0]["id"] == "backlash"
    header = (tmp_path / "a" / "est.csv").read_text(encoding="ascii").splitlines()[0]
    assert header == "t,pwm_l,pwm_r,omega_l,omega_r"


def test_the_command_line_writes_a_folder(tmp_path: Path) -> None:
    seed = str(list(NOTHINGS).index("short"))
    assert main(["--suite", "nothing", "--seed", seed, "-o", str(tmp_path)]) == 0
    assert {f.name for f in tmp_path.iterdir()} == {"est.csv", "val.csv", "truth.json"}


def test_without_a_compiler_a_sentence_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled.shutil, "which", lambda name: None)
    compiled.library.cache_clear()
    try:
        assert main(["-o", str(tmp_path / "out")]) == 1
    finally:
        monkeypatch.undo()
        compiled.library.cache_clear()
    assert "no compiler was found" in capsys.readouterr().err
    assert sensed(Sensor(kind=ANGLE)).reading.max() > 1.0


def test_numbers_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Sensor\.lines is nan"):
        sensed(Sensor(lines=float("nan")))
    with pytest.raises(ValueError, match="2 drives"):
        simulate(Machine(), np.zeros((10, 1)))
    with pytest.raises(ValueError, match="not a multiple"):
        sensed(Sensor(), Telemetry(rate=30.0))
