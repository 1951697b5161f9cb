"""Logs of people who know their robot, not this tool: the time of their rows."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from hypothesis import given, settings
from hypothesis import strategies as st
from named_fields import arguments
from written_logs import lines, motor, point, put, whole

from sysid.data.finding import Severity
from sysid.data.io import read_file
from sysid.data.reading.clock import unrolled
from sysid.data.reading.dates import seconds_of
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError


@pytest.mark.parametrize(
    ("name", "step", "dt"),
    [
        ("millis", 20, 0.02),
        ("micros", 20, 2e-5),
        ("millis()", 20, 0.02),
        ("t_ms", 5, 0.005),
        ("timeMs", 5, 0.005),
        ("TimeUS", 2500, 0.0025),
        ("time [ms]", 2, 0.002),
        ("time (us)", 500, 0.0005),
        ("Time_s", 2, 2.0),
        ("t [min]", 1, 60.0),
        ("elapsed seconds", 0.5, 0.5),
        ("utc_s", 1, 1.0),
        ("Zeit in ms", 10, 0.01),
        ("Zeit", 0.01, 0.01),
        ("time", 1, 1.0),
        ("time", 4, 4.0),
        ("time", 60, 60.0),
        ("time", 50, 0.05),
        ("time", 4000, 0.004),
        ("time", 10_000_000, 0.01),
        ("timestamp", 12.5, 0.0125),
    ],
)
def test_unit_of_the_time(tmp_path: Path, name: str, step: float, dt: float) -> None:
    k, u, y = motor(60)
    log = read_file(
        put(tmp_path, f"{name},u,y\n" + lines([point(step * k, 4), whole(u), point(y)]))
    )
    assert log.records[0].dt == pytest.approx(dt, rel=1e-6)
    guessed = [f for f in log.findings if f.code == "time-unit" and "by its steps" in f.text]
    unsure = name in ("time", "timestamp") and step >= 10
    assert bool(guessed) == unsure
    for finding in guessed:  # the field in the sentence works, and is believed
        assert finding.severity is Severity.WARNING
        units = arguments(finding.advice.partition(", or `ts")[0])["units"]
        assert [*units] == [name]
        other = ReadOptions(units=units)
        assert not [
            f
            for f in read_file(tmp_path / "log.csv", other).findings
            if f.code == "time-unit" and "by its steps" in f.text
        ]


@pytest.mark.parametrize("first", [1_714_564_800, 1_714_564_800_000, 1_714_564_800_000_000])
@pytest.mark.parametrize("seconds", [0.02, 1.0, 60.0])
def test_epochs_are_told_by_their_size(tmp_path: Path, first: int, seconds: float) -> None:
    if first == 1_714_564_800 and seconds < 1.0:
        pytest.skip("whole seconds cannot hold such steps")
    k, u, y = motor(60)
    unit = 1_714_564_800 / first
    text = "timestamp,u,y\n" + lines([whole(first + k * (seconds / unit)), whole(u), point(y)])
    log = read_file(put(tmp_path, text))
    assert log.records[0].dt == pytest.approx(seconds, rel=1e-9)
    assert log.records[0].t0 == 0.0
    assert log.origin == pytest.approx(1_714_564_800)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.sampled_from([2.0**16, 2.0**24, 2.0**31, 2.0**32]),
    st.sampled_from([1.0, 1e-3, 1e-6]),
    st.floats(0.0, 1.0),
    st.integers(1, 60),
    st.integers(0, 10**6),
)
def test_rollovers_are_undone(
    modulus: float, scale: float, start: float, step: int, seed: int
) -> None:
    """Counts modulo M come back as they were, with jitter and a few missing rows."""
    rng = np.random.default_rng(seed)
    usual = step * 40  # 40 … 2400 counts: far below half of the smallest modulus
    true = np.cumsum(usual + rng.integers(-usual // 5, usual // 5 + 1, 300)).astype(float)
    true = np.delete(true, [60, 61, 62]) + np.floor(start * modulus)
    read = (true % modulus) * scale
    found, said = unrolled(read, "clock", "log", lambda i: f"log, line {i + 2}")
    wraps = int(np.count_nonzero(np.diff(read) < 0))
    # Twelve digits of the largest number are what a float leaves after the products.
    np.testing.assert_allclose(found - found[0], (true - true[0]) * scale, atol=1e-9 * true[-1])
    assert len(said) == (wraps > 0)


def test_a_damaged_stamp_is_no_rollover() -> None:
    read = 43_000.0 + 20.0 * np.arange(100)
    read[50] = 5.0  # a line that lost its first half
    found, said = unrolled(read, "ms", "log", str)
    assert not said
    np.testing.assert_array_equal(found, read)


def test_a_restart_is_no_rollover(tmp_path: Path) -> None:
    k, u, y = motor(100)
    body = lines([whole(20 * k), whole(u), point(y)])
    path = put(tmp_path, "millis,u,y\n" + body + body)
    with pytest.raises(DataError, match="several logs; `resample='auto'`"):
        read_file(path, ReadOptions(resample="refuse"))
    assert len(read_file(path).records) == 2


def test_without_a_time_it_is_said_loudly(tmp_path: Path) -> None:
    _, u, y = motor(60)
    for head in ("u,y", "sample,u,y", "nr,u,y"):
        columns = [whole(u), point(y)]
        columns = columns if head == "u,y" else [whole(np.arange(60)), *columns]
        log = read_file(put(tmp_path, head + "\n" + lines(columns)))
        (found,) = (f for f in log.findings if f.code == "sample-time")
        assert found.severity is Severity.WARNING
        assert "`ts`" in found.text
        timed = read_file(tmp_path / "log.csv", ReadOptions(ts=0.02))
        assert timed.records[0].dt == 0.02
        assert not timed.findings


@pytest.mark.parametrize(
    ("cells", "step"),
    [
        (["2024-05-01T12:00:00.100Z", "2024-05-01T12:00:00.350Z"], 0.25),
        (["2024-05-01 12:00:00+02:00", "2024-05-01 11:00:00+01:00"], 0.0),
        (["01.05.2024 12:00:00,100", "01.05.2024 12:00:00,350"], 0.25),
        (["31.12.24 23:59:59", "01.01.25 00:00:00"], 1.0),
        (["5/1/2024 11:59:59 AM", "5/1/2024 12:00:00 PM"], 1.0),
        (["13/01/2024 12:00", "14/01/2024 12:00"], 86400.0),
        (["12:00:00:120", "12:00:00:140"], 0.02),
        (["59:59.5", "60:00.0"], 0.5),
        (["20240501_120000.123", "20240501_120000.223"], 0.1),
        (["2024-05-01", "2024-05-02"], 86400.0),
    ],
)
def test_dates(cells: list[str], step: float) -> None:
    found = seconds_of(cells)
    assert isinstance(found, tuple)
    assert found[0][1] == pytest.approx(step, abs=1e-9)


def test_numbers_are_no_dates() -> None:
    assert seconds_of(["1.05", "2"]) is None
    assert seconds_of(["-3.5e-3", "2"]) is None
    assert seconds_of(["2024-05-01", "soon"]) == 1


TIMES = ("t", "time", "millis", "Zeit", "TimeUS", "sample", "k", "foo")


@pytest.mark.parametrize("name", TIMES)
@pytest.mark.parametrize("side", ["inputs", "outputs"])
def test_the_time_is_no_signal(tmp_path: Path, name: str, side: str) -> None:
    k, u, y = motor(60)
    stamps = whole(k) if name in ("sample", "k") else point(0.02 * k)
    path = put(tmp_path, f"{name},u,y\n" + lines([stamps, whole(u), point(y)]))
    instead = "`inputs='u'`" if side == "inputs" else "`outputs='y'`"
    with pytest.raises(UsageError, match=f"column {name} of log.csv .* such as {instead}"):
        read_file(path, ReadOptions(**{side: (name,)}))  # type: ignore[arg-type]


def test_the_time_is_refused_as_a_person_types_it(tmp_path: Path, capsys: Capture) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "t,u,y\n" + lines([point(0.02 * k), whole(u), point(y)]))
    found = run(capsys, "fit", path, "--output", "t", "--workspace", tmp_path / "w")
    assert found.code == 2
    assert "column t of log.csv is the time and cannot be the output" in found.err


def test_a_current_named_like_a_counter_is_no_counter(tmp_path: Path) -> None:
    _, u, y = motor(60)
    log = read_file(
        put(tmp_path, "U,I\n" + lines([whole(u), point(y)])), ReadOptions(outputs=("I",))
    )
    np.testing.assert_array_equal(log.records[0].y[:, 0], y)


def test_a_clock_too_coarse_is_left_where_the_sample_time_is_given(tmp_path: Path) -> None:
    k, u, y = motor(200)
    path = put(tmp_path, "Zeit,u,y\n" + lines([whole(k // 50), whole(u), point(y)]))
    with pytest.raises(DataError, match=r"time stays at.*`ts`"):
        read_file(path)
    assert read_file(path, ReadOptions(ts=0.02)).records[0].dt == 0.02


def test_two_machines_in_one_table_are_said(tmp_path: Path) -> None:
    k, u, y = motor(120)
    pump = np.array(["P1", "P2"])[k % 2].tolist()
    path = put(tmp_path, "t,pump,u,y\n" + lines([whole(k // 2), pump, whole(u), point(y)]))
    with pytest.raises(DataError, match=r"column pump separates 2 series \(P1, P2\)"):
        read_file(path)


@pytest.mark.parametrize("step", [0.01, 0.013])
def test_two_machines_with_stamps_of_their_own_are_said(tmp_path: Path, step: float) -> None:
    """Rows in turn are no log of one machine, however even their clock; nor by interpolation."""
    k, u, y = motor(240)
    valve = np.array(["north", "south"])[k % 2].tolist()
    other = np.where(k % 2, y, 3.0 * y + 100.0)
    t = 0.02 * (k // 2) + step * (k % 2)
    body = lines([point(t, 4), valve, whole(np.where(k % 2, u, 0.5 * u)), point(other)])
    path = put(tmp_path, "t,valve,u,y\n" + body)
    for options in (ReadOptions(), ReadOptions(resample="fill")):
        with pytest.raises(DataError, match=r"column valve separates 2 series \(north, south\)"):
            read_file(path, options)


def test_a_clock_that_is_called_by_its_unit(tmp_path: Path) -> None:
    """``s`` may be a way as well; a way rises in no steps that are all alike."""
    k, u, y = motor(120)
    rest = [whole(u), point(y)]
    even = put(tmp_path, "s,u,y\n" + lines([point(0.01 * k), *rest]), "even.csv")
    assert read_file(even).records[0].dt == pytest.approx(0.01)
    way = 0.01 * k + 0.001 * np.sin(k)
    travelled = put(tmp_path, "s,u,y\n" + lines([point(way, 4), *rest]), "way.csv")
    assert read_file(travelled).records[0].dt == 1.0


def test_words_that_change_with_the_rows_of_one_machine_are_left(tmp_path: Path) -> None:
    k, u, y = motor(240)
    phase = np.array(["tick", "tock"])[k % 2].tolist()
    path = put(tmp_path, "t,phase,u,y\n" + lines([point(0.02 * k), phase, whole(u), point(y)]))
    assert len(read_file(path).records[0]) == 240


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["00:58", "01:00", "24:59", "25:01"], [0.0, 2.0, 1441.0, 1443.0]),
        (["99:59.5", "100:00.0"], [0.0, 0.5]),
        (["23:59:59", "24:00:01", "49:30:00"], [0.0, 2.0, 91801.0]),
    ],
)
def test_time_since_a_start_goes_beyond_a_day(cells: list[str], expected: list[float]) -> None:
    """A stopwatch in minutes and seconds, and one that ran for two nights."""
    dates = seconds_of(cells)
    assert not isinstance(dates, int)
    assert dates is not None
    np.testing.assert_allclose(dates.elapsed, expected)


@pytest.mark.parametrize("cells", [["12:00", "25:00", "13:00"], ["12:00", "12:61"]])
def test_a_wrong_time_of_day_is_said(cells: list[str]) -> None:
    assert seconds_of(cells) == 1


def test_rows_that_begin_with_empty_cells_are_no_titles(tmp_path: Path) -> None:
    k, u, y = motor(60)
    body = lines([point(0.02 * k), whole(u), point(y)])
    path = put(tmp_path, "t,u,y\n-0.04,,\n-0.02,,\n" + body)
    log = read_file(path)
    assert len(log.records[0]) == 60
    assert any("2 rows hold none of the columns used" in note for note in log.notes)


def test_a_ramp_is_a_signal_where_the_sample_time_is_given(tmp_path: Path) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "ramp,u,y\n" + lines([point(0.02 * k), whole(u), point(y)]))
    record = read_file(path, ReadOptions(inputs=("ramp",), outputs=("y",), ts=0.5)).records[0]
    assert record.dt == 0.5
    np.testing.assert_allclose(record.u[:, 0], 0.02 * k, atol=1e-12)


def test_a_signal_with_the_name_of_a_time_is_a_signal(tmp_path: Path) -> None:
    k, u, y = motor(60)
    path = put(tmp_path, "millis,n,T\n" + lines([whole(20 * k), point(y), whole(u)]))
    record = read_file(path, ReadOptions(inputs=("T",), outputs=("n",))).records[0]
    np.testing.assert_array_equal(record.y[:, 0], y)
    assert record.dt == 0.02
