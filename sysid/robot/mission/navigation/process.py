"""The process model of a filter: mean, derivatives and noise between two samples.

States are named. ``x, y`` [m], ``psi`` [rad], ``v`` [m/s] and ``yaw_rate`` [rad/s] are always
there, the last two as the tracks turn, before slip takes its part: so encoders stay linear, whose
measurements are the most exact. ``slip_l, slip_r`` (parts of the track speeds that are lost, 2.24)
and ``<reading>_bias`` are there where the sensors make sense of them; and for sensors that read a
change, what has changed since their last measurement: ``way`` [m] and ``turn`` [rad] since the
encoders were read, the pose ``x_vo, y_vo, psi_vo`` at the last frame of visual odometry, the speed
``v_acc`` at the accelerometer's last measurement.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.robot.mission.axis import FirstOrder
from sysid.robot.mission.navigation.flow import compiled, recorded
from sysid.vehicle.kinematics import Geometry, Real, step_pose

POSE_AND_SPEEDS = ("x", "y", "psi", "v", "yaw_rate")
"""States of every filter, the first ones in this order."""
PSI = 2

States = Mapping[str, Real]

_SMALL_HALF_TURN = 1e-3
"""Below this half turn [rad] slopes of the arc are those of their series: h³/30 is 3e-11 there, and
the quotient of small differences rounds worse."""


class Ground(NamedTuple):
    """How a vehicle moves over ground, and the slopes of that.

    Attributes:
        speed: [m/s].
        yaw_rate: [rad/s].
        by: slopes of both by a state.
    """

    speed: Real
    yaw_rate: Real
    by: Mapping[str, tuple[Real, Real]]


def over_ground(s: States, geometry: Geometry, slip: Real) -> Ground:
    """What the tracks' speeds are over ground: each track loses its slip (thesis 2.24, 2.13).

    Args:
        s: states with ``v`` and ``yaw_rate`` of the tracks.
        slip: part that both tracks lose besides the states ``slip_l, slip_r``.
    """
    v, yaw_rate = s["v"], s["yaw_rate"]
    kept = 1.0 - slip
    if "slip_l" not in s:
        return Ground(kept * v, kept * yaw_rate, {"v": (kept, 0.0), "yaw_rate": (0.0, kept)})
    half = 0.5 * geometry.B
    left, right = v - half * yaw_rate, v + half * yaw_rate
    grip_l, grip_r = kept - s["slip_l"], kept - s["slip_r"]
    mean, apart = 0.5 * (grip_r + grip_l), 0.5 * (grip_r - grip_l)
    return Ground(
        mean * v + apart * half * yaw_rate,
        mean * yaw_rate + apart / half * v,
        {
            "v": (mean, apart / half),
            "yaw_rate": (apart * half, mean),
            "slip_l": (-0.5 * left, 0.5 / half * left),
            "slip_r": (-0.5 * right, -0.5 / half * right),
        },
    )


@dataclass(frozen=True)
class Process:
    """The motion between two samples.

    Speed and yaw rate walk at random: v(t + dt) = v(t) + w_v, Var w_v = q_v dt, and both act on the
    pose by the mean of their old and their new value along the exact arc, as the vehicle of a
    mission moves. So the noise of a step reaches the pose by half of dt.

    Attributes:
        names: of the states, in their order.
        speed: q_v, density of the speed's walk [m²/s³].
        yaw_rate: density of the yaw rate's walk [rad²/s³].
        walks: what the variance of each state gains by itself [unit²/s], (n,).
        response: how the speed follows the drive; None where it walks.
        slip: part of the track speeds that is lost on both sides, besides the states of slip.
        known_heading: the pose is linear in the state: the heading counts as known where the way
            is laid along it.
    """

    names: tuple[str, ...]
    speed: float
    yaw_rate: float
    walks: tuple[float, ...]
    response: FirstOrder | None = None
    slip: float = 0.0
    known_heading: bool = False

    def advanced(
        self, s: States, dt: Real, drive: Real, geometry: Geometry, xp: Any
    ) -> dict[str, Real]:
        """The states ``dt`` later without noise; ψ is not wrapped.

        Args:
            s: numbers, or arrays of one shape.
            dt: [s].
            drive: mean command of both tracks [drive].
        """
        after = dict(s)
        kept, gained = self._speed(dt, xp)
        after["v"] = kept * s["v"] + gained * drive
        forward = 0.5 * (s["v"] + after["v"])
        mean = over_ground({**s, "v": forward}, geometry, self.slip)
        after["x"], after["y"], _ = step_pose(
            s["x"], s["y"], s["psi"], mean.speed, mean.yaw_rate, dt, xp=xp
        )
        after["psi"] = s["psi"] + mean.yaw_rate * dt
        if "way" in s:
            after["way"] = s["way"] + forward * dt
            after["turn"] = s["turn"] + s["yaw_rate"] * dt
        return after

    def _speed(self, dt: Real, xp: Any) -> tuple[Real, Real]:
        """What is kept of the speed, and what full drive adds to it [m/s]."""
        if self.response is None:
            return 1.0, 0.0
        kept = xp.exp(-dt / self.response.lag)
        return kept, (1.0 - kept) * self.response.gain

    def slopes(
        self, s: States, dt: Real, drive: Real, geometry: Geometry, xp: Any
    ) -> tuple[Any, Any]:
        """Slopes F = ∂f/∂x (n, n) of :meth:`advanced`, and the noise Q (n, n) of the step."""
        at, n = self.names.index, len(self.names)
        kept, gained = self._speed(dt, xp)
        share = 0.5 * (1.0 + kept)  # of the old speed in the mean speed
        forward = share * s["v"] + 0.5 * gained * drive
        mean = over_ground({**s, "v": forward}, geometry, self.slip)
        arc = _arc(s["psi"], mean, dt, self.known_heading, xp)
        v, yaw_rate = at("v"), at("yaw_rate")
        F = {(i, i): 1.0 for i in range(n)} | {(v, v): kept}
        # columns of the noise: speed, yaw rate; half of each step's noise is in its mean
        noise = {(v, 0): 1.0, (yaw_rate, 1): 1.0}
        for i in range(PSI + 1):  # x, y, ψ
            F[i, PSI] = arc.by_heading[i]
            for name, (speed, turning) in mean.by.items():
                F[i, at(name)] = arc.by_speed[i] * speed + arc.by_turn[i] * turning
            noise[i, 0], noise[i, 1] = 0.5 * F[i, v], 0.5 * F[i, yaw_rate]
            F[i, v] = share * F[i, v]
        if "way" in self.names:
            way, turn = at("way"), at("turn")
            F[way, v], F[turn, yaw_rate] = share * dt, dt
            noise[way, 0], noise[turn, 1] = 0.5 * dt, 0.5 * dt
        G = matrix(noise, n, 2, xp)
        Q = (G * xp.array([self.speed * dt, self.yaw_rate * dt])) @ G.T
        return matrix(F, n, n, xp), Q + dt * xp.array(self.walks) * xp.eye(n)


@dataclass(frozen=True)
class _Arc:
    """Slopes of x, y and ψ by the mean speed, the yaw rate and the heading, (3,) each."""

    by_speed: tuple[Real, Real, Real]
    by_turn: tuple[Real, Real, Real]
    by_heading: tuple[Real, Real, Real]


def _arc(psi: Real, mean: Ground, dt: Real, known_heading: bool, xp: Any) -> _Arc:
    half = 0.5 * mean.yaw_rate * dt
    straight = abs(half) < _SMALL_HALF_TURN
    safe = xp.where(straight, 1.0, half)
    sin, cos = xp.sin(safe), xp.cos(safe)
    shrink = xp.where(straight, 1.0 - half * half / 6.0, sin / safe)
    shrinking = xp.where(straight, -half / 3.0, (safe * cos - sin) / (safe * safe))
    along, across = xp.cos(psi + half), xp.sin(psi + half)
    way, change = mean.speed * dt * shrink, 0.5 * mean.speed * dt * dt * shrinking
    by_speed = dt * shrink * along, dt * shrink * across, 0.0
    if known_heading:
        return _Arc(by_speed, (0.0, 0.0, dt), (0.0, 0.0, 1.0))
    by_turn = (
        change * along - 0.5 * dt * way * across,
        change * across + 0.5 * dt * way * along,
        dt,
    )
    return _Arc(by_speed, by_turn, (-way * across, way * along, 1.0))


def matrix(entries: Mapping[tuple[int, int], Real], rows: int, columns: int, xp: Any) -> Any:
    """A matrix of zeros but for its entries (row, column)."""
    if recorded(xp):
        every = [[entries.get((i, j), 0.0) for j in range(columns)] for i in range(rows)]
        return xp.array(every)
    zeros = xp.zeros((rows, columns))
    if compiled(xp):
        at = np.array(list(entries)).T
        return zeros.at[at[0], at[1]].set(xp.array(list(entries.values())))
    for place, value in entries.items():
        zeros[place] = value
    return zeros


def is_angle(name: str) -> bool:
    """Whether a state or a measurement is a heading, which wraps around."""
    return name in {"psi", "psi_vo", "vo_psi", "heading"}
