"""From a case to logs as a user would have them, and the truth beside them.

``est.csv`` and ``val.csv`` are two drives of one machine with other commands; ``truth.json`` says
what is in it. Streams of a seed: 0 the machine and its causes, 1 and 2 commands, 11 and 12 noise,
21 and 22 the pose, 31 and 32 the clocks, 41 and 42 lost lines, for the two logs. ``driven`` makes
more logs of the machine, under commands of any other kind.
"""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sysid_datasets.physics.commands import SCHEDULES
from sysid_datasets.physics.hidden import Hidden
from sysid_datasets.physics.noises import NOISES, walk
from sysid_datasets.physics.parameters import ANGLE, TICKS, Controller, Machine
from sysid_datasets.physics.processes import Process
from sysid_datasets.physics.robots import Rig, figures
from sysid_datasets.physics.simulate import POSE_STEP, simulate
from sysid_datasets.physics.wire import PoseSensor

Array = NDArray[np.float64]

FULL = 20000
"""Full drive [µs]."""

SEEN_IN_SAMPLES = ("quantisation", "held-telemetry", "dropouts")
"""Causes that are seen in the readings themselves, and are more noise to all others."""

CURVES = ("dead-zone", "concave-gain", "input-saturation")
"""Causes that bend the command alone: of one with a single level they are another gain."""

VALIDATION = 0.6
"""Length of val.csv over that of est.csv."""


@dataclass(frozen=True)
class Columns:
    """How a log of another machine is written: header and factor of each column."""

    inputs: tuple[tuple[str, float], ...]
    outputs: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Case:
    """What one pair of logs is made of."""

    suite: str
    seed: int
    rig: Rig
    hidden: tuple[Hidden, ...] = ()
    spared: tuple[Rig, ...] = ()
    """The rig without what is seen in samples, and that without each cause of ``hidden`` besides;
    empty where one cause or none is hidden."""
    style: str = "steps"
    noise: str = "white"
    sigma: float = 0.01
    """Of a reading, over half the free speed."""
    walk: float = 0.0
    """Standard deviation of a drifting load at the end of a log, over the stall torque."""
    duration: float = 100.0
    """Of est.csv [s]."""
    reference: float = 0.0
    """In a closed loop: the reading at a reference of 1."""
    columns: Columns | None = None
    """Names and units; None is the tracked robot's."""
    process: Process | None = None
    """What runs in place of the rig's machine."""
    rhythm: tuple[float, float] = (0.0, 0.0)
    """A load that swings: over the stall torque, and how often [1/s]."""
    outside: str = ""
    """What is hidden that no effect of the catalogue holds."""

    @property
    def key(self) -> str:
        """A name that no other case has."""
        return f"{self.suite}-{self.seed}"

    @property
    def integrating(self) -> bool:
        """Whether a constant command moves the readings on and on."""
        kinds = {d.sensor.kind for d in self.rig.machine.drives}
        return ANGLE in kinds and self.rig.machine.controller == Controller()


ROBOT = Columns((("pwm_l", FULL), ("pwm_r", FULL)), (("omega_l", 1.0), ("omega_r", 1.0)))


@dataclass(frozen=True, eq=False)
class Log:
    """One drive: what is logged, and what would be without noise and drifting load."""

    t: Array
    command: Array
    """As logged, in its unit."""
    reading: Array
    clean: Array
    """The same without noise and drifting load, under the same commands."""
    pose: Array | None


@dataclass(frozen=True, eq=False)
class Logs:
    """Both drives of a case."""

    case: Case
    est: Log
    val: Log


def make(case: Case) -> Logs:
    """Drive the machine of a case twice.

    Raises:
        NoCompilerError: the machine is C, and no compiler is here.
    """
    return Logs(case, _drive(case, 1, case.duration), _drive(case, 2, VALIDATION * case.duration))


def first_log(case: Case) -> Log:
    """The first drive of a case: est.csv."""
    return _drive(case, 1, case.duration)


