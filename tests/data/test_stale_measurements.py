"""Sensors slower than the log: seen with period and phase, read at their rate, masked."""

import os
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.data.facts import LogFacts
from sysid.data.io import read_file
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.stale import refreshed, refreshes, without_repeats
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.samples import inspect_samples
from sysid.errors import UsageError

MEASURED = Path(
    os.environ.get("SYSID_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")
)
N, DT = 2400, 0.05
GAIN, TAU, LATE = 0.9, 0.6, 2
NOISE = 0.05


def driven(seed: int = 1, noise: float = NOISE) -> tuple[Array, Array]:
    """Command and reading of a first-order wheel with two rows of delay, each row fresh."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-6.0, 6.0, N // 30), 30)
    a = np.exp(-DT / TAU)
    w = np.zeros(N)
    for k in range(N - 1):
        w[k + 1] = a * w[k] + (1.0 - a) * GAIN * (u[k - LATE] if k >= LATE else 0.0)
    return u, w + rng.normal(0.0, noise, N)


def held(y: Array, every: int, phase: int, jitter: int, seed: int = 2) -> tuple[Array, Array]:
    """The reading repeated until the next one, and the rows where it is fresh."""
    at = np.arange(phase, len(y), every)
    at = np.minimum(at + np.random.default_rng(seed).integers(0, jitter + 1, len(at)), len(y) - 1)
    rows = np.zeros(len(y), dtype=np.int64)
    rows[at] = at
    return y[np.maximum.accumulate(rows)], np.unique(at)


@pytest.mark.parametrize("step", [0.0, 0.02, 0.3])
@pytest.mark.parametrize(("every", "jitter"), [(2, 0), (2, 1), (3, 1), (4, 0), (5, 2), (8, 2)])
def test_a_slow_sensor_is_seen_with_its_period_and_fresh_rows(
    every: int, jitter: int, step: float
) -> None:
    u, y = driven()
    if step:
        y = step * np.round(y / step)
    y, at = held(y, every, 1, jitter)
    found = refreshed([y], [u[:, None]])
    assert found is not None
    # of a coarse sensor only intervals with large changes count, and these are the longer ones
    assert found.period == pytest.approx(every, abs=0.3)
    told = np.flatnonzero(found.fresh[0])
    assert np.isin(np.flatnonzero(np.diff(y)) + 1, told).all()
    # where two readings are equal nothing shows the second one; it is put in between
    assert abs(len(told) - len(at)) <= 0.1 * len(at)
    assert found.repeated == pytest.approx(1.0 - 1.0 / every, abs=0.06)


def not_held() -> dict[str, Array]:
    """Readings in every row that repeat now and then, or often."""
    rng = np.random.default_rng(4)
    _, y = driven()
    lost = y.copy()
    for k in np.flatnonzero(rng.random(N) < 0.3):
        lost[k] = lost[max(k - 1, 0)]
    return {
        "every reading fresh": y,
        "a coarse encoder": 2.0 * np.round(y / 2.0),
        "a few ticks": 0.5 * np.round(y / 0.5),
        "coarse, hardly any noise": 0.7 * np.round(driven(1, 1e-3)[1] / 0.7),
        "readings lost at random": lost,
        "clipped": np.clip(y, -1.0, 1.0),
        "a wheel that stands half the time": np.where(np.arange(N) % 200 < 100, 0.0, y),
        "one that follows steps at once": np.repeat(rng.uniform(-6, 6, N // 30), 30),
    }


@pytest.mark.parametrize("what", sorted(not_held()))
def test_what_is_no_slow_sensor_is_left_alone(what: str) -> None:
    u, _ = driven()
    y = not_held()[what]
    command = y if what == "one that follows steps at once" else u
    assert refreshed([y], [command[:, None]]) is None


@pytest.mark.parametrize("what", ["a coarse encoder", "a few ticks", "coarse, hardly any noise"])
def test_a_coarse_sensor_has_no_dropouts(what: str) -> None:
    u, _ = driven()
    record = Record(u=u[:, None], y=not_held()[what][:, None], dt=DT)
    found = inspect_samples([record])
    assert found.ids in ((), ("quantisation",))
    assert found.hidden == 0


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_a_coarse_sensor_on_a_jittering_clock_has_no_dropouts(tmp_path: Path, step: float) -> None:
    """Its readings are interpolated onto a grid: no lattice is left, but they are no lost ones."""
    u, y = driven()
    t = np.arange(N) * DT + np.random.default_rng(3).uniform(-0.15, 0.15, N) * DT
    columns = (t, u, step * np.round(y / step))
    path = write_log(tmp_path / "jitter.csv", ("t", "u", "omega"), columns, None)
    found = inspect_samples(read_file(path).records)
    assert "dropouts" not in found.ids
    assert found.hidden == 0


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Two wheels whose readings arrive every four rows, each in rows of its own."""
    (ul, yl), (ur, yr) = driven(1), driven(7)
    columns = (ul, ur, held(yl, 4, 1, 0)[0], held(yr, 4, 3, 0)[0])
    return write_log(tmp_path / "slow.csv", ("u_l", "u_r", "omega_l", "omega_r"), columns, DT)


