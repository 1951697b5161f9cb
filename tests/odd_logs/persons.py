"""Logs of persons unlike each other: known physics, in the file that such a person has."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from log_files import write
from machines import Array, dead_zone, lag, robot
from scipy.io import savemat
from scipy.signal import cont2discrete, lfilter

RPM = 60.0 / (2.0 * np.pi)
Make = Callable[[np.random.Generator, Path], Path]


def late(u: Array, samples: int) -> Array:
    """A command that arrives so many samples late."""
    return np.concatenate([np.full(samples, u[0]), u])[: len(u)]


def stepped(rng: np.random.Generator, samples: int, low: float, high: float, hold: int) -> Array:
    """Random levels between two ends, each held between half and three halves of ``hold``."""
    lengths = rng.integers(hold // 2, hold * 3 // 2, 2 * samples // hold + 2)
    return np.repeat(rng.uniform(low, high, len(lengths)), lengths)[:samples]


def rubbed(u: Array, dt: float, gain: float, time: float, coulomb: float) -> Array:
    """τ ω' + ω = K (u − c sign ω), stuck at standstill while \\|u\\| < c: exact in each sample."""
    pole, y, w = np.exp(-dt / time), np.zeros(len(u)), 0.0
    for k, drive in enumerate(u):
        y[k] = w
        force = drive - coulomb * np.sign(w) if w else dead_zone(drive, -coulomb, coulomb)
        after = gain * force + (w - gain * force) * pole
        w = 0.0 if w * after < 0.0 else float(after)
    return y


def rated(u: Array, dt: float, rate: float, start: float = 0.0) -> Array:
    """A command that follows with a limited rate."""
    y, now = np.zeros(len(u)), start
    for k, wanted in enumerate(u):
        now += float(np.clip(wanted - now, -rate * dt, rate * dt))
        y[k] = now
    return y


def clock(samples: int, dt: float) -> Array:
    return np.round(np.arange(samples) * dt, 9)


def propeller(rng: np.random.Generator, folder: Path) -> Path:
    """150 s at 100 Hz: 13.2 to 9.4 rpm/µs above 1055 µs, 55 ms, 30 ms late; the supply sags."""
    n, dt = 15000, 0.01
    esc = np.rint(stepped(rng, n, 1000.0, 2000.0, 250))
    esc[:200] = 1000.0
    over = late(np.maximum(esc - 1055.0, 0.0), 3)
    speed = lag(13.2 * over - 3.8 / 1890.0 * over**2, dt, 1.0, (0.055,))
    current = 28.0 * (speed / 1e4) ** 2
    volts = 16.6 - 6e-3 * clock(n, dt) - 0.011 * current
    speed = speed * volts / 16.6
    thrust, torque = 9.1 * (speed / 1e4) ** 2, 0.16 * (speed / 1e4) ** 2
    w = rng.standard_normal
    columns = {"Time (s)": clock(n, dt), "ESC signal (µs)": esc.astype(int)}
    columns |= {f"Servo {k} (µs)": np.full(n, 1500) for k in (1, 2, 3)}
    columns |= {f"Acc{a} (g)": np.round(0.02 * w(n) + (a == "Z"), 3) for a in "XYZ"}
    columns |= {
        "Torque (N·m)": np.round(torque + 1e-3 * w(n), 4),
        "Thrust (N)": np.round(thrust + 0.02 * w(n), 3),
        "Voltage (V)": np.round(volts + 0.004 * w(n), 2),
        "Current (A)": np.round(current + 0.03 * w(n), 2),
        "Electrical Power (W)": np.round(current * volts, 1),
        "Motor Electrical Speed (RPM)": np.round(speed + 12.0 * w(n)),
        "Motor Optical Speed (RPM)": np.round(speed + 6.0 * w(n)),
        "Vibration (g)": np.round(0.1 + 2e-5 * speed + 0.01 * np.abs(w(n)), 3),
    }
    return write(folder, columns, name="stand.csv")


