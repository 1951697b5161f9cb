"""Preprocessing of records: offsets, trends, filters, decimation, trimming."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from sysid.data.documents import by_field, plain
from sysid.data.record import Array, Record
from sysid.data.schema import STORED
from sysid.errors import DataError, ModelError, UsageError


@dataclass(frozen=True, eq=False)
class Detrend:
    """Offsets and slopes taken from the data before a fit; stored with the model, put back after.

    u_fit(t) = u(t) − u_offset − u_slope·t,  y(t) = y_fit(t) + y_offset + y_slope·t, with t the
    time of the sample [s], so that a slope means the same in every part of a record.

    Attributes:
        u_offset, y_offset: shapes (nu,), (ny,), in the channels' units.
        u_slope, y_slope: shapes (nu,), (ny,), per second; zeros when not given.

    Raises:
        ModelError: shapes do not fit together, or a number is not finite.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    u_offset: Array
    y_offset: Array
    u_slope: Array | None = None
    y_slope: Array | None = None

    def __post_init__(self) -> None:
        for side in ("u", "y"):
            offset = _vector(getattr(self, f"{side}_offset"), f"{side}_offset")
            slope = getattr(self, f"{side}_slope")
            slope = _vector(np.zeros(len(offset)) if slope is None else slope, f"{side}_slope")
            if len(slope) != len(offset):
                raise ModelError(
                    f"detrending has {len(offset)} offsets but {len(slope)} slopes for {side}"
                )
            object.__setattr__(self, f"{side}_offset", offset)
            object.__setattr__(self, f"{side}_slope", slope)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Detrend) and plain(self) == plain(other)

    def __hash__(self) -> int:
        return hash((self.u_offset.tobytes(), self.y_offset.tobytes()))

    @classmethod
    def none(cls, nu: int, ny: int) -> "Detrend":
        """Take nothing away: zero is a physical zero, as on the robot."""
        return cls(np.zeros(nu), np.zeros(ny))

    @classmethod
    def means(cls, records: Sequence[Record]) -> "Detrend":
        """The mean of every channel over all samples of all experiments."""
        u, y, _ = _pooled(records, with_times=False)
        return cls(u.mean(axis=0), y.mean(axis=0))

    @classmethod
    def linear(cls, records: Sequence[Record]) -> "Detrend":
        """The least-squares straight line of every channel over all experiments."""
        u, y, t = _pooled(records)
        spread = t - t.mean()
        power = float(spread @ spread)
        if power <= 0:
            raise DataError(f"{records[0].name}: a single instant has no trend; record longer")
        u_slope, y_slope = spread @ u / power, spread @ y / power
        return cls(
            u.mean(axis=0) - u_slope * t.mean(),
            y.mean(axis=0) - y_slope * t.mean(),
            u_slope,
            y_slope,
        )

    @property
    def is_none(self) -> bool:
        """Whether nothing is taken away."""
        return not any(np.any(v) for v in by_field(self).values())

    def remove(self, record: Record) -> Record:
        """The record without its offsets and slopes; hash and name stay."""
        if (record.nu, record.ny) != (len(self.u_offset), len(self.y_offset)):
            raise DataError(
                f"{record.name} has {record.nu} inputs and {record.ny} outputs, the stored offsets "
                f"are for {len(self.u_offset)} and {len(self.y_offset)}; choose the same channels"
            )
        if self.is_none:
            return record
        u, y = (self._shift(getattr(record, side), record.t, side, -1.0) for side in ("u", "y"))
        return replace(record, u=u, y=y)

    def remove_input(self, u: ArrayLike, t: ArrayLike) -> Array:
        """Inputs (N, nu) at the instants t (N,) [s], without their offsets and slopes."""
        return self._shift(u, t, "u", -1.0)

    def restore_output(self, y: ArrayLike, t: ArrayLike) -> Array:
        """Outputs (N, ny) at the instants t (N,) [s], with their offsets and slopes put back."""
        return self._shift(y, t, "y", +1.0)

    def _shift(self, values: ArrayLike, t: ArrayLike, side: str, sign: float) -> Array:
        array = np.asarray(values, dtype=np.float64)
        offset, slope = (getattr(self, f"{side}_{part}") for part in ("offset", "slope"))
        if array.ndim != 2 or array.shape[1] != len(offset):
            raise DataError(
                f"expected {side} of shape (N, {len(offset)}), time first, got {array.shape}"
            )
        shift = offset + np.asarray(t, dtype=np.float64).reshape(-1, 1) * slope
        return np.asarray(array + sign * shift)


