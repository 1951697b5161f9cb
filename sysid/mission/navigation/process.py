"""How a vehicle moves between two samples, as a filter believes: mean, slopes and noise.

States are named. ``x, y`` [m], ``psi`` [rad], ``v`` [m/s] and ``yaw_rate`` [rad/s] are always
there; ``slip_l, slip_r`` (parts of the track speed that are lost, 2.24) and ``<reading>_bias``
where the sensors make sense of them; and for sensors that read a change since their last reading,
what has changed since then: ``way`` [m] and ``turn`` [rad] since the encoders were read, the pose
``x_vo, y_vo, psi_vo`` at the last frame of visual odometry, the speed ``v_acc`` at the
accelerometer's last reading.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.mission.navigation.flow import compiled
from sysid.vehicle.kinematics import Real, step_pose

POSE_AND_SPEEDS = ("x", "y", "psi", "v", "yaw_rate")
"""States of every filter, the first ones in this order."""
PSI = 2

States = Mapping[str, Real]

_SMALL_HALF_TURN = 1e-3
"""Below this half turn [rad] slopes of the arc are those of their series: h³/30 is 3e-11 there, and
the quotient of small differences rounds worse."""


@dataclass(frozen=True)
class Response:
    """How the speed follows the drive, where a filter believes to know: v̇ = (V u − v)/T.

    Attributes:
        lag: T [s].
        top_speed: V, at full drive [m/s].
    """

    lag: float
    top_speed: float


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
        known_heading: the pose is linear in the state: the heading counts as known where the way
            is laid along it.
    """

    names: tuple[str, ...]
    speed: float
    yaw_rate: float
    walks: tuple[float, ...]
    response: Response | None = None
    known_heading: bool = False

    def advanced(self, s: States, dt: Real, drive: Real, xp: Any) -> dict[str, Real]:
        """The states ``dt`` later without noise; ψ is not wrapped.

        Args:
            s: numbers, or arrays of one shape.
            dt: [s].
            drive: mean command of both tracks [drive].
            xp: array namespace.
        """
        after = dict(s)
        kept, gained = self._speed(dt, xp)
        after["v"] = kept * s["v"] + gained * drive
        forward, turned = 0.5 * (s["v"] + after["v"]), s["yaw_rate"] * dt
        after["x"], after["y"], _ = step_pose(
            s["x"], s["y"], s["psi"], forward, s["yaw_rate"], dt, xp=xp
        )
        after["psi"] = s["psi"] + turned
        if "way" in s:
            after["way"], after["turn"] = s["way"] + forward * dt, s["turn"] + turned
        return after

    def _speed(self, dt: Real, xp: Any) -> tuple[Real, Real]:
        """What is kept of the speed, and what full drive adds to it [m/s]."""
        if self.response is None:
            return 1.0, 0.0
        kept = xp.exp(-dt / self.response.lag)
        return kept, (1.0 - kept) * self.response.top_speed

    def slopes(self, s: States, dt: Real, drive: Real, xp: Any) -> tuple[Any, Any]:
        """Slopes F = ∂f/∂x (n, n) of :meth:`advanced`, and the noise Q (n, n) of the step."""
        at, n = self.names.index, len(self.names)
        kept, gained = self._speed(dt, xp)
        arc = _arc(s, kept * s["v"] + gained * drive, dt, self.known_heading, xp)
        share = 0.5 * (1.0 + kept)  # of the old speed in the mean speed
        v, yaw_rate = at("v"), at("yaw_rate")
        F = {(i, i): 1.0 for i in range(n)}
        F[v, v], F[PSI, yaw_rate] = kept, dt
        # columns of the noise: speed, yaw rate
        noise = {(v, 0): 1.0, (PSI, 1): 0.5 * dt, (yaw_rate, 1): 1.0}
        for i in range(2):  # x, y
            F[i, PSI], F[i, v], F[i, yaw_rate] = (
                arc.by_heading[i],
                share * arc.by_speed[i],
                arc.by_turn[i],
            )
            noise[i, 0], noise[i, 1] = 0.5 * arc.by_speed[i], 0.5 * arc.by_turn[i]
        if "way" in self.names:
            way, turn = at("way"), at("turn")
            F[way, v], F[turn, yaw_rate] = share * dt, dt
            noise[way, 0], noise[turn, 1] = 0.5 * dt, 0.5 * dt
        G = matrix(noise, n, 2, xp)
        Q = (G * xp.array([self.speed * dt, self.yaw_rate * dt])) @ G.T
        return matrix(F, n, n, xp), Q + dt * xp.array(self.walks) * xp.eye(n)


@dataclass(frozen=True)
class _Arc:
    """Slopes of x and y by the mean speed, the yaw rate and the heading, (2,) each."""

    by_speed: tuple[Real, Real]
    by_turn: tuple[Real, Real]
    by_heading: tuple[Real, Real]


def _arc(s: States, v_after: Real, dt: Real, known_heading: bool, xp: Any) -> _Arc:
    forward = 0.5 * (s["v"] + v_after)
    half = 0.5 * s["yaw_rate"] * dt
    straight = abs(half) < _SMALL_HALF_TURN
    safe = xp.where(straight, 1.0, half)
    sin, cos = xp.sin(safe), xp.cos(safe)
    shrink = xp.where(straight, 1.0 - half * half / 6.0, sin / safe)
    shrinking = xp.where(straight, -half / 3.0, (safe * cos - sin) / (safe * safe))
    along, across = xp.cos(s["psi"] + half), xp.sin(s["psi"] + half)
    way, change = forward * dt * shrink, 0.5 * forward * dt * dt * shrinking
    by_speed = dt * shrink * along, dt * shrink * across
    if known_heading:
        return _Arc(by_speed, (0.0, 0.0), (0.0, 0.0))
    by_turn = (
        change * along - 0.5 * dt * way * across,
        change * across + 0.5 * dt * way * along,
    )
    return _Arc(by_speed, by_turn, (-way * across, way * along))


def matrix(entries: Mapping[tuple[int, int], Real], rows: int, columns: int, xp: Any) -> Any:
    """A matrix of zeros but for its entries (row, column)."""
    zeros = xp.zeros((rows, columns))
    if compiled(xp):
        at = np.array(list(entries)).T
        return zeros.at[at[0], at[1]].set(xp.array(list(entries.values())))
    for place, value in entries.items():
        zeros[place] = value
    return zeros


def is_angle(name: str) -> bool:
    """Whether a state or a reading is a heading, which wraps around."""
    return name in {"psi", "psi_vo", "vo_psi", "heading"}
