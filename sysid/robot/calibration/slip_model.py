"""The slipping vehicle: wheel speeds to the pose of a point.

    V_s = r_s ω_s (1 − i_t |ω_R − ω_L| / (|ω_R| + |ω_L|)) (1 − i_v |V|)      s = L, R
    v + τ_v v̇ = (V_L + V_R)/2,   ψ̇ + τ_ψ ψ̈ = (V_R − V_L)/B_eff,   v_y = −k v ψ̇
    p(t) = c(t − T) + R(ψ(t − T)) (x_m, y_m),   ψ_read(t) = ψ(t − T_ψ) + δ

The vehicle turns about instantaneous centres that its two sides keep: with B_eff apart, on a line
that runs x_m behind the point of the pose (Mandow et al. 2007; Martínez et al. 2005). What the
wheels lose is the catalogue's law of slip (``sysid.effects``), the way they go the kinematics of
``sysid.vehicle``.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Index
from sysid.effects.ground import Ground
from sysid.effects.vehicle import SLIP, SLIP_SHARE
from sysid.robot.calibration.trajectory import Trajectory
from sysid.vehicle.kinematics import Geometry, body_velocity


@dataclass(frozen=True)
class Term:
    """One number of the model.

    Attributes:
        name: as users see it, where it is not a ratio to a length.
        null: value at which it does nothing.
        spread: what one would guess it may be off by without any log (standard deviation); a
            length's is in units of the vehicle's width, a slip with speed's in those of its speed.
        optional: whether it is in the model only where the log shows it.
        lower: smallest value that can be.
        meaning: what it is, in words.
        shown_by: the manoeuvre that determines it.
    """

    name: str
    unit: str
    null: float
    spread: float
    optional: bool
    lower: float
    meaning: str
    shown_by: str


TERMS = (
    Term(
        "radius_left",
        "m",
        1.0,
        1.0,
        False,
        0.01,
        "effective wheel radius of the left side",
        "long straight runs, forward and backward",
    ),
    Term(
        "radius_right",
        "m",
        1.0,
        1.0,
        False,
        0.01,
        "effective wheel radius of the right side",
        "long straight runs, forward and backward",
    ),
    Term(
        "effective_width",
        "m",
        1.0,
        1.0,
        False,
        1e-3,
        "effective width in turns",
        "turns on the spot and arcs, both ways",
    ),
    Term(
        "marker_x",
        "m",
        0.0,
        1.0,
        False,
        -np.inf,
        "how far the pose's point lies ahead of the axis of rotation",
        "turns on the spot, or tight arcs, both ways",
    ),
    Term(
        "marker_y",
        "m",
        0.0,
        1.0,
        False,
        -np.inf,
        "how far the pose's point lies to the left of the centre line",
        "turns on the spot, or tight arcs, both ways",
    ),
    Term(
        "heading_offset",
        "rad",
        0.0,
        0.5,
        False,
        -np.inf,
        "offset of the heading from the driving direction",
        "straight runs",
    ),
    Term(
        "pose_lag",
        "s",
        0.0,
        1.0,
        False,
        -np.inf,
        "delay of the position after the wheel speeds",
        "starts, stops and changes of the speed",
    ),
    Term(
        "heading_lag",
        "s",
        0.0,
        1.0,
        False,
        -np.inf,
        "delay of the heading after the wheel speeds",
        "turns that start, stop and reverse",
    ),
    Term(
        "slip_turning",
        "1",
        0.0,
        0.5,
        True,
        -0.9,
        "slip of the wheels in a turn on the spot, less in wider turns",
        "turns of several radii with straight runs between them",
    ),
    Term(
        "slip_speed",
        "s/m",
        0.0,
        0.5,
        True,
        -np.inf,
        "slip of the wheels per m/s",
        "straight runs at several speeds, slow and fast",
    ),
    Term(
        "slip_load",
        "s",
        0.0,
        0.5,
        True,
        0.0,
        "slip speed of the wheels per m/s² of the vehicle, which is the lag of its speed",
        "hard starts and stops on a straight line, with a pose whose own lag is known or steady",
    ),
    Term(
        "side_slip",
        "s",
        0.0,
        0.5,
        True,
        -np.inf,
        "outward drift speed per m/s² of centripetal acceleration",
        "wide turns at high speed, both ways",
    ),
    Term(
        "yaw_lag",
        "s",
        0.0,
        0.5,
        True,
        0.0,
        "additional lag of turning, as tyres or tracks scrub",
        "turns that start, stop and reverse while driving",
    ),
)
"""Every number of the model, in the order of q."""

NAMES = tuple(t.name for t in TERMS)
AT: Mapping[str, int] = {t.name: k for k, t in enumerate(TERMS)}
NULLS = np.array([t.null for t in TERMS])
LOWER = np.array([t.lower for t in TERMS])


def ground_of(q: Array) -> Ground:
    """The part of the model that effects of the catalogue hold: slip in turns."""
    share = float(q[AT["slip_turning"]])
    return Ground((SLIP,), {SLIP: {SLIP_SHARE: np.full(2, share)}}) if share else Ground()


def body_speeds(q: Array, omega: Array, step: float, geometry: Geometry) -> tuple[Array, Array]:
    """Forward speed [m/s] and yaw rate [rad/s] of the vehicle, (N,) each.

    Args:
        q: every number; radii and 1/width relative to the geometry's.
        omega: wheel speeds on a grid, (N, 2) [rad/s].
        step: of the grid [s].
        geometry: lengths that q multiplies.
    """
    rolled = ground_of(q).rolled(omega) * q[:2]
    fast = q[AT["slip_speed"]]
    if fast:
        speed = geometry.r * np.abs(rolled).mean(axis=1)
        rolled = rolled * (1.0 - fast * speed)[:, None]
    forward, yaw_rate = body_velocity(rolled[:, 0], rolled[:, 1], geometry)
    yaw_rate = yaw_rate * q[AT["effective_width"]]
    return (
        _following(forward, q[AT["slip_load"]], step),
        _following(yaw_rate, q[AT["yaw_lag"]], step),
    )


def path(q: Array, trajectory: Trajectory, geometry: Geometry, more: Array | float = 0.0) -> Array:
    """x, y [m], ψ [rad] of the vehicle at the nodes of the grid, from the origin, (N + 1, 3).

    Args:
        q: every number, radii and 1/width relative to the geometry's.
        trajectory: what the wheels rolled.
        geometry: lengths that q multiplies.
        more: what something else adds to the way forward and to the left [m] and to the turn [rad]
            of every step of the grid, (N, 3).
    """
    forward, yaw_rate = body_speeds(q, trajectory.omega, trajectory.step, geometry)
    along, turn = forward * trajectory.step, yaw_rate * trajectory.step
    aside = -q[AT["side_slip"]] * forward * turn
    added = np.broadcast_to(more, (len(along), 3))
    along, aside, turn = along + added[:, 0], aside + added[:, 1], turn + added[:, 2]
    psi = np.concatenate([[0.0], np.cumsum(turn)])
    middle = psi[:-1] + 0.5 * turn
    chord = np.sinc(turn / (2.0 * np.pi))
    c, s = chord * np.cos(middle), chord * np.sin(middle)
    out = np.zeros((len(psi), 3))
    out[1:, 0] = np.cumsum(along * c - aside * s)
    out[1:, 1] = np.cumsum(along * s + aside * c)
    out[:, 2] = psi
    return out


def pose_read(
    q: Array, trajectory: Trajectory, geometry: Geometry, more: Array | float = 0.0
) -> Array:
    """The pose that the trajectory's source reads of the vehicle, at its measurements, (M, 3)."""
    x, y, psi = path(q, trajectory, geometry, more).T
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


