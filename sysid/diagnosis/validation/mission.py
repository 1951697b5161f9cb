"""Validation on a mission: the path of a robot, measured and by the original and augmented models.

Open loop: the logged commands drive each model, whose wheel speeds move the vehicle; every error of
motors and ground adds up along the way. Closed loop: the mission is driven again by both plants,
with guidance, control and an odometry that sees the wheels alone.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.pose.ground_model import without_sensor_effects
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.robot.calibration.windows import path_of, track_channels
from sysid.robot.mission.clearance import has_surfaces, step_clearance
from sysid.robot.mission.contracts import Pose
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.model import Model
from sysid.structures.physics import ground_effects
from sysid.vehicle.kinematics import Geometry, wrap_angle

SAME_PLACE = 0.05
"""A log that begins within so many metres and radians of the mission's start begins there: the
start is then known better than by one noisy measurement."""

ELSEWHERE = 0.25
"""A log begins elsewhere where it begins farther from the start than this share of the way …"""

LEAST_ELSEWHERE = 0.3
"""… and than this [m]: places are set by hand and seen by cameras."""

ASTRAY = 0.5
"""A log that stays farther from the goal than this share of the way was not on its way there."""

HEAD = 20
"""Samples at the head of a log that the state of a model is fitted to."""

WHICH = {"before": "original", "after": "augmented"}

ROWS = 400
"""Points of a path kept for the picture."""

STRIDE = 0.5
"""Way is summed over steps of this length [s], or noise of the place would add to it."""


def prove_on_mission(
    mission_path: str | Path,
    records: Sequence[Record],
    before: Model,
    after: Model,
    geometry: Geometry | None = None,
) -> dict[str, Any]:
    """Compare both models with measured paths.

    Args:
        mission_path: the mission file; its geometry moves the vehicle.
        records: whole mission logs with pose; the first is compared with the closed loop.
        before, after: models of two tracks; effects of the vehicle are part of them.

    Returns:
        JSON-able: ``mission``, ``open_loop``, ``closed_loop``, ``sentence``, ``warnings``, and
        ``traces``, the paths x, y [m] of every log: measured and by both models under the logged
        commands.
    """
    mission = load_mission(mission_path)
    if geometry is not None:
        mission = mission.with_geometry(geometry)
    posed = [r for r in records if r.pose is not None and np.isfinite(r.pose).all(axis=1).sum() > 1]
    channels = track_channels(posed[0]) if posed else None
    if channels is None:
        raise ModelError(
            "the path cannot be compared: no log has the columns x, y, psi and the speeds of a "
            "left and a right side"
        )
    replays = [_Replay(r, mission, channels) for r in posed]
    paths = [
        {"measured": r.measured, "before": r.by(before), "after": r.by(after)} for r in replays
    ]
    driven, warnings = {}, []
    elsewhere = not_this_mission(posed[0], mission, channels)
    for name, model in (("before", before), ("after", after)):
        if elsewhere:  # a drive of another way would be compared with it
            break
        try:
            robot, notes = as_robot(model.plant(), mission)
            driven[name] = simulate(mission, robot)
        except ModelError as error:
            warnings.append(f"The mission cannot be driven by the {WHICH[name]} model: {error}.")
            continue
        warnings += [n for n in notes if n not in warnings]
    return {
        "mission": Path(mission_path).name,
        "open_loop": [
            _open_facts(r.record.name, p) | {"from_measured_speeds": r.by_wheels(after)}
            for p, r in zip(paths, replays, strict=True)
        ],
        "closed_loop": {"measured": _measured_facts(posed[0], mission)}
        | {k: _closed_facts(v, posed[0]) for k, v in driven.items()},
        "sentence": f"{elsewhere} {_sentence(paths[0], driven, posed[0])}".lstrip(),
        "warnings": warnings,
        "traces": [
            {"record": r.record.name, **{name: _drawn(path) for name, path in p.items()}}
            for p, r in zip(paths, replays, strict=True)
        ],
    }


def _drawn(path: Array) -> list[list[float]]:
    """x, y of a path for a picture."""
    points: list[list[float]] = np.round(path[:: max(len(path) // ROWS, 1), :2], 4).tolist()
    return points


def not_this_mission(record: Record, mission: Mission, channels: tuple[int, int]) -> str:
    """Why a log cannot be a drive of this mission, or nothing.

    It begins elsewhere, never comes near the goal, or strays farther from start and goal than they
    lie apart. Slip or wrong radii may lead a robot astray that believes it is there, so the path by
    its wheels counts as well as the measured one.

    Args:
        channels: outputs of the left and of the right track.

    Returns:
        A sentence, empty where start, goal and path fit.
    """
    replay = _Replay(record, mission, channels)
    place = replay.measured[np.isfinite(replay.measured).all(axis=1), :2]
    start, goal = np.array(mission.start[:2]), np.array(mission.goal)
    apart = max(float(np.hypot(*(goal - start))), mission.tolerance)
    off = float(np.hypot(*(place[0] - start)))
    rolled = replay.path(record.y, Ground())[:, :2]
    to_goal = min(float(np.min(np.hypot(*(way - goal).T))) for way in (place, rolled))
    strayed = float(np.max(np.minimum(*(np.hypot(*(place - p).T) for p in (start, goal)))))
    reasons = []
    if off > max(ELSEWHERE * apart, LEAST_ELSEWHERE):
        reasons.append(f"begins {off:.2g} m from its start")
    if to_goal > ASTRAY * apart + mission.tolerance:
        reasons.append(f"comes no nearer than {to_goal:.2g} m to its goal")
    if strayed > apart + mission.guidance.reach:
        reasons.append(f"strays up to {strayed:.2g} m from both")
    if not reasons:
        return ""
    return (
        f"{record.name} was not driven on this mission: it {' and '.join(reasons)}. The mission "
        "was therefore not simulated; give the mission of this log."
    )


# Open loop ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Replay:
    """A log with a pose, and the vehicle of the mission that it drove.

    Attributes:
        channels: outputs of the left and of the right track.
    """

    record: Record
    mission: Mission
    channels: tuple[int, int]

    @property
    def measured(self) -> Array:
        """x, y [m], ψ [rad], (N, 3)."""
        assert self.record.pose is not None
        return self.record.pose

    @cached_property
    def start(self) -> Array:
        """The mission's start where the log begins there, else the first pose measured."""
        first = self.measured[int(np.argmax(np.isfinite(self.measured).all(axis=1)))]
        given = np.array(self.mission.start)
        near = math.dist(first[:2], given[:2]) < SAME_PLACE
        return given if near and abs(wrap_angle(first[2] - given[2])) < SAME_PLACE else first

    def path(self, omega: Array, ground: Ground) -> Array:
        """Where wheel speeds (N, ny) lead, (N, 3)."""
        moved = ground.ordered(self.channels) if ground else ground
        wheels = np.nan_to_num(omega[:, list(self.channels)])
        return path_of(wheels, self.record.dt, moved, self.mission.vehicle.geometry, self.start)

    def by(self, model: Model) -> Array:
        """Where the logged commands lead a model, (N, 3)."""
        wheels, r = without_sensor_effects(model), self.record
        run = wheels.simulate(r.u, wheels.fitted_state(r, HEAD))
        return self.path(run, ground_effects(model.structure, model.theta))

    def by_wheels(self, after: Model) -> dict[str, float]:
        """Path errors of the measured speeds, without and with the effects of the vehicle."""
        ground, errors = ground_effects(after.structure, after.theta), dict[str, float]()
        for name, acting in (("before", Ground()), ("after", ground)):
            rms, end, _ = _apart(self.path(self.record.y, acting), self.measured)
            errors |= {f"rms_{name}_m": rms, f"end_{name}_m": end}
        return errors