def servo(rng: np.random.Generator, folder: Path) -> Path:
    """A servo at 50 Hz: 40 ms late, 280 °/s, 45 ms, and 1.2° of play to either side."""
    n, dt = 3000, 0.02
    target = np.round(stepped(rng, n, -60.0, 60.0, 40))
    target[1500:] = np.round(
        40.0 * np.sin(0.9 * clock(1500, dt)) + 8.0 * np.sin(4 * clock(1500, dt)), 1
    )
    gear = lag(rated(late(target, 2), dt, 280.0), dt, 1.0, (0.045,))
    horn, at = np.zeros(n), 0.0
    for k, g in enumerate(gear):
        at = float(np.clip(at, g - 1.2, g + 1.2))
        horn[k] = at
    actual = np.round(horn + 0.04 * rng.standard_normal(n), 2)
    columns = {"ms": [20 * k for k in range(n)], "target_deg": target, "actual_deg": actual}
    return write(folder, columns, sep="\t", name="servo.txt")


def night(rng: np.random.Generator, folder: Path) -> Path:
    """An oven, 4 s a row: 0.93 K/%, 640 s and 28 s, 16 s late, in a room that drifts by 1.7 K."""
    n = 7200
    duty = np.round(stepped(rng, n, 10.0, 90.0, 450))
    room = 19.0 + 1.7 * np.sin(2.0 * np.pi * np.arange(n) / n - 0.8)
    y = room + lag(duty, 4.0, 0.93, (640.0, 28.0), 4) + 0.03 * rng.standard_normal(n)
    first = datetime(2026, 3, 3, 21, 40, 8)
    times = [(first + timedelta(seconds=4 * k)).strftime("%H:%M:%S") for k in range(n)]
    columns = {
        "Uhrzeit": times,
        "Stellgrad [%]": duty.astype(int),
        "Ofentemperatur [°C]": np.round(y, 1),
    }
    return write(folder, columns, sep=";", comma=True, end="\r\n", name="nacht.csv")


def hobby(rng: np.random.Generator, folder: Path) -> Path:
    """A serial monitor's text: 0.9 rpm a count behind a drop of 17 and a friction of 26 counts."""
    n, dt = 4000, 1e-3
    t = np.cumsum(rng.integers(18, 27, n))
    at = np.arange(t[-1] + 1)
    pwm = stepped(rng, n, -255.0, 255.0, 30).astype(int)
    fine = pwm[np.maximum(np.searchsorted(t, at, "right") - 1, 0)].astype(float)
    rpm = rubbed(dead_zone(fine, -17.0, 17.0), dt, 0.9, 0.14, 26.0)[t] + 0.8 * rng.standard_normal(
        n
    )
    lines = [f"{1400 + t[k]},{pwm[k]},{rpm[k]:.1f}" for k in range(n)]
    lines[1200], lines[2600] = lines[1200][:7], lines[2600][5:]
    boot = [
        "ets Jul 29 2019 12:21:46",
        "",
        "rst:0x1 (POWERON_RESET),boot:0x13",
        "Motor shield ready.",
        "millis,pwm,rpm",
    ]
    path = folder / "putty.log"
    path.write_bytes(b"\0\0\0" + "\r\n".join([*boot, *lines, ""]).encode())
    return path


