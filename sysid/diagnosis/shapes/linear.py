"""Linear shapes: a wave over angle or time, one more mode, a tie between the tracks."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.over_angle import over_angle, strongest_lines
from sysid.diagnosis.shapes.reading import amount
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Track

WAVES = (0.5, 20.0)
"""Waves per radian of the wheel, least and most."""

LINES = 8
LEAST_PERIODS = 3.0
MODES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Further time constants in samples, that of the base times or over which are tried."""

DAMPINGS = (0.1, 0.3, 0.7)


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

    return Terms(columns, says, best)


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

    return Terms(columns, says, best)


def mode(track: Track) -> Terms | None:
    """One more real pole or pair of poles behind the base's, scanned."""
    samples = -1.0 / np.log(np.clip(track.pole, 1e-3, 0.9999))
    sets: list[Array] = []
    said: list[str] = []
    base = track.through(track.gain * track.drive)
    for factor in (*MODES, *(1.0 / m for m in MODES[1:])):
        p = np.exp(-1.0 / (samples * factor))
        late = track.filtered(np.array([1.0 - p]), np.array([1.0, -p]), base)
        sets.append(np.column_stack([late, _last(track, late)]))
        said.append(f"a further lag of {samples * factor * track.dt:.2g} s")
    for factor in MODES:
        for damping in DAMPINGS:
            w = np.pi / 2.0 / (samples * factor)
            if w > 1.5:
                continue
            z = np.exp(w * (-damping + 1j * np.sqrt(1.0 - damping**2)))
            a = np.array([1.0, -2.0 * z.real, abs(z) ** 2])
            late = track.filtered(np.array([a.sum()]), a, base)
            sets.append(np.column_stack([late, _last(track, late)]))
            said.append(
                f"a further swing every {2.0 * np.pi / w * track.dt:.2g} s, damping {damping:.1g}"
            )
    columns = np.array(sets)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        return f"{track.output.name} follows {track.command.name} with {said[k]}", None

    return Terms(columns, says, np.arange(len(said), dtype=np.float64))


def _last(track: Track, column: Array) -> Array:
    return track.past(column[:, 0], 1)[:, None]


def tie(track: Track) -> Terms | None:
    """The other track's command, speed and change of speed in this one's torque."""
    if track.other_drive is None or track.other_speed is None:
        return None
    other = track.other_speed
    columns = np.column_stack([track.other_drive, other, other - track.past(other, 1)])
    moved = track.through(columns)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        return f"{track.output.name} depends on the other side's command and speed", None

    return Terms(moved[None], says, np.zeros(1))


SHAPES = (
    Shape("angle-wave", ShapePlace.TORQUE, wave_over_angle, of_motion=True),
    Shape("time-wave", ShapePlace.TIME, wave_over_time),
    Shape("linear-mode", ShapePlace.SPEED, mode),
    Shape("track-tie", ShapePlace.TORQUE, tie),
)