def low_pass(record: Record, cutoff: float) -> Record:
    """All signals through one causal Butterworth low-pass of order 4, settled at the first sample.

    Filtering all alike leaves the relation between them as it is and weights the fit towards
    frequencies below ``cutoff``; it colours the noise, so residuals will not be white. A filter
    without phase would look into the future, which then predicts the outputs as a controller's
    commands do. (Ljung 1999, §14.4.)

    Args:
        cutoff: −3 dB frequency [Hz].

    Raises:
        UsageError: the cut-off is not between 0 and half the sampling rate.
    """
    nyquist = 0.5 / record.dt
    if not 0.0 < cutoff < nyquist:
        raise UsageError(
            f"a low-pass cut-off of {cutoff:g} Hz is impossible at {1 / record.dt:g} samples per "
            f"second; choose between 0 and {nyquist:g} Hz"
        )
    return _butterworth(record, 4, cutoff / nyquist, "lowpass")


def band_pass(record: Record, low: float, high: float) -> Record:
    """All signals through one causal Butterworth band-pass of order 4, settled at the first sample.

    What ``low_pass`` says holds here, too: the fit then counts the frequencies within the band.
    The levels are gone with what lies below it.

    Args:
        low, high: −3 dB frequencies [Hz].
    """
    nyquist = 0.5 / record.dt
    if not 0.0 < low < high < nyquist:
        raise UsageError(
            f"a band from {low:g} to {high:g} Hz is impossible at {1 / record.dt:g} samples per "
            f"second; its ends must rise between 0 and {nyquist:g} Hz"
        )
    return _butterworth(record, 2, (low / nyquist, high / nyquist), "bandpass")


def _butterworth(
    record: Record, order: int, ends: Any, kind: Literal["lowpass", "bandpass"]
) -> Record:
    from scipy import signal

    sections = signal.butter(order, ends, kind, output="sos")
    settled = signal.sosfilt_zi(sections)[:, :, None]
    return _each(record, lambda x: signal.sosfilt(sections, x, axis=0, zi=settled * x[0])[0])


def decimate(record: Record, factor: int) -> Record:
    """Keep every ``factor``-th sample.

    All signals pass the same mean of the last m = ``factor`` samples first: filtering the outputs
    alone would make the plant look slower, and a filter without phase would take the future into
    them. The input is then held between samples, so its new value is the mean of the samples it
    replaces, which acts on a slow plant like they did: ū_k = (1/m) Σ_{i<m} u_{km+i}.

    Raises:
        UsageError: the factor is below 1.
        DataError: fewer than ten samples would be left.
    """
    if factor < 1:
        raise UsageError(f"cannot decimate by {factor}; choose a factor of 2 or more")
    if factor == 1:
        return record
    count = len(record) // factor
    if count < 10:
        raise DataError(
            f"{record.name}: {len(record)} samples decimated by {factor} leave {count}; "
            "choose a smaller factor"
        )

    def last_means(x: Array) -> Array:
        before = np.repeat(x[:1], factor, axis=0)
        sums = np.cumsum(np.vstack([before, x]) - x[0], axis=0)
        return np.asarray(x[0] + (sums[factor:] - sums[:-factor]) / factor)

    return _each(record, last_means).every(factor)


def _each(record: Record, filtered: Callable[[Array], Array]) -> Record:
    """The record with every signal through the same filter."""
    smooth = replace(record, weights=None).mapped(filtered)
    return replace(smooth, weights=record.weights, as_logged=record.as_logged or record)


def trim(record: Record, start: float = 0.0, end: float = 0.0) -> Record:
    """Leave out the first ``start`` and the last ``end`` seconds."""
    if not (np.isfinite(start) and np.isfinite(end) and start >= 0 and end >= 0):
        raise UsageError(f"cannot trim {start:g} s and {end:g} s; give times of 0 or more")
    length = len(record) * record.dt
    if start + end > length - 2 * record.dt:
        raise DataError(
            f"{record.name} lasts {length:g} s; trimming {start + end:g} s leaves nothing"
        )
    first = round(start / record.dt)
    return record.rows(first, len(record) - round(end / record.dt))


def _vector(values: ArrayLike, name: str) -> Array:
    vector = np.array(values, dtype=np.float64)
    if vector.ndim != 1 or not np.all(np.isfinite(vector)):
        raise ModelError(f"{name} must be a vector of finite numbers, got {values!r}")
    vector.setflags(write=False)
    return vector


def _pooled(records: Sequence[Record], with_times: bool = True) -> tuple[Array, Array, Array]:
    """All samples of all records under each other, with their times [s] where these are wanted."""
    if not records:
        raise DataError("no record to take means of; give at least one")
    if len({(r.nu, r.ny) for r in records}) > 1:
        raise DataError("the records have different numbers of channels; choose the same ones")
    times = [r.t for r in records] if with_times else [np.zeros(0)]
    if len(records) == 1:
        return records[0].u, records[0].y, times[0]
    u, y = (np.concatenate([getattr(r, side) for r in records]) for side in ("u", "y"))
    return u, y, np.concatenate(times)
