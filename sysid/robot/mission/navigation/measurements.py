"""Measurement models: expected values and their derivatives.

Encoders read the mean of ω_l,r = (v ∓ ψ̇B/2)/r of the tracks (2.13) since their last measurement, a
gyroscope ψ̇ over ground, an accelerometer the mean of v̇ since its last measurement and vψ̇ to the
left, a magnetometer the field H(cos(ψ − north), −sin(ψ − north)), position fixes X and Y, and
visual odometry the motion since its last frame, seen from there; each plus its bias where that is
a state.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.robot.mission.contracts import Pose
from sysid.robot.mission.navigation.dead_reckoning import compass_heading
from sysid.robot.mission.navigation.process import States, is_angle, matrix, over_ground
from sysid.robot.mission.sensors.visual_odometry import motion_between
from sysid.vehicle.kinematics import Geometry, Real, wrap_angle

LOST_AFTER = 1.5
"""A measurement that comes after more than so many intervals follows one that was lost."""


class Setting(NamedTuple):
    """What expected measurements are computed with.

    Attributes:
        slip: part of the track speeds that is lost besides the states ``slip_l, slip_r``.
        elapsed: time since the last measurement of the same sensor [s].
        known_heading: slopes by the heading are left out where it turns a way.
    """

    geometry: Geometry
    slip: float = 0.0
    elapsed: Real = 0.0
    known_heading: bool = False


class Compass(NamedTuple):
    """The undisturbed field: its size, in the unit of the measurements, and its heading [rad]."""

    field: float = 1.0
    north: float = 0.0


UNIT_FIELD = Compass()


class Expected(NamedTuple):
    """What a measurement should be, and its slopes by the states it depends on."""

    value: Real
    slopes: Mapping[str, Real]


Expectation = Callable[[States, Setting, Compass, Any], Expected]


def _wheel(side: float, way: str, turn: str) -> Expectation:
    def expected(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
        half = side * 0.5 * c.geometry.B
        share = 1.0 / c.geometry.r
        if way == "way":
            share = share / xp.maximum(c.elapsed, 1e-9)
        return Expected(share * (s[way] + half * s[turn]), {way: share, turn: half * share})

    return expected


def _state(name: str) -> Expectation:
    return lambda s, c, compass, xp: Expected(s[name], {name: 1.0})


def _turning(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
    ground = over_ground(s, c.geometry, c.slip)
    return Expected(ground.yaw_rate, {name: turning for name, (_, turning) in ground.by.items()})


def _forward(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
    """Both tracks gain speed by the mean of what they keep: their slip hardly changes meanwhile."""
    kept: Real = 1.0 - c.slip
    slopes: dict[str, Real] = {}
    per_second = 1.0 / xp.maximum(c.elapsed, 1e-9)
    gained = per_second * (s["v"] - s["v_acc"])
    if "slip_l" in s:
        kept = kept - 0.5 * (s["slip_l"] + s["slip_r"])
        slopes = {"slip_l": -0.5 * gained, "slip_r": -0.5 * gained}
    slopes |= {"v": kept * per_second, "v_acc": -kept * per_second}
    return Expected(kept * gained, slopes)


def _sideways(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
    ground = over_ground(s, c.geometry, c.slip)
    v, yaw_rate = ground.speed, ground.yaw_rate
    return Expected(v * yaw_rate, {n: a * yaw_rate + b * v for n, (a, b) in ground.by.items()})


def _field(left: bool) -> Expectation:
    """The magnetic field forward or to the left."""

    def expected(s: States, c: Setting, compass: Compass, xp: Any) -> Expected:
        angle = s["psi"] - compass.north
        cos, sin = compass.field * xp.cos(angle), compass.field * xp.sin(angle)
        return Expected(-sin, {"psi": -cos}) if left else Expected(cos, {"psi": -sin})

    return expected


def _moved(left: bool) -> Expectation:
    """The way since the last frame, forward or to the left of the heading at that frame."""

    def expected(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
        dx, dy = s["x"] - s["x_vo"], s["y"] - s["y_vo"]
        cos, sin = xp.cos(s["psi_vo"]), xp.sin(s["psi_vo"])
        along, across = (-sin, cos) if left else (cos, sin)
        value = along * dx + across * dy
        slopes = {"x": along, "y": across, "x_vo": -along, "y_vo": -across}
        if not c.known_heading:
            slopes["psi_vo"] = -across * dx + along * dy
        return Expected(value, slopes)

    return expected


def _turned(s: States, c: Setting, _: Compass, xp: Any) -> Expected:
    return Expected(s["psi"] - s["psi_vo"], {"psi": 1.0, "psi_vo": -1.0})


EXPECTED: Mapping[str, Expectation] = {
    "omega_l": _wheel(-1.0, "v", "yaw_rate"),
    "omega_r": _wheel(1.0, "v", "yaw_rate"),
    "gyro_z": _turning,
    "acc_x": _forward,
    "acc_y": _sideways,
    "mag_x": _field(left=False),
    "mag_y": _field(left=True),
    "heading": _state("psi"),
    "vo_x": _state("x"),
    "vo_y": _state("y"),
    "vo_psi": _state("psi"),
    "fix_x": _state("x"),
    "fix_y": _state("y"),
}
"""Expected measurements by name; ``heading`` is that of a magnetometer, by atan2."""

ADDED_UP: Mapping[str, Expectation] = {
    "omega_l": _wheel(-1.0, "way", "turn"),
    "omega_r": _wheel(1.0, "way", "turn"),
    "vo_x": _moved(left=False),
    "vo_y": _moved(left=True),
    "vo_psi": _turned,
}
"""The same of sensors whose measurements are what has added up since their last measurement."""

VO = ("vo_x", "vo_y", "vo_psi")

SINCE: Mapping[str, tuple[tuple[str, str], ...]] = {
    "omega_l": (("way", ""), ("turn", "")),
    "vo_x": (("x_vo", "x"), ("y_vo", "y"), ("psi_vo", "psi")),
    "acc_x": (("v_acc", "v"),),
}
"""States that a measurement sets to another state, or to 0, for the next one of its sensor."""


@dataclass(frozen=True)
class Group:
    """Measurements that come together from one sensor and are used together.

    Attributes:
        names: of the measurements, (m,).
        variance: of each [unit²], (m,).
        delay: samples between the instant they are of and the sample where they come.
        interval: time between two measurements [s].
        biased: those whose bias is a state.
        adds_up: whether a measurement is what has added up since the last one.
        compass: the field that a magnetometer is in.
    """

    kind: str
    names: tuple[str, ...]
    variance: tuple[float, ...]
    delay: int = 0
    interval: float = 0.0
    biased: frozenset[str] = frozenset()
    adds_up: bool = False
    compass: Compass = UNIT_FIELD

    @property
    def since(self) -> tuple[tuple[str, str], ...]:
        """States that a measurement sets for the next one: (state, its source or nothing for 0)."""
        counted = [n for n in self.names if n == "acc_x" or (n in SINCE and self.adds_up)]
        return tuple(pair for name in counted for pair in SINCE[name])

    def values(self, measurements: Mapping[str, Real], xp: Any) -> Any:
        """The numbers read, (m,); NaN where nothing was."""
        if self.names == ("heading",):
            seen = compass_heading(
                measurements.get("mag_x", xp.nan), measurements.get("mag_y", xp.nan), xp
            )
            return xp.array([wrap_angle(seen + self.compass.north)])
        return xp.array([measurements.get(name, xp.nan) for name in self.names])

    def direct_values(self, z: Any, last: Any, elapsed: Real, xp: Any) -> Any:
        """Values that the measurements give directly, (m,); NaN without any.

        Args:
            z: the numbers, (m,).
            last: those of the last measurement, (m,).
            elapsed: time since then [s].
        """
        if self.names == VO and self.adds_up:
            before, now = (Pose(pose[0], pose[1], pose[2]) for pose in (last, z))
            return xp.array(motion_between(before, now, xp))
        if self.adds_up:
            return z + xp.where(elapsed > 0, 0.0, xp.nan)
        if "acc_x" in self.names:  # the mean over one interval, which is not known after a loss
            usable = (elapsed > 0) & (elapsed < LOST_AFTER * self.interval)
            fits = xp.array([usable | (name != "acc_x") for name in self.names])
            return xp.where(fits, z, xp.nan)
        return z

    def spread(self, elapsed: Real, xp: Any) -> Any:
        """Variance of each number, (m,): that of motions from frame to frame grows with time."""
        variance = xp.array(self.variance)
        if self.names == VO and self.adds_up:
            return variance * xp.maximum(elapsed / self.interval, 1e-3)
        return variance

    def expected(self, s: States, setting: Setting, xp: Any) -> list[Expected]:
        expectations = []
        for name in self.names:
            table = ADDED_UP if self.adds_up and name in ADDED_UP else EXPECTED
            value, slopes = table[name](s, setting, self.compass, xp)
            if name in self.biased:
                bias = f"{name}_bias"
                share = setting.elapsed if name in VO and self.adds_up else 1.0
                value, slopes = value + share * s[bias], {**slopes, bias: share}
            expectations.append(Expected(value, slopes))
        return expectations

    def linearised(
        self, z: Any, x: Any, names: tuple[str, ...], setting: Setting, xp: Any
    ) -> tuple[Any, Any]:
        """z − h(x), (m,), and the slopes of h at x, (m, n).

        Args:
            z: the numbers, (m,); NaN where nothing was read.
            x: states, (n,), those of ``names`` in front.
        """
        at = {name: i for i, name in enumerate(names)}
        expected = self.expected({name: x[i] for name, i in at.items()}, setting, xp)
        entries = {
            (row, at[name]): slope
            for row, one in enumerate(expected)
            for name, slope in one.slopes.items()
        }
        H = matrix(entries, len(expected), len(x), xp)
        return self.off(z - xp.array([one.value for one in expected]), xp), H

    def off(self, difference: Any, xp: Any) -> Any:
        """Differences of measurements, (…, m), headings around the circle."""
        angles = [is_angle(name) for name in self.names]
        if not any(angles):
            return difference
        return xp.where(xp.array(angles), wrap_angle(difference), difference)
