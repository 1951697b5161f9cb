"""Check by the motion that poses and twists follow the conventions of ROS (REP-103, Odometry).

Yaw counts counter-clockwise from x, so that a robot's way points along its heading, forward or
backward; the twist of an Odometry is expressed in the frame of the body, not of the world.
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.bags.clocks import Timed
from sysid.data.finding import Finding, Severity
from sysid.data.record import Array

ALONG = 0.9
"""Share of the way that lies along the heading where a robot drives as it points …"""
ACROSS = 0.6
"""… and where the heading is another angle; a robot that slides sideways lies between."""
SIDEWAYS = 0.1
"""… or, where nearly none lies along it, a frame turned by 90° (a robot on Swedish wheels
drives where it likes and has half of it there)."""
TURNS = 0.5
"""Variation of the heading [rad] below which its sense cannot be judged."""
BETTER = 0.25
"""A frame is accepted where its squared errors are below this share of the other frame's."""
WINDOWS = 200
"""Stretches of the drive that are compared: long ones, as positions are noisy."""


def frame_findings(streams: Sequence[Timed], where: str) -> tuple[Finding, ...]:
    """Poses and twists that break the conventions of ROS.

    Args:
        streams: on one clock.
        where: the bag, for messages.
    """
    column = {n: (s.t, v) for s in streams
              for n, v in zip(s.stream.names, s.stream.values.T, strict=True)}  # fmt: skip
    if not {"x", "y", "psi"} <= column.keys():
        return ()
    t = column["x"][0]
    edges = np.linspace(max(c[0][0] for c in column.values()), t[-1], WINDOWS + 1)
    known = {n: _at(edges, *column[n], n == "psi") for n in ("x", "y", "psi")}
    dx, dy = np.diff(known["x"]), np.diff(known["y"])
    psi = 0.5 * (known["psi"][1:] + known["psi"][:-1])
    moved = np.hypot(dx, dy) > 0.1 * np.max(np.hypot(dx, dy))
    if not moved.any() or np.ptp(psi[moved]) < TURNS:
        return ()
    problem = _sense(dx[moved], dy[moved], psi[moved])
    findings = (
        [Finding("bag", Severity.WARNING, f"{where}: {problem[0]}", problem[1])] if problem else []
    )
    if not problem:
        way = np.column_stack([dx, dy])
        findings += [f for s in streams for f in _twist(s, edges, way, psi, where)]
    return tuple(Finding(f.code, f.severity, f.sentence, f.advice, record=where) for f in findings)


def _at(edges: Array, t: Array, values: Array, turning: bool) -> Array:
    kept = np.isfinite(values)
    values = np.unwrap(values[kept]) if turning else values[kept]
    return np.interp(edges, t[kept], values)


def _sense(dx: Array, dy: Array, psi: Array) -> tuple[str, str] | None:
    """What a heading counts instead of counter-clockwise from x, and what to do."""
    course = np.arctan2(dy, dx)

    def along(heading: Array) -> float:
        return float(np.mean(np.cos(course - heading) ** 2))

    if along(psi) > ACROSS:
        return None
    if along(-psi) > ALONG:
        text = "by the path driven, psi counts clockwise; ROS counts counter-clockwise."
        return text, "Map x, y and psi one by one, psi with a minus before its path."
    if along(0.5 * np.pi - psi) > ALONG:
        text = "by the path driven, psi counts clockwise from north, like a compass."
        return text, "Map psi with a minus before its path, and swap x and y with a sign."
    if along(psi) > SIDEWAYS:
        return None
    text = "the path driven is perpendicular to psi."
    return text, "Check that the pose is that of the robot and psi its yaw."


def _twist(stream: Timed, edges: Array, way: Array, psi: Array, where: str) -> tuple[Finding, ...]:
    """Whether the speed of an Odometry is that along the world's x, not along the body's."""
    s = stream.stream
    at = [k for k, path in enumerate(s.paths) if path.endswith("twist.linear.x")]
    if not at or not s.kind.endswith("Odometry"):
        return ()
    speed = s.values[:, at[0]]
    area = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(stream.t))])
    published = np.diff(np.interp(edges, stream.t, area))
    body = way[:, 0] * np.cos(psi) + way[:, 1] * np.sin(psi)
    squared_errors = [float(np.sum((published - w) ** 2)) for w in (way[:, 0], body)]
    if not squared_errors[0] < BETTER * squared_errors[1]:
        return ()
    frame, child = s.frames
    text = (
        f"{where}: by the path driven, twist.twist.linear of {s.topic} is expressed in "
        f"{frame or 'the world'}; nav_msgs/Odometry expects {child or 'the body'}."
    )
    advice = "Map the wheel speeds instead, or correct the publisher."
    return (Finding("bag", Severity.WARNING, text, advice),)
