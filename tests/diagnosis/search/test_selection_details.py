"""Where naming goes wrong without care: noise, jumps, starts of a log, things that are alike."""

from pathlib import Path

import numpy as np
import pytest
from sysid_datasets.hidden_logs import Request, hide

from sysid.data.facts import LogFacts
from sysid.data.io import read_log
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.gap import measure_gap
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import prepare
from sysid.diagnosis.search.refinement import refined
from sysid.diagnosis.search.starts import clip_level, free_indices, starts_of
from sysid.effects.catalogue import about, chain_effects, effect
from sysid.structures.augmented.chain import share_before
from sysid.structures.augmented.given_base import begins_at_rest
from sysid.structures.augmented.structure import Augmented

DT = 0.05
FULL = np.full(2, 20000.0)


def switched(samples: int, hold: int, seed: int = 1) -> Array:
    """Commands of random size held for some samples, two tracks [PWM]."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-16000.0, 16000.0, size=(samples // hold + 1, 2))
    return np.repeat(levels, hold, axis=0)[:samples]


def record(u: Array, y: Array, dt: float = DT) -> Record:
    return Record(
        u,
        y,
        dt,
        (Channel("pwm_l", "PWM"), Channel("pwm_r", "PWM")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
    )


def chain(
    effects: tuple[str, ...], numbers: list[float], dt: float = DT
) -> tuple[Augmented, Array]:
    """Two equal tracks, K = 20 and τ = 0.25 s, with effects; numbers of one track each."""
    core = [20.0, -float(np.exp(-dt / 0.25))]
    return Augmented(1, 1, (20000.0, 20000.0), dt, effects), np.array(core * 2 + numbers * 2)


def answer(folder: Path, effects: str, seed: int, style: str, noise: str = "low") -> Diagnosis:
    asked = Request(tuple(effects.split("+")), seed=seed, style=style, noise=noise, duration=90.0)
    for name, text in hide(asked).files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return diagnose([read_log(folder / "est.csv")], [read_log(folder / "val.csv")])


def names(found: Diagnosis) -> list[set[str]]:
    return [{e.id, *e.indistinguishable} for e in found.effects]


@pytest.mark.parametrize("sigma", [0.1, 0.3])
def test_the_noise_is_read_off_between_the_switches(sigma: float) -> None:
    s, theta = chain((), [])
    u = switched(3000, 10)
    noise = sigma * np.random.default_rng(2).standard_normal((3000, 2))
    found = LogFacts((record(u, s.simulate(theta, u) + noise),)).noise
    # half of the readings are calm; their third differences overlap: 3 %, and transients remain
    np.testing.assert_allclose(found, sigma, rtol=0.1)


def test_readings_at_rest_or_clipped_do_not_pass_for_silence() -> None:
    s, theta = chain((), [])
    u = switched(3000, 20)
    u[:1500] = 0.0
    y = s.simulate(theta, u)
    y[1500:] += 0.2 * np.random.default_rng(3).standard_normal((1500, 2))
    np.testing.assert_allclose(LogFacts((record(u, y),)).noise, 0.2, rtol=0.15)


@pytest.mark.parametrize("sigma", [0.1, 0.3])
def test_a_clip_is_seen_through_noise_that_enters_behind_it(sigma: float) -> None:
    rng = np.random.default_rng(4)
    y = 8.0 * np.sin(np.linspace(0.0, 60.0, 3000)) + rng.uniform(-4.0, 4.0, 3000)
    noise = sigma * rng.standard_normal(3000)
    assert abs(clip_level(np.clip(y, -6.0, 6.0) + noise, sigma) - 6.0) < sigma
    assert clip_level(y + noise, sigma) == np.inf


def test_a_command_begins_with_a_log_that_begins_at_standstill() -> None:
    y = np.array([[0.1, 9.0], [5.0, 9.5], [10.0, 10.0]])
    np.testing.assert_array_equal(share_before(np.full((3, 2), 0.5), y), [0.0, 1.0])


def test_a_log_that_begins_with_a_step_begins_under_a_smaller_command() -> None:
    """Steady at 2, then the first command of the log: what held it at 2 acted before."""
    y = np.append(10.0 - 8.0 * np.exp(-np.arange(60) / 8.0), np.zeros(20))[:, None]
    u = np.append(np.full(60, 0.5), np.zeros(20))[:, None]
    np.testing.assert_allclose(share_before(u, y), [0.2], atol=0.002)
    np.testing.assert_array_equal(share_before(u, np.full((80, 1), 10.0)), [1.0])
    short = np.arange(80.0)[:, None]  # a command a row: nothing is known of what acted before
    np.testing.assert_array_equal(share_before(short, y), [1.0])


def test_a_lag_is_found_in_a_log_that_begins_with_its_command() -> None:
    s, theta = chain(("actuator-lag",), [0.15])
    u = switched(400, 20, seed=7)
    assert abs(u[0, 0]) > 2000.0
    from_rest = s.simulate(theta, u)
    assert abs(from_rest[3, 0]) < abs(chain((), [])[0].simulate(chain((), [])[1], u)[3, 0])
    begun = s.simulate(theta, u, s.fitted_state(theta, u, from_rest, 1))
    np.testing.assert_allclose(begun, from_rest, atol=1e-9)


@pytest.mark.parametrize(("inertia", "coast"), [(1.0, 1.0), (0.5, 0.3)])
def test_a_gap_is_found_though_runs_change_with_it_by_jumps(inertia: float, coast: float) -> None:
    s, theta = chain(("backlash",), [0.8, inertia, coast, 0.0])
    u = switched(900, 18, seed=6)
    r = record(u, s.simulate(theta, u))
    m = FullModel(chain_effects(), 1, 2, np.array([12.0, 12.0]), DT)
    start = m.null
    for i in range(2):
        start[m.index["core", "gain", i]] = 19.0
        start[m.index["core", "f1", i]] = -0.85
        for name, value in (("gap", 0.3), ("inertia", 0.8), ("coast", 0.4)):
            start[m.index["backlash", name, i]] = value
    core = tuple(k for k, slot in enumerate(m.parameters) if slot.owner == "core")
    free = (*core, *free_indices(m, about("backlash"), m.null, range(2)))
    q, _ = refined(m, start[None], [free], prepare([r], FULL, 1), 20, unknown=(0,))
    gaps = [q[0][m.index["backlash", "gap", i]] for i in range(2)]
    # between two jumps every gap fits as well: 45 reversals leave some hundredths of a rad
    np.testing.assert_allclose(gaps, 0.8, rtol=0.08)


def test_the_whole_wheel_stays_with_the_motor_where_there_is_no_gap() -> None:
    s, theta = chain(("backlash",), [0.0, 0.4, 0.2, 0.5])
    u = switched(300, 15)
    plain, core = chain((), [])
    np.testing.assert_array_equal(s.simulate(theta, u), plain.simulate(core, u))


def test_a_delay_on_a_whole_record_is_that_of_its_steps() -> None:
    s, theta = chain(("input-delay",), [2.4 * DT])
    u = switched(300, 7)
    y = s.simulate(theta, u)
    m = FullModel(chain_effects(), 1, 2, np.array([12.0, 12.0]), DT)
    q = m.null
    for i in range(2):
        q[m.index["core", "gain", i]], q[m.index["core", "f1", i]] = theta[0], theta[1]
        q[m.index["input-delay", "delay", i]] = 2.4 * DT
    run = m.run(q, prepare([record(u, y)], FULL, 1))[0][: len(u)]
    np.testing.assert_allclose(run, y, atol=1e-9)


@pytest.mark.slow
def test_what_one_track_loses_the_other_feels(tmp_path: Path) -> None:
    found = answer(tmp_path, "coulomb-friction+cross-coupling", 215, "prbs")
    assert any("coulomb-friction" in n for n in names(found))
    assert any("cross-coupling" in n for n in names(found))


@pytest.mark.slow
def test_a_clip_behind_noise_is_no_saturated_command(tmp_path: Path) -> None:
    found = answer(tmp_path, "sensor-saturation", 1, "prbs", "high")
    assert names(found) == [{"sensor-saturation"}]


@pytest.mark.slow
def test_a_name_whose_law_fits_in_part_says_how_much_is_left(tmp_path: Path) -> None:
    """Cogging with dead bands: a torque over the angle of the two laws' places, but not their form.

    Its first wave comes once in 3 rad, its fifth is all that the second law takes of the others.
    """
    found = answer(tmp_path, "other-4", 501, "steps")
    assert found.verdict == "effects-found"
    load, ripple = found.effects
    assert (load.id, ripple.id) == ("gravity-load", "speed-ripple")
    lines = {v.name.partition("[")[0]: v.value for v in (*load.parameters, *ripple.parameters)}
    assert (lines["per_turn"], lines["load_per_turn"]) == pytest.approx((1 / 3, 5 / 3), rel=0.01)
    assert ripple.error_ratio_without is not None
    # a third of what the first law left, which was little
    assert 1.2 < ripple.error_ratio_without < 2.0
    assert "partly explained" in ripple.fit_words
    assert "of the error beyond the noise remains" in found.story


@pytest.mark.slow
def test_a_load_that_no_channel_records_is_told_from_noise() -> None:
    rng = np.random.default_rng(9)
    s, theta = chain((), [])
    u = switched(2400, 20, seed=9)
    load = np.zeros((2400, 2))
    for k in range(2399):
        load[k + 1] = 0.9 * load[k] + 0.5 * rng.standard_normal(2)
    made = record(u, s.simulate(theta, u) + load + 0.05 * rng.standard_normal(load.shape))
    halves = [made.rows(0, 1200), made.rows(1200, 2400)]
    found = diagnose(halves[:1], halves[1:])
    assert found.verdict == "no-missing-effect"
    assert "An unrecorded load or disturbance acts" in found.story


def test_a_floor_that_errors_fall_below_is_read_off_them() -> None:
    rng = np.random.default_rng(10)
    before, after = [rng.standard_normal((600, 1))], [0.3 * rng.standard_normal((600, 1))]
    gap = measure_gap(before, after, np.array([1.1]), np.ones(1), ["omega"])
    # what the better model leaves is white: 0.3 is the floor (5 % for 600 samples), nothing is left
    assert gap.closed_percent > 99.0
    assert gap.channels["omega"].noise_floor == pytest.approx(0.3, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pair", "seed"),
    [
        # the core of signless readings is not found anew beside a dead zone, only as it stands
        ("unsigned-speed+dead-zone", 5),
        # nothing that is like a saturated command starts where no reading piles up
        ("input-saturation+actuator-lag", 6),
        ("coulomb-friction+inertial-coupling", 8),
    ],
)
def test_both_of_a_pair_are_named(pair: str, seed: int, tmp_path: Path) -> None:
    found = names(answer(tmp_path, pair, seed, "steps", "high"))
    assert len(found) == 2
    for id in pair.split("+"):
        assert any(id in entry for entry in found)


def test_a_given_model_begins_at_rest_only_where_the_machine_does() -> None:
    none, some = np.zeros(2), np.array([0.0, 1.5])
    rests, moves = np.array([[0.1, -0.05], [6.0, 9.0]]), np.array([[0.1, 2.0], [6.0, 9.0]])
    assert begins_at_rest(none, none, rests)
    assert not begins_at_rest(none, none, moves)
    assert not begins_at_rest(none, some, rests)  # zero is no physical zero there
    assert not begins_at_rest(none, none, rests[:0])


def test_a_wave_is_sought_beside_a_core_without_end_too() -> None:
    """A search may pass unstable cores: what they do to a wave is beyond all numbers."""
    rng = np.random.default_rng(0)
    log = Record(rng.uniform(-1.0, 1.0, (3000, 1)), rng.standard_normal((3000, 1)), 0.02)
    model = FullModel((effect("gravity-load"),), 1, 1, np.ones(1), log.dt)
    data = prepare([log], np.ones(1), 1)
    q = model.null.copy()
    q[model.index["core", "f1", 0]] = -1.5
    errors = np.zeros(data.y.shape)
    errors[: len(log)] = log.y
    rows = starts_of(model, effect("gravity-load"), q, errors, data)
    assert rows
    assert np.isfinite(rows).all()


def test_an_output_that_only_a_disturbance_moves_does_not_halve_the_headline() -> None:
    """Its errors are beyond the noise, small beside what it measures, and nothing closes them."""
    rng = np.random.default_rng(11)
    noise, load = rng.standard_normal((2, 2000)) * [[0.05], [0.15]]
    before, after = np.column_stack([4.0 * noise / 0.05, load]), np.column_stack([noise, load])
    floor, spread = np.array([0.05, 0.05]), np.array([10.0, 10.0])
    gap = measure_gap([before], [after], floor, spread, ["omega_l", "omega_r"])
    assert gap.closed_percent > 99.0
    assert gap.channels["omega_r"].rmse_after > 2.0 * floor[1]
