"""Trimming, filtering, decimation and drift of records before a fit, stored with the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.data.decision import Decision
from sysid.data.documents import by_field
from sysid.data.facts import without_drift
from sysid.data.finding import Finding
from sysid.data.io import read_files
from sysid.data.preprocess import band_pass, decimate, low_pass, trim
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Record
from sysid.data.same_kind import common_step
from sysid.data.schema import STORED
from sysid.errors import UsageError


@dataclass(frozen=True)
class Preparation:
    """Trimming, filtering, decimation and removal of a drift, in that order.

    Attributes:
        trim_start, trim_end: seconds cut from the head and the tail of each record.
        low_pass: cut-off [Hz] of the filter on all signals, None for none.
        band: ends of the band [Hz] that counts, None for all frequencies.
        decimate: keep every so many samples (means of them), 1 for all.
        remove_drift: take the slow drift of each output's level out, whatever the inputs do.

    Raises:
        UsageError: a number cannot be.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    trim_start: float = 0.0
    trim_end: float = 0.0
    low_pass: float | None = None
    decimate: int = 1
    remove_drift: bool = False
    band: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("trim_start", "trim_end"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise UsageError(f"trimming needs 0 s or more, got {value:g}")
        if self.low_pass is not None and not (np.isfinite(self.low_pass) and self.low_pass > 0.0):
            raise UsageError(f"`low_pass` needs a positive cut-off in Hz, got {self.low_pass:g}")
        if self.decimate < 1:
            raise UsageError(f"`decimate` needs a whole number of at least 1, got {self.decimate}")

    def apply(self, record: Record) -> Record:
        if self.trim_start or self.trim_end:
            record = trim(record, self.trim_start, self.trim_end)
        if self.low_pass is not None:
            record = low_pass(record, self.low_pass)
        if self.band is not None:
            record = band_pass(record, *self.band)
        if self.decimate > 1:
            record = decimate(record, self.decimate)
        if self.remove_drift:
            record = without_drift(record)
        done = self.to_json()
        steps = ", ".join(name.replace("_", " ") + _amount(value) for name, value in done.items())
        changes = dict.fromkeys(name.partition("_")[0] if "trim" in name else name for name in done)
        decision = Decision("prepared", steps, tuple(changes))
        return replace(record, read_as=(*record.read_as, decision)) if done else record

    def to_json(self) -> dict[str, Any]:
        """The steps as a JSON object; what is not done is left out."""
        return by_field(self, defaults=False)


def _amount(value: Any) -> str:
    if value is True:
        return ""
    return " " + ":".join(f"{v:g}" for v in (value if isinstance(value, list | tuple) else [value]))


def read_prepared(
    paths: Sequence[Path], options: ReadOptions, steps: Preparation, dt: float | None = None
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records of log files as a fit takes them, and what there is to say about the reading.

    Args:
        dt: sample time [s] of a model or log that finer records are brought to.
    """
    files = read_files(paths, options)
    records = tuple(steps.apply(r) for file in files for r in file.records)
    findings = tuple(f for file in files for f in file.findings)
    if dt is not None:
        records, resampled = common_step(records, dt)
        findings += resampled
    return records, findings
