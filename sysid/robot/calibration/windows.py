"""Increments of the pose over windows: measured, and from wheel speeds.

A window of two seconds is short enough that errors of the heading hardly turn its path, and long
enough that noise of the pose, which enters at its two ends only, is small against the way. In the
body frame at the window's start an increment is (forward [m], lateral [m], turn [rad]); the
measured heading serves for that frame. Speeds run linearly between samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.data.column_words import left_and_right
from sysid.data.noise import white_noise
from sysid.data.record import Array, Record
from sysid.effects.ground import Ground
from sysid.effects.lag import followed
from sysid.vehicle.kinematics import Geometry, body_velocity, chained_arcs, seen_from

WINDOW = 2.0
"""Length of a window [s]."""

OVERLAP = 4
"""Windows begin this many times in a window's length."""

BLOCK = 3.0
"""Length of the stretches [s] that go to the estimation and to the held-out part in turn, where
there is no other log to judge; windows that cross from one to the next are left out."""

CHANNELS = ("x", "y", "psi")
"""Increments: forward, lateral, turn."""


@dataclass(frozen=True, eq=False)
class Track:
    """A record as the vehicle stage sees it.

    Attributes:
        omega: measured wheel speeds, left and right, (N, 2) [rad/s].
        pose: x, y [m], ψ [rad], (N, 3).
        dt: sample time [s].
        part: 0 for windows in the first, third … stretch, 1 for the others, None for all.
    """

    omega: Array
    pose: Array
    dt: float
    part: int | None = None

    @cached_property
    def span(self) -> int:
        return max(2, round(WINDOW / self.dt))

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """First samples of the windows whose numbers are all there."""
        if len(self.omega) <= self.span:
            return np.zeros(0, dtype=np.intp)
        first = np.arange(0, len(self.omega) - self.span, max(1, self.span // OVERLAP))
        there: NDArray[np.bool_] = np.asarray(np.isfinite(self.pose).all(axis=1))
        lost = np.concatenate([[0], np.cumsum(~np.isfinite(self.omega).all(axis=1))])
        good = there[first] & there[first + self.span]
        if self.part is not None:
            block = np.floor(first * self.dt / BLOCK + 1e-9)
            inside = (first + self.span) * self.dt <= (block + 1.0) * BLOCK + 1e-9
            good &= inside & (block % 2 == self.part)
        return np.asarray(first[good & (lost[first + self.span + 1] == lost[first])])

    def measured(self, geometry: Geometry) -> Array:
        """Increments of the measured pose, (W, 3).

        A wrapped heading is followed reading by reading, not window by window, in which robots that
        skid may turn half a turn less than their wheels say; over holes the wheels lead it.
        """
        a, b = self.pose[self.starts], self.pose[self.starts + self.span]
        change = seen_from(a[:, 2], b[:, :2] - a[:, :2])
        rolled = self.path(Ground(), geometry)[:, 2]
        (there,) = np.nonzero(np.isfinite(self.pose[:, 2]))
        heading = np.full(len(rolled), np.nan)
        heading[there] = rolled[there] + np.unwrap(self.pose[there, 2] - rolled[there])
        turn = heading[self.starts + self.span] - heading[self.starts]
        return np.column_stack([change, turn])

    def predicted(
        self,
        ground: Ground,
        geometry: Geometry,
        offset: Array | None = None,
        late: tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> Array:
        """Increments that the wheel speeds make, (W, 3).

        Args:
            offset: of the speed sensors, taken off the measurements, (2,) [rad/s].
            late: by how much the pose comes later than the speeds, its heading more, and the time
                constant with which all of it follows, (3,) [s].
        """
        path = self.path(ground, geometry, offset)
        if late[2]:
            path = followed(path, late[2], self.dt)
        x, y, psi = path.T
        if late[0] or late[1]:
            t = np.arange(len(psi)) * self.dt
            x, y = (np.interp(t - late[0], t, v) for v in (x, y))
            psi = np.interp(t - late[0] - late[1], t, psi)
        a, b = self.starts, self.starts + self.span
        change = np.column_stack([x[b] - x[a], y[b] - y[a]])
        return np.column_stack([seen_from(psi[a], change), psi[b] - psi[a]])

    def path(self, ground: Ground, geometry: Geometry, offset: Array | None = None) -> Array:
        """x, y, ψ from the origin by the wheel speeds (missing ones count as rest), (N, 3)."""
        if offset is None or not offset.any():
            return path_of(self._filled, self.dt, ground, geometry)
        return path_of(np.nan_to_num(self.omega - offset), self.dt, ground, geometry)

    @cached_property
    def _filled(self) -> Array:
        return np.asarray(np.nan_to_num(self.omega))


def path_of(
    omega: Array, dt: float, ground: Ground, geometry: Geometry, start: Array | None = None
) -> Array:
    """x, y, ψ (not wrapped) that wheel speeds (N, 2) make from ``start``, (N, 3).

    Arcs of constant speed between samples, at the mean of the speeds at both ends.
    """
    rolled = ground.rolled(omega, dt)
    forward, yaw_rate = body_velocity(rolled[:, 0], rolled[:, 1], geometry)
    lateral = ground.lateral(forward, yaw_rate) if ground.slides else np.zeros(len(omega))
    along, turn, aside = (0.5 * dt * (v[1:] + v[:-1]) for v in (forward, yaw_rate, lateral))
    first = (0.0, 0.0, 0.0) if start is None else start.tolist()
    return chained_arcs(along, turn, aside if ground.slides else None, first)


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the increments (forward, lateral, turn).

    A wrong heading at the start of a window turns its way: what it adds forward goes with the way
    to the side, what it adds to the side with the way forward. Headings that the speeds' noise
    bends within the window act alike, by a third on average.

    Attributes:
        end: variance of the pose at either end, (3,); windows that share a measurement share it.
        rolled, yaw: variances of way [m²] and turn [rad²] by the speeds summed over a window;
            windows share what they overlap.
        tracks: whose windows set the floor.
        beyond: variances [m², m², rad²] of what neither measurements nor noise of the speeds
            explains, (3,): a ground that does not follow the wheels. How long that lasts nobody
            knows, so that every window is taken to err by itself, and four times as much as it
            does, because four windows share what they see.
    """

    end: Array
    rolled: float
    yaw: float
    geometry: Geometry
    tracks: tuple[Track, ...]
    beyond: Array

    def of_windows(self, track: Track) -> tuple[Array, Array]:
        """Variances by the heading at the start, and by the speeds, of every window, (W, 3)."""
        across = track.measured(self.geometry)[:, 1::-1] ** 2
        none = np.zeros(len(across))
        start = np.column_stack([self.end[2] * across, none])
        bent = self.yaw / 3.0 * across + np.array([self.rolled, 0.0])
        return start, np.column_stack([bent, none + self.yaw])

    @cached_property
    def floor(self) -> Array:
        """Standard deviation of a typical increment, without ``beyond``, (3,)."""
        parts = [sum(self.of_windows(t), 2.0 * self.end) for t in self.tracks]
        return np.asarray(np.maximum(np.sqrt(np.mean(np.concatenate(parts), axis=0)), 1e-9))

    def whitener(self, track: Track) -> Callable[[Array], Array]:
        """(W, 3) errors of a record's windows → independent ones of variance one.

        E = L⁻¹ e with LLᵀ the covariance of overlapping windows, which is banded.
        """
        from scipy.linalg import cholesky_banded
        from scipy.linalg.lapack import dtbtrs

        first, span = track.starts, track.span
        start, walk = self.of_windows(track)
        width = min(OVERLAP + 1, len(first) - 1)
        factors = []
        for i in range(3):
            band = np.zeros((width + 1, len(first)))
            alone = OVERLAP * self.beyond[i] + 1e-18
            band[0] = 2.0 * self.end[i] + start[:, i] + walk[:, i] + alone
            root = np.sqrt(walk[:, i])
            for k in range(1, width + 1):
                later = first[k:] - first[:-k]
                shared = root[k:] * root[:-k] * np.maximum(1.0 - later / span, 0.0)
                band[k, : len(later)] = shared - self.end[i] * (later == span)
            factors.append(cholesky_banded(band, lower=True))

        def white(errors: Array) -> Array:
            columns = [dtbtrs(factor, errors[:, i], "L")[0] for i, factor in enumerate(factors)]
            return np.column_stack(columns)

        return white


def increments_noise(tracks: Sequence[Track], geometry: Geometry) -> Noise:
    """Noise of the increments, from the data.

    σ of pose and speeds by third differences (a smooth signal has none; their median passes over
    transients), the pose's after the way of the wheels is taken off. The noise of the ends is
    added to that of the speeds summed over the window; a wrong heading at the start turns the way.
    """
    signals = []
    for track in tracks:
        path = track.path(Ground(), geometry)
        lost = np.unwrap(np.nan_to_num(track.pose[:, 2] - path[:, 2]))
        turned = np.nan_to_num(track.pose[:, 2])
        middle = 0.5 * (turned[1:] + turned[:-1])
        mean = 0.25 * geometry.r * track.dt * (track.omega[1:] + track.omega[:-1]).sum(axis=1)
        gone = np.nan_to_num(mean)[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
        rolled = np.concatenate([np.zeros((1, 2)), np.cumsum(gone, axis=0)])
        columns = np.column_stack([track.pose[:, :2] - rolled, lost, track.omega])
        signals.append(columns)
    sigma = white_noise(signals)
    place, psi = float(np.mean(sigma[:2] ** 2)), float(sigma[2] ** 2)
    wheel = float(np.mean(sigma[3:] ** 2)) * tracks[0].dt ** 2 * tracks[0].span
    return Noise(
        end=np.array([place, place, psi]),
        rolled=0.5 * geometry.r**2 * wheel,
        yaw=2.0 * (geometry.r / geometry.B) ** 2 * wheel,
        geometry=geometry,
        tracks=tuple(tracks),
        beyond=np.zeros(3),
    )


def track_channels(record: Record) -> tuple[int, int] | None:
    """Outputs of the left and of the right track: by name, else the only two in order."""
    if any(c.unit not in ("rad/s", "") for c in record.outputs):
        return None
    named = left_and_right(record.output_names)
    if named is not None:
        return named
    return (0, 1) if record.ny == 2 and record.is_robot_log else None


def tracks_of(
    records: Sequence[Record], channels: tuple[int, int], part: int | None = None
) -> tuple[Track, ...]:
    """The records that have a pose, with the left and the right speed by index.

    Args:
        part: every other stretch only, from the first one on or from the second; in every other
            record the other way round, because missions turn where they begin.
    """
    posed = [r for r in records if r.pose is not None and len(r)]
    tracks = [
        Track(r.y[:, list(channels)], r.pose, r.dt, part if part is None else (part + k) % 2)
        for k, r in enumerate(posed)
        if r.pose is not None
    ]
    return tuple(t for t in tracks if len(t.starts))
