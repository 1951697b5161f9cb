"""The fan of predicted paths, and where a measured one leaves it.

A path is judged as a whole. Half of the runs say where the middle of the fan is and how wide it is,
z = (value − median)/standard deviation at every instant and in every quantity; for each run of the
other half d is the largest |z| that lasts. A measured path whose d is larger than all but 5 % of
theirs leaves the fan: a robot like the runs does so in at most 5 % of its drives, however many
instants are looked at, because its d has the same chance of any rank among theirs (split conformal
prediction; Lei, G'Sell, Rinaldo, Tibshirani and Wasserman 2018).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Index, Record
from sysid.errors import UsageError
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.measured.drive import (
    FINEST,
    Clock,
    MeasuredDrive,
    command_begins,
    sets_off,
)
from sysid.robot.mission.monte_carlo.runs import RunPaths, run_paths
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import Spread, StartSpread
from sysid.structures.model import Model
from sysid.vehicle.kinematics import wrap_angle

QUANTITIES = ("x", "y", "psi", "speed")
"""What is compared, with the units below."""

UNITS = ("m", "m", "rad", "m/s")

FALSE_ALARMS = 0.05
"""Drives of a robot like the runs that leave the fan all the same, at most."""

MIN_RUNS = 40
"""Simulated runs: half of them must number at least 19, or none lies beyond 95 % of the others."""

LASTS = 0.5
"""Shorter excursions [s] do not count as leaving: single camera measurements are wild."""

MIN_ROWS_OUTSIDE = 3
"""Shorter excursions [rows] do not count either."""

SPEED_OVER = 1.0
"""Speed is the way of the last second: with it a millimetre of noise makes a millimetre a second,
and a robot that is slower shows it long before it is late."""


WAYS = 120
"""Runs whose ways are kept for a picture."""


@dataclass(frozen=True, eq=False)
class Fan:
    """What the runs predict at the instants of a measured drive.

    Attributes:
        t: instants since it set off [s], (M,).
        middle: median of every quantity, (M, 4).
        scale: its standard deviation, (M, 4).
        low, high: 5 % and 95 % quantiles at each instant, (M, 4).
        limit: in standard deviations: 95 % of the runs stay within it all the way.
        ways: x, y of some of them, (WAYS at most, M, 2).
    """

    t: Array
    middle: Array
    scale: Array
    low: Array
    high: Array
    limit: float
    runs: int
    ways: Array


@dataclass(frozen=True, eq=False)
class Comparison:
    """Where a measured drive leaves the fan.

    Attributes:
        values: what was measured, (M, 4).
        leaves: row at which it leaves; None where it stays inside.
        quantity: of ``QUANTITIES``, the one that leaves; empty where none does.
        inside_share: of the instants; those while a quantity is outside for long do not count.
        offset_s: time of the log at which t is 0 [s].
        ended_s: when the last run had ended [s].
    """

    name: str
    fan: Fan
    values: Array
    leaves: int | None
    quantity: str
    inside_share: float
    offset_s: float
    ended_s: float
    notes: tuple[str, ...]

    @property
    def leaves_at_s(self) -> float | None:
        """When it leaves, since it set off [s]."""
        return None if self.leaves is None else float(self.fan.t[self.leaves])

    @property
    def where(self) -> tuple[float, float] | None:
        """Where the robot was then: x, y [m]."""
        if self.leaves is None:
            return None
        x, y = self.values[self.leaves, :2].tolist()
        return x, y

    @property
    def sentence(self) -> str:
        fan, until = self.fan, float(self.fan.t[-1])
        short = until < self.ended_s - SPEED_OVER
        end = f" up to its end at {until:.1f} s, before the last run has ended" if short else ""
        if self.leaves is None:
            return f"{self.name} stays inside the fan of {fan.runs} runs{end}."
        x, y = self.values[self.leaves, :2]
        k = QUANTITIES.index(self.quantity)
        off = self.values[self.leaves, k] - fan.middle[self.leaves, k]
        if self.quantity == "psi":
            off = wrap_angle(off)
        half = 0.5 * (fan.high[self.leaves, k] - fan.low[self.leaves, k])
        way = "more" if off > 0 else "less"
        return (
            f"{self.name} leaves the fan of {fan.runs} runs at {self.leaves_at_s:.1f} s, at "
            f"({x:.2f}, {y:.2f}): {self.quantity} is {abs(off):.2g} {UNITS[k]} {way} than the "
            f"median of the fan, and 90 % of the runs lie within ±{half:.2g} {UNITS[k]}."
        )

    def summary(self) -> dict[str, object]:
        where = self.where
        return {
            "log": self.name,
            "runs": self.fan.runs,
            "leaves_at_s": self.leaves_at_s,
            "quantity": self.quantity or None,
            "where": None if where is None else {"x": where[0], "y": where[1]},
            "inside_share": self.inside_share,
            "offset_s": self.offset_s,
            "sentence": self.sentence,
        }


def compared(drive: MeasuredDrive, paths: RunPaths, begins: float, seed: int = 0) -> Comparison:
    """Lay a measured drive over the runs that were predicted for it.

    Args:
        begins: when the first command of the runs comes [s].
        seed: of the noise that the runs are read with: that of the log's measurements.
    """
    if len(paths.pose) < MIN_RUNS:
        raise UsageError(
            f"{len(paths.pose)} runs are too few for a fan; give at least {MIN_RUNS}, better some "
            "hundred"
        )
    ended = paths.ended_s - begins
    rows = _rows(drive, paths, ended)
    t = drive.t[rows] - drive.clock.at
    runs = _at(paths, t, begins, drive.clock)
    runs = runs + drive.noise * np.random.default_rng((seed, 0x666E)).standard_normal(runs.shape)
    fan = _fan(t, _quantities(t, runs))
    values = _quantities(t, drive.pose[rows][None])[0]
    z = np.abs(_around(values, fan.middle)) / fan.scale
    lasting = _lasting(t, z)
    out = np.flatnonzero(lasting.max(axis=1) > fan.limit)
    first = int(out[0]) if len(out) else None
    outside = np.unique(out[:, None] + np.arange(len(z) - len(lasting) + 1))
    return Comparison(
        name=drive.name,
        fan=fan,
        values=values,
        leaves=first,
        quantity="" if first is None else QUANTITIES[int(np.argmax(lasting[first]))],
        inside_share=1.0 - len(outside) / len(z),
        offset_s=drive.clock.at,
        ended_s=ended,
        notes=(),
    )


def _rows(drive: MeasuredDrive, paths: RunPaths, ended: float) -> Index:
    """Rows that are compared: from the first command until the last run has ended, no finer than
    the runs' own samples."""
    at = drive.t - drive.clock.at
    step = float(np.median(np.diff(drive.t)))
    stride = max(1, round(float(np.diff(paths.t).max(initial=step)) / step))
    return np.flatnonzero((at >= 0.0) & (at <= ended + 0.5 * step))[::stride]


