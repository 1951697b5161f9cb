"""One experiment as many loggers would write it: the text and the options a person needs first."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROWS = 240
STEP = 0.02
RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True)
class Written:
    """A log as one logger writes it.

    Attributes:
        text: the file.
        u, y: what must be read, in SI where the file tells its units.
        dt: sample time [s].
        options: options of reading that a person gives.
        said: parts of sentences that reading must say.
    """

    text: str
    u: np.ndarray
    y: np.ndarray
    dt: float = STEP
    options: dict[str, Any] = field(default_factory=dict)
    said: tuple[str, ...] = ()


def motor(rows: int = ROWS, seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row numbers, a command in whole numbers, and a first-order answer with two decimals."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(-10, 11, rows // 12 + 1) * 20.0, 12)[:rows]
    y = np.zeros(rows)
    for k in range(1, rows):
        y[k] = 0.9 * y[k - 1] + 0.4 * u[k - 1]
    return np.arange(rows), u, np.round(y + rng.normal(0, 0.3, rows), 2)


def lines(columns: Sequence[Sequence[str]], sep: str = ",") -> str:
    return "".join(sep.join(row) + "\n" for row in zip(*columns, strict=True))


def comma(values: Sequence[float] | np.ndarray, digits: int = 2) -> list[str]:
    return [f"{v:.{digits}f}".replace(".", ",") for v in values]


def point(values: Sequence[float] | np.ndarray, digits: int = 2) -> list[str]:
    return [f"{v:.{digits}f}" for v in values]


def whole(values: np.ndarray) -> list[str]:
    return [str(int(v)) for v in values]


def _arduino() -> Written:
    k, u, y = motor()
    text = "Starting...\r\nCalibrating sensor\r\nmillis\tpwm\trpm\r\n"
    body = lines([whole(15234 + 20 * k), whole(u), point(y)], "\t").replace("\n", "\r\n")
    return Written(text + body, u, y * RPM, said=("lines 1 to 2 above the header", "[ms]"))


def _serial_monitor() -> Written:
    k, u, y = motor()
    rows = ["millis,pwm,rpm", *lines([whole(20 * k), whole(u), point(y)]).splitlines()]
    text = "".join(f"12:03:{i // 50:02d}.{i % 50 * 20:03d} -> {r}\n" for i, r in enumerate(rows))
    return Written(text, u, y * RPM, said=("serial monitor",))


def _serial_plotter() -> Written:
    k, u, y = motor()
    rows = zip(whole(20 * k), whole(u), point(y), strict=True)
    text = "".join(f"millis:{t},pwm:{a},rpm:{b}\n" for t, a, b in rows)
    return Written(text, u, y * RPM, said=("the names in front of the numbers",))


def _esp32() -> Written:
    k, u, y = motor()
    stamps = (2**32 - 900_000 + 20_000 * k) % 2**32
    text = "time_us,duty,speed_rpm\n" + lines([whole(stamps), whole(u), point(y)])
    return Written(text, u, y * RPM, said=("starts over at 4294967296 once",))


def _uint16() -> Written:
    k, u, y = motor()
    text = "ms,pwm,rpm\n" + lines([whole((64000 + 20 * k) % 2**16), whole(u), point(y)])
    return Written(text, u, y * RPM, said=("starts over at 65536 once",))


def _ros1() -> Written:
    k, u, y = motor()
    stamps = [str(1_714_564_800_000_000_000 + 20_000_000 * int(i)) for i in k]
    text = "%time,field.cmd,field.speed\n" + lines([stamps, whole(u), point(y)])
    return Written(text, u, y, said=("in ns (since 1970)",))


def _ros2() -> Written:
    k, u, y = motor()
    seconds, nanos = 1_714_564_800 + k // 50, k % 50 * 20_000_000
    text = "header.stamp.sec,header.stamp.nanosec,cmd.data,vel.data\n"
    return Written(text + lines([whole(seconds), whole(nanos), whole(u), point(y)]), u, y)


def _bag_py() -> Written:
    k, u, y = motor()
    stamps = [f"{1714564800 + STEP * i:.6f}" for i in k]
    text = "Time,header.seq,cmd,vel\n" + lines([stamps, whole(k), whole(u), point(y)])
    return Written(text, u, y)


def _german_excel() -> Written:
    k, u, y = motor()
    stamps = [f"01.05.2024 23:59:{58 + i // 50:02d},{i % 50 * 20:03d}" for i in k[:100]]
    stamps += [f"02.05.2024 00:00:{i // 50 - 2:02d},{i % 50 * 20:03d}" for i in k[100:]]
    head = "Messung vom 1. Mai;;\nDatum/Uhrzeit;Spannung [V];Drehzahl [U/min]\n"
    return Written(head + lines([stamps, comma(u), comma(y)], ";"), u, y * RPM)


def _excel_sep() -> Written:
    k, u, y = motor()
    head = "sep=;\nZeit [ms];Spannung;Drehzahl (1/min);\n"
    body = lines([whole(20 * k), comma(u), comma(y), [""] * len(k)], ";")
    return Written(head + body, u, y * RPM)


def _plc() -> Written:
    k, u, y = motor()
    switch = ["EIN" if v > 0 else "AUS" for v in u]
    stamps = [
        f"23:59:{50 + i}" if i < 10 else f"00:{(i - 10) // 60:02d}:{(i - 10) % 60:02d}" for i in k
    ]
    head = "Uhrzeit;Heizung;Temperatur\n[hh:mm:ss];[-];[°C]\n"
    text = head + lines([stamps, switch, comma(y)], ";")
    return Written(text, (u > 0) * 1.0, y, 1.0, said=("AUS = 0, EIN = 1", "starts over at 86400"))


def _labview() -> Written:
    k, u, y = motor()
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nX_Dimension\tTime\n"
        "X0\t0.0000000000000000E+0\nDelta_X\t0.020000\n***End_of_Header***\t\n"
        "X_Value\tVoltage\tSpeed\tComment\n"
    )
    return Written(head + lines([point(STEP * k, 6), point(u, 6), point(y, 6)], "\t"), u, y)


def _labview_german() -> Written:
    k, u, y = motor()
    head = "X_Wert\tSpannung\tDrehzahl\n"
    return Written(head + lines([comma(STEP * k, 6), comma(u, 6), comma(y, 6)], "\t"), u, y)


def _matlab() -> Written:
    k, u, y = motor()
    return Written("Time,Voltage,Speed\n" + lines([point(STEP * k), whole(u), point(y)]), u, y)


def _units_below() -> Written:
    k, u, y = motor()
    head = "time,voltage,speed\nms,V,rpm\n"
    text = head + lines([whole(20 * k), point(u), point(y)])
    return Written(text, u, y * RPM, said=("units from a line next to the header",))


def _quoted() -> Written:
    k, u, y = motor()
    cells = [[f'"{c}"' for c in col] for col in (comma(STEP * k), comma(u), comma(y))]
    return Written('"Zeit";"u";"y"\n'.replace(";", ",") + lines(cells), u, y)


def _comments() -> Written:
    k, u, y = motor()
    body = lines([point(STEP * k), whole(u), point(y)]).splitlines()
    body[50:50] = ["# operator touched the wheel", "t,u,y"]
    return Written(
        "\n".join(["// run 3", "t,u,y", *body]) + "\n",
        u,
        y,
        said=("1 comment line between the data was left out", "repeated once below"),
    )


def _doubled() -> Written:
    k, u, y = motor()
    body = lines([point(STEP * k), whole(u), point(y)]).splitlines()
    twice = [line for i, line in enumerate(body) for _ in range(2 if i % 40 == 7 else 1)]
    return Written("\n".join(["t,u,y", *twice]) + "\n", u, y, said=("the first of 6 such lines",))


def _spreadsheet_days() -> Written:
    k, u, y = motor()
    days = [f"{45413.5 + STEP * i / 86400:.12f}" for i in k]
    return Written("Datum,u,y\n" + lines([days, whole(u), point(y)]), u, y, said=("spreadsheet",))


def _nameless_clock() -> Written:
    k, u, y = motor()
    text = "tick_val,u,y\n" + lines([whole(500 + 20 * k), whole(u), point(y)])
    return Written(text, u, y, said=("was taken as the time, in ms", "`units={'tick_val': 's'}`"))


def _zeit_ms() -> Written:
    k, u, y = motor()
    text = "Zeit;Stellgröße;Istwert\n" + lines([whole(20 * k), comma(u), comma(y)], ";")
    return Written(text, u, y, said=("Zeit rises by 20 a row and was read in ms",))


def _asked() -> Written:
    k, u, y = motor()
    text = "clock,u,y\n" + lines([whole(20 * k), whole(u), point(y)])
    return Written(text, u, y, options={"units": {"clock": "ms"}})


def _two_clocks() -> Written:
    k, u, y = motor()
    dates = [f"2024-05-01T12:00:{i // 50:02d}" for i in k]
    text = "date,millis,u,y\n" + lines([dates, whole(20 * k), whole(u), point(y)])
    return Written(text, u, y)


def _temperature_t() -> Written:
    k, u, y = motor()
    text = "Zeit,heater,T\n" + lines([point(STEP * k), whole(u), point(y)])
    return Written(text, u, y)


LOGGERS: dict[str, Callable[[], Written]] = {
    "Arduino": _arduino,
    "Arduino serial monitor": _serial_monitor,
    "Arduino serial plotter": _serial_plotter,
    "ESP32": _esp32,
    "uint16 milliseconds": _uint16,
    "rostopic echo": _ros1,
    "ROS 2": _ros2,
    "bag to CSV": _bag_py,
    "German Excel": _german_excel,
    "Excel with sep=": _excel_sep,
    "PLC": _plc,
    "LabVIEW": _labview,
    "German LabVIEW": _labview_german,
    "MATLAB": _matlab,
    "units below the header": _units_below,
    "quoted decimal commas": _quoted,
    "comments and a second header": _comments,
    "doubled lines": _doubled,
    "spreadsheet days": _spreadsheet_days,
    "a clock of another name": _nameless_clock,
    "Zeit in milliseconds": _zeit_ms,
    "unit by option": _asked,
    "date beside millis": _two_clocks,
    "T is a temperature": _temperature_t,
}


def robot_drive(rows: int = 600, seed: int = 2) -> dict[str, np.ndarray]:
    """Two tracks that drive curves: PWM, speeds [rad/s], and the pose [m, rad], turning often."""
    rng = np.random.default_rng(seed)
    pwm = np.repeat(rng.integers(-2, 11, (rows // 20 + 1, 2)), 20, axis=0)[:rows] * 20.0
    omega = np.zeros((rows, 2))
    for k in range(1, rows):
        omega[k] = 0.8 * omega[k - 1] + 0.02 * pwm[k - 1]
    v, rate = 0.03 * omega.mean(axis=1), 0.3 * (omega[:, 1] - omega[:, 0])
    psi = np.cumsum(rate * STEP)
    x, y = np.cumsum(v * np.cos(psi) * STEP), np.cumsum(v * np.sin(psi) * STEP)
    return {"pwm": pwm, "omega": omega, "x": x, "y": y, "psi": psi}


def put(folder: Path, text: str, name: str = "log.csv") -> Path:
    """A log with this text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path
