"""One motor in the files that people have: every one reads as the same record."""

import contextlib
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sysid.data.io import LogFile, read_file, read_files
from sysid.data.reading.read_options import ReadOptions
from sysid.data.same_kind import with_validation
from sysid.errors import DataError, SysidError

N, DT = 600, 0.02


def motor(
    n: int = N, dt: float = DT, tau: float = 0.3, gain: float = 20.0
) -> tuple[np.ndarray, ...]:
    """t, u and y of a first-order plant, rounded as a logger writes them."""
    draw = np.random.default_rng(4)
    u = np.repeat(np.round(draw.uniform(-8, 8, n // 25 + 1), 2), 25)[:n]
    a, y = np.exp(-dt / tau), np.zeros(n)
    for k in range(1, n):
        y[k] = a * y[k - 1] + (1 - a) * gain * u[k - 1]
    return np.round(dt * np.arange(n), 3), u, np.round(y, 3)


def put(folder: Path, data: bytes, name: str = "l.csv") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


T, U, Y = motor()
ROWS = [f"{t:.2f},{u:.2f},{y:.3f}" for t, u, y in zip(T, U, Y, strict=True)]
TWO = {"inputs": ("u",), "outputs": ("y",)}
OBJECTS = [{"t": float(t), "u": float(u), "y": float(y)} for t, u, y in zip(T, U, Y, strict=True)]


def text(rows: list[str], header: str = "t,u,y", sep: str = ",") -> bytes:
    return ("\n".join([*([header] if header else []), *rows]).replace(",", sep) + "\n").encode()


def with_line(at: int, *lines: str) -> list[str]:
    return [*ROWS[:at], *lines, *ROWS[at:]]


def mat(**variables: object) -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, variables)
    return out.getvalue()


def grouped(separator: str, point: str) -> bytes:
    """Numbers beyond 999 with thousands separators: u in 1/1000."""
    rows = []
    for t, u, y in zip(T, U, Y, strict=True):
        whole = f"{1000 * u:,.0f}".replace(",", separator)
        rows.append(f"{t:.2f}".replace(".", point) + f";{whole};" + f"{y:.3f}".replace(".", point))
    return text(rows, "t;u;y")


def long(block: bool = False) -> bytes:
    of = [
        [f"{t:.2f},{n},{v:.3f}" for t, v in zip(T, x, strict=True)] for n, x in (("u", U), ("y", Y))
    ]
    rows = [*of[0], *of[1]] if block else [r for pair in zip(*of, strict=True) for r in pair]
    return text(rows, "time,name,value")


JSON_LINES = "".join(json.dumps(row) + "\n" for row in OBJECTS).encode()
JSON_COLUMNS = json.dumps({"t": T.tolist(), "u": U.tolist(), "y": Y.tolist()}).encode()
OF_MATRIX = {"inputs": ("m_2",), "outputs": ("m_3",)}
BY_POSITION = {"inputs": ("column_2",), "outputs": ("column_3",)}
FILES: dict[str, tuple[str, bytes, dict[str, object], str]] = {
    # name of the file, its bytes, options, what the reading says
    "a footer": ("l.csv", text([*ROWS, "", "Mean,0.1", "Max,7.9,150,3", "stopped"]), {}, "3 lines"),
    "a message": ("l.csv", text(with_line(300, "-- sensor reset --")), {}, "line 302 '-- sensor"),
    "half a line": ("l.csv", text(with_line(300, ROWS[299][-7:])), {}, "1 line that is no row"),
    "a time cut short": ("l.csv", text(with_line(300, ROWS[299][2:])), {}, "1 line that is no row"),
    "an unknown unit": (
        "l.csv",
        text([f"{t:.2f},{u:.2f},{y:.3f} t/h" for t, u, y in zip(T, U, Y, strict=True)]),
        {},
        "y in t/h",
    ),
    "a history of states": (
        "l.csv",
        long().replace(b"name,value", b"entity_id,state"),
        {},
        "is a long table",
    ),
    "no time": ("l.csv", text(with_line(300, ",1.0,2.0")), {}, "line 302 ',1.0,2.0'"),
    "zero bytes": ("l.csv", b"\0\0" + text(ROWS).replace(b"5.00,", b"5\0.00,"), {}, "3 zero bytes"),
    "boot messages": ("l.csv", b"rst:1\n\nready\n" + text(ROWS), {}, "above the header"),
    "boot, no header": ("l.csv", b"ready\n" + text(ROWS, ""), BY_POSITION, "named by position"),
    "no header": ("l.dat", text(ROWS, "", "\t"), BY_POSITION, "named by position"),
    "UTF-16 without mark": ("l.csv", text(ROWS).decode().encode("utf-16-le"), {}, ""),
    "cp1252": ("l.csv", text(ROWS, "t [s],u [V],y [µm/s]").decode().encode("cp1252"), {}, "1252"),
    "thousands": ("l.csv", grouped(",", "."), {}, "separators are of thousands"),
    "thousands, German": ("l.csv", grouped(".", ","), {}, "separators are of thousands"),
    "thousands, Swiss": ("l.csv", grouped("'", "."), {}, "separators are of thousands"),
    "units as words": ("l.csv", text(ROWS, "t in s,u in V,y in m/s"), {}, ""),
    "JSON lines": ("l.jsonl", JSON_LINES, {}, ""),
    "JSON lines, cut off": ("l.jsonl", JSON_LINES + b'{"t"', {}, ""),
    "JSON array": ("l.json", json.dumps({"run": 3, "rows": OBJECTS}).encode(), {}, ""),
    "JSON columns": ("l.json", JSON_COLUMNS, {}, ""),
    "MATLAB": ("l.mat", mat(t=T, u=U, y=Y, note="x"), {}, ""),
    "MATLAB structure": ("l.mat", mat(run={"t": T, "u": U, "y": Y}), {}, ""),
    "MATLAB matrix": ("l.mat", mat(m=np.vstack([T, U, Y])), OF_MATRIX, ""),
    "long": ("l.csv", long(), {}, "long table"),
    "long, in blocks": ("l.csv", long(block=True), {}, "long table"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_one_log_in_many_files(name: str, tmp_path: Path) -> None:
    file, data, options, said = FILES[name]
    log = read_file(put(tmp_path, data, file), ReadOptions(**options))  # type: ignore[arg-type]
    record = log.records[0]
    scale = np.max(np.abs(record.u)) / np.max(np.abs(U))
    micro = 1e-6 if record.outputs[0].file_unit == "µm/s" else 1.0
    assert (len(log.records), record.dt) == (1, DT)
    np.testing.assert_allclose(record.u[:, 0], scale * U, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(record.y[:, 0], micro * Y, rtol=1e-9, atol=1e-12)
    assert scale == pytest.approx(1000.0 if "thousands" in name else 1.0)
    assert said in " ".join(log.notes)


STRICT = ["a footer", "a message", "half a line", "no time"]


@pytest.mark.parametrize("name", STRICT)
def test_strict_refuses_what_is_no_row(name: str, tmp_path: Path) -> None:
    file, data, _, _ = FILES[name]
    with pytest.raises(DataError, match=r"line [36]0[0-9]"):
        read_file(put(tmp_path, data, file), ReadOptions(strict=True))


def test_many_bad_lines_are_refused(tmp_path: Path) -> None:
    rows = [r if k % 8 else "fault" for k, r in enumerate(ROWS)]
    with pytest.raises(DataError, match="cell"):
        read_file(put(tmp_path, text(rows)))


def test_a_word_for_no_number_is_an_empty_cell(tmp_path: Path) -> None:
    rows = [
        r if k not in (50, 90, 200) else r.rpartition(",")[0] + ",OVL" for k, r in enumerate(ROWS)
    ]
    log = read_file(put(tmp_path, text(rows)))
    assert len(log.records[0]) == N
    assert "are empty cells" in " ".join(log.notes)


@pytest.mark.parametrize(
    ("cells", "value", "said"),
    [
        (("1,591", "0,250"), 1.591, ""),
        (("1,591", "955"), 1.591, "if it separates thousands, give `decimal='.'`"),
        (("1,591", "2.5"), 1591.0, "thousands"),
        (("1,591,000", "7"), 1591000.0, "thousands"),
        (("1.591,5", "7"), 1591.5, "thousands"),
    ],
)
def test_a_comma_is_read_by_its_company(
    cells: tuple[str, str], value: float, said: str, tmp_path: Path
) -> None:
    rows = [f"{k};{cells[k % 2]};{k % 7}" for k in range(40)]
    log = read_file(put(tmp_path, text(rows, "t;u;y")))
    assert log.records[0].u[0, 0] == pytest.approx(value)
    assert said in " ".join(log.notes)
    if "give `decimal" in said:  # the advice works
        advised = read_file(log.path, ReadOptions(decimal="."))
        assert advised.records[0].u[0, 0] == 1591.0


@pytest.mark.parametrize("quote", ['"', ""])
def test_whole_numbers_that_go_on_below_a_thousand_have_thousands(
    quote: str, tmp_path: Path
) -> None:
    y = 600 + 37 * np.arange(40)
    rows = [f"{k};{quote}{v:,}{quote};{k % 7}" for k, v in enumerate(y)]
    log = read_file(put(tmp_path, text(rows, "t;y;u")))
    assert np.array_equal(log.records[0].y[:, 0], y)
    assert "its separators are of thousands" in " ".join(log.notes)


@pytest.mark.parametrize("level", ["4", "5"])
def test_a_damaged_matlab_file_is_read_or_refused(level: str, tmp_path: Path) -> None:
    """A compiled reader ended the process here."""
    from scipy.io import savemat

    out = io.BytesIO()
    run = {"run": {"t": T, "u": U, "y": Y}} if level == "5" else {"t": T, "u": U, "y": Y}
    savemat(out, run, format=level)
    whole, draw = out.getvalue(), np.random.default_rng(1)
    for _ in range(80):
        data = bytearray(whole[: draw.integers(100, len(whole))])
        for at in draw.integers(0, min(len(data), 600), 3):
            data[at] = draw.integers(256)
        with contextlib.suppress(SysidError):
            read_file(put(tmp_path, bytes(data), "l.mat"))


def test_jitter_without_inputs(tmp_path: Path) -> None:
    late = T + 0.003 * (np.arange(N) % 3 == 1)
    rows = [f"{t:.4f},{y:.3f}" for t, y in zip(late, Y, strict=True)]
    assert read_file(put(tmp_path, text(rows, "t,y"))).records[0].u.shape == (N, 0)


# ------------------ rates of their own


def bus() -> bytes:
    """Rows at 100 Hz, u at 50 Hz in the even ones, y at 20 Hz."""
    t, u, y = motor(3000, 0.01)
    rows = [
        f"{t[k]:.2f},{u[k] if k % 2 == 0 else ''},{y[k] if k % 5 == 0 else ''}" for k in range(3000)
    ]
    return text(rows)


def events() -> bytes:
    """A command that is written where it changes only."""
    changed = np.flatnonzero(np.diff(U, prepend=np.nan) != 0.0)
    rows = [f"{T[k]:.2f},{U[k] if k in changed else ''},{Y[k]:.3f}" for k in range(N)]
    return text(rows)


def changes() -> bytes:
    """An output that is written where its rounded value changes only."""
    y = 20.0 * np.round(Y / 20.0)
    changed = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)
    rows = [f"{T[k]:.2f},{U[k]},{y[k] if k in changed else ''}" for k in range(N)]
    return text(rows)


def own_rows() -> bytes:
    """A slow sensor in rows of its own, 4 ms after those of the others."""
    rows = []
    for k in range(N):
        rows.append(f"{T[k]:.3f},{U[k]},{Y[k]},")
        if k % 50 == 20:
            rows.append(f"{T[k] + 0.004:.3f},,,{T[k]:.3f}")
    return text(rows, "t,u,y,speed_gnss")


def same(log: LogFile) -> None:
    np.testing.assert_allclose(log.records[0].u[:, 0], U[: len(log.records[0])])
    np.testing.assert_allclose(log.records[0].y[:, 0], Y[: len(log.records[0])], atol=1e-9)


def rounded(log: LogFile) -> None:
    n = len(log.records[0])
    np.testing.assert_allclose(log.records[0].y[:, 0], 20.0 * np.round(Y[:n] / 20.0))
    assert n > 0.9 * N


def at_20_hz(log: LogFile) -> None:
    _, u, y = motor(3000, 0.01)
    record = log.records[0]
    np.testing.assert_allclose(record.y[:-1, 0], y[::5][: len(record) - 1], atol=1e-9)
    # u is read in even rows and held; its steps fall on every 25th row, an odd one every other time
    held = np.repeat(u[::2], 2).reshape(-1, 5).mean(axis=1)
    np.testing.assert_allclose(record.u[:-1, 0], held[: len(record) - 1], atol=1e-9)


def at_1_hz(log: LogFile) -> None:
    record = log.records[0]
    np.testing.assert_allclose(record.y[:, 0], record.t - 0.004, atol=1e-9)


RATES: dict[
    str, tuple[Callable[[], bytes], dict[str, object], float, str, Callable[[LogFile], None]]
]
RATES = {
    "a bus": (bus, {}, 0.05, "u 50 Hz (held), y 20 Hz", at_20_hz),
    "events": (events, {}, DT, "u 2 Hz (held), y 50 Hz", same),
    "changes": (changes, {}, DT, "y at events (held)", rounded),
    "rows of others": (
        own_rows, TWO, DT, "12 rows hold none of the columns", same
    ),
    "a slow sensor": (
        own_rows, {"inputs": ("u",), "outputs": ("speed_gnss",)}, 1.0, "speed_gnss 1 Hz", at_1_hz
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RATES)
def test_columns_with_rates_of_their_own(name: str, tmp_path: Path) -> None:
    write, options, dt, said, check = RATES[name]
    log = read_file(put(tmp_path, write()), ReadOptions(**options))  # type: ignore[arg-type]
    assert log.records[0].dt == pytest.approx(dt, rel=1e-9)
    assert said in " ".join(log.notes)
    check(log)


@pytest.mark.parametrize("coarse", [0.04, 0.05])
def test_logs_of_different_sample_times_are_read_at_the_coarser(
    coarse: float, tmp_path: Path
) -> None:
    t, u, y = motor(400, coarse)
    other = [f"{a:.3f},{b},{c}" for a, b, c in zip(t, u, y, strict=True)]
    paths = [put(tmp_path, text(ROWS), "a.csv"), put(tmp_path, text(other), "b.csv")]
    for order in (paths, paths[::-1]):
        logs = {log.path.name: log for log in read_files(order)}
        fine = logs["a.csv"].records[0]
        assert fine.dt == logs["b.csv"].records[0].dt == pytest.approx(coarse)
        n = len(fine)
        np.testing.assert_allclose(fine.y[:, 0], np.interp(coarse * np.arange(n), T, Y), atol=1e-9)
        integral = np.concatenate([[0.0], np.cumsum(U * DT)])
        at = np.interp(coarse * np.arange(n), DT * np.arange(N + 1), integral)
        np.testing.assert_allclose(fine.u[:-1, 0], np.diff(at) / coarse, atol=1e-9)
        assert "the sample time of all together" in " ".join(logs["a.csv"].notes)
        apart = [read_file(p).records for p in order]
        pair = with_validation(*apart)
        assert [r.dt for records in pair[:2] for r in records] == [fine.dt, fine.dt]
        assert [f.record for f in pair[2]] == ["a.csv"]


def test_matlab_73(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "l.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in (("t", T), ("u", U), ("y", Y)):
            file["run/" + name] = column[None, :]
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    same(read_file(path))