def bus(rng: np.random.Generator, folder: Path) -> Path:
    """A car: 60 columns, rows at 100 Hz, pedal and brake at 50, speed at 20, otherwise empty.

    m = 1480 kg: m v' = min(52 N/% p, 47 kW/v) − 95 N/bar b − 210 N − 0.47 v².
    """
    n, dt, v = 24000, 0.01, 12.0
    pedal = np.round(stepped(rng, n, -30.0, 85.0, 500).clip(0.0), 1)
    brake = np.round(np.where(pedal == 0.0, stepped(rng, n, -20.0, 30.0, 300).clip(0.0), 0.0), 1)
    speed = np.zeros(n)
    for k in range(n):
        speed[k] = v
        drive = min(52.0 * pedal[k], 47e3 / max(v, 1.0))
        force = drive - 95.0 * brake[k] - (210.0 if v > 0.0 else 0.0) - 0.47 * v * v
        v = max(v + dt * force / 1480.0, 0.0)
    speed = np.round(3.6 * speed + 0.05 * rng.standard_normal(n), 2)

    def every(values: Array, rows: int, text: str = "{:g}") -> list[str]:
        return [text.format(x) if k % rows == 0 else "" for k, x in enumerate(values)]

    columns: dict[str, object] = {
        "timestamps": clock(n, dt),
        "AccelPedalPos [%]": every(pedal, 2),
        "BrakePress [bar]": every(brake, 2),
        "VehSpd [km/h]": every(speed, 5),
    }
    for k in range(56):
        noise = np.round((k + 1) * 0.3 + 0.01 * rng.standard_normal(n), 2)
        columns[f"Sig_{k:02d}" + (" [V]" if k % 3 else "")] = every(noise, (5, 10, 20)[k % 3])
    return write(folder, columns, name="drive.csv")  # type: ignore[arg-type]


def model_car(rng: np.random.Generator, folder: Path) -> Path:
    """Yaw rate [deg/s] = 0.038 v (steering − 1500 µs) behind ±28 µs, bias 1.9; GNSS at 5 Hz."""
    n, dt = 9000, 0.02
    steering = np.rint(stepped(rng, n, 1200.0, 1800.0, 60)).astype(int)
    throttle = np.rint(stepped(rng, n, 1520.0, 1750.0, 250)).astype(int)
    v = lag(np.maximum(throttle - 1510.0, 0.0), dt, 0.024, (0.7,))
    turn = lag(dead_zone(steering - 1500.0, -28.0, 28.0), dt, 0.038, (0.09,)) * v
    gyro = np.round(turn + 1.9 + 0.4 * rng.standard_normal(n), 2)
    speed = v + 0.03 * rng.standard_normal(n)
    columns = {
        "time_ms": [20 * k for k in range(n)],
        "steering_us": steering,
        "throttle_us": throttle,
        "gyro_z_dps": gyro,
        "gps_speed_mps": [f"{speed[k]:.2f}" if k % 10 == 0 else "" for k in range(n)],
    }
    return write(folder, columns, name="car.csv")


def two_tanks(rng: np.random.Generator, folder: Path) -> Path:
    """A h₁' = q − k √h₁, A h₂' = k √h₁ − k √h₂: 150 cm², k = 6.4 cm³/s/√mm; heights in mm."""
    n = 5000
    flow = np.round(stepped(rng, n, 1.5, 6.0, 250), 2)
    h, y = np.array([60.0, 60.0]), np.zeros((n, 2))
    for k in range(n):
        y[k] = h
        for _ in range(4):
            out = 6.4 * np.sqrt(h)
            h = np.maximum(
                h + 0.25 * 10.0 / 150.0 * (np.array([flow[k] / 0.06, out[0]]) - out), 0.0
            )
    y = np.round(y + 0.3 * rng.standard_normal((n, 2)), 1)
    columns = {
        "t [s]": np.arange(n),
        "inflow [L/min]": flow,
        "h1 [mm]": y[:, 0],
        "h2 [mm]": y[:, 1],
    }
    return write(folder, columns, name="tanks.csv")