def _apart(path: Array, measured: Array) -> tuple[float, float, float]:
    """RMS distance [m], distance at the end [m], RMS of the heading [rad]."""
    n = min(len(path), len(measured))
    gap = path[:n] - measured[:n]
    gap = gap[np.isfinite(gap).all(axis=1)]
    far = np.hypot(gap[:, 0], gap[:, 1])
    turned = wrap_angle(gap[:, 2])
    return float(np.sqrt(np.mean(far**2))), float(far[-1]), float(np.sqrt(np.mean(turned**2)))


def _open_facts(record: str, paths: Mapping[str, Array]) -> dict[str, Any]:
    facts: dict[str, Any] = {"record": record}
    for name in ("before", "after"):
        rms, end, heading = _apart(paths[name], paths["measured"])
        facts |= {f"rms_{name}_m": rms, f"end_{name}_m": end, f"heading_rms_{name}_rad": heading}
    if facts["rms_before_m"] > 0:
        facts["shrunk_percent"] = 100.0 * (1.0 - facts["rms_after_m"] / facts["rms_before_m"])
    return facts


# Closed loop --------------------------------------------------------------------------------------


def _measured_facts(record: Record, mission: Mission) -> dict[str, Any]:
    assert record.pose is not None
    known = np.isfinite(record.pose).all(axis=1)
    pose, t = record.pose[known], (record.t - record.t0)[known]
    step = max(1, round(STRIDE / record.dt))
    coarse = np.vstack([pose[::step, :2], pose[-1:, :2]])
    scene, ways = mission.scene(), (Pose(*pose[:-1].T), Pose(*pose[1:].T))
    clearance = step_clearance(scene, *ways, t[1:], np.diff(t), np)
    return {
        "time_s": float((len(record) - 1) * record.dt),
        "final": dict(zip(("x", "y", "psi"), pose[-1].tolist(), strict=True)),
        "path_length_m": float(np.hypot(*np.diff(coarse, axis=0).T).sum()),
        "min_clearance_m": float(np.min(clearance)) if has_surfaces(scene) else None,
    }


