"""Shapes of the command: a free curve, and play (Prandtl–Ishlinskii)."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.shapes.reading import (
    GRID,
    amount,
    axis,
    half_band,
    in_log,
    static_gain,
)
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms, best_of_scan
from sysid.diagnosis.shapes.smoother import Fit, bend, spline
from sysid.diagnosis.shapes.track import Track
from sysid.fitting.profile import NORMAL

PIECES = 16
WIDTHS = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35)
"""Half widths of a play that are tried first, in units of the command's range."""

FINE = 12
"""Widths that are then tried between the neighbours of the best."""

LEVELS = 4
"""A command of fewer levels has no curve: any is another gain."""


def command_curve(track: Track) -> Terms | None:
    """f(d) with f(0) = 0, added to K d."""
    low, high = float(track.drive.min()), float(track.drive.max())
    if len(np.unique(np.round(track.drive / max(high - low, 1e-12), 2))) < LEVELS:
        return None
    basis = spline(low, high, PIECES)
    zero = basis(np.array([0.0])) if low <= 0.0 <= high else basis(track.drive).mean(axis=0)
    columns = track.through(track.gain * (basis(track.drive) - zero))

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(low, high, GRID)
        B = track.gain * (basis(x) - zero)
        gain = static_gain(track, fit)
        y = gain * x + B @ fit.coefficients
        half = half_band(B, fit.covariance, noise)
        return _curve_words(track, x, y), _curve(track, x, y, half)

    return Terms(columns[None], says, bend(columns.shape[1]))


def _curve_words(track: Track, x: Array, y: Array) -> str:
    slope = np.gradient(y, x)
    steepest = slope[int(np.argmax(np.abs(slope)))]
    ratio = float(np.min(slope * np.sign(steepest)) / max(abs(steepest), 1e-300))
    at = float(x[int(np.argmin(slope * np.sign(steepest)))])
    sign = "−" if at < 0.0 else ""
    return (
        f"{track.output.name} follows a curve of {_commands(track)}: its slope is between "
        f"{max(100.0 * ratio, 0.0):.0f} and 100 % of the steepest, least near "
        f"{sign}{_command(track, at)}"
    )


def _curve(track: Track, x: Array, y: Array, half: Array) -> Curve:
    factor, _ = track.output.to_file
    labels = axis(track.command), axis(track.output, "steady")
    x, y, half = in_log(track, x), factor * y, factor * np.abs(half)
    return Curve(*labels, x, y, y - half, y + half)


def _commands(track: Track) -> str:
    """What a curve or a play takes: a command, or the sum of those of one output."""
    if not track.adds_inputs:
        return f"the command {track.command.name}"
    names = " and ".join(c.name for c in track.channels)
    return f"the sum of {names}, in units of {track.command.name}"


def _command(track: Track, drive: float, digits: int = 3) -> str:
    return amount(track.command, drive * track.scale, digits)


def play(track: Track) -> Terms | None:
    """K (P_w d − d): the command behind a play of half width w, scanned.

    P_w d(t) = max(d − w, min(d + w, P_w d(t − 1))).
    """
    size = float(np.ptp(track.drive))
    if size <= 0.0:
        return None

    def lost(widths: Array) -> Array:
        behind = played(track.drive, widths, track.starts)
        return track.through(track.gain * (behind - track.drive[:, None])).T[:, :, None]

    coarse = size * np.array(WIDTHS)
    rows = track.fitted & np.isfinite(track.error)
    best, _ = best_of_scan(track.error, track.own, lost(coarse), rows)
    ends = coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)]
    widths = np.linspace(*ends, FINE)
    columns = lost(widths)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        words = (
            f"{_commands(track)} acts behind a play or hysteresis about "
            f"{_command(track, 2.0 * widths[k], 2)} wide"
        )
        loop = np.concatenate([np.linspace(-1, 1, GRID), np.linspace(1, -1, GRID)])
        x = track.drive.min() + 0.5 * size * (1.0 + loop)
        both = np.concatenate([x, x])
        path = played(both, widths[[k]], (0, len(both)))[len(x) :, 0]
        y = static_gain(track, fit) * (x + fit.coefficients[0] * (path - x))
        half = NORMAL * noise * np.sqrt(fit.covariance[0, 0]) * np.abs(track.gain * (path - x))
        return words, _curve(track, x, y, half)

    return Terms(columns, says)


def played(d: Array, widths: Array, starts: tuple[int, ...]) -> Array:
    """A signal (N,) behind plays of half widths (k,), from the middle of each, (N, k)."""
    low, high = d[:, None] - widths, d[:, None] + widths
    first = [n for n in starts if n < len(d)]
    low[first] = high[first] = d[first][:, None]
    # a step clips what it is given; two that follow each other clip once, and so, in pairs, do all
    apart = 1
    while apart < len(d):
        later = slice(apart, None)
        low[later], high[later] = (
            np.clip(end[:-apart], low[later], high[later]) for end in (low, high)
        )
        apart *= 2
    return low


SHAPES = (
    Shape("command-curve", ShapePlace.COMMAND, command_curve),
    Shape("command-play", ShapePlace.COMMAND, play),
)
