"""The files of the odd logs: each function makes one from a seed and returns where it is."""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from machines import Array, closed_loop, dead_zone, integrate, lag, levels, robot

Columns = Mapping[str, Sequence[object] | Array]
SYMMETRIC = (-3.0, -1.5, 0.0, 1.0, 2.0, 3.0)
ONE_SIDED = (0.0, 2.0, 4.0, 6.0, 8.0)


def write(
    folder: Path,
    columns: Columns,
    *,
    sep: str = ",",
    comma: bool = False,
    before: str = "",
    after: str = "",
    end: str = "\n",
    tail: str = "",
    bom: bool = False,
    keep: Array | None = None,
    name: str = "log.csv",
) -> Path:
    """A text log; ``keep`` selects rows, ``after`` is a second header row, ``tail`` ends lines."""
    rows = np.arange(len(next(iter(columns.values())))) if keep is None else np.flatnonzero(keep)
    lines = [sep.join(columns) + tail]
    for k in rows:
        cells = [_cell(values[k], comma) for values in columns.values()]
        lines.append(sep.join(cells) + tail)
    if after:
        lines.insert(1, after)
    if before:
        lines.insert(0, before)
    path = folder / name
    text = end.join([*lines, ""])
    path.write_bytes((b"\xef\xbb\xbf" if bom else b"") + text.encode("utf-8"))
    return path


def _cell(value: object, comma: bool) -> str:
    if isinstance(value, str):
        return value
    text = f"{value:.7g}" if isinstance(value, float) else str(value)
    return text.replace(".", ",") if comma else text


def motor(
    rng: np.random.Generator, samples: int = 500, dt: float = 0.02, delay: int = 0
) -> tuple[Array, Array]:
    """(volts, rpm) of a motor with 150 rpm/V and 0.12 s."""
    u = levels(rng, samples, SYMMETRIC, 15)
    return u, lag(u, dt, 150.0, (0.12,), delay) + 2.0 * rng.standard_normal(samples)


def ticks(
    samples: int, dt: float, unit: float, start: float = 0.0, jitter: Array | None = None
) -> list[int]:
    """Whole-numbered times of a clock that counts in ``unit`` seconds."""
    t = np.arange(samples) * dt + (0.0 if jitter is None else jitter)
    return [int(v) for v in np.rint((start + t) / unit)]


def clocked(time: str, unit: float, start: float = 0.0, wrap: int = 0, **how: object) -> Callable:
    """A motor's log whose time column counts in a unit of its own, and may start over."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        u, y = motor(rng)
        t = ticks(len(u), 0.02, unit, start)
        if wrap:
            t = [v % wrap for v in t]
        return write(folder, {time: t, "u": u, "y": y}, **how)  # type: ignore[arg-type]

    return make


def dated(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng)
    first = datetime(2026, 5, 1, 23, 59, 57)
    t = [
        (first + timedelta(seconds=0.02 * k)).isoformat(timespec="milliseconds")
        for k in range(len(u))
    ]
    return write(folder, {"timestamp": t, "voltage": u, "speed_rpm": y})


def with_missing_lines(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng)
    keep = np.ones(len(u), dtype=bool)
    keep[rng.choice(np.arange(10, len(u) - 10), 42, replace=False)] = False
    return write(folder, {"t": np.arange(len(u)) * 0.02, "u": u, "y": y}, keep=keep)


def with_jitter(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng)
    t = ticks(len(u), 0.02, 1e-3, 5.0, 0.0015 * rng.uniform(-1.0, 1.0, len(u)))
    return write(folder, {"time_ms": t, "u": u, "y": y})


def with_a_gap(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng, 700)
    keep = np.ones(len(u), dtype=bool)
    keep[300:390] = False
    return write(folder, {"t": np.arange(len(u)) * 0.02, "volt": u, "rpm": y}, keep=keep)


def plain(
    u_name: str, y_name: str, scale: float = 1.0, u_scale: float = 1.0, **how: object
) -> Callable:
    """A motor's log with other names and units."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        u, y = motor(rng)
        t = np.arange(len(u)) * 0.02
        return write(folder, {"t": t, u_name: u_scale * u, y_name: scale * y}, **how)  # type: ignore[arg-type]

    return make


def untimed(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng)
    return write(folder, {"u": u, "y": y})


def german(rng: np.random.Generator, folder: Path) -> Path:
    u, y = motor(rng)
    columns = {"Zeit": np.arange(len(u)) * 0.02, "Spannung": u, "Drehzahl [U/min]": y}
    return write(folder, columns, sep=";", comma=True, end="\r\n", bom=True)


