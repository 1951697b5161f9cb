"""One drive: a log of voltage, current and speed or angle, and its prediction from the constants.

The two linear equations of the motor are solved exactly between rows, over which the voltage is
held; dry friction makes them piecewise linear, and a shaft that stops stands until the torque
exceeds it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from sysid.data.filtering import lfilter
from sysid.data.record import Array
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.testbench.motor.equations import MotorConstants, time_constant
from sysid.testbench.motor.events import Events
from sysid.testbench.motor.experiments import smallest_step
from sysid.testbench.motor.joint import Part

LEAST_LAG = 0.01
"""Electrical time constant L/R in parts of a sample below which it acts at once: e^(−100) is 0."""

FIRST_CHUNK = 256
"""Rows that are solved at once; twice as many while the shaft keeps its direction."""


@dataclass(frozen=True, eq=False)
class DriveLog:
    """A log of a motor driven by its voltage.

    Attributes:
        t: instants of the rows [s], (N,), evenly spaced.
        voltage: at the leads [V], (N,).
        current: [A], (N,), or None.
        speed: of the output shaft [rad/s], (N,), or None.
        events: of the output shaft where a counter was read, or None.
        load: torque that resists at the output shaft [Nm].
        channels: names of voltage and speed in the log.
        dt: sample time [s].
    """

    name: str
    t: Array
    voltage: Array
    current: Array | None
    speed: Array | None
    events: Events | None
    load: float = 0.0
    channels: tuple[str, str] = ("voltage", "omega")
    dt: float = 0.1

    def speed_at_rows(self) -> Array:
        """Speed of the output shaft at the rows [rad/s], from intervals where there are events."""
        if self.speed is not None:
            return self.speed
        assert self.events is not None
        start, end, speed, _ = self.events.intervals()
        return np.interp(self.t, 0.5 * (start + end), speed, 0.0)


def motion(
    c: MotorConstants, voltage: Array, dt: float, first: tuple[float, float], load: float = 0.0
) -> tuple[Array, Array, Array]:
    """Current [A], speed [rad/s] and angle [rad] of the motor's shaft at the rows of a log.

        L di/dt = V − R i − Kem ω,    J dω/dt = Kc i − f ω − C0 sign(ω) − τ Cr sign(ω)

    Args:
        c: the motor; J above 0.
        voltage: held from each row to the next [V], (N,).
        dt: between two rows [s].
        first: current and speed of the motor's shaft at the first row.
        load: resisting torque at the output shaft [Nm].

    Returns:
        (N,) each; the values of a row precede its voltage.
    """
    dry = c.C0 + load / c.gear
    free, stuck = _solved(c, dt, dry)
    n = len(voltage)
    i, w = np.zeros(n), np.zeros(n)
    gained = np.zeros(n)
    i[0], w[0] = first
    k, chunk = 0, FIRST_CHUNK
    while k < n - 1:
        rows = voltage[k : min(k + chunk, n - 1)]
        sense = np.sign(w[k]) or stuck.leaves(float(i[k]), float(rows[0]))
        if sense == 0.0:
            ran, took = stuck.run(i[k], rows)
            i[k + 1 : k + 1 + took] = ran
        else:
            taken, took = free.run(i[k], w[k], sense, rows)
            i[k + 1 : k + 1 + took], w[k + 1 : k + 1 + took] = taken[0], taken[1]
            gained[k + 1 : k + 1 + took] = taken[2]
        chunk = 2 * chunk if took == len(rows) else FIRST_CHUNK
        k += took
    return i, w, np.cumsum(gained)


@lru_cache(maxsize=8)
def _solved(c: MotorConstants, dt: float, dry: float) -> "tuple[_Sliding, _Standing]":
    """The step of a motor, once for all the initial states and inputs that a fit tries."""
    return _Sliding(c, dt, dry), _Standing(c, dt, dry)


class _Sliding:
    """The motion in one direction: x⁺ = A x + b V − s d of current and speed, by eigenvalues."""

    def __init__(self, c: MotorConstants, dt: float, dry: float) -> None:
        L = max(c.L, LEAST_LAG * c.R * dt)
        rates = np.array([[-c.R / L, -c.Kem / L], [c.Kc / c.J, -c.f / c.J]])
        given = np.array([[1.0 / L, 0.0], [0.0, -dry / c.J]])  # by voltage, by friction's sense
        slow, self.vectors = np.linalg.eig(rates)
        self.inverse = np.linalg.inv(self.vectors)
        self.values = np.exp(slow * dt)
        self.A = np.real(self.vectors @ np.diag(self.values) @ self.inverse)
        once = np.linalg.solve(rates, self.A - np.eye(2))  # ∫ e^(rates s) ds over a step
        twice = np.linalg.solve(rates, once - dt * np.eye(2))  # the same of that
        self.b, self.d = (once @ given).T
        self.turned = np.concatenate([once[1], (twice @ given)[1]])
        self.dt, self.holds = dt, dry / c.Kc

    def run(self, i: float, w: float, sense: float, voltage: Array) -> tuple[Array, int]:
        """Current, speed and angle gained at the following rows, as many as it keeps its sense.

        Where the speed changes its sign the step is cut at the stop (by linear interpolation);
        over the rest of it the shaft stands, or leaves with the torque that it has at the stop.
        """
        x0 = np.array([i, w])
        drive = self.b[:, None] * voltage + self.d[:, None] * sense
        modes = self.inverse @ drive.astype(complex)
        z0 = self.inverse @ x0.astype(complex)
        z = np.array(
            [
                lfilter([1.0], [1.0, -v], m, zi=np.array([v * a]))[0]
                for v, m, a in zip(self.values, modes, z0, strict=True)
            ]
        )
        x = np.real(self.vectors @ z)
        before = np.column_stack([x0, x[:, :-1]])
        angle = self.turned[0] * before[0] + self.turned[1] * before[1]
        angle = angle + self.turned[2] * voltage + self.turned[3] * sense
        back = np.flatnonzero(x[1] * sense < 0.0)
        took = len(voltage) if not len(back) else int(back[0]) + 1
        states = np.array([x[0], x[1], angle])[:, :took]
        if len(back):
            states[1, -1], states[2, -1] = self._beyond(
                before[:, took - 1], x[:, took - 1], voltage[took - 1]
            )
        return states, took

    def _beyond(self, here: Array, there: Array, voltage: float) -> tuple[float, float]:
        """Speed at the end of a step in which the shaft stops, and the angle gained over it."""
        share = float(here[1] / (here[1] - there[1]))
        current = float(here[0] + share * (there[0] - here[0]))
        leaves = np.sign(current) if abs(current) > self.holds else 0.0
        whole = self.A[1, 0] * current + self.b[1] * voltage + self.d[1] * leaves
        speed = (1.0 - share) * float(whole) if leaves else 0.0
        return speed, 0.5 * self.dt * (share * float(here[1]) + (1.0 - share) * speed)


class _Standing:
    """The current of a shaft that stands, i⁺ = a i + (1 − a) V/R, until its torque moves it."""

    def __init__(self, c: MotorConstants, dt: float, dry: float) -> None:
        self.a = float(np.exp(-dt * c.R / max(c.L, LEAST_LAG * c.R * dt)))
        self.R, self.holds = c.R, dry / c.Kc

    def leaves(self, i: float, voltage: float) -> float:
        """The sense in which it leaves within the next step, 0 where it stands."""
        after = self.a * i + (1.0 - self.a) * voltage / self.R
        return float(np.sign(after)) if abs(after) > self.holds else 0.0

    def run(self, i: float, voltage: Array) -> tuple[Array, int]:
        """The current at the following rows, and how many before it moves."""
        drive = (1.0 - self.a) * voltage / self.R
        x = lfilter([1.0], [1.0, -self.a], drive, zi=np.array([self.a * i]))[0]
        moves = np.flatnonzero(np.abs(x) > self.holds)
        took = len(voltage) if not len(moves) else max(int(moves[0]), 1)
        return x[:took], took


LARGE = 0.1
"""A voltage that changes by this share of its span from row to row makes a step."""


MOST_STEPS = 80
"""Steps up to which each has an instant of its own: so many more numbers to fit."""


def behind_steps(voltage: Array) -> NDArray[np.bool_]:
    """Rows before which the voltage makes a step, (N,)."""
    large = LARGE * float(np.ptp(voltage))
    return np.append(False, np.abs(np.diff(voltage)) > large)


STEPS_IN_TIME_CONSTANT = 20
"""Steps in the mechanical time constant: a stop is found within a step by linear interpolation."""


def drive_part(log: DriveLog, start: MotorConstants, share: float, smeared: bool = False) -> Part:
    """A drive as a part of the joint fit.

    Its initial state is the speed, and the angle where a counter was read. The voltage between two
    rows is (1 − s) V_k + s V_(k+1): s = 0 where it is a command for the interval behind its row,
    s = 1 where it is measured with the rest. Where steps fall anywhere between rows each has an s
    of its own to estimate, the share of the interval behind it; from ``MOST_STEPS`` on they share
    one. The current right behind a step, which goes with it, then does not count.

    Args:
        start: constants as far as they are known, for the gear and the length of a step.
        share: s.
        smeared: whether steps fall between rows.
    """
    later = np.append(log.voltage[1:], log.voltage[-1])
    counts = ~behind_steps(log.voltage) if smeared else np.ones(len(log.t), dtype=bool)
    steps = np.flatnonzero(~counts) - 1
    many = len(steps) > MOST_STEPS
    i0 = float(log.current[0]) if log.current is not None else 0.0
    quantities, measured = [], []
    if log.current is not None:
        quantities.append("current")
        measured.append(log.current[counts])
    steps_in_row = max(1, round(STEPS_IN_TIME_CONSTANT * log.dt / time_constant(start)))
    state = [float(log.speed_at_rows()[0]) * start.gear]
    if log.speed is not None:
        quantities.append("speed")
        measured.append(log.speed)
    else:
        assert log.events is not None
        quantities.append("angle")
        measured.append(log.events.angle)
        state.append(float(log.events.angle[0]))
    first = len(state)

    def predict(c: MotorConstants, unknowns: Array) -> tuple[Array, ...]:
        s = np.full(len(log.t), share)
        if smeared:
            s[steps] = unknowns[first:]
        between = (1.0 - s) * log.voltage + s * later
        fine = np.repeat(between, steps_in_row)
        run = motion(c, fine, log.dt / steps_in_row, (i0, float(unknowns[0])), log.load)
        current, speed, angle = (column[::steps_in_row] for column in run)
        signals = [current[counts]] if log.current is not None else []
        if log.events is None:
            return (*signals, speed / c.gear)
        between_rows = CubicHermiteSpline(log.t, angle, speed)(log.events.t)
        return (*signals, unknowns[1] + between_rows / c.gear)

    floor = tuple(
        0.0 if q == "angle" else float(smallest_step(m) / np.sqrt(12.0))
        for q, m in zip(quantities, measured, strict=True)
    )
    shares = [share] * (1 if many else len(steps)) if smeared else []
    unknowns = np.array([*state, *shares])
    return Part(log.name, "drive", tuple(quantities), tuple(measured), floor, predict, unknowns)


def guessed(
    logs: Sequence[DriveLog], gear: float, known: MotorConstants | None, block: int
) -> MotorConstants:
    """Constants read off drives by least squares on blocks of rows: where a fit begins.

        V̄ = R ī + Kem ω̄ + L Δi/T        ī = (J/Kc) Δω/T + (f/Kc) ω̄ + (C0/Kc) sign(ω̄)

    over blocks of ``block`` rows or T seconds, with Kc = Kem unless it is known. Without a current
    only J is read off, with the other constants known.
    """
    rows = [_blocks(log, gear, block) for log in logs]
    V, i, w, di, dw = (np.concatenate(part) for part in zip(*rows, strict=True))
    moving = np.abs(w) > 0.02 * float(np.max(np.abs(w), initial=0.0))
    if known is not None and not np.all(np.isfinite(i)):
        torque = known.Kc * (V - known.Kem * w) / known.R - known.f * w - known.C0 * np.sign(w)
        J = float(dw[moving] @ torque[moving] / max(float(dw[moving] @ dw[moving]), 1e-300))
        return replace(known, J=max(J, 1e-12), L=known.R * logs[0].dt)
    R, Kem, L = scaled_lstsq(np.column_stack([i, w, di]), V)
    Kc = known.Kc if known is not None else Kem
    terms = np.column_stack([dw, w, np.sign(w)])[moving]
    J, f, C0 = Kc * scaled_lstsq(terms, i[moving])
    return MotorConstants(
        R=R,
        Kem=Kem,
        Kc=Kc,
        f=max(f, 1e-3 * Kc * Kem / R),
        C0=max(C0, 1e-6 * Kc),
        J=max(J, 1e-12),
        L=max(L, LEAST_LAG * abs(R) * logs[0].dt),
        gear=gear,
    )


BLOCKS = (1, 5, 25)
"""Rows of a block: long ones average the noise out, in short ones the slopes are seen."""


def _blocks(log: DriveLog, gear: float, block: int) -> tuple[Array, ...]:
    """Mean voltage, current and speed, and slopes of the last two, by block."""
    n = (len(log.t) - 1) // block
    speed = gear * log.speed_at_rows()
    current = log.current if log.current is not None else np.full(len(log.t), np.nan)

    def mean(values: Array) -> Array:
        return np.asarray(values[: n * block].reshape(n, block).mean(axis=1))

    def slope(values: Array) -> Array:
        return np.diff(values[: n * block + 1 : block]) / (block * log.dt)

    return mean(log.voltage), mean(current), mean(speed), slope(current), slope(speed)
