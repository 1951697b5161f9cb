"""The slipping vehicle: wheel speeds to the pose of a point.

    V_s = r_s ω_s (1 − i_t |ω_R − ω_L| / (|ω_R| + |ω_L|)) (1 − i_v |V|)      s = L, R
    v + τ_v v̇ = (V_L + V_R)/2,   ψ̇ + τ_ψ ψ̈ = (V_R − V_L)/B_eff,   v_y = −k v ψ̇
    p(t) = c(t − T) + R(ψ(t − T)) (x_m, y_m),   ψ_read(t) = ψ(t − T_ψ) + δ

The vehicle turns about instantaneous centres that its two sides keep: with B_eff apart, on a line
that runs x_m behind the point of the pose (Mandow et al. 2007; Martínez et al. 2005). What the
wheels lose is the catalogue's law of slip (``sysid.effects``), the way they go the kinematics of
``sysid.vehicle``.
"""

from abc import ABC
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index
from sysid.effects.ground import Ground
from sysid.effects.vehicle import SLIP, SLIP_SHARE
from sysid.robot.calibration.trajectory import Part, Trajectory
from sysid.vehicle.kinematics import Geometry, body_velocity, chained_arcs, seen_from


@dataclass(frozen=True)
class Term:
    """One number of the model.

    Attributes:
        name: as users see it, where it is not a ratio to a length.
        meaning: what it is, in words.
        shown_by: the manoeuvre that determines it.
        null: value at which it does nothing.
        spread: what one would guess it may be off by without any log (standard deviation); a
            length's is in units of the vehicle's width, a slip with speed's in those of its speed.
        optional: whether it is in the model only where the log shows it.
        lower: smallest value that can be.
    """

    name: str
    meaning: str
    shown_by: str
    unit: str = "m"
    null: float = 0.0
    spread: float = 1.0
    optional: bool = False
    lower: float = -np.inf


def _optional(name: str, unit: str, meaning: str, shown_by: str, lower: float = -np.inf) -> Term:
    return Term(name, meaning, shown_by, unit, spread=0.5, optional=True, lower=lower)


def _length(name: str, meaning: str, shown_by: str, lower: float) -> Term:
    return Term(name, meaning, shown_by, null=1.0, lower=lower)


STRAIGHT = "long straight runs, forward and backward"
TURNS = "turns on the spot and arcs, both ways"
TIGHT_TURNS = "turns on the spot, or tight arcs, both ways"

TERMS = (
    _length("radius_left", "effective wheel radius of the left side", STRAIGHT, 0.01),
    _length("radius_right", "effective wheel radius of the right side", STRAIGHT, 0.01),
    _length("effective_width", "effective width in turns", TURNS, 1e-3),
    Term("marker_x", "how far the pose's point lies ahead of the axis of rotation", TIGHT_TURNS),
    Term("marker_y", "how far the pose's point lies to the left of the centre line", TIGHT_TURNS),
    Term(
        "heading_offset",
        "offset of the heading from the driving direction",
        "straight runs",
        "rad",
        spread=0.5,
    ),
    Term(
        "pose_lag",
        "delay of the position after the wheel speeds",
        "starts, stops and changes of the speed",
        "s",
    ),
    Term(
        "heading_lag",
        "delay of the heading after the wheel speeds",
        "turns that start, stop and reverse",
        "s",
    ),
    _optional(
        "slip_turning",
        "1",
        "slip of the wheels in a turn on the spot, less in wider turns",
        "turns of several radii with straight runs between them",
        -0.9,
    ),
    _optional(
        "slip_speed",
        "s/m",
        "slip of the wheels per m/s",
        "straight runs at several speeds, slow and fast",
    ),
    _optional(
        "slip_load",
        "s",
        "slip speed of the wheels per m/s² of the vehicle, which is the lag of its speed",
        "hard starts and stops on a straight line, with a pose whose own lag is known or steady",
        0.0,
    ),
    _optional(
        "side_slip",
        "s",
        "outward drift speed per m/s² of centripetal acceleration",
        "wide turns at high speed, both ways",
    ),
    _optional(
        "yaw_lag",
        "s",
        "additional lag of turning, as tyres or tracks scrub",
        "turns that start, stop and reverse while driving",
        0.0,
    ),
)
"""Every number of the model, in the order of q."""

AT: Mapping[str, int] = {t.name: k for k, t in enumerate(TERMS)}
NULLS = np.array([t.null for t in TERMS])
LOWER = np.array([t.lower for t in TERMS])


def increments(pose: Array, windows: Index, offset: float) -> Array:
    """Forward and lateral way [m] and turn [rad] over windows, in the frame at their start, (W, 3).

    Args:
        pose: at every measurement, (M, 3).
        windows: first and last measurement of each, (W, 2).
        offset: of the heading, which is no direction of the vehicle [rad].
    """
    a = pose[windows[:, 0]]
    change = pose[windows[:, 1]] - a
    return np.column_stack([seen_from(a[:, 2] - offset, change[:, :2]), change[:, 2]])


