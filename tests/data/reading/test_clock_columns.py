"""Clocks in two columns, dates whose day and month could be exchanged, clocks that are set back."""

import datetime as dt
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from written_logs import lines, motor, point, put, whole

from sysid.data.io import LogFile, read_file
from sysid.data.reading.dates import ORDERS, Dates, seconds_of
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError

START = dt.datetime(2026, 3, 4, 23, 58)


def instants(seconds: float, rows: int, start: dt.datetime = START) -> list[dt.datetime]:
    return [start + dt.timedelta(seconds=seconds * k) for k in range(rows)]


def written(folder: Path, head: str, *columns: Sequence[str], options: ReadOptions) -> LogFile:
    """A log of u and y behind these columns."""
    _, u, y = motor(len(columns[0]))
    return read_file(put(folder, f"{head},u,y\n" + lines([*columns, whole(u), point(y)])), options)


def time_decision(log: LogFile) -> str:
    return next(d.value for d in log.records[0].read_as if d.what == "time")


@pytest.mark.parametrize("time", [None, "clock", "day"])
@pytest.mark.parametrize(
    ("head", "day", "clock"),
    [
        ("Date,UTC", "%d.%m.%Y", "%H:%M:%S"),
        ("日付,時刻", "%Y/%m/%d", "%H:%M:%S.%f"),
        ("Jour,Heure", "%d/%m/%Y", "%H:%M:%S"),
        ("day,hms", "%m-%d-%y", "%I:%M:%S %p"),
        ("ymd,hms", "%Y%m%d", "%H:%M:%S"),
    ],
)
def test_a_date_and_a_time_of_day_are_one_clock(
    tmp_path: Path, head: str, day: str, clock: str, time: str | None
) -> None:
    """Across midnight, with three rows missing, whichever of the two is named."""
    at = instants(1.0, 200)
    del at[60:63]
    names = head.split(",")
    named = {None: None, "day": names[0], "clock": names[1]}[time]
    columns = [[t.strftime(form) for t in at] for form in (day, clock)]
    log = written(tmp_path, head, *columns, options=ReadOptions(time=named))
    assert [len(r) for r in log.records] == [200]
    assert log.records[0].dt == 1.0
    assert time_decision(log).startswith(f"{names[0]} + {names[1]} [dates")
    assert not any(n in note for n in names for note in log.notes if "not used" in note)


def test_a_date_is_no_signal(tmp_path: Path) -> None:
    at = [f"{t:%H:%M:%S}" for t in instants(1.0, 60)]
    k, _, _ = motor(60)
    with pytest.raises(UsageError, match=r"column UTC of log\.csv .* cannot be the output"):
        written(tmp_path, "t,UTC", point(0.5 * k), at, options=ReadOptions(outputs=("UTC",)))


def test_where_the_time_stands_the_clock_that_moves_is_named(tmp_path: Path) -> None:
    k, _, _ = motor(60)
    columns = (["2026-03-04"] * 60, whole(500 + 3 * k))
    with pytest.raises(DataError, match=r"stays at 0 .*`time='ticks'`, or count the rows"):
        written(tmp_path, "date,ticks", *columns, options=ReadOptions())
    log = written(tmp_path, "date,ticks", *columns, options=ReadOptions(time="ticks"))
    assert log.records[0].dt == 3.0


@pytest.mark.parametrize("written_as", [*ORDERS])
@pytest.mark.parametrize(
    ("days", "step"), [((5, 10), 3600.0), ((1, 4), 900.0), ((9, 12), 6 * 3600.0)]
)
def test_the_order_of_day_and_month_is_that_of_the_steadier_clock(
    written_as: str, days: tuple[int, int], step: float
) -> None:
    first = dt.datetime(2026, days[1], days[0])
    at = instants(step, int(3 * 86400 / step), first)
    form = {"dmy": "%d/%m/%y %H:%M", "mdy": "%m/%d/%Y %I:%M %p", "ymd": "%y/%m/%d %H:%M"}[
        written_as
    ]
    found = seconds_of([t.strftime(form) for t in at])
    assert isinstance(found, Dates)
    np.testing.assert_array_equal(found.elapsed, step * np.arange(len(at)))
    assert found.order == written_as or max(days) + 2 > 12


def test_the_order_is_said_and_can_be_given(tmp_path: Path) -> None:
    """A day's first rows of 1/1, 2/1, 3/1 …: each a day, unless they are said to be months."""
    at = [f"{k}/1/2026" for k in range(1, 13)]
    seen = written(tmp_path, "day", at, options=ReadOptions(resample="fill"))
    assert time_decision(seen) == "day [dates, day/month/year]"
    assert seen.records[0].dt == 86400.0
    given = seconds_of(at, "mdy")
    assert isinstance(given, Dates)
    assert given.elapsed[-1] == 334 * 86400.0
    asked = ReadOptions(resample="fill", units={"day": "mdy"})
    told = written(tmp_path, "day", at, options=asked)
    assert time_decision(told) == "day [dates, month/day/year]"
    with pytest.raises(DataError, match="'1/1/2026' is not a date in the order year/month/day"):
        written(tmp_path, "day", at, options=ReadOptions(units={"day": "ymd"}))


def stamps(*pieces: tuple[float, float], step: float = 5.0) -> np.ndarray:
    return np.concatenate([np.arange(a, b, step) for a, b in pieces])


@pytest.mark.parametrize(
    ("t", "pieces", "said"),
    [
        (stamps((0, 7200), (3600, 15000)), [1440, 2280], "line 1442: the clock goes back by 1 h;"),
        (stamps((0, 4e5), (396400, 5e5)), [80000, 20720], "goes back by 1 h;"),  # under 1 % of it
        (stamps((0, 300), (240, 5000), step=15.0), [20, 318], "goes back by 60 s;"),
        (stamps((1000, 2000), (1500, 2500)), [200, 200], "goes back by 500 s;"),
        (stamps((100, 500), (50, 600), (300, 900)), [80, 110, 120], "(the first of 2 times)"),
    ],
)
def test_a_clock_set_back_cuts_the_log(
    tmp_path: Path, t: np.ndarray, pieces: list[int], said: str
) -> None:
    log = written(tmp_path, "t_s", point(t), options=ReadOptions())
    assert [len(r) for r in log.records] == pieces
    (found,) = (f for f in log.findings if f.code == "clock-set-back")
    assert said in found.text


RNG = np.random.default_rng(4)
DISORDER = {
    "shuffled": RNG.permutation(600),
    "short blocks": np.concatenate([np.arange(30 * k, 30 * k + 30) for k in RNG.permutation(20)]),
    "often exchanged": np.arange(600) ^ (np.arange(600) % 20 < 2),
}


@pytest.mark.parametrize("order", [*DISORDER])
def test_rows_in_disorder_are_still_refused(tmp_path: Path, order: str) -> None:
    t = 5.0 * DISORDER[order]
    with pytest.raises(DataError, match="sort the rows"):
        written(tmp_path, "t", point(t), options=ReadOptions())


@pytest.mark.parametrize("values", [(301, 300), (1, 301), (3000, 301), (300, 30, 302, 303)])
def test_a_damaged_or_exchanged_stamp_is_no_other_experiment(
    tmp_path: Path, values: tuple[int, ...]
) -> None:
    t = 5.0 * np.arange(600)
    t[300 : 300 + len(values)] = 5.0 * np.array(values)
    log = written(tmp_path, "t", point(t), options=ReadOptions())
    assert [len(r) for r in log.records] == [600]
    assert not any(f.code == "clock-set-back" for f in log.findings)