def regulated(rng: np.random.Generator, folder: Path) -> Path:
    """A closed loop and nothing else: 0.48, 240 ms, 40 ms late, under a PI law clipped at 0."""
    n, dt = 6000, 0.01
    wanted = np.round(stepped(rng, n, 5.0, 45.0, 150))
    out, y = np.zeros(n), np.zeros(n)
    pole, state, total = np.exp(-dt / 0.24), 0.0, 0.0
    for k in range(n):
        y[k] = state + 0.08 * rng.standard_normal()
        error = wanted[k] - y[k]
        total = float(np.clip(total + 9.0 * error * dt, 0.0, 100.0))
        out[k] = np.clip(2.0 * error + total, 0.0, 100.0)
        state = (
            pole * state + 0.48 * (1.0 - pole) * out[max(k - 4, 0)] + 0.05 * rng.standard_normal()
        )
    columns = {
        "time": clock(n, dt),
        "setpoint": wanted,
        "pid_output": np.round(out, 2),
        "speed": np.round(y, 2),
    }
    return write(folder, columns, name="loop.csv")


def simulink(rng: np.random.Generator, folder: Path) -> Path:
    """2 − gain 1.7, ζ = 0.2 at 6 rad/s, offset 2: names by number, a decimal comma."""
    n, dt = 4000, 0.01
    u = np.round(stepped(rng, n, -2.0, 2.0, 150), 1)
    top, den, _ = cont2discrete(([1.7 * 36.0], [1.0, 2.4, 36.0]), dt, method="zoh")
    y = 2.0 + lfilter(np.ravel(top), den, u) + 0.01 * rng.standard_normal(n)
    columns = {"time": clock(n, dt), "signals_1": u, "signals_2": y}
    return write(folder, columns, sep=";", comma=True, name="simout.csv")


def two_days(rng: np.random.Generator, folder: Path) -> Path:
    """One motor (31 rad/s/V, 0.11 s), logged at 10 ms on one day and at 20 ms on the other."""
    for name, dt in (("tuesday.csv", 0.02), ("monday.csv", 0.01)):
        n = int(40.0 / dt)
        u = np.round(stepped(rng, n, -6.0, 6.0, int(0.6 / dt)), 1)
        y = lag(u, dt, 31.0, (0.11,)) + 0.5 * rng.standard_normal(n)
        path = write(folder, {"t_s": clock(n, dt), "u_V": u, "w_radps": np.round(y, 2)}, name=name)
    return path


def long_lab(rng: np.random.Generator, folder: Path) -> Path:
    """Ten minutes at 1 kHz: 24 rad/s/V, 55 ms and 1.9 ms, 0.32 V of Coulomb friction."""
    n, dt = 600_000, 1e-3
    u = np.round(stepped(rng, n, -6.0, 6.0, 400), 2)
    y = rubbed(lag(u, dt, 1.0, (1.9e-3,)), dt, 24.0, 0.055, 0.32) + 0.3 * rng.standard_normal(n)
    return write(folder, {"t": clock(n, dt), "u_V": u, "w_radps": np.round(y, 2)}, name="lab.csv")


def student(rng: np.random.Generator, folder: Path) -> Path:
    """60 rows: a step of 3 V through 4.2, 0.5 s and 0.25 s, 0.3 s late, every 0.1 s."""
    u = np.where(np.arange(60) < 5, 0.0, 3.0)
    y = lag(u, 0.1, 4.2, (0.5, 0.25), 3) + 0.05 * rng.standard_normal(60)
    return write(folder, {"t": clock(60, 0.1), "u": u, "y": np.round(y, 2)}, name="step.csv")


def miswired(rng: np.random.Generator, folder: Path) -> Path:
    """Tracks whose encoders are exchanged, the left one negative, rpm in columns of rad/s."""
    r = robot(rng, 2400, 0.05, 0.0215, 0.186)
    columns = {
        "t": clock(2400, 0.05),
        "pwm_l": np.rint(20000.0 * r["drive_l"]),
        "pwm_r": np.rint(20000.0 * r["drive_r"]),
        "omega_l [rad/s]": np.round(-RPM * r["omega_r"], 2),
        "omega_r [rad/s]": np.round(RPM * r["omega_l"], 2),
        "x": np.round(r["x"], 4),
        "y": np.round(r["y"], 4),
        "psi": np.round(r["psi"], 4),
    }
    return write(folder, columns, name="tracks.csv")