def write(logs: Logs, folder: Path) -> list[Path]:
    """Write est.csv, val.csv and truth.json.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, log in (("est", logs.est), ("val", logs.val)):
        file = folder / f"{name}.csv"
        file.write_text(csv_of(log, logs.case.columns or ROBOT), encoding="ascii", newline="\n")
        written.append(file)
    truth = folder / "truth.json"
    truth.write_text(json.dumps(truth_of(logs), indent=1) + "\n", encoding="utf-8")
    return [*written, truth]


def csv_of(log: Log, columns: Columns) -> str:
    """The text of a log."""
    count = log.command.shape[1]
    header = ["t", *(c for c, _ in columns.inputs[:count]), *(c for c, _ in columns.outputs)]
    table = [log.t[:, None], log.command, log.reading]
    digits = ["%.4f"] + ["%.6g"] * count + ["%.5g"] * log.reading.shape[1]
    if log.pose is not None:
        header += ["x", "y", "psi"]
        table.append(log.pose)
        digits += ["%.4f", "%.4f", "%.4f"]
    row = ",".join(digits)
    lines = [",".join(header[: len(digits)])]
    lines += [row % tuple(values) for values in (np.hstack(table) + 0.0).tolist()]
    return "\n".join(lines) + "\n"


def truth_of(logs: Logs) -> dict[str, Any]:
    """What is in the machine, what noise leaves, and how large the effects show [its unit]."""
    case = logs.case
    return {
        "suite": case.suite,
        "seed": case.seed,
        "hidden": [
            {
                "id": h.id,
                "cause": h.cause,
                "also": list(h.also),
                "channels": list(h.channels),
                "sizes": dict(h.sizes),
                "same_meaning": _as_read(h, case),
                "spread": h.spread,
            }
            for h in case.hidden
        ],
        "outside": case.outside,
        "lengths": None if case.rig.lengths is None else list(case.rig.lengths),
        "full_drive": [factor for _, factor in (case.columns or ROBOT).inputs],
        "style": case.style,
        "noise": case.noise,
        "floor": {"est": floor(logs.est), "val": floor(logs.val)},
        "excess": excess(logs.val, case.integrating, _rest(logs)),
        "shows": shows(logs),
        "pose_floor": pose_floor(case.rig.pose),
        "pose_excess": pose_excess(logs.val, case.rig.lengths or (1.0, 1.0)),
    }


def _as_read(hidden: Hidden, case: Case) -> dict[str, float]:
    """True numbers as a log can show them.

    Nobody tells a late command from a late reading: a delay is that of both. Ticks differenced over
    a clock are the mean speed of it, which is half of one old. An edge on the axis of the duty lies
    on that of the command where the curve of a remote control before it puts it: an entry of its
    own for each output.
    """
    numbers = dict(hidden.same_meaning or {})
    names = [name for name, _ in (case.columns or ROBOT).outputs]
    for k, (name, drive) in enumerate(zip(names, case.rig.machine.drives, strict=False)):
        if k in hidden.channels and drive.firmware.expo != 0.0:
            for side in ("plus", "minus"):
                if side in numbers:
                    edge = _before_curve(numbers[side], drive.firmware.expo)
                    numbers[f"{side}[{name}]"] = edge
    if "delay" in numbers:
        clocks = case.rig.telemetry
        ticks = any(d.sensor.kind == TICKS for d in case.rig.machine.drives)
        differenced = 0.5 * (clocks.refresh or 1.0 / clocks.rate) if ticks else 0.0
        jitter = 0.5 * (clocks.command_jitter + clocks.reading_jitter)
        numbers["delay"] += clocks.latency + differenced + jitter
    return numbers


def _before_curve(duty: float, expo: float) -> float:
    """The command that d + expo (d − d³) makes a duty of."""
    from scipy.optimize import brentq

    return float(brentq(lambda d: d + expo * (d - d**3) - duty, 0.0, 1.0))


def floor(log: Log) -> list[float]:
    """RMS of what noise and drifting load do to each reading."""
    return [float(v) for v in np.sqrt(np.mean((log.reading - log.clean) ** 2, axis=0))]


def excess(log: Log, integrating: bool = False, level: float = 0.0) -> list[float]:
    """RMS error of the best line of first order through each clean reading, from its command.

    Args:
        log: a drive.
        integrating: whether the readings are angles.
        level: of the readings at rest.
    """
    columns = zip(log.command.T, (log.clean - level).T, strict=False)
    return [_plain_error(u, y, integrating) for u, y in columns]


def pose_excess(log: Log, lengths: tuple[float, float]) -> list[float]:
    """RMS by which way [m] and turn [rad] of two seconds differ from wheels that roll as drawn."""
    return [] if log.pose is None else _sizes(_off_wheels(log, log.pose, lengths))


def _off_wheels(log: Log, pose: Array, lengths: tuple[float, float]) -> Array:
    """What a pose changes by in two seconds beyond wheels that roll as drawn, (N, 3)."""
    radius, width = lengths
    dt = float(log.t[1] - log.t[0])
    rows = round(WINDOW / dt)
    way = 0.5 * dt * radius * (log.clean[1:] + log.clean[:-1])  # of each track in a row
    heading = np.concatenate([[0.0], np.cumsum((way[:, 1] - way[:, 0]) / width)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    steps = way.mean(axis=1)[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
    place = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    rolled = _increments(np.column_stack([place, heading]), rows)
    return _increments(pose, rows) - rolled


def _sizes(off: Array) -> list[float]:
    """RMS of way [m] and turn [rad]."""
    way = np.sqrt(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2))
    return [float(way), float(np.sqrt(np.mean(off[:, 2] ** 2)))]


def shows(logs: Logs) -> list[float | None]:
    """How far each of several causes shows beside the others, over the noise.

    RMS by which the reading where it shows most differs from that without the cause, beyond
    another gain and another lag; 0 for a curve of a command that has a single level. None for
    what is seen in the samples.
    """
    case, full = logs.case, logs.val
    if not case.spared:
        return []
    duration = VALIDATION * case.duration
    bare, *rest = (_drive(replace(case, rig=rig), 2, duration) for rig in case.spared)
    noise = np.sqrt(np.mean((full.reading - full.clean) ** 2 + (full.clean - bare.clean) ** 2, 0))
    floors, found = pose_floor(case.rig.pose), list[float | None]()
    for h, without in zip(case.hidden, rest, strict=True):
        sizes = [
            _apart(a, b) / n for a, b, n in zip(bare.clean.T, without.clean.T, noise, strict=True)
        ]
        if bare.pose is not None:
            sizes += [v / f for v, f in zip(_on_ground(case, bare, without), floors, strict=True)]
        size = 0.0 if h.id in CURVES and _single_level(logs.est.command) else float(max(sizes))
        found.append(None if h.id in SEEN_IN_SAMPLES else round(size, 3))
    return found


def _single_level(command: Array) -> bool:
    """Whether no command is anything but zero or one size, either way."""
    return all(len(set(np.abs(c[c != 0.0]).tolist())) < 2 for c in command.T)


def _on_ground(case: Case, log: Log, other: Log) -> list[float]:
    """RMS by which way [m] and turn [rad] beyond the wheels differ from another machine's.

    From those of wheels that roll as drawn where the other one has no pose. What differs by a
    factor is the same ground under other speeds.
    """
    lengths = case.rig.lengths or (1.0, 1.0)
    if log.pose is None or other.pose is None:
        return pose_excess(log, lengths)
    mine, theirs = (_off_wheels(v, v.pose, lengths) for v in (log, other) if v.pose is not None)
    for part in (slice(0, 2), slice(2, 3)):
        size = float(np.sum(theirs[:, part] ** 2))
        if size > 0.0:
            theirs[:, part] *= float(np.sum(mine[:, part] * theirs[:, part])) / size
    return _sizes(mine - theirs)


def _apart(reading: Array, other: Array) -> float:
    """RMS of what a gain and a lag on the other leave of a reading."""
    both = np.column_stack([other[1:], other[:-1]])
    left = reading[1:] - both @ np.linalg.lstsq(both, reading[1:], rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def _increments(pose: Array, rows: int) -> Array:
    """What a pose changes by in so many rows, in the frame in which it starts."""
    start, change = pose[:-rows, 2], pose[rows:] - pose[:-rows]
    c, s = np.cos(start), np.sin(start)
    x, y = change[:, 0], change[:, 1]
    return np.column_stack([c * x + s * y, c * y - s * x, change[:, 2]])


def _rest(logs: Logs) -> float:
    """A process rests at its surroundings, a drive at zero: what else it reads is an error."""
    return float(logs.val.clean[0, 0]) if logs.case.process is not None else 0.0


def pose_floor(pose: PoseSensor | None) -> list[float]:
    """RMS of what the noise of a pose does to way [m] and turn [rad] of two seconds."""
    if pose is None:
        return []
    # x and y at both ends, and the heading at both
    return [2.0 * pose.position_noise, math.sqrt(2.0) * pose.heading_noise]


WINDOW = 2.0
"""Of the increments of the pose [s]."""


def _plain_error(u: Array, y: Array, integrating: bool) -> float:
    """min over a, b of RMS(y − b G(a) u), G = (1 − a) z⁻¹/(1 − a z⁻¹), its sum for an angle."""
    from scipy.optimize import minimize_scalar
    from scipy.signal import lfilter

    def error(pole: float) -> float:
        x = lfilter([0.0, 1.0 - pole], [1.0, -pole], u)
        x = np.cumsum(x) if integrating else x
        power = float(x @ x)
        gain = float(x @ y) / power if power > 0.0 else 0.0
        return float(np.sqrt(np.mean((y - gain * x) ** 2)))

    found = minimize_scalar(error, bounds=(0.0, 0.9999), method="bounded")
    return float(found.fun)


def generator(case: Case, stream: int) -> np.random.Generator:
    """Randomness of a case; suites with the same seed share none."""
    name = int.from_bytes(case.suite.encode()[:8].ljust(8), "big")
    return np.random.Generator(np.random.PCG64([name, case.seed, stream]))


def _drive(case: Case, which: int, duration: float) -> Log:
    if case.process is not None:
        return _process(case, case.process, which, duration)
    dt = 1.0 / case.rig.telemetry.rate
    rows, drives = round(duration / dt), len(case.rig.machine.drives)
    return driven(case, which, SCHEDULES[case.style](generator(case, which), rows, dt, drives))


def driven(case: Case, which: int, wanted: Array) -> Log:
    """One drive of a case's machine under given commands.

    Args:
        case: whose machine, clocks and noise.
        which: of its logs, from 1: each has noise and jitter of its own.
        wanted: commands in −1 … 1 at the rate of the log, (N, drives).
    """
    rig, columns = case.rig, case.columns or ROBOT
    dt = 1.0 / rig.telemetry.rate
    rows, drives = wanted.shape
    closed = rig.machine.controller != Controller()
    scale = np.array([f for _, f in columns.inputs[:drives]])
    if not closed:  # what is logged is what was sent
        wanted = np.round(wanted * scale) / scale if np.all(scale >= 100.0) else wanted
    wanted = wanted * case.reference if closed else wanted
    rng = generator(case, 10 + which)
    f = figures(rig.machine)
    drift = case.walk * f.stall_torque * walk(rng, rows, drives)
    phase = 2.0 * np.pi * case.rhythm[1] * dt * np.arange(rows)
    swing = case.rhythm[0] * f.stall_torque * np.sin(phase)
    steady = np.repeat(swing[:, None], drives, axis=1)
    sensor_dt = rig.telemetry.refresh or dt
    sigma = case.sigma * 0.5 * f.speed

    def noise(count: int) -> Array:
        return sigma * NOISES[case.noise](rng, (count, drives), sensor_dt)

    run = simulate(
        rig.machine, wanted, rig.telemetry, noise=noise, disturbance=steady + drift,
        rng=generator(case, 30 + which),
    )  # fmt: skip
    inner = rig.telemetry.loop_rate > 0.0
    still = rig.machine if inner else _open(rig.machine)
    quiet = simulate(
        still, wanted if inner else run.command, rig.telemetry, disturbance=steady,
        rng=generator(case, 30 + which),
    )  # fmt: skip
    command = run.reference / case.reference if inner else run.command
    if np.all(scale >= 100.0):
        command = np.round(command * scale) / scale
    pose = None
    if rig.pose is not None:
        pose = rig.pose.measure(run.t, run.pose, POSE_STEP, generator(case, 20 + which))
    factors = np.array([f for _, f in columns.outputs])
    carried = [
        rig.wire.carry(r.reading, generator(case, 40 + which)) * factors for r in (run, quiet)
    ]
    return Log(run.t, command * scale, carried[0], carried[1], pose)


SLOWER = 60.0
"""A process is so much slower than a motor: its commands are held so much longer."""

PERIOD = 2.0
"""Sample time of a process [s]."""


def _process(case: Case, process: Process, which: int, duration: float) -> Log:
    """A heater or a pump knows no backward: commands are of one sign."""
    rows = round(duration / PERIOD)
    wanted = np.abs(SCHEDULES["steps"](generator(case, which), rows, PERIOD / SLOWER, 1))
    clean = process.run(wanted, PERIOD)
    noise = NOISES[case.noise](generator(case, 10 + which), (rows, 1), PERIOD)
    t = np.arange(rows) * PERIOD
    return Log(t, wanted * process.volts, clean + case.sigma * noise, clean, None)


def _open(machine: Machine) -> Machine:
    return replace(machine, controller=Controller())
