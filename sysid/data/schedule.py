"""Schedules of PWM commands, and their CSV files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.files import write_atomic
from sysid.data.record import PWM_FULL_SCALE, Array, Channel, frozen
from sysid.errors import UsageError
from sysid.outside_text import csv_text

REST = 1.0
"""Standstill before and after the excitation [s]."""
MAX_SAMPLES = 1_000_000
"""Longer schedules are refused."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """What to send to the robot and when.

    Attributes:
        t: instants [s], shape (N,), read-only.
        u: PWM [µs] or what the channels say, shape (N, nu), read-only.
        channels: the nu input channels.
        active: first and one past the last row that is not the rest at the ends.
    """

    t: Array
    u: Array
    channels: tuple[Channel, ...]
    active: tuple[int, int]

    def __len__(self) -> int:
        return len(self.t)

    @property
    def excited(self) -> Array:
        """The rows between the rests, shape (M, nu)."""
        return self.u[slice(*self.active)]


def crest_factor(u: Array) -> float:
    """max|u| / rms(u): 1 for a binary signal, √2 for a sine; low is good (Ljung 1999, §13.3)."""
    rms = float(np.sqrt(np.mean(np.square(u))))
    return float(np.max(np.abs(u))) / rms if rms > 0 else float("inf")


def write_schedule(schedule: Schedule, path: str | Path) -> Path:
    """Write a schedule as CSV: ``t`` [s] and one column for each input, PWM in whole µs."""
    header = ",".join(("t", *(csv_text(c.name) for c in schedule.channels)))
    rows = (
        ",".join((f"{t:.9g}", *(str(int(v)) if v == int(v) else f"{v:.6g}" for v in row)))
        for t, row in zip(schedule.t, schedule.u, strict=True)
    )
    return write_atomic(path, "\n".join((header, *rows)) + "\n")


def sample_count(
    duration: float, dt: float, amplitude: float, offset: float, names: Sequence[str]
) -> int:
    """Number of samples of the excitation, after checking what all designs share."""
    if not names or len(set(names)) != len(names):
        raise UsageError("a schedule needs one or more inputs of different names")
    if not (np.isfinite(dt) and dt > 0):
        raise UsageError(f"the sample time must be positive, got {dt:g} s")
    if not (np.isfinite(duration) and duration >= 10 * dt):
        raise UsageError(f"a duration of {duration:g} s is too short at {dt:g} s a sample")
    if duration / dt > MAX_SAMPLES:
        raise UsageError(f"{duration:g} s at {dt:g} s a sample are over {MAX_SAMPLES} samples")
    if not (np.isfinite(amplitude) and np.isfinite(offset) and amplitude > 0):
        raise UsageError(f"the amplitude must be positive, got {amplitude:g} µs")
    if abs(offset) + amplitude > PWM_FULL_SCALE:
        reach = f"±{amplitude:g}" if offset == 0 else f"{offset:g} ± {amplitude:g}"
        raise UsageError(f"PWM of {reach} µs exceeds full drive, ±{PWM_FULL_SCALE:g} µs; lower it")
    return round(duration / dt)


def with_rests(u: Array, dt: float, names: Sequence[str]) -> Schedule:
    """Put the rests around an excitation and round it to whole µs."""
    n = max(1, round(REST / dt))
    still = np.zeros((n, u.shape[1]))
    # + 0.0 turns the −0 that rounding leaves into 0.
    whole = frozen(np.vstack([still, np.rint(u) + 0.0, still]))
    t = np.round(np.arange(len(whole)) * dt, 12)
    t.setflags(write=False)
    return Schedule(t, whole, tuple(Channel(n_, "µs") for n_ in names), (n, n + len(u)))
