"""Radius and track distance estimated from a pose and wheel speeds.

With the measured heading ψ the way of a window is linear in the radius, its turn in r/B:

    Δx + iΔy = r e^{iα} Σ ½(ω_L + ω_R) e^{iψ} Δt,    Δψ = (r/B) Σ (ω_R − ω_L) Δt

A constant angle α between heading and way, a heading that counts clockwise or in degrees and axes
that are mirrored are found from the same two lines: with the right ones the first line holds.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sysid.criteria.coloured import coloured_gram
from sysid.data.record import Array
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.robot.calibration.windows import OVERLAP, Track
from sysid.vehicle.kinematics import Geometry

CONTRADICTS = 0.20
"""A length that the pose puts further from the given one than this share contradicts it: tracks
that sink in, stretch or wear change it by less."""

SURE = 3.0
"""Standard errors by which a length must be off."""

KNOWN = 0.10
"""A radius or a turn with a larger relative standard error is not known from the pose."""

FRAME = 0.5
"""A heading is read in another way than it is given when that leaves less than this share of the
way that the speeds do not determine."""

FAR, ROUNDS = 3.0, 10
"""Windows that err by more than so many times the median count less, in so many rounds."""

ASKEW = 0.2
"""Smallest angle between heading and way [rad] that is taken for a heading counted from elsewhere:
less is what slip to the side does."""

SMALLEST, LARGEST = 0.002, 2.0
"""Radii [m] beyond which rather a unit is wrong: a toy's wheel, a dumper's."""

LEFT_OUT = 0.001
"""Share of a length that speeds which change between samples leave uncertain at least; measured on
made logs: with it the standard errors hold the truth as often as they should."""

BEYOND_A_TURN = 7.0
"""A heading beyond this may be in degrees."""


@dataclass(frozen=True)
class GeometryEstimate:
    """Lengths of the vehicle, estimated from the pose.

    Attributes:
        geometry: r and B; a length that the pose does not determine is that of ``assumed``.
        std_errors: of r and B [m]; None where the pose does not determine the length.
        assumed: what was taken before.
    """

    geometry: Geometry
    std_errors: tuple[float | None, float | None]
    assumed: Geometry

    @property
    def contradicts(self) -> bool:
        """Whether a length is off what was assumed by more than ``CONTRADICTS`` and ``SURE``."""
        lengths = ("r", "B")
        off = {n: abs(getattr(self.geometry, n) - getattr(self.assumed, n)) for n in lengths}
        return any(
            error is not None and off[n] > max(CONTRADICTS * getattr(self.assumed, n), SURE * error)
            for n, error in zip(lengths, self.std_errors, strict=True)
        )

    @property
    def sentence(self) -> str:
        lengths = " and ".join(
            f"{name} = {value:.4g} ± {NORMAL * error:.1g} m"
            if error is not None
            else f"{name} = {value:.4g} m (assumed; not identifiable from this log)"
            for name, value, error in zip(
                ("r", "B"), (self.geometry.r, self.geometry.B), self.std_errors, strict=True
            )
        )
        sentence = (
            f"The pose contradicts the geometry that is assumed unless one is given "
            f"(r = {self.assumed.r:g} m, B = {self.assumed.B:g} m); from the log {lengths}, "
            "with slip and skidding included."
        )
        if not SMALLEST < self.geometry.r < LARGEST:
            sentence += (
                " No vehicle has such a radius, so the pose is not in metres or the speeds are "
                "not in rad/s; give their units."
            )
        return sentence

    def to_json(self) -> dict[str, Any]:
        """{r, B, std_errors, assumed} [m]."""
        errors = dict(zip(("r", "B"), self.std_errors, strict=True))
        return {**asdict(self.geometry), "std_errors": errors, "assumed": asdict(self.assumed)}


@dataclass(frozen=True, eq=False)
class _Ways:
    """What the windows of all tracks say of way and turn.

    Attributes:
        each: windows of each record, in the order of time.
        moved: Δx + iΔy measured, (W,) complex.
        rolled: the same by the speeds at a radius of one, (W,) complex.
        turned: Δψ measured, (W,).
        spun: Σ (ω_R − ω_L) Δt, (W,).
    """

    each: tuple[int, ...]
    moved: Array
    rolled: Array
    turned: Array
    spun: Array

    @cached_property
    def line(self) -> tuple[complex, float]:
        """r e^{iα} and the standard error of r."""
        return _line(self.rolled, self.moved, self.each)

    @cached_property
    def slope(self) -> tuple[float, float]:
        """r/B and its standard error."""
        slope, error = _line(self.spun, self.turned, self.each)
        return float(slope.real), error

    @property
    def rest(self) -> float:
        """Mean distance that no r e^{iα} explains."""
        return float(np.mean(np.abs(self.moved - self.line[0] * self.rolled)))


def _line(x: Array, y: Array, each: Sequence[int]) -> tuple[complex, float]:
    """Factor c of y = c x and the standard error of its size.

    Wheels slip more the faster they go, and for seconds at a time, so the errors e = y − c x are
    neither of one size nor independent. What counts is the sum of s = Re(c̄ x̄ e)/|c|, whose
    variance has the memory of s (den Haan & Levin 1997, Handbook of Statistics 15):

        var |c| = 1ᵀΣ1/(Σ|x|²)²,    Σ from an AR fit of s.

    Errors beyond ``FAR`` times the typical one count less (Huber 1964): a pose that jumps, or logs
    that were cut and joined, spoil some windows and not the lengths.
    """
    weight = np.ones(len(x))
    reach = np.abs(x) + float(np.median(np.abs(x))) + 1e-300
    c = 0.0 + 0.0j
    for _ in range(ROUNDS):
        power = max(float(np.sum(weight * np.abs(x) ** 2)), 1e-300)
        c = complex(np.sum(weight * np.conj(x) * y) / power)
        size = np.abs(y - c * x) / reach
        weight = np.minimum(1.0, FAR * float(np.median(size)) / np.maximum(size, 1e-300))
    freedom = max(len(x) / OVERLAP - 1.0, 1.0)
    # an error cut short does not move the line along its direction, and less across it
    moved = 0.5 * weight if np.iscomplexobj(y) else 0.0
    power = float(np.sum(np.where(weight < 1.0, moved, 1.0) * np.abs(x) ** 2))
    if power <= 1e-300:
        return c, math.inf
    along = c.conjugate() / abs(c) if c else 1.0
    score = weight * np.real(along * np.conj(x) * (y - c * x))
    pieces = np.split(score, np.cumsum(each)[:-1])
    memory = float(coloured_gram([np.ones((len(p), 1)) for p in pieces], pieces)[0, 0])
    return c, math.sqrt(memory * len(x) / freedom / OVERLAP) / power


_DEGREES = math.pi / 180.0
_CONVENTIONS = {
    -1.0: "The heading of the pose counts clockwise; it was reversed.",
    _DEGREES: "The heading of the pose is in degrees; it was converted.",
    -_DEGREES: "The heading of the pose is in degrees and counts clockwise; it was converted.",
}
"""Ways to read a heading, by what it is multiplied with, and what is said of them."""


def _read(track: Track, factor: float = 1.0) -> Track:
    """The track with its heading read so, in radians and not wrapped; missing ones stay so."""
    pose = track.pose.copy()
    there = np.isfinite(pose[:, 2])
    pose[there, 2] = np.unwrap(factor * pose[there, 2])
    return replace(track, pose=pose)


def in_one_frame(tracks: Sequence[Track]) -> tuple[tuple[Track, ...], tuple[str, ...]]:
    """The tracks with a heading that counts as the way does, and what was changed, in words."""
    best, rest = 1.0, FRAME * _ways([_read(t) for t in tracks]).rest
    largest = max(float(np.nanmax(np.abs(t.pose[:, 2]), initial=0.0)) for t in tracks)
    for factor in _CONVENTIONS:
        if abs(factor) != 1.0 and largest < BEYOND_A_TURN:
            continue
        remaining = _ways([_read(t, factor) for t in tracks]).rest
        if remaining < rest:
            best, rest = factor, remaining
    said = [_CONVENTIONS[best]] if best in _CONVENTIONS else []
    read = tuple(_read(t, best) for t in tracks) if said else tuple(tracks)
    ways = _ways([_read(t) for t in read])
    angle = float(np.angle(ways.line[0]))
    if abs(angle) > ASKEW and ways.rest < FRAME * float(np.mean(np.abs(ways.moved))):
        read = tuple(replace(t, pose=t.pose + np.array([0.0, 0.0, angle])) for t in read)
        said.append(
            f"The heading of the pose is {math.degrees(-angle):.3g}° off the driving direction; "
            "it was corrected."
        )
    slope, error = ways.slope
    if slope < -SURE * error and abs(slope) * float(np.ptp(ways.spun)) > ASKEW:
        read = tuple(replace(t, pose=t.pose * np.array([1.0, -1.0, -1.0])) for t in read)
        said.append(
            "The pose turns against the wheel speeds, because left and right are swapped or y "
            "points to the right. The pose was mirrored; check which it is."
        )
    return read, tuple(said)


def lengths_of(tracks: Sequence[Track], assumed: Geometry) -> GeometryEstimate:
    """The lengths that the pose says.

    Args:
        tracks: of one vehicle, in one frame.
        assumed: lengths used where the pose does not determine them.
    """
    ways = _ways([_read(t) for t in tracks])
    scale, r_error = ways.line
    r, (slope, slope_error) = abs(scale), ways.slope
    known_r, known_turn = r_error < KNOWN * r, slope_error < KNOWN * abs(slope)
    radius = r if known_r else assumed.r
    width = radius / slope if known_turn and slope > 0.0 else assumed.B
    r_error = math.hypot(r_error, LEFT_OUT * r)
    relative = math.hypot(slope_error / slope if slope else 0.0, r_error / r if known_r else 0.0)
    return GeometryEstimate(
        Geometry(radius, width),
        (r_error if known_r else None, relative * width if known_turn else None),
        assumed,
    )


def contradicted(tracks: Sequence[Track], assumed: Geometry) -> GeometryEstimate | None:
    """The lengths that the pose says, where it contradicts the assumed ones; else None.

    Args:
        tracks: of one vehicle, in one frame.
        assumed: lengths that were not given.
    """
    estimate = lengths_of(tracks, assumed)
    return estimate if estimate.contradicts else None


def _ways(tracks: Sequence[Track]) -> _Ways:
    """Ways and turns over all windows of tracks whose headings are not wrapped.

    A record that is cut into stretches comes as two tracks; here it counts once, as a whole.
    """
    parts = []
    for t in (replace(t, part=None) for t in tracks if t.part != 1):
        psi = filled(t.pose[:, 2])
        omega = np.nan_to_num(t.omega)
        mean = 0.25 * t.dt * (omega[1:] + omega[:-1]).sum(axis=1)
        spin = 0.5 * t.dt * np.diff(omega[1:] + omega[:-1], axis=1)[:, 0]
        middle = 0.5 * (psi[1:] + psi[:-1])
        way = np.concatenate([[0.0], np.cumsum(mean * np.exp(1j * middle))])
        turn = np.concatenate([[0.0], np.cumsum(spin)])
        z = t.pose[:, 0] + 1j * t.pose[:, 1]
        both = np.column_stack([z, way, psi, turn])
        parts.append(both[t.starts + t.span] - both[t.starts])
    moved, rolled, turned, spun = np.concatenate(parts).T
    return _Ways(tuple(map(len, parts)), moved, rolled, turned.real, spun.real)


def filled(values: Array) -> Array:
    """Evenly sampled values with those that are missing interpolated; zeros where all are."""
    there = np.isfinite(values)
    at = np.arange(len(values))
    return np.interp(at, at[there], values[there]) if there.any() else np.zeros(len(values))
