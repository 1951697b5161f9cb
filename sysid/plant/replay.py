"""Open-loop simulation of a plant on the inputs of a log, beside the measured outputs."""

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.criteria.fit import fit_percent, rmse
from sysid.data.files import write_atomic
from sysid.data.record import Array, Channel, Record
from sysid.errors import ModelError
from sysid.outside_text import csv_text
from sysid.plant.selftest import run
from sysid.structures.plant import Plant

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions

ELSEWHERE = 0.1
"""Share of an output's range in the log by which it may begin beside the plant's rest: less than
that is noise, or gone before anybody sees it in a figure."""


@dataclass(frozen=True, eq=False)
class Replay:
    """What a plant answered to the inputs of a record.

    Attributes:
        record: the log, in the plant's units.
        simulated: the plant's outputs, shape (N, ny).
        warnings: what to know before trusting the figures.
    """

    record: Record
    simulated: Array
    warnings: tuple[str, ...]

    def summary(self) -> dict[str, Any]:
        """Fit [%] and RMSE of each output by name, with what they were computed from."""
        names = self.record.output_names
        fit = fit_percent(self.record.y, self.simulated)
        error = rmse(self.record.y, self.simulated)
        return {
            "data": self.record.name,
            "horizon": "free run",
            "initial_state": "rest",
            "fit_percent": dict(zip(names, map(float, fit), strict=True)),
            "rmse": dict(zip(names, map(float, error), strict=True)),
            "warnings": list(self.warnings),
        }


def read_for(plant: Plant, path: str | Path, options: "ReadOptions | None" = None) -> Record:
    """Read the columns of a log that a plant needs.

    Args:
        plant: names the columns; its sample time is used where the log has none.
        options: how to read it; the columns are the plant's unless they are named here.

    Raises:
        DataError, UsageError: the log cannot serve; see ``sysid.data.io``.
    """
    from sysid.data.io import read_file, read_log  # a mission reads no log
    from sysid.data.reading.read_options import ReadOptions

    options = options or ReadOptions()
    options = replace(
        options,
        inputs=options.inputs or tuple(c.name for c in plant.inputs),
        outputs=options.outputs or tuple(c.name for c in plant.outputs),
        strict=True,  # what is left out would not be said here
    )
    log = read_file(path, options)
    if options.ts is None and any(f.code == "sample-time" for f in log.findings):
        options = replace(options, ts=plant.dt)
    return read_log(path, options)


def replay(plant: Plant, record: Record) -> Replay:
    """Step a plant from rest through the inputs of a log.

    The log's channels are brought to the plant's units by the scale that is stored with the plant.

    Args:
        record: a log with the plant's inputs and outputs.
    """
    record = _in_units(record, plant)
    if abs(record.dt - plant.dt) > 1e-2 * plant.dt:
        raise ModelError(
            f"{record.name} is sampled every {record.dt:g} s but the plant every {plant.dt:g} s; "
            "fit and export a model of this sample time"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = run(plant, record.u)
    if not np.all(np.isfinite(simulated)):
        raise ModelError(
            f"the plant runs away on {record.name}: it is unstable; fit it with `stable=True` or "
            "choose another model"
        )
    notes = (*outside_domain(plant, record.u), *begins_elsewhere(record, simulated))
    return Replay(record, simulated, notes)


def begins_elsewhere(record: Record, simulated: Array) -> tuple[str, ...]:
    """A sentence for each output that begins in the log where the plant at rest does not.

    The run then first goes from the one to the other, which its figures count as an error.
    """
    sentences = []
    for i, channel in enumerate(record.outputs):
        measured, rest = float(record.y[0, i]), float(simulated[0, i])
        if abs(measured - rest) > ELSEWHERE * float(np.ptp(record.y[:, i])):
            unit = f" {channel.unit}" if channel.unit else ""
            sentences.append(
                f"{channel.name} begins at {measured:.4g}{unit} in the log and the plant rests at "
                f"{rest:.4g}{unit}: the figures include this transition. `sysid compare` starts "
                "from the log's own state."
            )
    return tuple(sentences)


def write_replay(result: Replay, path: str | Path) -> Path:
    """Write t, inputs, measured and simulated outputs (``…_sim``) as CSV."""
    record = result.record
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    simulated = [f"{n}_sim" for n in record.output_names]
    names = ["t", *record.input_names, *record.output_names, *simulated]
    writer.writerow(map(csv_text, names))
    t = np.round(record.t, 12)
    writer.writerows(np.column_stack([t, record.u, record.y, result.simulated]).tolist())
    return write_atomic(path, text.getvalue())


def outside_range(plant: Plant, u: Array) -> NDArray[np.bool_]:
    """Where u (N, nu) leaves the range that the plant was identified in by over 1 %, (N, nu).

    Nowhere where the range is not known.
    """
    if not plant.input_range:
        return np.zeros(u.shape, dtype=np.bool_)
    low, high = np.array(plant.input_range).T
    margin = 0.01 * (high - low)
    return np.asarray((u < low - margin) | (u > high + margin))


def outside_domain(plant: Plant, u: Array) -> tuple[str, ...]:
    """A sentence for each input of u (N, nu) that leaves the range the plant was identified in."""
    leaves = [bool(outside.any()) for outside in outside_range(plant, u).T]
    return tuple(
        f"{channel.name} runs from {values.min():.5g} to {values.max():.5g} but the plant "
        f"was identified from {low:.5g} to {high:.5g}: outside it extrapolates."
        for channel, (low, high), values, leaving in zip(
            plant.inputs, plant.input_range, u.T, leaves, strict=False
        )
        if leaving
    )


def _in_units(record: Record, plant: Plant) -> Record:
    """The record with the channels of the plant, in the plant's order and units."""
    wanted = [c.name for c in (*plant.inputs, *plant.outputs)]
    there = (*record.input_names, *record.output_names)
    missing = [n for n in wanted if n not in there]
    if missing:
        raise ModelError(
            f"{record.name} has no column {missing[0]}, which the plant needs; it has "
            + ", ".join(there)
        )
    chosen = record.select([c.name for c in plant.inputs], [c.name for c in plant.outputs])
    return replace(
        chosen,
        u=chosen.u * _factors(chosen.inputs, plant.inputs),
        y=chosen.y * _factors(chosen.outputs, plant.outputs),
        inputs=plant.inputs,
        outputs=plant.outputs,
    )


def _factors(read: tuple[Channel, ...], wanted: tuple[Channel, ...]) -> Array:
    """From the units a log was read in to those the plant was identified in."""
    return np.array([w.scale / r.scale for r, w in zip(read, wanted, strict=True)])