def _at(paths: RunPaths, t: Array, begins: float, clock: Clock) -> Array:
    """Poses of the runs so long after they set off, (K, M, 3); a run that is over stays."""
    pose = paths.pose.copy()
    pose[..., 2] = np.unwrap(pose[..., 2], axis=1)
    origin = np.full(len(pose), begins)
    if clock.by == "motion":
        instants = sets_off(paths.t, pose, clock.distance, clock.angle)
        origin = np.where(np.isfinite(instants), instants, begins)
    at = np.clip(origin[:, None] + t, paths.t[0], paths.t[-1])
    high = np.clip(np.searchsorted(paths.t, at), 1, len(paths.t) - 1)
    low = high - 1
    part = ((at - paths.t[low]) / (paths.t[high] - paths.t[low]))[..., None]
    rows = np.arange(len(pose))[:, None]
    return np.asarray((1.0 - part) * pose[rows, low] + part * pose[rows, high])


def _quantities(t: Array, pose: Array) -> Array:
    """x, y, ψ and the way of the last second over its time, (K, M, 4)."""
    since = np.searchsorted(t, t - SPEED_OVER - 1e-6)  # rounding must not choose the row
    lasted = np.where(t - t[0] < SPEED_OVER, SPEED_OVER, t - t[since])
    way = np.hypot(*np.moveaxis(pose[..., :2] - pose[:, since, :2], -1, 0))
    return np.concatenate([pose, (way / lasted)[..., None]], axis=-1)


