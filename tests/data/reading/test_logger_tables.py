"""What loggers write beside the numbers: rows on processing, counters of rows, units in cells."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.finding import Severity
from sysid.data.inspection import inspect_records
from sysid.data.io import read_file
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, SysidError

N = 200


def put(folder: Path, text: str, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def campbell(
    processing: str = '"","","Smp","Avg"', units: str = '"TS","RN","volts","m/s^2"'
) -> str:
    head = [
        '"TOA5","Mast7","CR1000X","20331","CR1000X.Std.05.01","CPU:mast.CR1X","4411","Vib"',
        '"TIMESTAMP","RECORD","U","Accel_X"',
        units,
        processing,
    ]
    rows = [
        f'"2026-02-01 03:{k // 60:02d}:{k % 60:02d}",{88000 + k},{np.sin(0.3 * k):.4f},'
        f"{np.cos(0.3 * k):.4f}"
        for k in range(N)
    ]
    return "\r\n".join([*head, *rows]) + "\r\n"


@pytest.mark.parametrize("processing", ['"","","Smp","Avg"', '"","","Min","Max"', '"","","",WVc'])
def test_campbell_tables_are_read(tmp_path: Path, processing: str) -> None:
    log = read_file(put(tmp_path, campbell(processing), "tower.dat"))
    record = log.records[0]
    assert record.input_names == ("U",)
    assert record.output_names == ("Accel_X",)
    assert record.outputs[0].unit == "m/s^2"
    assert record.dt == pytest.approx(1.0)
    assert len(record) == N
    assert "RECORD" in " ".join(log.notes)  # not used, and said


def test_a_row_of_minutes_is_one_of_units(tmp_path: Path) -> None:
    rows = "\n".join(f"{k / 60:.6f},{k % 7},{k % 5}" for k in range(N))
    record = read_file(put(tmp_path, f"Run\nTime,u,y\nmin,,\n{rows}\n")).records[0]
    assert record.dt == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    "counter", ["RECORD", "Nr.", "Frame", "lfd.", "lfd. Nr.", "field.header.seq"]
)
@pytest.mark.parametrize("signals", ["alpha beta", "alpha beta gamma"])
def test_counters_of_rows_are_no_signals(tmp_path: Path, counter: str, signals: str) -> None:
    """Neither taken nor offered, wherever they stand."""
    names = signals.split()
    rng = np.random.default_rng(3)
    values = rng.normal(size=(N, len(names)))
    for order in ([counter, "t"], ["t", counter]):
        lines = [",".join([*order, *names])]
        for k, row in enumerate(values):
            own = {counter: str(5000 + k), "t": f"{0.1 * k:.1f}"}
            lines.append(",".join([*(own[n] for n in order), *(f"{v:.4f}" for v in row)]))
        path = put(tmp_path, "\n".join(lines) + "\n")
        with pytest.raises(SysidError) as refused:
            read_file(path)
        example = str(refused.value).split("for example ")[1]
        assert example.startswith("`inputs='alpha', outputs='beta'`")


def test_a_counter_beside_one_signal_is_a_time_series(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.1 * k:.1f},{k},{np.sin(k):.4f}" for k in range(N))
    record = read_file(put(tmp_path, f"t,RECORD,accel\n{rows}\n")).records[0]
    assert record.output_names == ("accel",)
    assert not record.input_names


def test_a_column_called_count_that_does_not_count_rows_is_a_signal(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    count = np.cumsum(rng.integers(-3, 9, N))
    rows = "\n".join(f"{0.1 * k:.1f},{k % 9},{c}" for k, c in enumerate(count))
    record = read_file(put(tmp_path, f"t,u,count\n{rows}\n")).records[0]
    assert record.output_names == ("count",)


def test_text_and_clocks_are_not_offered(tmp_path: Path) -> None:
    rows = "\n".join(
        f"{0.1 * k:.1f},{k % 2},base,{np.sin(k):.3f},{np.cos(k):.3f}" for k in range(N)
    )
    with pytest.raises(DataError, match=r"can be barrier, alpha or beta;"):
        read_file(put(tmp_path, f"t,barrier,frame_id,alpha,beta\n{rows}\n"))


@pytest.mark.parametrize(
    ("cell", "dt"),
    [
        ("{0:g} sec", 0.25),
        ("{0:g} s", 0.25),
        ("{0:g} min", 15.0),
        ("{0:g}ms", 0.25e-3),
        ("{0:g} hr", 900.0),
        ("00:00:{0:05.2f}", 0.25),
    ],
)
@pytest.mark.parametrize(("sep", "point"), [(",", "."), (";", ","), ("\t", ".")])
def test_durations_with_a_unit_behind_the_number(
    tmp_path: Path, cell: str, dt: float, sep: str, point: str
) -> None:
    """As MATLAB's writetimetable writes durations."""
    rows = [sep.join(["Time", "u", "y"])]
    for k in range(N):
        cells = [cell.format(0.25 * k % 60 if ":" in cell else 0.25 * k), f"{k % 7}.5", f"{k % 5}"]
        rows.append(sep.join(c.replace(".", point) for c in cells))
    log = read_file(put(tmp_path, "\n".join(rows) + "\n"))
    assert log.records[0].dt == pytest.approx(dt, rel=1e-6)
    if ":" not in cell:
        assert "units from behind the numbers: Time in" in " ".join(log.notes)


