"""Linear shapes: a wave over angle or time, one more mode, a tie between the tracks."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.over_angle import over_angle, strongest_lines
from sysid.diagnosis.shapes.reading import amount
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms, best_of_scan
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Track

WAVES = (0.5, 20.0)
"""Waves per radian of the wheel, least and most."""

LINES = 8
LEAST_PERIODS = 3.0
SPEEDS, REFINED = 14, 6
"""Natural frequencies of a further swing that are tried first, and how often the best is refined
between its neighbours."""

DAMPINGS = (0.05, 0.12, 0.3, 0.6, 1.1, 2.0, 4.0)
"""Damping ratios tried first."""


LINEAR_MODE = "linear-mode"
"""The shape of a linear model with one more state."""


def _whitened(track: Track) -> Array:
    """The errors as torque: F(q) e, 0 where samples are missing, (N,)."""
    e = np.nan_to_num(track.error)
    out = e.copy()
    for k, f in enumerate(track.f, start=1):
        out += f * track.past(e, k)
    return np.where(np.isfinite(track.error), out, 0.0)


def wave_over_angle(track: Track) -> Terms | None:
    """a cos nθ + b sin nθ in the torque, n scanned among the strongest lines."""
    span = float(np.ptp(track.angle))
    if span < 2.0 * np.pi * LEAST_PERIODS:
        return None
    rows = track.fitted & np.isfinite(track.error)
    lines, whole = over_angle(track.angle[rows], _whitened(track)[rows], WAVES[1])
    best = np.array(strongest_lines(lines, np.abs(whole), WAVES, span, LINES))
    columns = np.array(
        [
            track.through(np.column_stack([np.cos(n * track.angle), np.sin(n * track.angle)]))
            for n in best
        ]
    )

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        size = float(np.hypot(*fit.coefficients))
        words = (
            f"the torque waves over the angle, {best[k]:.4g} times a radian of "
            f"{track.output.name}, by {amount(track.output, size)}"
        )
        return words, None

    return Terms(columns, says)


def wave_over_time(track: Track) -> Terms | None:
    """a cos ωt + b sin ωt in the torque, ω scanned among the strongest lines."""
    rows = track.fitted_in_time & np.isfinite(track.error)
    span = float(np.ptp(track.t))
    low, high = 2.0 * np.pi * LEAST_PERIODS / max(span, track.dt), np.pi / (4.0 * track.dt)
    if high <= low or not rows.any():
        return None
    lines, whole = over_angle(track.t[rows], _whitened(track)[rows], high)
    size = np.abs(whole) / np.maximum(
        np.abs(1.0 - track.pole * np.exp(-1j * lines * track.dt)), 1e-6
    )
    best = np.array(strongest_lines(lines, size, (low, high), span, LINES))
    columns = np.array(
        [track.through(np.column_stack([np.cos(n * track.t), np.sin(n * track.t)])) for n in best]
    )

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        size = float(np.hypot(*fit.coefficients))
        words = (
            f"a load of {amount(track.output, size)} of {track.output.name} swings with "
            f"the clock, every {2.0 * np.pi / best[k]:.3g} s"
        )
        return words, None

    return Terms(columns, says)


def mode(track: Track) -> Terms | None:
    """y = (b₁ q⁻¹ + b₂ q⁻²)/(1 + a₁ q⁻¹ + a₂ q⁻²) u beside the base; a scanned, refined.

    In continuous time the poles are those of s² + 2 ζ ω₀ s + ω₀²; above ζ = 1 they are two lags.
    """
    slowest = float(np.clip(0.05 * np.log(1.0 / track.pole), 6.0 / len(track.drive), 0.05))
    speeds = np.geomspace(slowest, 1.5, SPEEDS)
    rows = track.fitted & np.isfinite(track.error)
    tried = np.array([(w, z) for w in speeds for z in DAMPINGS])
    columns = _swings(track, tried)
    step = np.array([speeds[1] / speeds[0], 1.8])
    for _ in range(REFINED):
        w, z = tried[best_of_scan(track.error, track.own, columns, rows)[0]]
        step = step**0.5
        near = [
            (w * a, z * b)
            for a in (1.0, 1.0 / step[0], step[0])
            for b in (1.0, 1.0 / step[1], step[1])
        ]
        tried = np.array(near)
        columns = _swings(track, tried)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        w, z = tried[k]
        second = track.dt / w
        if z < 1.0:
            how = f"swings every {2.0 * np.pi * second:.2g} s with a damping of {z:.2g}"
        else:
            lags = second * (z + np.sqrt(z**2 - 1.0)), second * (z - np.sqrt(z**2 - 1.0))
            how = f"has lags of {lags[0]:.2g} and {lags[1]:.2g} s"
        words = (
            f"{track.output.name} follows {track.command.name} linearly with one more state, such "
            f"as a spring, an elastic part or a store of energy: it {how}"
        )
        return words, None

    return Terms(columns, says)


def _swings(track: Track, tried: Array) -> Array:
    """The command through two poles each, now and a sample later, (V, N, 2)."""
    w, z = tried.T
    apart = np.sqrt(z**2 - 1.0 + 0j)
    poles = np.exp(w * (apart - z)), np.exp(w * (-apart - z))
    a = np.column_stack([np.ones_like(w), -np.real(sum(poles)), np.real(poles[0] * poles[1])])
    b = np.column_stack([np.zeros_like(w), a.sum(axis=1)])
    late = track.filtered(b, a, track.gain * track.drive)
    return np.stack([late.T, track.past(late, 1).T], axis=2)


def tie(track: Track) -> Terms | None:
    """The other track's command, speed and change of speed in this one's torque."""
    if track.other_speed is None:
        return None
    other = track.other_speed
    columns = np.column_stack([track.inputs[:, 1], other, other - track.past(other, 1)])
    moved = track.through(columns)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        return f"{track.output.name} depends on the other side's command and speed", None

    return Terms(moved[None], says)


SHAPES = (
    Shape("angle-wave", ShapePlace.TORQUE, wave_over_angle, of_motion=True),
    Shape("time-wave", ShapePlace.TIME, wave_over_time),
    Shape(LINEAR_MODE, ShapePlace.SPEED, mode),
    Shape("track-tie", ShapePlace.TORQUE, tie),
)
