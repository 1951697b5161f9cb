"""Runs of a machine: clocks of log, sensor and command, then the steps in C.

Steps are 0.1 ms by RK4 with what switches (diodes, dry friction at rest, load of the tracks) held
within a step and corrected at its end. What is stiffer than RK4 bears at that step (teeth in
contact on a light load, bristles, a winding with little inductance) divides it: ``substeps``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sysid_datasets.physics.compiled import call
from sysid_datasets.physics.parameters import Body, Drive, Friction, Machine

Array = NDArray[np.float64]
Noise = Callable[[int], Array]
"""From a number of readings to what is added to them, shape (N, drives)."""

STEP = 1e-4
"""[s]."""

STABLE = 0.8
"""Largest step times rate. RK4 is stable to 2.8, and at 0.8 its error per step is below 0.3 %."""

POSE_STEP = 1e-3
"""Time between two rows of the pose [s]."""

TRUTH = ("speed", "angle", "current", "bus", "duty", "winding", "motor_speed", "voltage")
"""What is noted of each drive at each row, as in run.c."""


@dataclass(frozen=True)
class Telemetry:
    """Clocks: of the log, the sensor and the command line."""

    rate: float = 20.0
    """Rows a second."""
    refresh: float = 0.0
    """Time between two readings of the sensor [s]; 0: one a row."""
    latency: float = 0.0
    """From a reading to the row that may know it [s]."""
    reading_jitter: float = 0.0
    """A reading is up to so much older than its clock says [s]; less than a refresh."""
    command_delay: float = 0.0
    """From a row to the change of the command at the firmware [s]."""
    command_jitter: float = 0.0
    """Up to so much more, from row to row [s]."""
    loop_rate: float = 0.0
    """Of the controller, where it is faster than the log [1/s]; a multiple of it."""


@dataclass(frozen=True, eq=False)
class Trace:
    """What a run left; a row per row of the log, a column per drive."""

    t: Array
    """[s], shape (N,)."""
    command: Array
    """−1 … 1 as sent; shape (N, drives)."""
    reference: Array
    """What came in: the same without a controller."""
    reading: Array
    """rad/s or rad, before the wire; shape (N, drives)."""
    truth: dict[str, Array]
    """By the names of ``TRUTH``, each of shape (N, drives)."""
    pose: Array
    """x, y [m], heading [rad] every ``POSE_STEP``, shape (M, 3)."""


def simulate(
    machine: Machine,
    commands: Array,
    telemetry: Telemetry | None = None,
    *,
    noise: Noise | None = None,
    disturbance: Array | None = None,
    rng: np.random.Generator | None = None,
) -> Trace:
    """Drive a machine from rest.

    Args:
        machine: what is driven.
        commands: −1 … 1, or references of the controller in rad/s or rad; shape (N, drives).
        telemetry: clocks; the default is 20 rows a second without any delay.
        noise: added to the readings before a controller sees them.
        disturbance: torque on the outputs [N m], held over a row, shape (N, drives).
        rng: source of the jitter; needed where there is any.

    Raises:
        NoCompilerError: no C compiler is here.
        ValueError: clocks or shapes are impossible.
        FloatingPointError: the machine's numbers are so stiff that it diverged.
    """
    tm = telemetry or Telemetry()
    drives = len(machine.drives)
    if commands.ndim != 2 or commands.shape[1] != drives:
        raise ValueError(f"commands of shape {commands.shape} for {drives} drives")
    every = round(tm.loop_rate / tm.rate) if tm.loop_rate else 1
    period = _steps(1.0 / (tm.rate * every), "the time between two rows")
    wanted = np.repeat(np.asarray(commands, dtype=np.float64), every, axis=0)
    rows = len(wanted)
    row_at = np.arange(rows, dtype=np.int64) * period
    read_at, newest = _readings(tm, row_at, period, rng)
    steps = int(row_at[-1])
    push = np.zeros((rows, drives)) if disturbance is None else np.repeat(disturbance, every, 0)
    added = np.zeros((len(read_at), drives)) if noise is None else noise(len(read_at))
    sent, reading = wanted.copy(), np.zeros((len(read_at), drives))
    truth = np.zeros((rows, drives, len(TRUTH)))
    pose = np.zeros((steps // round(POSE_STEP / STEP) + 1, 3))
    call(
        machine,
        {
            "step": STEP,
            "steps": steps,
            "substeps": substeps(machine),
            "drives": drives,
            "readings": len(read_at),
            "read_at": read_at,
            "noise": np.ascontiguousarray(added, dtype=np.float64),
            "rows": rows,
            "row_at": row_at,
            "newest": newest,
            "acts_at": _arrivals(tm, row_at, rng),
            "command": sent,
            "disturbance": np.ascontiguousarray(push, dtype=np.float64),
            "reading": reading,
            "truth": truth,
            "pose": pose,
        },
    )
    known = np.where(newest[:, None] < 0, 0.0, reading[np.maximum(newest, 0)])
    return Trace(
        t=row_at[::every] * STEP,
        command=sent[::every],
        reference=wanted[::every],
        reading=known[::every],
        truth={name: truth[::every, :, i] for i, name in enumerate(TRUTH)},
        pose=pose,
    )


def substeps(machine: Machine) -> int:
    """Parts of a step that keep the fastest rate of a machine within ``STABLE``.

    Raises:
        ValueError: it would need more than a hundred.
    """
    rate = max(fastest(drive, machine.body) for drive in machine.drives)
    parts = max(math.ceil(rate * STEP / STABLE), 1)
    if parts > 100:
        raise ValueError(f"a rate of {rate:.3g} 1/s is too fast for steps of {STEP} s")
    return parts


def fastest(drive: Drive, body: Body) -> float:
    """The fastest rate of a drive [1/s]: winding, teeth, bristles, slip of the track."""
    motor, bridge, gear = drive.motor, drive.bridge, drive.gearbox
    reflected = motor.inertia * gear.ratio**2
    load = gear.load_inertia if gear.stiffness > 0.0 else gear.load_inertia + reflected
    rates = [0.0]
    if motor.inductance > 0.0:
        dead = bridge.dead_time * 12.0 / bridge.ripple_current
        rates.append((motor.resistance + bridge.on_resistance + dead) / motor.inductance)
        if bridge.pwm_period > 0.0:  # the current runs dry: fast near the emf
            rates.append(100.0 / bridge.pwm_period)
    if gear.stiffness > 0.0:
        light = 1.0 / (1.0 / gear.load_inertia + 1.0 / reflected)
        rates += [math.sqrt(gear.stiffness / light), gear.damping / light]
    rates += [_bristles(drive.friction, load), _bristles(drive.motor_friction, motor.inertia)]
    if body.mass > 0.0:
        push = body.grip * body.mass * body.gravity / 2.0 / body.slip_speed
        rates += [push * body.radius_left**2 / load, 2.0 * push / body.mass]
    return max(rates)


def _bristles(f: Friction, inertia: float) -> float:
    if f.presliding <= 0.0:
        return 0.0
    torque = max(f.coulomb_forward, f.coulomb_backward)
    stiff = math.sqrt(torque / f.presliding / inertia)
    return max(stiff, f.bristle_damping / inertia, BRISTLE_SPEED / f.presliding)


BRISTLE_SPEED = 30.0
"""Speed up to which bristles are followed [rad/s]; they slip over within one presliding angle."""


def _steps(seconds: float, what: str) -> int:
    count = round(seconds / STEP)
    if count < 1 or abs(count * STEP - seconds) > 1e-9:
        raise ValueError(f"{what} is {seconds} s, not a multiple of {STEP} s")
    return count


def _readings(
    tm: Telemetry, row_at: NDArray[np.int64], period: int, rng: np.random.Generator | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Steps at which the sensor reads, and which reading each row knows."""
    clock = _steps(tm.refresh, "the sensor's refresh") if tm.refresh else period
    due = np.arange(0, row_at[-1] + 1, clock, dtype=np.int64)
    read_at = due
    if tm.reading_jitter > 0.0:
        early = _draw(rng).uniform(0.0, tm.reading_jitter / STEP, len(due))
        read_at = np.maximum(due - early.astype(np.int64), 0)
    known_at = due + round(tm.latency / STEP)
    newest = np.searchsorted(known_at, row_at, side="right") - 1
    return read_at, newest.astype(np.int64)


def _arrivals(
    tm: Telemetry, row_at: NDArray[np.int64], rng: np.random.Generator | None
) -> NDArray[np.int64]:
    delay = np.full(len(row_at), tm.command_delay / STEP)
    if tm.command_jitter > 0.0:
        delay += _draw(rng).uniform(0.0, tm.command_jitter / STEP, len(row_at))
    arrivals = row_at + np.rint(delay).astype(np.int64)
    return np.maximum.accumulate(arrivals)  # commands do not overtake


def _draw(rng: np.random.Generator | None) -> np.random.Generator:
    if rng is None:
        raise ValueError("jitter needs a source of randomness: give `rng`")
    return rng
