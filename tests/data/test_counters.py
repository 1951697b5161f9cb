"""Counters that start over and angles that wrap: seen, undone, said; speed from a position."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.data.io import read_file
from sysid.data.reading.counters import counted, suspected
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array
from sysid.data.unit_words import synonym
from sysid.errors import DataError, UsageError

N, DT = 2000, 0.01
GAIN, TAU = 15.0, 0.12


def driven(seed: int = 3, both_ways: bool = False) -> tuple[Array, Array]:
    """Voltage and angle [rad] of a first-order motor, exact: ω⁺ = a ω + (1 − a) K u."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-6.0 if both_ways else 1.0, 6.0, N // 40), 40)
    a = np.exp(-DT / TAU)
    w, angle = 0.0, np.zeros(N)
    for k in range(N - 1):
        angle[k + 1] = angle[k] + GAIN * u[k] * DT + TAU * (1.0 - a) * (w - GAIN * u[k])
        w = a * w + (1.0 - a) * GAIN * u[k]
    return u, angle


def counts(angle: Array, per_turn: float, bits: int, signed: bool) -> Array:
    """What a register of so many bits reads."""
    c = np.floor(angle / (2.0 * np.pi) * per_turn)
    low = 2.0 ** (bits - 1) if signed else 0.0
    return np.mod(c + low, 2.0**bits) - low


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("both_ways", [False, True])
@pytest.mark.parametrize(
    ("bits", "per_turn", "start"),
    [(8, 64, 0.0), (12, 4096, 0.0), (16, 20000, 0.0), (32, 2048, 2.0**31 / 2048 - 1.0)],
)
def test_a_register_that_starts_over_is_seen_and_undone_whole(
    bits: int, per_turn: float, start: float, both_ways: bool, signed: bool
) -> None:
    _, angle = driven(both_ways=both_ways)
    if bits == 32:  # it wraps once in a lifetime: here, a turn after the log began
        start *= 2.0 if not signed else 1.0
    angle = angle + 2.0 * np.pi * start
    truth = np.floor(angle / (2.0 * np.pi) * per_turn)
    found = counted(counts(angle, per_turn, bits, signed), ())
    assert found.period == 2.0**bits
    np.testing.assert_array_equal(np.diff(found.values), np.diff(truth))


@pytest.mark.parametrize("turn", [360.0, 2.0 * np.pi])
def test_an_angle_that_wraps_is_seen_whether_or_not_it_has_a_unit(turn: float) -> None:
    _, angle = driven(both_ways=True)
    y = angle / (2.0 * np.pi) * turn
    wrapped = np.mod(y + turn / 2.0, turn) - turn / 2.0
    for known in (False, True):
        found = counted(wrapped, (turn,) if known else (2.0 * np.pi, 360.0), not known)
        np.testing.assert_allclose(found.values - found.values[0], y - y[0], atol=1e-9 * turn)


