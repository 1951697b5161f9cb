"""The size of the remaining error beyond the noise, and its consequence for a mission.

A test of long logs finds structure far too small to matter. So its size is said beside it: the
root mean square of the errors beyond the noise, and where a robot would stand after a minute or
after ten metres, if wheel speeds were off as they are: Δs = r ∫ e dt, mean of the tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.vehicle.kinematics import Geometry

LASTS, WAY = 60.0, 10.0
"""A mission as it is usual: so long [s], so far [m]."""

USUAL = 95.0
"""Percentile of the measurements' sizes that the errors are compared with."""


@dataclass(frozen=True)
class ExcessError:
    """Errors beyond the noise.

    Attributes:
        outputs: of each output its name, its unit in the file, the RMS beyond the noise in it, and
            that in per cent of the usual size of its measurements.
        after_time: how far off a robot is after ``LASTS`` [m]; None where the log is no robot's.
        after_way: the same after ``WAY``.
    """

    outputs: tuple[tuple[str, str, float, float], ...]
    after_time: float | None = None
    after_way: float | None = None

    @property
    def sentence(self) -> str:
        """The sizes in words."""
        sizes = ", ".join(
            f"{rms:.2g}{f' {unit}' if unit else ''} RMS on {name} "
            f"({share:.2g} % of the typical output)"
            for name, unit, rms, share in self.outputs
        )
        if not sizes:
            return ""
        said = f"Remaining error beyond the noise: {sizes}."
        if self.after_time is not None and self.after_way is not None:
            said += (
                f" A robot driven by this model would be about {self.after_time:.2g} m off after "
                f"{LASTS:.0f} s, and {self.after_way:.2g} m after {WAY:.0f} m."
            )
        return said

    def to_json(self) -> dict[str, Any]:
        """{outputs {name: {unit, rms, percent}}, after_60_s_m, after_10_m_m, sentence}."""
        return {
            "outputs": {
                name: {"unit": unit, "rms": rms, "percent": share}
                for name, unit, rms, share in self.outputs
            },
            "after_60_s_m": self.after_time,
            "after_10_m_m": self.after_way,
            "sentence": self.sentence,
        }


def excess_error(
    records: Sequence[Record], errors: Sequence[Array], floor: Array, geometry: Geometry | None
) -> ExcessError:
    """Size of the errors beyond the noise.

    Args:
        errors: its free-run errors there, (N, ny) a record; NaN where a sample does not count.
        floor: noise of each output, (ny,).
    """
    e, y = np.concatenate(errors), np.concatenate([r.y for r in records])
    beyond = np.sqrt(np.maximum(np.nanmean(e**2, axis=0) - floor**2, 0.0))
    usual = np.nanpercentile(np.abs(y), USUAL, axis=0)
    sizes = tuple(
        (c.name, unit, float(factor * rms), float(100.0 * rms / max(size, 1e-300)))
        for c, rms, size in zip(records[0].outputs, beyond, usual, strict=True)
        for factor, unit in [c.to_file]
    )
    if not (records[0].is_robot_log and all(c.unit == "rad/s" for c in records[0].outputs)):
        return ExcessError(sizes)
    r = (geometry or Geometry()).r
    minutes = np.concatenate(
        [_drifts(rec, err, r) for rec, err in zip(records, errors, strict=True)]
    )
    drift = float(np.sqrt(np.mean(minutes[:, 0] ** 2)))
    way = float(np.mean(minutes[:, 1]))
    return ExcessError(sizes, drift, drift * WAY / way if way > 0.0 else None)


def _drifts(record: Record, errors: Array, r: float) -> Array:
    """Of each minute of a record: how far off its end is, and how far it drove [m], (n, 2).

    A record shorter than a minute stands for one in proportion, samples that do not count for the
    mean of those that do.
    """
    parts = max(round(len(record) * record.dt / LASTS), 1)
    drifts = []
    for e, y in zip(np.array_split(errors, parts), np.array_split(record.y, parts), strict=True):
        there = np.isfinite(e).all(axis=1)
        if there.any():
            means = float(np.mean(e[there])), float(np.mean(np.abs(y[there])))
            drifts.append([r * LASTS * mean for mean in means])
    return np.array(drifts or [[0.0, 0.0]])
