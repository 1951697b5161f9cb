"""Dead times with intervals, what changes within a log, and what looks like it and is none."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import cont2discrete

from sysid.data.facts import LogFacts, without_drift
from sysid.data.record import Array, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.samples import inspect_samples


def steps(rng: np.random.Generator, samples: int, hold: int, low: float, high: float) -> Array:
    return np.repeat(rng.uniform(low, high, samples // hold + 1), hold)[:samples]


def lag(u: Array, lags: Array | float, dead: int = 0) -> Array:
    """A first-order lag of so many samples, and a dead time: y(t + 1) from u(t - dead)."""
    a = np.exp(-1.0 / np.broadcast_to(lags, u.shape))
    late = np.concatenate([np.full(dead, u[0]), u])[: len(u)]
    y = np.full(len(u), late[0])
    for k in range(1, len(u)):
        y[k] = a[k] * y[k - 1] + (1.0 - a[k]) * late[k - 1]
    return y


def plant(kind: str, seed: int) -> Record:
    """Constant logs of 2 000 samples; of the nonlinear ones the operating region changes."""
    rng = np.random.default_rng([3, seed])
    u = steps(rng, 2000, 25, -1.0, 1.0)
    if kind in ("dead zone", "saturation"):
        u = u * np.where(np.arange(2000) < 1000, 0.35, 1.0)
    acting = {
        "dead zone": np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0),
        "saturation": np.clip(u, -0.6, 0.6),
    }.get(kind, u)
    y, noise = lag(acting, 8.0, 2), 0.02 * rng.standard_normal(2000)
    if kind == "coloured":
        noise = lag(0.2 * rng.standard_normal(2000), 20.0)
    y = y + noise
    return Record(u, np.round(y, 1) if kind == "coarse" else y, 0.05)


def controlled(seed: int, dead: int) -> Record:
    """PI control of a lag whose sensor is noisy."""
    rng = np.random.default_rng([4, seed])
    wanted, u, y, x, integral = steps(rng, 2000, 150, 10.0, 60.0), [0.0] * dead, [], 0.0, 0.0
    for k in range(2000):
        y.append(x + 0.15 * rng.standard_normal())
        integral += 0.03 * (wanted[k] - y[-1])
        u.append(0.8 * (wanted[k] - y[-1]) + integral)
        x += 0.05 * (0.8 * u[k] - x)
    return Record(np.array(u[dead:]), np.array(y), 0.01)


@pytest.mark.parametrize("dead", [0, 4])
def test_feedback_fakes_no_delay(dead: int) -> None:
    for seed in range(3):
        (d,) = LogFacts((controlled(seed, dead),)).delays or ()
        assert d.low <= dead + 1 <= d.high
        assert d.high - d.low <= 2


@pytest.mark.parametrize("dead", [0, 3])
def test_a_second_lag_is_no_dead_time(dead: int) -> None:
    """Two lags of 12 and 5.5 samples behind a zero-order hold, exactly discretised."""
    rng = np.random.default_rng(11)
    u = steps(rng, 2000, 60, -1.0, 1.0)
    rates, gains = np.array([[-1 / 12, 0.0], [1 / 5.5, -1 / 5.5]]), np.array([[1 / 12], [0.0]])
    a, b, *_ = cont2discrete((rates, gains, np.eye(2), 0.0 * gains), 1.0)
    x, y = np.zeros(2), np.zeros(2000)
    for k in range(dead, 2000):
        y[k] = x[1]
        x = a @ x + b[:, 0] * u[k - dead]
    (d,) = LogFacts((Record(u, y + 0.002 * rng.standard_normal(2000), 1.0),)).delays or ()
    assert d.delay == dead + 1
    assert d.dead_s == pytest.approx(dead, abs=3.0 * d.error_s)
    assert d.error_s < 0.1


def test_each_input_has_its_own_dead_time() -> None:
    """A valve through 31 samples beside a slow disturbance without any."""
    rng = np.random.default_rng(5)
    valve = steps(rng, 4000, 200, 0.0, 90.0)
    outdoor = 8.0 + 3.0 * np.sin(np.arange(4000) / 700.0) + lag(rng.standard_normal(4000), 300.0)
    y = 0.33 * lag(valve, 60.0, 31) + 0.5 * lag(outdoor, 90.0) + 0.05 * rng.standard_normal(4000)
    first, second = LogFacts((Record(np.column_stack([valve, outdoor]), y, 1.0),)).delays or ()
    assert first.delay == 32
    assert first.dead_s == pytest.approx(31.0, abs=3.0 * first.error_s)
    assert second.low <= 1


@pytest.mark.parametrize("kind", ["plain", "coloured", "coarse", "dead zone", "saturation"])
def test_nothing_changes_in_constant_logs(kind: str) -> None:
    """Of 298 other logs of ten such kinds none had a change, and five a drift (1.7 %)."""
    for seed in range(3):
        facts = LogFacts((plant(kind, seed),))
        assert not facts.changes
        assert not facts.drifts.any()


def ramped(seed: int) -> Record:
    """A drive that changes its frequency slowly, and a lag behind it: 40 steps of all sizes."""
    rng = np.random.default_rng([7, seed])
    u = steps(rng, 4000, 100, 0.0, 50.0)
    slow = u.copy()
    for k in range(1, 4000):
        slow[k] = slow[k - 1] + np.clip(u[k] - slow[k - 1], -1.1, 1.1)
    return Record(u, 29.0 * lag(slow, 5.6) + 2.0 * rng.standard_normal(4000), 0.05)


def test_a_limit_of_a_rate_is_no_change() -> None:
    """Without ramps beside it these three had a time constant that changed at one time."""
    for seed in (3, 7, 11):
        assert not LogFacts((ramped(seed),)).changes


def test_a_step_of_gain_and_time_constant_is_dated(tmp_path: Path, capsys: Capture) -> None:
    rng = np.random.default_rng(6)
    u, later = steps(rng, 3000, 60, 2.0, 12.0), np.arange(3000) >= 1700
    a, y, x = np.exp(-1.0 / np.where(later, 20.0, 13.0)), [], 0.0
    for k in range(3000):
        y.append(x)
        x = a[k] * x + (1.0 - a[k]) * (105.0 if later[k] else 150.0) * u[k]
    speed = np.array(y) + 3.0 * rng.standard_normal(3000)
    (change,) = LogFacts((Record(u, speed, 0.02),)).changes
    gain, time_constant = change.parts
    assert change.at == pytest.approx(34.0, abs=max(change.error, 0.04))
    assert gain.change == pytest.approx(-0.3, abs=0.01)
    assert time_constant.change == pytest.approx(20.0 / 13.0 - 1.0, abs=4.0 * time_constant.error)
    log = write_log(tmp_path / "brake.csv", ["volts", "speed"], [u, speed])
    said = " ".join(run(capsys, "inspect", log).out.split())
    assert "the gain from volts to speed falls by" in said


def test_warming_is_a_trend_and_no_step() -> None:
    rng = np.random.default_rng(7)
    u = steps(rng, 3000, 25, 0.2, 1.0)
    y = lag(u * (1.0 - 0.2 * np.arange(3000) / 3000.0), 8.0) + 0.01 * rng.standard_normal(3000)
    (change,) = LogFacts((Record(u, y, 0.05),)).changes
    assert not change.is_step
    assert change.parts[0].change == pytest.approx(-0.2, abs=0.02)


def test_a_growing_spool_is_not_called_constant(tmp_path: Path, capsys: Capture) -> None:
    """Paper winds the spool that draws it: its speed grows with what it has wound, as a curve may.

    r² = r₀² + d L/π; without the paper (d = 0) the log is constant.
    """
    said = {}
    for thick in (0.0, 7.5e-5):
        rng = np.random.default_rng(12)
        volts, turning, wound, y = np.zeros(0), 0.0, 0.0, np.empty(4200)
        while len(volts) < 4200:
            level = rng.choice([4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 8.0])
            volts = np.append(volts, np.full(int(rng.uniform(30, 150)), level))
        for k in range(4200):
            radius = np.sqrt(0.022**2 + thick * wound / np.pi)
            y[k] = 1000.0 * turning * radius + 0.25 * rng.standard_normal()
            for _ in range(5):
                turning += 0.02 / 0.7 * (0.42 * volts[k] - turning)
                wound += 0.02 * turning * radius
        path = write_log(tmp_path / "roll.csv", ["volts", "speed"], [volts[:4200], y], 0.1)
        said[thick] = " ".join(run(capsys, "inspect", path).out.split())
    assert "are constant" in said[0.0]
    assert "are constant" not in said[7.5e-5]
    assert "the gain from volts to speed rises by" in said[7.5e-5]


def beside(kind: str, seed: int) -> tuple[Array, Array, Array]:
    """Input, output and another column: it acts on gain or level, is a view of the output, or a
    slow one beside a load that is engaged."""
    rng = np.random.default_rng([10, seed])
    u, rope = steps(rng, 3000, 25, -1.0, 1.0), lag(steps(rng, 3000, 400, 2.0, 9.0), 40.0)
    load = np.where(np.arange(3000) < 1700, 1.0, 0.75)
    gain = {"gain": rope / 5.0, "load": load}.get(kind, 1.0)
    y = lag(u * gain, 8.0) + 0.02 * rng.standard_normal(3000)
    y = y + 0.1 * lag(rope, 8.0) * (kind == "level")
    views = {"copy": y + 0.02 * rng.standard_normal(3000), "square": y**2, "late": lag(u, 20.0)}
    return u, y, views.get(kind, np.cumsum(rng.standard_normal(3000)) if kind == "load" else rope)


@pytest.mark.parametrize("kind", ["gain", "level", "load", "copy", "square", "late", "rope"])
def test_a_change_goes_with_an_unused_column_before_time(kind: str) -> None:
    """Of 700 other logs with a column that has no say (ten kinds) none is told."""
    for seed in range(2):
        u, y, column = beside(kind, seed)
        log = Record(u, y, 0.05, unused=column, unused_names=("rope",))
        changes = LogFacts((log,)).changes
        assert len(changes) == (kind in ("gain", "level", "load"))
        assert all((c.column is None) == (kind == "load") == c.is_step for c in changes)
        assert all(c.level == (kind == "level") for c in changes)
        if kind == "gain":
            (part,) = changes[0].parts
            name, low, high = changes[0].column or ("", 0.0, 0.0)
            assert name == "rope"
            # the product acts before the lag, and is fitted behind it
            assert (part.before, part.after) == pytest.approx((low / 5.0, high / 5.0), rel=0.1)


def test_an_unused_column_in_rows_of_its_own_is_named(tmp_path: Path, capsys: Capture) -> None:
    u, y, rope = beside("gain", 3)
    path = tmp_path / "crane.csv"
    rows = [f"{0.05 * k:.2f},{u[k]:.4f},{y[k]:.4f}," for k in range(3000)]
    rows[::10] = [
        f"{row}\n{0.05 * k + 0.02:.2f},,,{rope[k]:.3f}" for k, row in [*enumerate(rows)][::10]
    ]
    path.write_text("\n".join(["t,u,y,rope_m", *rows]) + "\n")
    said = " ".join(run(capsys, "inspect", path, "--input", "u", "--output", "y").out.split())
    assert "the gain from u to y rises from" in said
    assert "as rope_m, not used, goes from" in said
    assert "narmax takes it as an input: --input u,rope_m" in said


@pytest.mark.parametrize("samples", [5000, 3600])
def test_a_drift_is_seen_and_taken_out(samples: int) -> None:
    rng = np.random.default_rng(8)
    u = steps(rng, samples, 240, 10.0, 70.0)
    room = 20.0 + 2.0 * np.sin(np.arange(samples) / 750.0)
    y = np.round(1.3 * lag(lag(u, 100.0, 4), 6.0) + room + 0.1 * rng.standard_normal(samples), 1)
    log = Record(u, y, 5.0)
    assert LogFacts((log,)).drifts[0] == pytest.approx(4.0, rel=0.1)
    assert not LogFacts((without_drift(log),)).drifts.any()


@pytest.mark.slow
def test_a_diagnosis_says_that_a_level_drifts() -> None:
    """What is named beside a drift is named with what takes the drift out."""
    rng = np.random.default_rng(9)
    u = steps(rng, 1200, 60, 10.0, 70.0)
    room = 20.0 + 2.0 * np.sin(np.arange(1200) / 180.0)
    y = lag(u, 12.0) + room + 0.1 * rng.standard_normal(1200)
    changes = diagnose([Record(u, y, 5.0)]).changes
    assert any("drifts by 4" in c and "remove_drift" in c for c in changes)


def test_equal_neighbours_within_the_dead_time_are_no_dropouts() -> None:
    """A rounded sensor repeats itself before a step shows; of 600 such logs none is accused."""
    for seed in range(4):
        rng = np.random.default_rng([9, seed])
        u = steps(rng, 2000, 12, -1.0, 1.0)
        y = np.round(50.0 * lag(u, 1.5, 3) + 0.7 * rng.standard_normal(2000))
        assert not inspect_samples([Record(u, y, 0.01)]).lost