def _fan(t: Array, runs: Array) -> Fan:
    """Middle and scale from one half of the runs, the limit from the other."""
    half = len(runs) // 2
    shape, others = runs[:half], runs[half:]
    middle = np.median(shape, axis=0)
    # one run may have turned once more than another: the middle of ψ is a direction
    psi = shape[..., 2]
    middle[:, 2] = np.arctan2(np.sin(psi).mean(axis=0), np.cos(psi).mean(axis=0))
    middle[:, 2] = np.unwrap(middle[:, 2] + np.median(_around(shape, middle)[..., 2], axis=0))
    scale = np.maximum(_around(shape, middle).std(axis=0), (*FINEST, FINEST[0] / SPEED_OVER))
    low, high = np.quantile(_around(runs, middle), (0.05, 0.95), axis=0)
    z = np.abs(_around(others, middle)) / scale
    worst = np.sort(_lasting(t, z).max(axis=(1, 2)))
    rank = math.ceil((1.0 - FALSE_ALARMS) * (len(worst) + 1))
    return Fan(
        t=t,
        middle=middle,
        scale=scale,
        low=middle + low,
        high=middle + high,
        limit=float(worst[rank - 1]),
        runs=len(runs),
        ways=runs[:WAYS, :, :2],
    )


def _around(values: Array, middle: Array) -> Array:
    """How far values are from the middle; angles around the circle."""
    off = values - middle
    off[..., 2] = wrap_angle(off[..., 2])
    return np.asarray(off)


def _lasting(t: Array, z: Array) -> Array:
    """The |z| that a quantity keeps for a while from each row on, (…, rows, 4) of (…, M, 4)."""
    step = float(np.median(np.diff(t)))
    rows = min(max(MIN_ROWS_OUTSIDE, round(LASTS / step)), z.shape[-2])
    windows = np.lib.stride_tricks.sliding_window_view(z, rows, axis=-2)
    return np.asarray(windows.min(axis=-1))


RUNS = 400
"""Default number of runs of a fan: 200 say how wide it is, to 5 %, and 10 of the other 200
lie beyond the limit of the whole path."""


def against_runs(
    record: Record,
    mission: Mission,
    plants: Sequence[Model | SteppablePlant],
    runs: int = RUNS,
    seed: int = 0,
    vary: Sequence[str] | None = None,
) -> Comparison:
    """Drive a mission many times from where a measured drive of it began, and lay that over them.

    The start is measured, so it varies no more than its measurement is uncertain.

    Args:
        mission: what it drove; its ``vary`` says what else varies.
        plants: as of :func:`sysid.robot.mission.monte_carlo.runs.simulate_runs`.
        vary: names of what varies instead.
    """
    drive = MeasuredDrive.of(record)
    x, y, psi = drive.start.tolist()
    begins_there = mission.model_copy(update={"start": (x, y, float(wrap_angle(psi)))})
    setup = Setup.of(begins_there, plants, vary)
    spread = (Spread(sigma=float(e)) for e in drive.start_error)
    start = StartSpread(**dict(zip(("x", "y", "psi"), spread, strict=True)))
    setup = replace(setup, variation=setup.variation.model_copy(update={"start": start}))
    nominal = simulate(begins_there, setup.plant_variants[0].robot).log
    begins = command_begins(nominal["t"], np.column_stack([nominal["pwm_l"], nominal["pwm_r"]]))
    comparison = compared(drive, run_paths(setup, runs, seed), begins, seed)
    notes = (*drive.notes(mission.start), *setup.notes(0, 0, runs))
    return replace(comparison, notes=notes)
