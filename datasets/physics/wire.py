"""From a sensor to a line of the log: what electronics and transmission do to readings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wire:
    """The way of the readings into the log; the default loses nothing."""

    offset: tuple[float, ...] = ()
    """Of each channel [its unit]."""
    largest: float = 0.0
    """Where the electronics clip, both ways; 0: nowhere."""
    step: float = 0.0
    """Of the converter; 0: none."""
    lost: float = 0.0
    """Share of lines whose readings are lost."""
    lost_is_zero: bool = False
    """A lost reading is logged as 0; else as the last one."""
    counter: int = 0
    """Ticks in a turn of a 16-bit counter that is logged instead of the angle; 0: none."""

    def carry(self, readings: Array, rng: np.random.Generator) -> Array:
        """What the log holds of ``readings``, shape (N, channels)."""
        out = readings.copy()
        if self.offset:
            out += np.array(self.offset)
        if self.largest > 0.0:
            out = np.clip(out, -self.largest, self.largest)
        if self.step > 0.0:
            out = np.round(out / self.step) * self.step
        if self.lost > 0.0:
            gone = rng.uniform(size=out.shape) < self.lost
            gone[0] = False
            rows = np.where(gone, 0, np.arange(len(out))[:, None])
            last = np.take_along_axis(out, np.maximum.accumulate(rows, axis=0), axis=0)
            out = np.where(gone, 0.0 if self.lost_is_zero else last, out)
        if self.counter:
            ticks = np.floor(out * self.counter / (2.0 * np.pi)).astype(np.int64)
            out = ((ticks + 2**15) % 2**16 - 2**15).astype(np.float64)
        return out


@dataclass(frozen=True)
class PoseSensor:
    """A camera or a lidar: where it sits, when it says what."""

    lag: float = 0.0
    """Age of what it says [s]."""
    heading_lag: float = 0.0
    """Age of the heading beyond that [s]."""
    ahead: float = 0.0
    """Of its place before the middle of the axle [m]."""
    left: float = 0.0
    """[m]."""
    refresh: float = 0.0
    """Time between two poses, held in between [s]; 0: one a row."""
    position_noise: float = 0.001
    """[m]."""
    heading_noise: float = 0.002
    """[rad]."""

    def measure(self, t: Array, pose: Array, step: float, rng: np.random.Generator) -> Array:
        """x, y, heading at the rows ``t`` of a log.

        Args:
            t: times of the rows [s].
            pose: true pose every ``step`` seconds, shape (M, 3).
            step: [s].
            rng: of the noise.
        """
        asked = np.floor(t / self.refresh + 1e-9) * self.refresh if self.refresh else t
        place = self._at(asked - self.lag, pose, step)
        place[:, 2] = self._at(asked - self.lag - self.heading_lag, pose, step)[:, 2]
        noise = rng.standard_normal(place.shape)
        if self.refresh:
            rows = np.searchsorted(t, asked - 1e-9)
            noise = noise[np.minimum(rows, len(t) - 1)]
        place += noise * np.array([self.position_noise, self.position_noise, self.heading_noise])
        return place

    def _at(self, times: Array, pose: Array, step: float) -> Array:
        grid = np.arange(len(pose)) * step
        x, y, heading = (np.interp(times, grid, pose[:, i]) for i in range(3))
        c, s = np.cos(heading), np.sin(heading)
        return np.column_stack(
            [x + c * self.ahead - s * self.left, y + s * self.ahead + c * self.left, heading]
        )