def _closed_facts(result: MissionResult, record: Record) -> dict[str, Any]:
    """Summary, and how far from the measured path at equal times; a robot that is done stays."""
    assert record.pose is not None
    t = result.log["t"]
    path = np.column_stack([np.interp(record.t - record.t0, t, result.log[c]) for c in ("x", "y")])
    heading = np.interp(record.t - record.t0, t, np.unwrap(result.log["psi"]))
    rms, end, turned = _apart(np.column_stack([path, heading]), record.pose)
    measured = float((len(record) - 1) * record.dt)
    return result.summary() | {
        "path_error_rms_m": rms,
        "path_error_end_m": end,
        "heading_error_rms_rad": turned,
        "time_error_s": result.time_s - measured,
    }


def _sentence(
    paths: Mapping[str, Array], driven: Mapping[str, MissionResult], record: Record
) -> str:
    old, old_end, _ = _apart(paths["before"], paths["measured"])
    new, new_end, _ = _apart(paths["after"], paths["measured"])
    said = (
        f"Under the logged commands the path error is {_far(old)} RMS ({_far(old_end)} at the end) "
        f"with the original model and {_far(new)} ({_far(new_end)}) with the augmented one."
    )
    if {"before", "after"} <= driven.keys():
        off = {k: _closed_facts(v, record)["path_error_end_m"] for k, v in driven.items()}
        said += (
            f" In closed loop the mission takes {driven['before'].time_s:.1f} s with the original "
            f"and {driven['after'].time_s:.1f} s with the augmented model (measured "
            f"{(len(record) - 1) * record.dt:.1f} s) and ends {_far(off['before'])} and "
            f"{_far(off['after'])} from the end of the measured path."
        )
    return said


def _far(metres: float) -> str:
    return f"{metres:.2f} m" if metres >= 0.1 else f"{1000 * metres:.0f} mm"
