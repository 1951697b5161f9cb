"""An H-bridge from a staircase of PWM: dead band, drop and gain of each direction.

    y = g (|d| − δ + j)  for |d| > δ,  0 below

y is what the motor gets [V] or does [rad/s, A], d the command as a share of full drive. Where the
line through the answers begins, and where the first answer comes, together determine the dead band
δ from a jump j: a band that is cut out of the command has none, a bridge that only lets pulses
beyond a length through jumps onto the line it would have had without one.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.documents import by_field
from sysid.data.record import Array
from sysid.errors import DataError

SETTLED = 0.5
"""Share of a step, from its end, that is averaged: before that the motor's speed changes."""
SAME = 1e-4
"""Commands closer than this share of full drive are one step."""
MIN_STEPS = 3
"""Steps with a response that a line with a standard error needs."""
ANSWERS = 0.02
"""Share of the largest response from which a step counts as answered …"""
NOISY = 5.0
"""… and standard deviations of the measurements at rest."""
SURE = 2.0
"""Standard errors within which the line's beginning counts as the edge of the dead band."""
BENDS = 3.0
"""Standard errors of its curvature beyond which the answer is no line, if it also moves the answer
by BENT of the largest."""
BENT = 0.03


@dataclass(frozen=True)
class Direction:
    """Result of a staircase in one direction of drive; shares are of full drive.

    Attributes:
        dead_band, dead_band_std_error: δ.
        between: largest command without and smallest command with an answer.
        jump, jump_std_error: j; 0 where the answers begin at the dead band's edge.
        gain, gain_std_error: g, what full drive adds [V, rad/s or A].
        at_full, at_full_std_error: answer at full drive, by the line [V, rad/s or A].
        starts, stops: where it starts to answer while the command rises, and where it stops while
            it falls; None where that was not visited.
        bends: whether the response is nonlinear.
        drive, answer: of each step, (K,).
    """

    dead_band: float
    dead_band_std_error: float
    between: tuple[float, float]
    jump: float
    jump_std_error: float
    gain: float
    gain_std_error: float
    at_full: float = field(metadata={"alias": "at_full_drive"})
    at_full_std_error: float = field(metadata={"alias": "at_full_drive_std_error"})
    starts: float | None = field(metadata={"alias": "starts_at"})
    stops: float | None = field(metadata={"alias": "stops_at"})
    bends: bool
    steps: int
    drive: Array = field(metadata={"exclude": True})
    answer: Array = field(metadata={"exclude": True})

    def line(self, drive: Array) -> Array:
        line = self.gain * (drive - self.dead_band + self.jump)
        return np.where(drive > self.dead_band, line, 0.0)


