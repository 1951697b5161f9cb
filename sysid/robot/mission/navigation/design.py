"""From the sensors of a mission and the keys of a filter to its states, noises and delays."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import Figures, Sensor
from sysid.robot.mission.navigation.measurements import EXPECTED, Compass, Group
from sysid.robot.mission.navigation.process import POSE_AND_SPEEDS, Process

OVER_GROUND = frozenset({"vo_x", "fix_x"})
"""Measurements that show the way over ground, without which slip cannot be distinguished from
driving."""
EXACT_WHEELS = 1e-6
"""Variance [rad²/s²] of wheel speeds that a mission without encoders reads exactly: far below any
encoder's, far above rounding."""
WHEELS = ("omega_l", "omega_r")
LEAST_VARIANCE = 1e-10
"""A sensor without noise of its own counts as this exact in its unit squared, and so does what is
set at a measurement: far below any use, and covariances stay positive definite."""
AT_REST = 1e-4
"""Variance of the speeds at first: a robot that is about to start hardly moves."""
SPEED_WALK = 0.05
"""Density of the speed's walk [m²/s³]: 0.07 m/s within 0.1 s, 0.22 m/s within a second, as a robot
of 0.43 m/s top speed starts or stops."""
YAW_RATE_WALK = 2.0
"""Density of the yaw rate's walk [rad²/s³]: 0.45 rad/s within 0.1 s, as such a robot begins to
turn."""
SLIP_WALK = 0.01
"""Density of the slip's walk [1/s]: within a second it changes by a tenth, as on patches of
another floor."""
SLIP_START = 0.01
"""Variance of the slip at first: a tenth of the speed either way is ordinary for tracks."""


@dataclass(frozen=True)
class Noises:
    """What the keys of a filter say of noise.

    Attributes:
        q: densities by state [unit²/s], replacing those of the sensors' figures and defaults.
        r: variances by reading [unit²], replacing those of the sensors.
        position, heading: standard deviation of the start pose [m], [rad].
        buffer: samples within which measurements that come late are still used.
    """

    q: tuple[tuple[str, float], ...] = ()
    r: tuple[tuple[str, float], ...] = ()
    position: float = 0.001
    heading: float = 0.001
    buffer: int = 100


@dataclass(frozen=True, eq=False)
class Design:
    """A filter laid out for one set of sensors.

    Attributes:
        groups: its measurements, in the order in which those of one instant are used.
        start: variances at t = 0, (n,).
        since: of each group, what its measurement does to the state (n, n) for the next one of its
            sensor; None where nothing.
        too_late: kinds of sensors whose measurements come later than the buffer holds.
        unknown: measurements that no filter knows.
        unread: measurements whose variance was given and that no sensor has.
    """

    process: Process
    groups: tuple[Group, ...]
    start: tuple[float, ...]
    since: tuple[Array | None, ...]
    too_late: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()

    @property
    def latest(self) -> int:
        """The longest delay [samples]."""
        return max((g.delay for g in self.groups), default=0)


Sensors = tuple[tuple[str, Sensor], ...]


def design(
    sensors: Mapping[str, Sensor], dt: float, noises: Noises, linear: bool = False
) -> Design:
    """Lay a filter out.

    Args:
        dt: time between two samples [s].
        linear: leave out whatever is not linear in the state: slip, and acceleration to the left.
    """
    listed = tuple(sensors.items())
    try:
        return _remembered(listed, dt, noises, linear)
    except TypeError:  # a sensor of another package that cannot be hashed
        return _design(listed, dt, noises, linear)