def switched(rng: np.random.Generator, folder: Path) -> Path:
    """An oven at 20 °C whose heater is switched: 60 K at full power, 40 s."""
    on = levels(rng, 600, (0.0, 1.0), 25)
    on[:30] = 0.0
    y = 20.0 + lag(on, 1.0, 60.0, (40.0,)) + 0.1 * rng.standard_normal(600)
    words = ["ON" if v else "OFF" for v in on]
    return write(folder, {"time_s": np.arange(600) * 1.0, "heater": words, "temperature_degC": y})


def oven(first: int) -> Callable:
    """An oven at 20 °C, gain 8 K a unit, 30 s, logged from rest or from the middle of its work."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        u = levels(rng, 900, ONE_SIDED, 30)
        u[:40] = 0.0
        y = 20.0 + lag(u, 1.0, 8.0, (30.0,)) + 0.1 * rng.standard_normal(900)
        t = np.arange(900) * 1.0
        return write(folder, {"t": t[first:], "u": u[first:], "y": y[first:]})

    return make


def step_test(rng: np.random.Generator, folder: Path) -> Path:
    """One step of 2 V from rest: the plainest experiment there is."""
    u = np.where(np.arange(400) < 60, 0.0, 2.0)
    y = lag(u, 0.05, 12.0, (0.8,)) + 0.05 * rng.standard_normal(400)
    return write(folder, {"time": np.arange(400) * 0.05, "u": u, "y": y})


def second_order_from_rest(rng: np.random.Generator, folder: Path) -> Path:
    """10 s of a second-order motor driven to one side, from rest."""
    u = levels(rng, 500, ONE_SIDED, 25)
    u[:20] = 0.0
    y = lag(u, 0.02, 150.0, (0.12, 0.03)) + 3.0 * rng.standard_normal(500)
    return write(folder, {"t": np.arange(500) * 0.02, "volt": u, "rpm": y})


def shifted(rng: np.random.Generator, folder: Path) -> Path:
    """A sensor that reads 40 rpm at standstill."""
    u = levels(rng, 600, ONE_SIDED, 20)
    y = 40.0 + lag(u, 0.02, 150.0, (0.12,)) + 3.0 * rng.standard_normal(600)
    return write(folder, {"t": np.arange(600) * 0.02, "volt": u, "rpm": y})


def delayed(delay: int) -> Callable:
    """A motor behind a long dead time."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        u, y = motor(rng, 900, delay=delay - 1)
        return write(folder, {"t": np.arange(900) * 0.02, "u": u, "y": y})

    return make


def in_a_loop(reference: bool) -> Callable:
    """A motor under a PI law that answers in the same row, with process noise."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        wanted = levels(rng, 1200, (-2.0, 0.0, 1.0, 2.0), 40)
        u, y = closed_loop(wanted, 0.02, 3.0, 0.15, (0.8, 3.0), rng, 0.08)
        columns = {"t": np.arange(1200) * 0.02, "u": u, "y": y}
        return write(folder, columns | ({"y_ref": wanted} if reference else {}))

    return make


def noise(rng: np.random.Generator, folder: Path) -> Path:
    u = levels(rng, 500, SYMMETRIC, 10)
    return write(folder, {"t": np.arange(500) * 0.1, "u": u, "y": rng.standard_normal(500)})


def alone(rng: np.random.Generator, folder: Path) -> Path:
    y = np.zeros(600)
    for k in range(2, 600):
        y[k] = 1.5 * y[k - 1] - 0.8 * y[k - 2] + rng.standard_normal()
    return write(folder, {"t": np.arange(600) * 0.1, "vibration": y})


def sided(names: Sequence[str], scale: float) -> Callable:
    """A robot's log with left and right said in other words; commands to ±255."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        r = robot(rng, 600, 0.05, 0.0215, 0.186)
        t = np.arange(600) * 0.05
        signals = (255.0 * r["drive_l"], 255.0 * r["drive_r"])
        speeds = (scale * r["omega_l"], scale * r["omega_r"])
        return write(folder, dict(zip(["t", *names], (t, *signals, *speeds), strict=True)))

    return make