@dataclass(frozen=True)
class Bridge:
    """Result of a staircase for one bridge.

    Attributes:
        side: ``left``, ``right`` or empty.
        quantity: what answers: ``voltage``, ``speed`` or ``current``.
        forward, backward: None where that direction was not driven, or never answered.
        supply: mean voltage of the supply while it was driven [V]; None where it was not read.
        turned: whether the answer's sign was turned so that a positive command answers positively.
    """

    name: str
    side: str
    quantity: str
    forward: Direction | None
    backward: Direction | None
    supply: float | None
    turned: bool

    @property
    def unit(self) -> str:
        """Of the answers."""
        return {"voltage": "V", "speed": "rad/s", "current": "A"}[self.quantity]

    def directions(self) -> dict[str, Direction]:
        """Those that were driven."""
        both = {"forward": self.forward, "backward": self.backward}
        return {name: d for name, d in both.items() if d is not None}

    def drop(self, direction: Direction) -> tuple[float, float] | None:
        """What the bridge keeps of the supply at full drive [V], and its standard error."""
        if self.quantity != "voltage" or self.supply is None:
            return None
        return self.supply - direction.at_full, direction.at_full_std_error

    def to_json(self) -> dict[str, Any]:
        """The figures by name and unit; those of the directions that were driven."""
        figures = {}
        for name, d in self.directions().items():
            drop, error = self.drop(d) or (None, None)
            figures[name] = by_field(d) | {"drop_V": drop, "drop_std_error": error}
        named = {n: getattr(self, n) for n in ("name", "side", "quantity", "unit")}
        return {**named, "supply_V": self.supply, **figures}


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps of a staircase: command, mean answer and its standard error, in order, (K,)."""

    drive: Array
    answer: Array
    error: Array


def fit_bridge(
    name: str,
    side: str,
    drive: Array,
    quantity: str,
    answer: Array,
    supply: Array | None = None,
    log: bool = True,
) -> Bridge:
    """Read dead band, jump and gain of both directions off a staircase.

    Args:
        drive: command as a share of full drive, (N,).
        quantity: what answers: ``voltage``, ``speed`` or ``current``.
        answer: (N,).
        supply: its voltage meanwhile [V], (N,).
        log: whether the rows follow each other in time; in a table each is a step of its own.
    """
    good = np.isfinite(drive) & np.isfinite(answer)
    steps = _steps(drive[good], answer[good], log)
    if len(steps.drive) < MIN_STEPS:
        raise DataError(
            f"{name}: {len(steps.drive)} PWM steps are too few for a staircase; go up and down in "
            "small steps both ways, one second each"
        )
    away = steps.drive - np.median(steps.drive)
    turned = float(away @ (steps.answer - np.median(steps.answer))) < 0.0
    if quantity in ("speed", "current") and np.all(answer[good] >= 0.0) and np.any(drive < 0.0):
        signed = np.sign(steps.drive) * np.abs(steps.answer)  # a measurement without a sign
        steps, turned = _Steps(steps.drive, signed, steps.error), False
    sign = -1.0 if turned else 1.0
    steps = _Steps(steps.drive, sign * steps.answer, steps.error)
    both = [_direction(steps, s) for s in (1.0, -1.0)]
    if both == [None, None]:
        raise DataError(
            f"{name}: fewer than {MIN_STEPS} PWM steps change the {quantity} in either direction; "
            "continue to larger commands"
        )
    return Bridge(name, side, quantity, both[0], both[1], _at_large(supply, drive), turned)


def _at_large(supply: Array | None, drive: Array) -> float | None:
    """Mean of the supply at large commands; None where it was not read."""
    if supply is None:
        return None
    read = supply[(np.abs(drive) > 0.5) & np.isfinite(supply)]
    return float(np.mean(read)) if len(read) else None


def _steps(drive: Array, answer: Array, log: bool) -> _Steps:
    """Mean of the end of every step; the scatter of neighbours gives its error."""
    if not log:
        return _Steps(drive, answer, np.zeros(len(drive)))
    edges = [0, *(np.flatnonzero(np.abs(np.diff(drive)) > SAME) + 1).tolist(), len(drive)]
    rows = []
    for a, b in pairwise(edges):
        if b - a < 2:
            continue  # a ramp's sample is no step
        end = answer[b - max(int(SETTLED * (b - a)), 1) : b]
        rows.append((drive[a], float(np.mean(end)), float(np.std(end)) / math.sqrt(len(end))))
    if not rows:
        return _Steps(np.zeros(0), np.zeros(0), np.zeros(0))
    d, y, e = np.array(rows).T
    return _Steps(d, y, e)


def _direction(steps: _Steps, sign: float) -> Direction | None:
    """One direction of drive; None where fewer than three steps of it answer."""
    in_direction = sign * steps.drive > SAME
    rest = np.abs(steps.drive) <= SAME
    d, y = sign * steps.drive[in_direction], sign * steps.answer[in_direction]
    if not len(d):
        return None
    offset = float(np.median(sign * steps.answer[rest])) if rest.any() else 0.0
    noise = float(np.median(steps.error)) if len(steps.error) else 0.0
    threshold = max(ANSWERS * float(np.max(y)), NOISY * noise)
    if abs(offset) < threshold:
        y = y - offset  # a meter's own zero
    moves = y > threshold
    if moves.sum() < MIN_STEPS or len(np.unique(d[moves])) < MIN_STEPS:
        return None
    slope, cut, cov, bends = _line(d[moves], y[moves])
    # a small answer that stands on the line is the line's, below the share or not
    on_line = (y > NOISY * noise) & (np.abs(slope * d + cut - y) < 0.5 * y)
    still = d[~moves & ~on_line & (d < float(np.max(d[moves])))]
    low, high = float(np.max(still)) if len(still) else 0.0, float(np.min(d[moves]))
    starts_line = -cut / slope
    gradient = np.array([cut / slope**2, -1.0 / slope])
    line_error = math.sqrt(max(float(gradient @ cov @ gradient), 0.0))
    step = float(np.min(np.diff(np.unique(d)))) if len(np.unique(d)) > 1 else 0.0
    edge, width = 0.5 * (low + high), max(abs(high - low), step) / math.sqrt(12.0)
    first, last = min(low, high), max(low, high)
    if first - SURE * line_error <= starts_line <= last + SURE * line_error:
        edge, width, jump, jump_error = max(starts_line, 0.0), line_error, 0.0, 0.0
    else:
        jump = max(edge - starts_line, 0.0)
        jump_error = math.hypot(width, line_error)
    full = np.array([1.0, 1.0])
    return Direction(
        dead_band=edge,
        dead_band_std_error=width,
        between=(low, high),
        jump=jump,
        jump_std_error=jump_error,
        gain=slope,
        gain_std_error=math.sqrt(float(cov[0, 0])),
        at_full=slope + cut,
        at_full_std_error=math.sqrt(max(float(full @ cov @ full), 0.0)),
        starts=_edge(d, moves, rising=True),
        stops=_edge(d, moves, rising=False),
        bends=bends,
        steps=int(moves.sum()),
        drive=sign * d,
        answer=sign * y,
    )


def _line(d: Array, y: Array) -> tuple[float, float, Array, bool]:
    """Slope, value at 0, their covariance, and whether the answers bend."""
    X = np.column_stack([d, np.ones(len(d))])
    theta = np.linalg.lstsq(X, y, rcond=None)[0]
    residual = y - X @ theta
    variance = float(residual @ residual) / max(len(d) - 2, 1)
    cov = variance * np.linalg.inv(X.T @ X)
    bends = False
    if len(np.unique(d)) > MIN_STEPS + 1:
        Z = np.column_stack([(d - d.mean()) ** 2, X])
        curved = np.linalg.lstsq(Z, y, rcond=None)[0]
        rest = y - Z @ curved
        spread = float(rest @ rest) / max(len(d) - 3, 1) * np.linalg.inv(Z.T @ Z)
        sure = abs(curved[0]) > BENDS * math.sqrt(max(float(spread[0, 0]), 1e-300))
        size = abs(curved[0]) * (0.5 * float(np.ptp(d))) ** 2
        bends = bool(sure and size > BENT * float(np.max(y)))
    return float(theta[0]), float(theta[1]), np.asarray(cov), bends


def _edge(d: Array, moves: NDArray[np.bool_], rising: bool) -> float | None:
    """Middle between the last step without and the first with an answer, in one sense of change."""
    change = np.diff(d)
    here = (change > SAME) if rising else (change < -SAME)
    before, after = (~moves[:-1], moves[1:]) if rising else (moves[:-1], ~moves[1:])
    at = np.flatnonzero(here & before & after)
    return float(np.mean(0.5 * (d[at] + d[at + 1]))) if len(at) else None
