"""Excitation designs: the properties their theory promises, within the robot's limits."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.checks.dynamics_checks import excitation_order
from sysid.data.excitation import (
    DESIGNS,
    Schedule,
    chirp,
    crest_factor,
    multisine,
    prbs,
    pulses,
    steps,
    write_schedule,
)
from sysid.data.io import read_file
from sysid.data.record import PWM_FULL_SCALE, Record
from sysid.errors import UsageError

MADE = {name: design() for name, design in DESIGNS.items()}


@pytest.mark.parametrize("name", MADE)
def test_every_design_rests_at_both_ends_within_limits(name: str) -> None:
    s = MADE[name]
    assert np.all(np.abs(s.u) <= PWM_FULL_SCALE)
    np.testing.assert_array_equal(s.u, np.rint(s.u))
    assert not s.u[:10].any()
    assert not s.u[-10:].any()
    assert s.excited.any(axis=0).all()
    np.testing.assert_allclose(np.diff(s.t), 0.1, atol=1e-9)
    assert [c.name for c in s.channels] == ["pwm_l", "pwm_r"]
    assert not s.u.flags.writeable


@pytest.mark.parametrize("name", MADE)
def test_the_same_call_gives_the_same_schedule(name: str) -> None:
    np.testing.assert_array_equal(DESIGNS[name]().u, MADE[name].u)


@pytest.mark.parametrize("design", [prbs, multisine, steps])
def test_the_seed_matters(design: type[Schedule]) -> None:
    assert not np.array_equal(design(seed=1).u, design(seed=2).u)  # type: ignore[call-arg]


def test_prbs_autocorrelation_is_that_of_its_theory() -> None:
    n = 127
    s = prbs(duration=n * 0.1, clock=1, amplitude=1000)
    u = s.excited / 1000
    assert set(np.unique(u)) == {-1.0, 1.0}
    assert crest_factor(u[:, 0]) == 1.0
    for i in range(2):
        r = np.fft.ifft(np.abs(np.fft.fft(u[:, i])) ** 2).real / n
        np.testing.assert_allclose(r[0], 1.0, atol=1e-12)
        np.testing.assert_allclose(r[1:], -1 / n, atol=1e-12)
    # Shifted copies: their product at lag 0 is one of those −1/n.
    assert np.mean(u[:, 0] * u[:, 1]) == pytest.approx(-1 / n, abs=1e-12)


@pytest.mark.parametrize("clock", [1, 2, 5])
def test_prbs_holds_for_its_clock(clock: int) -> None:
    u = prbs(duration=50.0, clock=clock).excited[:, 0]
    changes = np.flatnonzero(np.diff(u)) + 1
    assert np.all(changes % clock == 0)
    assert len(changes) > 0.3 * len(u) / clock


def test_prbs_offset_moves_the_levels() -> None:
    assert set(np.unique(prbs(offset=5000, amplitude=3000).excited)) == {2000.0, 8000.0}


def test_multisine_spectrum_is_only_where_it_was_put() -> None:
    duration, dt, band = 60.0, 0.1, (0.2, 1.5)
    s = multisine(duration, dt, 15000, band)
    spectrum = np.abs(np.fft.rfft(s.excited, axis=0)) / len(s.excited)
    f = np.fft.rfftfreq(len(s.excited), dt)
    # Rounding to whole µs leaves ±0.5 µs spread over all lines.
    strong = spectrum > 20.0
    assert not (strong[:, 0] & strong[:, 1]).any()
    either = strong.any(axis=1)
    np.testing.assert_allclose(f[either].min(), band[0], atol=1e-9)
    np.testing.assert_allclose(f[either].max(), band[1], atol=1e-9)
    assert np.count_nonzero(either) == round((band[1] - band[0]) * duration) + 1
    for i in range(2):
        lines = spectrum[strong[:, i], i]
        np.testing.assert_allclose(lines, lines.mean(), rtol=0.01)  # a flat spectrum
    assert spectrum[~either].max() < 1.0


def test_multisine_inputs_are_orthogonal_and_low_in_crest() -> None:
    u = multisine().excited
    c = (u[:, 0] @ u[:, 1]) / (np.linalg.norm(u[:, 0]) * np.linalg.norm(u[:, 1]))
    assert abs(c) < 1e-4  # the rounding to whole µs
    for column in u.T:
        # Random phases of 60 lines give about 3; Schroeder's rule promises about 1.7 to 2.
        assert crest_factor(column) < 2.1
        assert np.max(np.abs(column)) == 15000


def test_excitation_orders_of_the_designs() -> None:
    def order(u: np.ndarray, limit: int) -> tuple[int, ...]:
        return excitation_order([Record(u, np.zeros((len(u), 1)), 0.1)], limit)

    assert order(prbs(duration=12.7, clock=1).excited, 20) == (20, 20)
    t = np.arange(400) * 0.1
    three = sum(np.cos(2 * np.pi * f * t + f) for f in (0.2, 0.7, 1.5))
    assert order(np.asarray(three)[:, None], 20) == (6,)  # two for each sine


def test_chirp_drives_each_input_alone_then_all() -> None:
    u = chirp(duration=60.0, band=(0.1, 2.0)).excited
    assert not u[:200, 1].any()
    assert not u[200:400, 0].any()
    np.testing.assert_array_equal(u[400:, 0], u[400:, 1])
    crossings = np.flatnonzero(np.diff(np.signbit(u[:200, 0])))
    periods = 2 * np.diff(crossings) * 0.1
    # Frequency rises from 0.1 to 2 Hz: the first half-wave is long, the last short.
    assert periods[0] > 4.0
    assert periods[-1] == pytest.approx(0.5, abs=0.21)  # two samples of 0.1 s resolve 0.2 s


def test_steps_use_every_level_and_keep_the_hold_times() -> None:
    s = steps(duration=200.0, levels=7, hold=(0.5, 2.0), amplitude=18000)
    for column in s.excited.T:
        np.testing.assert_array_equal(np.unique(column), np.linspace(-18000, 18000, 7))
        runs = np.diff(np.flatnonzero(np.append(True, np.diff(column) != 0)))
        assert runs.min() >= 5
        assert runs.max() <= 20
    assert not np.array_equal(s.excited[:, 0], s.excited[:, 1])


@pytest.mark.parametrize("rotate", [False, True])
def test_pulses_drive_and_rotate(rotate: bool) -> None:
    s = pulses(levels=2, amplitude=10000, on=1.0, pause=0.5, rotate=rotate)
    left, right = s.excited.T
    np.testing.assert_array_equal(left, -right if rotate else right)
    levels = [right[k] for k in (0, 10, 15, 25, 30, 45)]
    assert levels == [5000, 0, -5000, 0, 10000, -10000]


BAD = [
    (prbs, {"amplitude": 20001}, "exceeds full drive"),
    (prbs, {"amplitude": 15000, "offset": 6000}, "exceeds full drive"),
    (prbs, {"amplitude": 0}, "amplitude must be positive"),
    (prbs, {"amplitude": float("nan")}, "amplitude must be positive"),
    (prbs, {"clock": 0}, "clock of a PRBS"),
    (prbs, {"dt": 0.0}, "sample time must be positive"),
    (prbs, {"duration": 0.2}, "too short"),
    (prbs, {"duration": float("inf")}, "too short"),
    (prbs, {"duration": 1e9}, "samples"),
    (prbs, {"names": ()}, "one or more inputs"),
    (prbs, {"names": ("a", "a")}, "different names"),
    (multisine, {"band": (1.0, 0.5)}, "must rise"),
    (multisine, {"band": (0.0, 9.0)}, "half the sampling rate"),
    (multisine, {"band": (1.0, 1.001)}, "fewer than the 2 inputs"),
    (chirp, {"band": (0.0, 1.0)}, "excluded"),
    (chirp, {"band": (0.01, 1.0)}, "does not hold one period"),
    (steps, {"levels": 1}, "2 levels or more"),
    (steps, {"hold": (0.01, 1.0)}, "hold times"),
    (steps, {"hold": (2.0, 1.0)}, "hold times"),
    (pulses, {"levels": 0}, "1 level or more"),
    (pulses, {"on": 0.01}, "shorter than"),
]


@pytest.mark.parametrize(("design", "arguments", "expected"), BAD)
def test_impossible_designs_get_one_sentence(
    design: type[Schedule], arguments: dict[str, object], expected: str
) -> None:
    with pytest.raises(UsageError, match=expected):
        design(**arguments)  # type: ignore[arg-type]


def test_a_written_schedule_can_be_read_back(tmp_path: Path) -> None:
    s = MADE["steps"]
    path = write_schedule(s, tmp_path / "plan" / "steps.csv")
    text = path.read_text()
    assert text.startswith("t,pwm_l,pwm_r\n0,0,0\n0.1,0,0\n")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows[:, 1:], s.u)
    np.testing.assert_allclose(rows[:, 0], s.t, atol=1e-9)
    logged = tmp_path / "log.csv"
    body = [f"{line},0.1,{i % 3}" for i, line in enumerate(text.splitlines()[1:])]
    logged.write_text("\n".join(["t,pwm_l,pwm_r,omega_l,omega_r", *body]))
    assert not read_file(logged).findings
