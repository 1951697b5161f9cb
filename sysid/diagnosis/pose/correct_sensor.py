"""Wheel speeds corrected for the selected effects of the sensor.

A sensor that clips, lags or loses the sign would look like slip or another radius, since the
measured speeds drive the vehicle. The corrected speeds are

    ω̂ = y + (run without the sensor's effects − run with them).

Lost or repeated measurements take the model's speed and the error of their neighbours.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.samples import inspect_samples
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.selection import Selection
from sysid.effects.base import Place
from sysid.effects.catalogue import about

Parts = tuple[tuple[Record, ...], tuple[Record, ...]]
"""Estimation records, and held-out records."""


def correct_sensor(base: Base, selection: Selection) -> Parts:
    """The records of both parts, their outputs as speeds.

    Effects of the sensor that may as well be the motor's (a bias, a load) change nothing here.
    """
    parts = (base.parts.facts, base.parts.holdout_facts)
    both = parts[0].records, parts[1].records
    sensors = [
        n.id
        for n in selection.selected
        if all(about(id).place is Place.READING for id in (n.id, *n.ties))
    ]
    lost = tuple(inspect_samples(part).weights for part in parts)
    if base.on_rate or not (sensors or any(np.any(w == 0.0) for part in lost for w in part)):
        return both
    search, candidate = base.search, selection.final
    holdout_q = search.in_phase(candidate.q, candidate.effects)
    return (
        _corrected(base, both[0], lost[0], candidate.q, search.data, sensors),
        _corrected(base, both[1], lost[1], holdout_q, search.holdout_data, sensors),
    )


def _corrected(
    base: Base,
    records: tuple[Record, ...],
    weights: Sequence[Array],
    q: Array,
    data: Data,
    sensors: Sequence[str],
) -> tuple[Record, ...]:
    model, plain = base.search.model, q.copy()
    for id in sensors:
        indices = list(model.of(id))
        plain[indices] = model.null[indices]
    read, moved = (data.split(run) for run in model.run(np.array([q, plain]), data))
    return tuple(
        replace(r, y=m + _bridged(r.y - a, w))
        for r, a, m, w in zip(records, read, moved, weights, strict=True)
    )


def _bridged(errors: Array, weights: Array) -> Array:
    """Errors (N, ny), along straight lines where a reading has no weight."""
    out = errors.copy()
    rows = np.arange(len(errors))
    for column, good in zip(out.T, (weights > 0.0).T, strict=True):
        if good.any() and not good.all():
            column[~good] = np.interp(rows[~good], rows[good], column[good])
    return out
