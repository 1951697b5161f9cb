"""What is decided before a fit, and its level, does not hang on a few wild readings."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log

from sysid.data.checks.delay import estimate_delays
from sysid.data.facts import LogFacts
from sysid.data.outliers import bridged, outlier_flags
from sysid.data.record import Record
from sysid.estimation.selection.delays import chosen_delay
from sysid.estimation.selection.select_structure import select_structure
from sysid.fitting.options import FitOptions
from sysid.structures.orders import MAX_ORDER

GAIN, ZERO = 11.4, 180.0
POLE = float(np.exp(-0.1 / 1.1))


def fan(seed: int, samples: int = 1500, delay: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Duty from 60 to 250 and rpm = 11.4 duty + 180 in the steady state, read without a fault."""
    rng = np.random.default_rng(seed)
    duty = np.repeat(rng.integers(60, 250, samples // 25 + 1), 25)[:samples].astype(float)
    speed = np.full(samples, 1200.0)
    for k in range(1, samples):
        rest = GAIN * duty[max(k - delay, 0)] + ZERO
        speed[k] = rest + POLE * (speed[k - 1] - rest)
    return duty, np.round(speed + 8.0 * rng.standard_normal(samples))


def misread(rpm: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """2.3 % of the readings doubled, zero or the largest of a counter, and where."""
    rng = np.random.default_rng(seed + 100)
    kind = rng.random(len(rpm))
    bad = np.where(kind < 0.012, 2.0 * rpm, np.where(kind < 0.02, 0.0, 65535.0))
    where = kind < 0.023
    return np.where(where, bad, rpm), where


def record(duty: np.ndarray, rpm: np.ndarray) -> Record:
    return Record(duty[:, None], rpm[:, None], 0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_largest_outliers_do_not_hide_the_others(seed: int) -> None:
    duty, rpm = fan(seed)
    bad, where = misread(rpm, seed)
    flags = outlier_flags(record(duty, bad))[:, 0]
    # neighbours that are both wild, or a zero read near standstill, may be missed
    assert np.sum(flags & where) >= 0.9 * np.sum(where)
    assert not np.any(flags & ~where)
    assert not outlier_flags(record(duty, rpm)).any()


@pytest.mark.parametrize("delay", [1, 4])
def test_the_delay_is_found_behind_outliers(delay: int) -> None:
    duty, rpm = fan(4, delay=delay)
    log = record(duty, misread(rpm, 4)[0])
    assert estimate_delays(bridged([log]).records)[0].delay == delay
    found = select_structure(("oe",), [log], FitOptions())
    model = found.entries[0].model
    assert model.structure.order_values()["nk"] == delay
    assert any("were outliers" in note for note in found.entries[0].notes)


def test_inspect_speaks_of_the_dynamics_behind_outliers(tmp_path: Path, capsys: Capture) -> None:
    duty, rpm = fan(5)
    log = write_log(tmp_path / "fan.csv", ["duty", "rpm"], [duty, misread(rpm, 5)[0]])
    out = " ".join(run(capsys, "inspect", log).out.split())
    assert "Delay to rpm in samples: 1 from duty" in out
    assert "checks of dynamics ignore" in out
    assert "takes 1." in out  # 1.1 s


def test_no_delay_is_searched_with_that_orders_do_not_allow() -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal(2000)
    y = np.roll(u, MAX_ORDER + 60) + 0.1 * rng.standard_normal(2000)
    log = Record(u[:, None], y[:, None], 0.1)
    found = chosen_delay(LogFacts((log,)))
    assert found.nk == 1
    assert f"more than the {MAX_ORDER} that orders allow" in found.notes[0]


@pytest.mark.parametrize("detrend", ["auto", "level"])
def test_a_robust_fit_has_the_level_of_the_good_readings(
    detrend: str, tmp_path: Path, capsys: Capture
) -> None:
    duty, rpm = fan(6)
    found = {}
    for name, values in (("good", rpm), ("bad", misread(rpm, 6)[0])):
        log = write_log(tmp_path / f"{name}.csv", ["duty", "rpm"], [duty, values])
        fitted = run(
            capsys, "fit", log, "--structure", "oe", "--orders", "nb=1 nf=1 nk=1", "--robust",
            "--detrend", detrend, "--json", "--workspace", tmp_path / name,
        ).document  # fmt: skip
        level, unit = fitted["offsets"], np.pi / 30.0
        assert level["origin"] == "estimated"
        found[name] = level["y_std_error"][0] / unit
        # five standard errors of 8 rpm of noise on steps of hundreds of rpm
        assert fitted["properties"]["static_gain"][0][0] / unit == pytest.approx(GAIN, rel=2e-3)
        truth = GAIN * level["u_offset"][0] + ZERO
        off = abs(level["y_offset"][0] / unit - truth)
        assert off < 4.0 * found[name]  # one chance in 16 000
    # 2 % fewer readings
    assert found["bad"] == pytest.approx(found["good"], rel=0.1)