def posed(rng: np.random.Generator, folder: Path) -> Path:
    """A robot with its pose in millimetres and degrees that fold."""
    r = robot(rng, 600, 0.05, 0.0215, 0.186)
    degrees = (np.degrees(r["psi"]) + 180.0) % 360.0 - 180.0
    columns = {
        "t": np.arange(600) * 0.05,
        "pwm_l": 20000.0 * r["drive_l"],
        "pwm_r": 20000.0 * r["drive_r"],
        "omega_l": r["omega_l"],
        "omega_r": r["omega_r"],
        "x [mm]": 1000.0 * r["x"],
        "y [mm]": 1000.0 * r["y"],
        "psi [deg]": degrees,
    }
    return write(folder, columns)


def counted(bits: int, signed: bool) -> Callable:
    """An encoder of 2048 counts a turn whose register is too small."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        u = levels(rng, 800, ONE_SIDED, 20)
        angle = 2.0 * integrate(u, 0.02, 4.0, 0.15)
        counts = np.rint(angle / (2.0 * np.pi) * 2048.0).astype(np.int64) % 2**bits
        if signed:
            counts = np.where(counts >= 2 ** (bits - 1), counts - 2**bits, counts)
        columns = {"t": np.arange(800) * 0.02, "u": u, "encoder": [int(c) for c in counts]}
        return write(folder, columns)

    return make


def position(rng: np.random.Generator, folder: Path) -> Path:
    """A motor read by its position: the output integrates."""
    u = levels(rng, 800, SYMMETRIC, 20)
    y = integrate(u, 0.02, 0.5, 0.15) + 1e-3 * rng.standard_normal(800)
    return write(folder, {"t": np.arange(800) * 0.02, "u": u, "y": y})


def held(rng: np.random.Generator, folder: Path) -> Path:
    """A drive that reports every fourth row: 20 Hz log, 5 Hz readings."""
    u = levels(rng, 1600, SYMMETRIC, 40)
    y = lag(u, 0.05, 5.0, (0.8,)) + 0.05 * rng.standard_normal(1600)
    y = y[(np.arange(1600) // 4) * 4]
    return write(folder, {"t": np.arange(1600) * 0.05, "u": u, "y": y})


def coarse(rng: np.random.Generator, folder: Path) -> Path:
    """An encoder of few ticks: speed in steps of 20 rpm."""
    u, y = motor(rng, 800)
    return write(folder, {"t": np.arange(800) * 0.02, "u": u, "y": 20.0 * np.rint(y / 20.0)})


def wild(rng: np.random.Generator, folder: Path) -> Path:
    """Two per cent of the readings are wild."""
    u, y = motor(rng, 800)
    at = rng.choice(np.arange(5, 795), 16, replace=False)
    y[at] += rng.choice((-1.0, 1.0), 16) * 300.0
    return write(folder, {"t": np.arange(800) * 0.02, "u": u, "y": y})


def deadened(rng: np.random.Generator, folder: Path) -> Path:
    """A motor that does not move below a fifth of its range, and an offset sensor."""
    u = levels(rng, 1500, np.linspace(-1.0, 1.0, 21), 10)
    y = 0.5 + lag(dead_zone(u, -0.2, 0.2), 0.05, 10.0, (0.2,)) + 0.02 * rng.standard_normal(1500)
    return write(folder, {"t": np.arange(1500) * 0.05, "u": u, "y": y})


def two_valued(rng: np.random.Generator, folder: Path) -> Path:
    u = levels(rng, 600, (0.0, 5.0), 12)
    y = lag(u, 0.05, 20.0, (0.3,)) + 0.3 * rng.standard_normal(600)
    return write(folder, {"t": np.arange(600) * 0.05, "u": u, "y": y})


def joined(rng: np.random.Generator, folder: Path) -> Path:
    """Wheels at 50 Hz, and a camera at 120 Hz whose clock is 3.7 s ahead, in a second file."""
    r = robot(rng, 3600, 1.0 / 120.0, 0.0215, 0.186, 120)
    t = np.arange(3600) / 120.0
    write(
        folder,
        {"time": t + 3.7, "x": r["x"], "y": r["y"], "yaw_deg": np.degrees(r["psi"]) % 360.0},
        name="mocap.csv",
    )
    at = np.arange(0.0, t[-1], 0.02)
    near = np.minimum(np.rint(at * 120.0).astype(int), 3599)
    columns = {
        "t": at,
        "pwm_l": 20000.0 * r["drive_l"][near],
        "pwm_r": 20000.0 * r["drive_r"][near],
    }
    columns |= {n: np.interp(at, t, r[n]) for n in ("omega_l", "omega_r")}
    return write(folder, columns)
