"""Shapes of the torque and the reading: resistance over speed, a curve of the reading."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.shapes.over_time import constant
from sysid.diagnosis.shapes.reading import (
    GRID,
    amount,
    axis,
    half_band,
    in_log,
    own_feedback,
    static_gain,
)
from sysid.diagnosis.shapes.shape import Curve, Shape, ShapePlace, Terms
from sysid.diagnosis.shapes.smoother import Fit, bend, spline
from sysid.diagnosis.shapes.track import Track

PIECES = 10
STANDS = 0.02
"""Speeds below this share of the fast ones are standstill: there friction holds any torque."""

SLIGHT = 0.05
"""A slope below this share of the other end's is none."""


def odd_resistance(track: Track) -> Terms | None:
    """sign(ω) f(|ω|), with what holds the track at standstill."""
    return _resistance(track, odd=True)


def resistance(track: Track) -> Terms | None:
    """The same with a curve of its own for each direction."""
    fast = STANDS * track.full_speed
    forward, backward = (np.mean(s * track.measured > fast) for s in (1.0, -1.0))
    if min(forward, backward) < 0.1:
        return None
    return _resistance(track, odd=False)


def _resistance(track: Track, odd: bool) -> Terms:
    # whether a track stands is measured: how fast it runs is simulated
    top, w = track.full_speed, track.speed
    stands = np.abs(track.measured) < STANDS * top
    sign = np.tanh(track.measured / (STANDS * top))
    basis = spline(0.0, top, PIECES)
    at_zero = basis(np.zeros(1))

    def library(w: Array, sign: Array) -> Array:
        curve = basis(np.abs(w)) - at_zero
        if odd:
            return np.column_stack([sign, sign[:, None] * curve])
        sides = [(sign > 0.0) * 1.0, (sign <= 0.0) * 1.0]
        return np.column_stack(
            [sign * s for s in sides] + [(sign * s)[:, None] * curve for s in sides]
        )

    held = np.where(stands, -track.gain * track.drive, 0.0)
    columns = track.through(np.column_stack([held, -library(w, sign)]))
    jumps, size = 2 if odd else 3, PIECES + 3
    S = np.zeros((columns.shape[1],) * 2)
    for side in range(1 if odd else 2):
        rows = slice(jumps + side * size, jumps + (side + 1) * size)
        S[rows, rows] = bend(size)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(0.0 if odd or track.measured.min() > -STANDS * top else -top, top, GRID)
        B = library(x, np.where(x >= 0.0, 1.0, -1.0))
        b, C = fit.coefficients[1:], fit.covariance[1:, 1:]
        y = x * (1.0 - own_feedback(track, fit)) + B @ b
        half = half_band(B, C, noise)
        factor, _ = track.output.to_file
        words = (
            f"a resistance follows the speed {track.output.name} in a curve"
            f"{'' if odd else ' of its own for each direction'}; near standstill it is "
            f"{amount(track.output, float(b[0]))} of lost {track.output.name}"
        )
        x, y, half = factor * x, factor * y, factor * half
        label = axis(track.output, "resistance, lost")
        return words, Curve(axis(track.output), label, x, y, y - half, y + half)

    return Terms(columns[None], says, S)


def _bend(bottom: float, top: float) -> str:
    """How a curve bends whose slopes in the lowest and the highest quarter are these."""
    more, less, where = max(bottom, top), min(bottom, top), "top" if top > bottom else "bottom"
    if less < SLIGHT * more:
        return f"hardly but at the {where} of its range"
    if top < bottom:
        return f"its slope in the upper quarter is {100.0 * top / bottom:.0f} % of the lower one's"
    return f"its slope in the upper quarter is {top / bottom:.2g} times the lower one's"


def loss(track: Track) -> Terms | None:
    """−f(y), a smooth curve without friction's jump: outflow, radiation, drag."""
    low, high = float(np.min(track.measured)), float(np.max(track.measured))
    basis = spline(low, high, PIECES)
    middle = basis(track.speed).mean(axis=0)
    columns = track.through(-(basis(track.speed) - middle))

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(low, high, GRID)
        B = basis(x) - middle
        y = x * (1.0 - own_feedback(track, fit)) + B @ fit.coefficients
        half = half_band(B, fit.covariance, noise)
        slope = np.gradient(y, x)
        factor, _ = track.output.to_file
        words = (
            f"what is lost grows with {track.output.name} in a curve: "
            f"{_bend(*(float(np.mean(part)) for part in np.array_split(slope, 4)[::3]))}"
        )
        x, y, half = factor * x, factor * y, factor * half
        label = axis(track.output, "loss, as lost")
        return words, Curve(axis(track.output), label, x, y, y - half, y + half)

    return Terms(columns[None], says, bend(columns.shape[1]), constant(track))


def lag_by_command(track: Track) -> Terms | None:
    """(ω − T)·h(|d|): the time constant is a curve of the command's size."""
    size = np.abs(track.drive)
    top = float(np.quantile(size, 0.99))
    if top <= 0.0 or float(np.quantile(size, 0.1)) > 0.9 * top:
        return None
    basis = spline(0.0, top, 4)
    moved = track.unbalanced[:, None]
    columns = track.through(basis(size) * moved)

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(0.0, top, GRID)
        B = basis(x) - basis(size).mean(axis=0)
        y = 100.0 * (B @ fit.coefficients)
        half = 100.0 * half_band(B, fit.covariance, noise)
        label = axis(track.command, "size of")
        words = f"the time constant changes with the size of {track.command.name}"
        x = in_log(track, x)
        return words, Curve(label, "time constant [% from its mean]", x, y, y - half, y + half)

    return Terms(columns[None], says, bend(columns.shape[1]))


def reading_curve(track: Track) -> Terms | None:
    """f(ω̂) added to the reading, of the simulated speed."""
    low, high = float(track.run.min()), float(track.run.max())
    if not high > low:
        return None
    basis = spline(low, high, PIECES)
    zero = basis(np.zeros(1)) if low <= 0.0 <= high else basis(track.run).mean(axis=0)
    columns = basis(track.run) - zero

    def says(fit: Fit, k: int, noise: float) -> tuple[str, Curve | None]:
        x = np.linspace(low, high, GRID)
        B = basis(x) - zero
        gain = static_gain(track, fit) / track.gain if track.gain else 1.0
        y = gain * x + B @ fit.coefficients
        half = half_band(B, fit.covariance, noise)
        factor, _ = track.output.to_file
        words = f"the reading {track.output.name} is a curve of what is measured"
        x, y, half = factor * x, factor * y, factor * half
        true, read = axis(track.output, "simulated"), axis(track.output, "read")
        return words, Curve(true, read, x, y, y - half, y + half)

    return Terms(columns[None], says, bend(columns.shape[1]))


SHAPES = (
    Shape("resistance-odd", ShapePlace.TORQUE, odd_resistance, of_motion=True, of_speed=True),
    Shape("resistance", ShapePlace.TORQUE, resistance, of_motion=True, of_speed=True),
    Shape("loss-curve", ShapePlace.TORQUE, loss, of_speed=True),
    Shape("lag-by-command", ShapePlace.SPEED, lag_by_command, of_speed=True),
    Shape("reading-curve", ShapePlace.READING, reading_curve),
)