def increments(pose: Array, windows: Index, offset: float) -> Array:
    """Forward and lateral way [m] and turn [rad] over windows, in the frame at their start, (W, 3).

    Args:
        pose: at every measurement, (M, 3).
        windows: first and last measurement of each, (W, 2).
        offset: of the heading, which is no direction of the vehicle [rad].
    """
    a, b = pose[windows[:, 0]], pose[windows[:, 1]]
    change = b - a
    c, s = np.cos(a[:, 2] - offset), np.sin(a[:, 2] - offset)
    return np.column_stack(
        [
            c * change[:, 0] + s * change[:, 1],
            c * change[:, 1] - s * change[:, 0],
            change[:, 2],
        ]
    )


def window_errors(
    q: Array, trajectory: Trajectory, geometry: Geometry, windows: Index, more: Array | float = 0.0
) -> Array:
    """Measured less predicted increments over windows, (W, 3) [m, m, rad]."""
    offset = float(q[AT["heading_offset"]])
    measured = increments(trajectory.pose, windows, offset)
    error = measured - increments(pose_read(q, trajectory, geometry, more), windows, offset)
    error[:, 2] -= 2.0 * np.pi * np.rint(error[:, 2] / (2.0 * np.pi))
    return error


def _following(values: Array, lag: float, step: float) -> Array:
    """y + τ ẏ = x: means of y over steps in which x is constant, from rest in the first, (N,)."""
    if lag <= 0.0 or not len(values):
        return values
    keep = float(np.exp(-step / lag))
    ends, _ = lfilter([1.0 - keep], np.array([1.0, -keep]), values, zi=np.array([keep * values[0]]))
    starts = np.concatenate([values[:1], ends[:-1]])
    return np.asarray(values + (starts - values) * (lag / step) * (1.0 - keep))
