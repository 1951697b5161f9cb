"""A trajectory: wheel travel between equal instants, and the pose where it was measured anew.

Telemetry repeats measurements: a lidar's pose may come every fifth row of a log, late and
unevenly. A repeat carries nothing new, so a trajectory keeps the new measurements with their
instants, and the wheel travel on a grid of its own, fine enough to read the path between rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.data.column_words import meaning, words
from sysid.data.facts import LogFacts
from sysid.data.record import Array, Index, Record
from sysid.errors import DataError
from sysid.robot.calibration.geometry import filled, in_one_frame
from sysid.robot.calibration.windows import OVERLAP, WINDOW, Track
from sysid.vehicle.kinematics import Geometry

SLOWEST_GRID, FASTEST_GRID = 0.05, 0.02
"""Steps of the grid [s]: at 1 m/s and 1 rad/s a chord of the slowest one errs by 0.3 mm, and no
vehicle changes its speed within the fastest one."""

OFF_LENGTH = 0.125
"""A window may be longer or shorter by this share, where measurements come unevenly."""

AT_REST = 0.02
"""A vehicle is at rest in a window in which the wheels turn less than this share of what they turn
at the log's usual speeds: there is nothing to learn, and errors of nothing flatter a model."""

IMPOSSIBLE = 3.0
"""A pose has jumped where it moves so many times as far as usual for what the wheels roll around
that time: wheels that slip carry the vehicle less far in one place, three times as far in none."""

USUAL = 0.75
"""… the quantile that is usual: many steps lie beside a motion and not in it, and joined logs may
hold a jump in every eighth."""

LATEST = 1.0
"""… which is looked for within this time [s], because poses come late."""

NOISES = 10.0
"""… by more than so many standard deviations of its steps, as noise of the pose moves it, too."""

STILL = 1e-3
"""A vehicle whose wheels never turn faster than this [rad/s] does not drive."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One record as the fit of a vehicle sees it.

    Attributes:
        step: of the grid [s].
        omega: mean speed of the left and the right wheels in each step of the grid, (N, 2) [rad/s].
        at: instants of the pose's measurements, from the start of the record, (M,) [s].
        pose: x, y [m], ψ [rad], not wrapped, at these instants, (M, 3).
        joins: number of the stretch without a jump that each measurement belongs to, (M,).
    """

    name: str
    step: float
    omega: Array
    at: Array
    pose: Array
    joins: Index

    @cached_property
    def nodes(self) -> Array:
        return np.asarray(np.arange(len(self.omega) + 1) * self.step, dtype=np.float64)

    def windows(self, length: float = WINDOW) -> Index:
        """First and last measurement of every window in which the wheels turn, (W, 2).

        Windows begin ``OVERLAP`` times in their length, and hold no jump.

        Args:
            length: of the windows [s].
        """
        ends = self.at + length
        after = np.searchsorted(self.at, ends)
        before = np.maximum(after - 1, 0)
        after = np.minimum(after, len(self.at) - 1)
        closer = np.abs(self.at[before] - ends) < np.abs(self.at[after] - ends)
        last = np.where(closer, before, after)
        whole = np.abs(self.at[last] - ends) <= OFF_LENGTH * length + 1e-9
        good = whole & (self.joins == self.joins[last]) & self._driven(last)
        chosen, latest = [], -np.inf
        for i in np.flatnonzero(good):
            if self.at[i] >= latest + length / OVERLAP - 1e-9:
                chosen.append(i)
                latest = self.at[i]
        first = np.array(chosen, dtype=np.intp)
        return np.column_stack([first, last[first]])

    def _driven(self, last: Index) -> NDArray[np.bool_]:
        """Whether the wheels turn between each measurement and its last one, (M,)."""
        rolled = np.concatenate([[0.0], np.cumsum(np.abs(self.omega).max(axis=1)) * self.step])
        between = np.interp(self.at[last], self.nodes, rolled) - np.interp(
            self.at, self.nodes, rolled
        )
        usual = float(np.quantile(np.abs(self.omega).max(axis=1), 0.9))
        return np.asarray(between > AT_REST * usual * (self.at[last] - self.at))