class Motion(ABC):
    """A model that predicts the pose from the wheel speeds.

    Attributes:
        q: every number, in the order of ``TERMS``; radii and 1/width relative to ``geometry``.
        geometry: lengths that q multiplies.
    """

    q: Array
    geometry: Geometry

    def added(self, trajectory: Trajectory) -> Array | float:
        """Way forward and to the left [m] and turn [rad] that something else adds in each step of
        a grid, (N, 3)."""
        return 0.0

    def errors(self, parts: Sequence[Part]) -> Array:
        """Measured minus predicted increments of windows, (W, 3) [m, m, rad]."""
        return np.concatenate([self._window_errors(p.trajectory, p.windows) for p in parts])

    def predicted_pose(self, trajectory: Trajectory) -> Array:
        """x, y [m], ψ [rad] that the trajectory's source would read, from any start, (M, 3)."""
        q = self.q
        x, y, psi = self._path(trajectory).T
        late = trajectory.at - q[AT["pose_lag"]]
        heading = np.interp(late, trajectory.nodes, psi)
        c, s = np.cos(heading), np.sin(heading)
        ahead, left = q[AT["marker_x"]], q[AT["marker_y"]]
        return np.column_stack(
            [
                np.interp(late, trajectory.nodes, x) + c * ahead - s * left,
                np.interp(late, trajectory.nodes, y) + s * ahead + c * left,
                np.interp(trajectory.at - q[AT["heading_lag"]], trajectory.nodes, psi)
                + q[AT["heading_offset"]],
            ]
        )

    def driven(self, trajectory: Trajectory) -> tuple[Array, Array]:
        """Way [m] and angle turned [rad] in each step of a trajectory's grid."""
        forward, yaw_rate = self._body_speeds(trajectory)
        added = np.broadcast_to(self.added(trajectory), (len(forward), 3))
        return forward * trajectory.step + added[:, 0], yaw_rate * trajectory.step + added[:, 2]

    def _body_speeds(self, trajectory: Trajectory) -> tuple[Array, Array]:
        """Forward speed [m/s] and yaw rate [rad/s] of wheels alone in each step, (N,) each."""
        q, step = self.q, trajectory.step
        share = float(q[AT["slip_turning"]])
        ground = Ground((SLIP,), {SLIP: {SLIP_SHARE: np.full(2, share)}}) if share else Ground()
        rolled = ground.rolled(trajectory.omega) * q[:2]
        fast = q[AT["slip_speed"]]
        if fast:
            speed = self.geometry.r * np.abs(rolled).mean(axis=1)
            rolled = rolled * (1.0 - fast * speed)[:, None]
        forward, yaw_rate = body_velocity(rolled[:, 0], rolled[:, 1], self.geometry)
        yaw_rate = yaw_rate * q[AT["effective_width"]]
        return (
            _following(forward, q[AT["slip_load"]], step),
            _following(yaw_rate, q[AT["yaw_lag"]], step),
        )

    def _path(self, trajectory: Trajectory) -> Array:
        """x, y [m], ψ [rad] of the vehicle at the nodes of the grid, from the origin."""
        forward, yaw_rate = self._body_speeds(trajectory)
        along, turn = forward * trajectory.step, yaw_rate * trajectory.step
        aside = -self.q[AT["side_slip"]] * forward * turn
        added = np.broadcast_to(self.added(trajectory), (len(along), 3))
        return chained_arcs(along + added[:, 0], turn + added[:, 2], aside + added[:, 1])

    def _window_errors(self, trajectory: Trajectory, windows: Index) -> Array:
        offset = float(self.q[AT["heading_offset"]])
        measured = increments(trajectory.pose, windows, offset)
        error = measured - increments(self.predicted_pose(trajectory), windows, offset)
        error[:, 2] -= 2.0 * np.pi * np.rint(error[:, 2] / (2.0 * np.pi))
        return error


def nothing(trajectory: Trajectory) -> float:
    """What is added to wheels that do what their numbers say."""
    return 0.0


@dataclass(frozen=True, eq=False)
class Kinematic(Motion):
    """Wheels of these numbers: what such a vehicle does, and the model that others start from.

    Attributes:
        more: what something else adds; see :meth:`Motion.added`.
    """

    geometry: Geometry
    q: Array = field(default_factory=NULLS.copy)
    more: Callable[[Trajectory], Array | float] = nothing

    def added(self, trajectory: Trajectory) -> Array | float:
        return self.more(trajectory)


def _following(values: Array, lag: float, step: float) -> Array:
    """y + τ ẏ = x: means of y over steps in which x is constant, from rest in the first, (N,)."""
    if lag <= 0.0 or not len(values):
        return values
    keep = float(np.exp(-step / lag))
    ends, _ = lfilter([1.0 - keep], np.array([1.0, -keep]), values, zi=np.array([keep * values[0]]))
    starts = np.concatenate([values[:1], ends[:-1]])
    return np.asarray(values + (starts - values) * (lag / step) * (1.0 - keep))