def test_units_behind_the_numbers_of_any_column(tmp_path: Path) -> None:
    rows = "\n".join(f"{k},{k % 7}.5 mV,{'' if k == 3 else f'{k % 5} rpm'}" for k in range(N))
    path = put(tmp_path, f"t,u,y\n{rows}\n")
    record = read_file(path, ReadOptions(resample="fill")).records[0]
    assert record.inputs[0].unit == "V"
    assert record.u[1, 0] == pytest.approx(1.5e-3)
    assert record.outputs[0].unit == "rad/s"


def test_two_units_in_one_column_are_refused(tmp_path: Path) -> None:
    rows = "\n".join(f"{k} {'ms' if k < 100 else 's'},{k % 7},{k % 5}" for k in range(N))
    with pytest.raises(DataError, match=r"line 102, column t: '100 s' is not in ms"):
        read_file(put(tmp_path, f"t,u,y\n{rows}\n"))


def test_text_that_begins_as_a_measurement_stays_text(tmp_path: Path) -> None:
    rows = "\n".join(f"{k},{k % 7},{k % 5},{'5 V' if k < 9 else 'off'}" for k in range(N))
    assert read_file(put(tmp_path, f"t,u,y,range\n{rows}\n")).records[0].output_names == ("y",)


@pytest.mark.parametrize("wraps", [True, False])
def test_a_counter_that_waits_at_its_start_does_not_clip(tmp_path: Path, wraps: bool) -> None:
    """60 rows of rest."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(10, 90, 30), 20)
    u[:60] = 0.0
    count = 20000 + np.floor(np.cumsum(u * (2.0 if wraps else 0.2))).astype(int)
    shown = (count + 32768) % 65536 - 32768
    rows = "\n".join(f"{k},{a:.1f},{b}" for k, (a, b) in enumerate(zip(u, shown, strict=True)))
    log = read_file(put(tmp_path, f"t,u,enc\n{rows}\n"))
    said = inspect_records(LogFacts(log.records, log.findings))
    assert not [f for f in said if f.code == "saturation" and f.severity is not Severity.OK]


def test_a_sensor_at_its_limit_still_clips(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    y = np.minimum(np.cumsum(rng.normal(size=600)), 5.0)
    y[:40] = 5.0
    rows = "\n".join(f"{k},{k % 7},{b:.4f}" for k, b in enumerate(y))
    log = read_file(put(tmp_path, f"t,u,y\n{rows}\n"))
    said = inspect_records(LogFacts(log.records, log.findings))
    assert [f for f in said if f.code == "saturation" and f.severity is not Severity.OK]


def ros_log(stamp: str, broken: int | None = None) -> str:
    """Reception jitters by a tenth of the sample time; the sender's stamp does not."""
    rng = np.random.default_rng(7)
    pair = stamp == "header.stamp.secs"
    names = [stamp, "header.stamp.nsecs"] if pair else [stamp]
    rows = [",".join(["%time", "field.header.seq", *names, "u", "y"])]
    for k in range(N):
        ns = 1777777777123456789 + k * 10_000_000
        own = [str(ns // 10**9), str(ns % 10**9)] if pair else [str(ns)]
        own = ["0"] * len(own) if broken == k else own
        heard = ns + int(rng.uniform(5e5, 1.5e6))
        rows.append(",".join([str(heard), str(k), *own, f"{k % 7}", f"{k % 5}"]))
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("stamp", ["field.header.stamp", "header.stamp.secs"])
def test_the_senders_stamp_goes_before_the_recorders(tmp_path: Path, stamp: str) -> None:
    path = put(tmp_path, ros_log(stamp))
    log = read_file(path)
    assert not [f for f in log.findings if f.code == "jitter"]
    assert log.records[0].dt == pytest.approx(0.01, rel=1e-6)
    assert f"the time is {stamp}, the sender's stamp; time," in " ".join(log.notes)
    asked = read_file(path, ReadOptions(time="time"))
    assert [f for f in asked.findings if f.code == "jitter"]


@pytest.mark.parametrize("stamp", ["field.header.stamp", "header.stamp.secs"])
def test_a_senders_stamp_with_a_hole_is_left(tmp_path: Path, stamp: str) -> None:
    log = read_file(put(tmp_path, ros_log(stamp, broken=50)))
    assert "sender's own stamp" not in " ".join(log.notes)
    assert log.records[0].dt == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("unit", "seconds", "digits", "step", "shown"),
    [
        ("min", 60.0, 4, 5.0, "5 s"),
        ("min", 60.0, 2, 5.0, "5 s"),
        ("h", 3600.0, 4, 10.0, "10 s"),
        ("s", 1.0, 3, 1.0 / 30.0, "0.03333 s"),
        ("min", 60.0, 4, 4.98, "4.98 s"),
    ],
)
def test_rounded_stamps_tell_their_round_period(
    tmp_path: Path, unit: str, seconds: float, digits: int, step: float, shown: str
) -> None:
    """A mean of 200 rounded steps is right to a last digit / 200; a round period exactly."""
    rows = "\n".join(f"{k * step / seconds:.{digits}f},{k % 7},{k % 5}" for k in range(N))
    log = read_file(put(tmp_path, f"Zeit ({unit}),u,y\n{rows}\n"))
    round_one = float(f"{step:.2g}") == step
    slack = 0.0 if round_one else seconds * 10.0**-digits / (N - 1)
    assert abs(log.records[0].dt - step) <= slack
    assert not [f for f in log.findings if f.code == "jitter"]
    assert f"{log.records[0].dt:.4g} s" == shown