@dataclass(frozen=True, eq=False)
class Part:
    """Windows of one trajectory.

    Attributes:
        windows: first and last measurement of each, (W, 2).
    """

    trajectory: Trajectory
    windows: Index


@dataclass(frozen=True, eq=False)
class Trajectories:
    """The trajectories of one vehicle.

    Attributes:
        each: in the order of the records.
        tracks: the same as the effects of the vehicle stage see them, with every row of the log.
        notes: what was done to them, in sentences.
    """

    each: tuple[Trajectory, ...]
    tracks: tuple[Track, ...]
    notes: tuple[str, ...]


def trajectories_of(records: Sequence[Record], geometry: Geometry) -> Trajectories:
    """The trajectories that the records hold.

    Args:
        records: of one vehicle.
        geometry: its lengths, as far as they are known: they bring speeds in m/s to rad/s.
    """
    missing = what_is_missing(records)
    if missing:
        raise DataError(missing)
    facts = LogFacts(tuple(_sided(r, geometry) for r in records)).without_repeats
    records = facts.records
    said = []
    if meaning(records[0].output_names[0]).quantity == "command":
        said.append(
            "No wheel speeds were measured, so the commanded ones are used; the lag of the pose "
            "then includes the response of the wheels."
        )
    elif all(np.isfinite(r.y).all() for r in records):
        clean = facts.outliers
        records = clean.records
        if clean.words:
            said.append(
                f"Interpolated: {clean.words} far from their neighbours, as after lost telegrams."
            )
    raw = tuple(Track(r.y, r.pose, r.dt) for r in records if r.pose is not None)
    if max(float(np.nanmax(np.abs(t.omega))) for t in raw) < STILL:
        raise DataError(f"the wheels of {records[0].name} never turn; give a log of a drive")
    tracks, changed = in_one_frame(raw) if all(len(t.starts) for t in raw) else (raw, ())
    each = tuple(_drive(r.name, t) for r, t in zip(records, tracks, strict=True))
    each, jumped = _without_jumps(each)
    return Trajectories(each, tracks, (*said, *changed, *jumped))


# What a log must hold ---------------------------------------------------------------------------


def what_is_missing(records: Sequence[Record]) -> str:
    """What the records lack, as a sentence with how to name it; empty where all is there."""
    lacking = []
    first = records[0]
    if any(r.pose is None for r in records):
        lacking.append(
            "a pose in three columns such as x, y [m] and psi [rad] (a second file with it can be "
            "joined by `join`)"
        )
    if _sides_of(first) is None:
        lacking.append(
            "wheel speeds of the left and of the right side in two columns such as omega_l and "
            "omega_r [rad/s] (name others with `outputs`)"
        )
    if not lacking:
        return ""
    has = ", ".join((*first.input_names, *first.output_names))
    return (
        f"{first.name} lacks {' and '.join(lacking)}, which radius, width and slip need; "
        f"it has {has}"
    )


_WHEELS = {
    **dict.fromkeys(("fl", "rl", "bl", "lf", "lr", "lb"), "left"),
    **dict.fromkeys(("fr", "rr", "br", "rf", "rb"), "right"),
}
"""Words for one wheel of several: front left, rear right …"""


def side_of(name: str) -> str:
    """The side in a column's name, ``left`` or ``right``; empty without one."""
    by_wheel = next((_WHEELS[w] for w in words(name) if w in _WHEELS), "")
    return by_wheel or meaning(name).side


def _sides_of(record: Record) -> tuple[str, list[int], list[int]] | None:
    """Where the speeds of both sides stand: among outputs or inputs, and their columns."""
    for place in ("outputs", "inputs"):
        channels = getattr(record, place)
        speeds = [
            (k, side_of(c.name))
            for k, c in enumerate(channels)
            if c.unit in ("rad/s", "m/s", "")
            and not (place == "inputs" and c.unit not in ("rad/s", "m/s"))
        ]
        left, right = ([k for k, side in speeds if side == s] for s in ("left", "right"))
        if left and len(left) == len(right):
            return place, left, right
        if place == "outputs" and len(channels) == 2 and len(speeds) == 2 and not left + right:
            return place, [0], [1]
    return None