def ordinary() -> dict[str, Array]:
    """Readings that jump, or fill a register, and are no counters."""
    rng = np.random.default_rng(5)
    square = np.repeat(rng.integers(0, 2, N // 25), 25)
    lag = np.zeros(N)
    for k in range(1, N):
        lag[k] = 0.9 * lag[k - 1] + 0.1 * 250.0 * square[k - 1]
    return {
        "switched between the ends of a byte": 255.0 * square,
        "switched, with noise, in whole numbers": np.rint(
            np.clip(255.0 * square + rng.normal(0, 6, N), 0, 255)
        ),
        "a lag in whole numbers": np.rint(lag),
        "white in whole numbers": rng.integers(0, 256, N).astype(float),
        "a square wave in degrees": 350.0 * square + rng.normal(0, 0.2, N),
        "an angle that swings by less than a turn": 150.0 * np.sin(np.arange(N) / 30.0),
        "readings lost to zero": np.where(rng.random(N) < 0.02, 0.0, np.rint(200.0 + lag)),
        "a counter that never wraps": np.floor(10.0 * driven()[1]),
        "a speed that is cut off": np.where(square > 0, 3000.0, 0.0) + np.rint(rng.normal(0, 5, N)),
    }


@pytest.mark.parametrize("what", sorted(ordinary()))
def test_what_is_no_counter_is_left_alone(what: str) -> None:
    y = ordinary()[what]
    for periods, full in (((), False), ((2.0 * np.pi, 360.0), True)):
        found = counted(y, periods, full)
        assert (found.wraps, found.resets) == (0, ())
        np.testing.assert_array_equal(found.values, y)
    assert suspected(y) == 0.0


def test_a_counter_set_back_to_zero_goes_on_from_its_last_value() -> None:
    _, angle = driven()
    truth = np.floor(angle * 300.0)
    y = truth.copy()
    y[1200:] -= y[1200]
    found = counted(y, ())
    assert found.resets == (1200,)
    # the step at the reset itself is not in the file: the one before it stands for it
    np.testing.assert_allclose(found.values, truth, atol=np.max(np.abs(np.diff(truth, n=2))))


def test_a_period_nobody_uses_is_said_and_can_be_given(tmp_path: Path) -> None:
    u, angle = driven()
    truth = np.floor(angle / (2.0 * np.pi) * 3600.0)
    log = write_log(tmp_path / "turns.csv", ("volts", "enc"), (u, np.mod(truth, 3600.0)), DT)
    seen = read_file(log, ReadOptions(outputs=("enc",)))
    (said,) = [f for f in seen.findings if f.code == "counter"]
    assert "jumps by about 3600" in said.text
    assert "`unwrap={'enc': 3600.0}`, or keep the jumps, `unwrap={'enc': None}`" in said.text
    told = read_file(log, ReadOptions(outputs=("enc",), unwrap={"enc": 3600.0}))
    np.testing.assert_allclose(told.records[0].y[:, 0], truth - truth[0])


def test_a_log_of_a_wrapping_encoder_gives_the_motor(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Speed from counts: gain and time constant as they are, and the wraps are said."""
    monkeypatch.chdir(tmp_path)
    u, angle = driven()
    y = counts(angle, 20000, 16, signed=False)
    write_log(tmp_path / "run.csv", ("volts", "enc"), (u, y), DT)
    fitted = run(
        capsys,
        *("fit", "run.csv", "--unit", "enc=counts=20000/rev", "--speed-of", "enc"),
        *("--structure", "oe", "--orders", "nb=2 nf=1 nk=1", "--json"),
    )
    document = fitted.document
    assert any("starts over every 65536" in w for w in document["warnings"])
    theta = {p["name"]: p["value"] for p in document["parameters"]}
    # one count a sample is 0.03 rad/s, uniform: the fit of 2000 samples is far better than 0.5 %
    assert (theta["b1"] + theta["b2"]) / (1.0 + theta["f1"]) == pytest.approx(GAIN, rel=5e-3)
    assert -DT / np.log(-theta["f1"]) == pytest.approx(TAU, rel=5e-3)
    shown = run(capsys, "inspect", "run.csv", "--unit", "enc=counts/20000", "--speed-of", "enc")
    assert "enc_speed" in shown.out
    assert "rad/s" in shown.out
    assert "10 outliers" not in shown.out


def test_what_cannot_be_undone_is_refused_in_a_sentence(tmp_path: Path) -> None:
    u, angle = driven()
    log = write_log(tmp_path / "a.csv", ("volts", "y"), (u, np.floor(50.0 * angle)), DT)
    with pytest.raises(DataError, match="y runs from 0 to"):
        read_file(log, ReadOptions(unwrap={"y": 256.0}))
    with pytest.raises(DataError, match="no output starts over every 256"):
        read_file(log, ReadOptions(unwrap={"": 256.0}))
    with pytest.raises(UsageError, match=r"not an output of a\.csv"):
        read_file(log, ReadOptions(unwrap={"volts": 256.0}))
    with pytest.raises(UsageError, match=r"not an output of a\.csv"):
        read_file(log, ReadOptions(speed_of=("volts",), outputs=("y",)))
    assert read_file(log, ReadOptions(unwrap={"y": None})).records[0].ny == 1


def test_unwrapping_is_undone_by_wrapping() -> None:
    y = driven(both_ways=True)[1]
    np.testing.assert_allclose(counted(np.mod(y, 7.0), (7.0,)).values, y, atol=1e-9)


@pytest.mark.parametrize(
    ("unit", "turn", "said"),
    [
        ("°T", 360.0, "was unwrapped"),
        ("deg M", 360.0, "was unwrapped"),
        ("mil", 6400.0, "was unwrapped"),
        ("Strich", 360.0, "was unwrapped"),
        ("V", 360.0, "--unwrap y=360"),
    ],
)
def test_an_angle_wraps_whatever_its_unit_is_called(
    unit: str, turn: float, said: str, tmp_path: Path, capsys: Capture
) -> None:
    u, angle = driven(both_ways=True)
    y = np.round(np.mod(angle / (2.0 * np.pi), 1.0) * turn, 1)
    path = write_log(tmp_path / "turn.csv", ["u", f"y [{unit}]"], [u, y], step=DT)
    text = " ".join(run(capsys, "inspect", path).out.split())
    assert said in text
    assert "outliers in y" not in text


@pytest.mark.parametrize("unit", ["°C", "degF", "°K", "deg R", "degC"])
def test_a_temperature_is_no_angle(unit: str) -> None:
    assert synonym(unit) != "deg"