def test_a_log_is_read_at_the_rate_of_its_sensors(log: Path) -> None:
    read = read_file(log)
    (record,) = read.records
    (said,) = [f for f in read.findings if f.code == "held-telemetry"]
    assert "omega_l and omega_r are refreshed every 4 rows (0.2 s, mostly in row 2, 4 of 4)" in str(
        said.text
    )
    assert record.dt == pytest.approx(0.2)
    full = read_file(log, ReadOptions(held="keep")).records[0]
    assert full.dt == pytest.approx(DT)
    first = round(record.t0 / DT)
    np.testing.assert_array_equal(record.y[:, 0], full.y[first : first + 4 * len(record) : 4, 0])
    means = full.u[first : first + 4 * len(record), 0].reshape(-1, 4).mean(axis=1)
    np.testing.assert_allclose(record.u[:, 0], means)
    with pytest.raises(UsageError, match="leaves 4"):
        read_file(log, ReadOptions(held="600"))
    for how in ("no", "0", "-1", "2.5"):
        with pytest.raises(UsageError, match="`held` is auto, keep or a number"):
            ReadOptions(held=how)


def test_a_fit_of_a_slow_sensor_finds_the_wheel(
    log: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    document = run(
        capsys,
        *("fit", log, "--input", "u_l", "--output", "omega_l", "--structure", "oe"),
        *("--orders", "nb=2 nf=1 nk=1", "--json"),
    ).document
    assert any("refreshed every 4 rows" in w for w in document["warnings"])
    theta = {p["name"]: p for p in document["parameters"]}
    gain = (theta["b1"]["value"] + theta["b2"]["value"]) / (1.0 + theta["f1"]["value"])
    assert gain == pytest.approx(GAIN, rel=0.01)
    # half of the commands change inside a period, where their mean acts, not they themselves
    assert -0.2 / np.log(-theta["f1"]["value"]) == pytest.approx(TAU, rel=0.05)
    assert document["estimation"]["fit_percent"]["omega_l"] > 95.0


def test_repeats_count_neither_as_readings_nor_as_dropouts() -> None:
    (ul, yl), (ur, yr) = driven(1), driven(7)
    (yl, at), (yr, _) = held(yl, 5, 2, 1), held(yr, 5, 4, 1)
    record = Record(
        u=np.column_stack([ul, ur]),
        y=np.column_stack([yl, yr]),
        dt=DT,
        outputs=(Channel("omega_l"), Channel("omega_r")),
    )
    found = inspect_samples([record])
    assert found.ids == ("held-telemetry",)
    assert [h.output for h in found.stale] == ["omega_l", "omega_r"]
    assert np.flatnonzero(found.weights[0][:, 0])[1:-1] == pytest.approx(at[:-1], abs=3)
    assert found.weights[0].mean() == pytest.approx(0.2, abs=0.01)
    # third differences of a wheel seen every 0.25 s hold some of its motion beside the noise
    np.testing.assert_array_less(0.8 * NOISE, LogFacts((record,)).noise)
    np.testing.assert_array_less(LogFacts((record,)).noise, 3.0 * NOISE)
    (joined,) = without_repeats([record], refreshes([record]))
    clean = driven(1, 0.0)[1]
    np.testing.assert_allclose(joined.y[at[5:-5], 0], yl[at[5:-5]])
    assert np.sqrt(np.mean((joined.y[:, 0] - clean) ** 2)) < np.sqrt(np.mean((yl - clean) ** 2))


def test_a_real_robot_whose_drive_reports_every_fifth_row() -> None:
    path = MEASURED / "drive" / "warthog_gravel_2024_8_6_longest.csv"
    if not path.exists():
        pytest.skip(f"no measured records in {MEASURED}")
    names = {"inputs": ("u_l_rad_s", "u_r_rad_s"), "outputs": ("omega_l", "omega_r")}
    kept = read_file(path, ReadOptions(**names, resample="fill", held="keep"))
    found = inspect_samples(kept.records)
    assert found.ids == ("held-telemetry",)
    assert [h.period for h in found.stale] == pytest.approx([5.0, 5.0], rel=0.01)
    assert [h.share for h in found.stale] == pytest.approx([0.8, 0.8], abs=0.01)
    assert read_file(path, ReadOptions(**names, resample="fill")).records[0].dt == 0.25