def _sided(record: Record, geometry: Geometry) -> Record:
    """The record with the mean speeds of its left and of its right wheels [rad/s] as outputs."""
    sides = _sides_of(record)
    if sides is None:
        raise DataError(what_is_missing([record]))
    place, left, right = sides
    values, channels = (
        (record.y, record.outputs) if place == "outputs" else (record.u, record.inputs)
    )
    both = np.column_stack([values[:, left].mean(axis=1), values[:, right].mean(axis=1)])
    if channels[left[0]].unit == "m/s":
        both = both / geometry.r
    named = tuple(replace(channels[k[0]], unit="rad/s") for k in (left, right))
    return replace(record, y=both, outputs=named, weights=None, sha256=record.sha256)


# Onto the grid ----------------------------------------------------------------------------------


def _drive(name: str, track: Track) -> Trajectory:
    dt = track.dt
    step = dt / np.ceil(dt / SLOWEST_GRID - 1e-9) if dt > SLOWEST_GRID else max(dt, FASTEST_GRID)
    t = np.arange(len(track.omega), dtype=np.float64) * dt
    lost = ~np.isfinite(track.omega).all(axis=1)
    rolled = np.zeros((len(t), 2))
    omega = np.column_stack([filled(track.omega[:, k]) for k in (0, 1)])
    rolled[1:] = np.cumsum(0.5 * dt * (omega[1:] + omega[:-1]), axis=0)
    nodes = np.arange(int(t[-1] / step + 1e-9) + 1) * step
    on_grid = np.column_stack([np.interp(nodes, t, rolled[:, k]) for k in (0, 1)])
    there = np.isfinite(track.pose).all(axis=1)
    moved = np.any(np.diff(track.pose, axis=0, prepend=track.pose[:1] - 1.0) != 0.0, axis=1)
    at_rest = (np.abs(omega) < STILL).all(axis=1)
    rows = np.flatnonzero(there & (moved | at_rest))
    pose = track.pose[rows].copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    gaps = np.concatenate([[0], np.cumsum(lost)])
    return Trajectory(name, step, np.diff(on_grid, axis=0) / step, t[rows], pose, gaps[rows])


def _without_jumps(
    trajectories: tuple[Trajectory, ...],
) -> tuple[tuple[Trajectory, ...], tuple[str, ...]]:
    """The trajectories, cut where the pose moves faster than the wheels ever roll.

    How far these carry it is seen in the log itself, so that no length need be known.
    """
    cut, count = [], 0
    for d in trajectories:
        jumped = _jumps(d)
        count += int(jumped.sum())
        cut.append(replace(d, joins=d.joins + np.cumsum(jumped)))
    if not count:
        return tuple(cut), ()
    times = "time" if count == 1 else "times"
    text = (
        f"The pose jumps {count} {times} farther than the wheels can move the vehicle; no window "
        "spans a jump."
    )
    return tuple(cut), (text,)


def _jumps(d: Trajectory) -> NDArray[np.bool_]:
    from scipy.ndimage import maximum_filter1d

    jumped = np.zeros(len(d.at), dtype=bool)
    if len(d.at) < 3:
        return jumped
    gap = np.diff(d.at)
    gap = gap + float(np.median(gap))  # a measurement may come late by the time of one
    moves = np.diff(d.pose, axis=0)
    way, turn = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
    around = max(round(LATEST / d.step), 1)
    for moved, wheels in ((way, d.omega.sum(axis=1)), (turn, np.diff(d.omega, axis=1)[:, 0])):
        most = maximum_filter1d(np.abs(wheels), 2 * around + 1, mode="nearest")
        at = np.clip((d.at[1:] / d.step).astype(int), 0, len(most) - 1)
        reach = most[at] * gap
        driven = reach > 0.1 * float(reach.max(initial=0.0))
        scale = float(np.quantile(moved[driven] / reach[driven], USUAL)) if driven.any() else 0.0
        noise = 1.4826 * float(np.median(np.abs(moved - np.minimum(moved, scale * reach))))
        typical = 1.4826 * float(np.median(np.abs(moved - np.median(moved))))
        limit = IMPOSSIBLE * scale * reach + NOISES * max(noise, typical)
        jumped[1:] |= moved > limit + 1e-9
    return jumped