def _design(sensors: Sensors, dt: float, noises: Noises, linear: bool) -> Design:
    groups, biases, late, unknown = [], dict[str, Figures](), [], []
    r = dict(noises.r)
    for kind, sensor in sensors:
        read = dict(sensor.figures(dt))
        unknown += [name for name in read if name not in EXPECTED]
        compass = Compass(getattr(sensor, "field", 1.0), getattr(sensor, "north", 0.0))
        used = _used({n: f for n, f in read.items() if n in EXPECTED}, compass, linear)
        used = {n: f._replace(variance=r.get(n, f.variance)) for n, f in used.items()}
        if not used:
            continue
        group = _group(kind, used, bool(getattr(sensor, "adds_up", False)), compass)
        if group.delay > noises.buffer:
            late.append(kind)
            continue
        biases |= {name: used[name] for name in used if name in group.biased}
        groups.append(group)
    if not any("omega_l" in g.names for g in groups) and "encoders" not in late:
        exact = tuple(r.get(n, EXACT_WHEELS) for n in WHEELS)
        groups.insert(0, Group("wheels", WHEELS, exact))
    names = {name for g in groups for name in g.names}
    unread = tuple(name for name in r if name not in names)
    notes = tuple(late), tuple(unknown), unread
    return _laid_out(tuple(groups), biases, noises, linear, notes)


_remembered = lru_cache(maxsize=64)(_design)


def _used(read: dict[str, Figures], compass: Compass, linear: bool) -> dict[str, Figures]:
    if not linear:
        return read
    if {"mag_x", "mag_y"} <= read.keys():  # an angle: σ_ψ = σ/H
        both, square = read["mag_x"], compass.field**2
        return {
            "heading": both._replace(
                variance=0.5 * (both.variance + read["mag_y"].variance) / square,
                bias_variance=both.bias_variance / square,
                bias_drift=both.bias_drift / square,
            )
        }
    return {name: figures for name, figures in read.items() if name != "acc_y"}


def _group(kind: str, used: Mapping[str, Figures], adds_up: bool, compass: Compass) -> Group:
    figures = tuple(used.values())
    return Group(
        kind=kind,
        names=tuple(used),
        variance=tuple(max(f.variance, LEAST_VARIANCE) for f in figures),
        delay=max(f.delay for f in figures),
        interval=max(f.interval for f in figures),
        biased=frozenset(n for n, f in used.items() if f.bias_variance > 0 or f.bias_drift > 0),
        adds_up=adds_up,
        compass=compass,
    )


def _laid_out(
    groups: tuple[Group, ...],
    biases: Mapping[str, Figures],
    noises: Noises,
    linear: bool,
    notes: tuple[tuple[str, ...], ...],
) -> Design:
    """The states that these measurements make sense of, each with its start and its walk."""
    q, names = dict(noises.q), {name for g in groups for name in g.names}
    position, heading = noises.position**2, noises.heading**2
    start = dict(zip(POSE_AND_SPEEDS, (position, position, heading, AT_REST, AT_REST), strict=True))
    walks = dict.fromkeys(POSE_AND_SPEEDS, 0.0)
    slip = q.get("slip", SLIP_WALK if names & OVER_GROUND else 0.0)
    if slip > 0 and not linear:
        start |= {"slip_l": SLIP_START, "slip_r": SLIP_START}
        walks |= {"slip_l": slip, "slip_r": slip}
    for group in groups:
        for name, source in group.since:
            start[name], walks[name] = start.get(source, 0.0) + LEAST_VARIANCE, 0.0
    for name, figures in biases.items():
        start[f"{name}_bias"] = max(figures.bias_variance, LEAST_VARIANCE)
        walks[f"{name}_bias"] = q.get(f"{name}_bias", figures.bias_drift)
    process = Process(
        names=tuple(start),
        speed=q.get("speed", SPEED_WALK),
        yaw_rate=q.get("yaw_rate", YAW_RATE_WALK),
        walks=tuple(walks.values()),
        known_heading=linear,
    )
    since = tuple(_since(group, process.names) for group in groups)
    return Design(process, groups, tuple(start.values()), since, *notes)


def _since(group: Group, names: tuple[str, ...]) -> Array | None:
    """The matrix that sets some states to others, or to 0."""
    if not group.since:
        return None
    matrix = np.eye(len(names))
    for name, source in group.since:
        matrix[names.index(name)] = 0.0
        if source:
            matrix[names.index(name), names.index(source)] = 1.0
    return matrix