def dynamometer(rng: np.random.Generator, folder: Path) -> Path:
    """At 52 s a load is engaged: 118 → 81 rpm/V (−31 %), 180 → 300 ms."""
    n, dt, w = 6000, 0.02, 0.0
    u, y = np.round(stepped(rng, n, 2.0, 12.0, 60), 1), np.zeros(n)
    for k in range(n):
        y[k] = w
        gain, time = (118.0, 0.18) if k < 2600 else (81.4, 0.30)
        w = gain * u[k] + (w - gain * u[k]) * float(np.exp(-dt / time))
    y = np.round(y + 4.0 * rng.standard_normal(n))
    return write(folder, {"t [s]": clock(n, dt), "U [V]": u, "n [rpm]": y}, name="dyno.csv")


def building(rng: np.random.Generator, folder: Path) -> Path:
    """Supply temperature: 0.34 K/% of the valve, 90 s, 18 s late; 0.6 of outdoor, 40 s, at once."""
    import pandas as pd

    n = 7200
    valve = np.round(stepped(rng, n, 10.0, 90.0, 240))
    outdoor = np.round(4.0 + lag(rng.standard_normal(n), 1.0, 45.0, (150.0,)), 1)
    supply = (
        21.0 + lag(valve, 1.0, 0.34, (90.0,), 18) + lag(outdoor, 1.0, 0.6, (40.0,), 0, outdoor[0])
    )
    index = pd.date_range("2026-02-11 06:00", periods=n, freq="s", tz="Europe/Vienna", name="time")
    columns = {
        "AHU1_Valve_pct": valve,
        "T_outdoor_degC": outdoor,
        "T_supply_degC": np.round(supply + 0.05 * rng.standard_normal(n), 2),
    }
    path = folder / "ahu.parquet"
    pd.DataFrame(columns, index=index).to_parquet(path)
    return path


def spreadsheet(rng: np.random.Generator, folder: Path) -> Path:
    """0.88 kPa/rpm: cp1252, thousands with a comma, NULL, '-' and doubled rows."""
    n, dt = 3000, 0.1
    rpm = np.rint(stepped(rng, n, 700.0, 2900.0, 60))
    y = lag(rpm, dt, 0.88, (1.1,), 0, rpm[0]) + 1.5 * rng.standard_normal(n)
    lines = [
        "# Prüfstand 4 – Pumpe",
        "# exportiert: 11.05.2026",
        "Zeit (s);Drehzahl (rpm);Druck (kPa);T (°C)",
    ]
    for k in range(n):
        row = f"{k * dt:.1f};{rpm[k]:,.0f};{y[k]:,.1f};{'NULL' if k % 7 else '-'}"
        lines += [row] * (2 if k % 400 == 399 else 1)
    path = folder / "pumpe.csv"
    path.write_bytes("\r\n".join([*lines, ""]).encode("cp1252"))
    return path


def plc(rng: np.random.Generator, folder: Path) -> Path:
    """A converter: a ramp of 18 Hz/s, then 28.5 rpm/Hz and 0.35 s; a clock of ms in 16 bits."""
    n, dt = 6000, 0.02
    wanted = np.round(stepped(rng, n, 5.0, 50.0, 150), 1)
    y = lag(rated(wanted, dt, 18.0), dt, 28.5, (0.35,)) + 2.0 * rng.standard_normal(n)
    columns = {
        "DB12_Trace.Zaehler": [(41230 + 20 * k) % 65536 for k in range(n)],
        "DB12_Trace.Sollfrequenz_Hz": wanted,
        "DB12_Trace.Istdrehzahl": np.rint(y).astype(int),
    }
    return write(folder, columns, sep=";", name="trace.csv")


def fan(rng: np.random.Generator, folder: Path) -> Path:
    """J ω' = torque(duty) − b ω − d ω²; off below 18 %; 4 Hz, no time column, means at the end."""
    n, w = 2400, 0.0
    duty = np.round(stepped(rng, n, 0.0, 100.0, 50))
    y = np.zeros(n)
    for k in range(n):
        y[k] = w
        for _ in range(10):
            w += 0.025 * ((40.0 * duty[k] if duty[k] >= 18.0 else 0.0) - 0.5 * w - 2.4e-4 * w * w)
    y = np.rint(y + 4.0 * rng.standard_normal(n))
    path = write(folder, {"duty_%": duty.astype(int), "fan_rpm": y.astype(int)}, name="fan.csv")
    with path.open("a") as file:
        file.write(f"\nMean,{duty.mean():.2f},{y.mean():.2f}\nMax,{duty.max():.0f},{y.max():.0f}\n")
    return path


CONTAINERS = (
    "utf16",
    "rostopic",
    "iso",
    "lvm",
    "units",
    "headerless",
    "dat",
    "jsonl",
    "long",
    "mat",
)
LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\tOne
Date\t2026/05/11
Time\t10:21:33.1
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t{0}\t{0}\t
Y_Unit_Label\tV\trpm\t
X0\t0.0\t0.0\t
Delta_X\t0.02\t0.02\t
***End_of_Header***\t\t\t"""


def contained(container: str) -> Make:
    """One motor (140 rpm/V, 0.16 s, 50 Hz) in each container."""

    def make(rng: np.random.Generator, folder: Path) -> Path:
        n, dt = 1500, 0.02
        t, u = clock(n, dt), np.round(stepped(rng, n, -5.0, 5.0, 40), 1)
        y = np.round(lag(u, dt, 140.0, (0.16,)) + 2.0 * rng.standard_normal(n), 1)
        log = {"t": t, "volt": u, "rpm": y}
        rows = [f"{a:g},{b:g},{c:g}" for a, b, c in zip(t, u, y, strict=True)]
        first = datetime(2026, 5, 11, 8, 0, tzinfo=UTC)
        if container == "utf16":
            path = write(folder, log, sep="\t", name="log.txt")
            path.write_bytes(path.read_text().encode("utf-16"))
        elif container == "rostopic":
            stamps = [1_778_486_400_000_000_000 + 20_000_000 * k for k in range(n)]
            path = write(folder, {"%time": stamps, "field.volt": u, "field.rpm": y})
        elif container == "iso":
            iso = [
                (first + timedelta(seconds=dt * k)).isoformat(timespec="milliseconds")
                for k in range(n)
            ]
            path = write(folder, {"time": iso, "volt": u, "rpm": y})
        elif container == "lvm":
            columns = {"X_Value": t, "volt": u, "rpm": y}
            path = write(folder, columns, sep="\t", before=LVM.format(n), name="log.lvm")
        elif container == "units":
            path = write(folder, log, after="[s],[V],[rpm]")
        elif container in ("headerless", "dat"):
            path = folder / ("log.dat" if container == "dat" else "log.csv")
            body = "\n".join(rows)
            path.write_text(body.replace(",", "   ") if container == "dat" else body)
        elif container == "jsonl":
            path = folder / "log.jsonl"
            lines = [dict(zip(log, map(float, r), strict=True)) for r in zip(t, u, y, strict=True)]
            path.write_text("\n".join(json.dumps(line) for line in lines))
        elif container == "long":
            path = folder / "log.csv"
            lines = [
                f"{a:g},{s},{v:g}"
                for a, b, c in zip(t, u, y, strict=True)
                for s, v in (("volt", b), ("rpm", c))
            ]
            path.write_text("\n".join(["time,signal,value", *lines]))
        else:
            path = folder / "log.mat"
            savemat(path, log)
        return path

    return make
