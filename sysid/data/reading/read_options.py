"""ReadOptions: how to read a log, in a form that a model can store."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from sysid.data.documents import by_field
from sysid.data.reading.dates import ORDERS
from sysid.data.reading.decoding import check_encoding
from sysid.data.reading.missing_codes import given_codes
from sysid.data.reading.stale import check_held
from sysid.data.reading.time_column import unit_of
from sysid.data.reading.timing import ResamplePolicy, check_policy
from sysid.data.schema import STORED
from sysid.data.units import conversion, pwm_conversion
from sysid.errors import UsageError

STAMPS = ("auto", "header", "received")
"""auto: the sender's stamps in a bag where they serve; received: when they were recorded."""


@dataclass(frozen=True)
class ReadOptions:
    """How to read a log; a model stores it, so that its data can be read again alike.

    Attributes:
        inputs, outputs: column names; empty to go by convention.
        time: name of the time column; None to go by name.
        ts: sample time [s], where the file has no time column or only counts its samples.
        delimiter, decimal, encoding: of a text; None to find them.
        units: channel name → unit of its numbers in the file (see ``units.UNITS``); for a column of
            dates the order of day and month (see ``dates.ORDERS``).
        pwm_max: the command value of full drive, where it is not 20000; None otherwise.
        resample: what to do about jitter, gaps and missing cells (see ``timing``).
        unwrap: output → number after which its counter starts over, None to leave its jumps alone;
            an empty name for every output; else it is seen from the measurements (see
            ``counters``).
        held: what to do about sensors slower than the log: ``auto`` reads the log at their rate,
            ``keep`` leaves every row, a number is that of the rows in a sample (see ``stale``).
        join: files with more columns of the same experiment, ``LOG=FILE`` where there are several
            logs; they are brought onto the log's rows by time (see ``join``).
        join_offset: time of the log less time of the joined file [s]; None to estimate it.
        map: column → field of a bag, ``/topic.field``; a column may carry its unit in brackets
            (see ``bags.mapping``).
        stamps: the clock of a bag's streams, one of ``STAMPS`` (see ``bags.clocks``).
        latency: what to do about streams of a bag that come late: ``remove``, or ``/topic=SECONDS``
            for each that is to be moved; they are said and kept unless given.
        strict: whether lines that are no rows of the table are refused, not left out.
        speed_of: outputs that are positions and are read as the speed between their measurements.
        missing: numbers that stand for a missing measurement, ``none`` for none; empty to detect
            them (see ``missing_codes``).
        enable: the column that is 0 where the drive is released; those rows are left out. ``none``
            keeps every row, None goes by name (see ``released``).

    Raises:
        UsageError: an option cannot be.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    time: str | None = None
    ts: float | None = None
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    units: Mapping[str, str] = field(default_factory=dict, hash=False)
    pwm_max: float | None = None
    resample: ResamplePolicy = "auto"
    unwrap: Mapping[str, float | None] = field(default_factory=dict, hash=False)
    speed_of: tuple[str, ...] = ()
    held: str = "auto"
    join: tuple[str, ...] = ()
    join_offset: float | None = None
    map: Mapping[str, str] = field(default_factory=dict, hash=False)
    stamps: str = "auto"
    latency: tuple[str, ...] = ()
    strict: bool = False
    missing: tuple[str, ...] = ()
    enable: str | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        for name in ("inputs", "outputs", "speed_of", "join", "latency", "missing"):
            given = getattr(self, name)
            put(self, name, (given,) if isinstance(given, str) else tuple(given))
        put(self, "units", dict(self.units))
        put(self, "map", dict(self.map))
        put(self, "unwrap", self.periods)
        check_policy(self.resample)
        check_held(self.held)
        given_codes(self.missing)
        if self.stamps not in STAMPS:
            raise UsageError(f"unknown `stamps` {self.stamps!r}; choose one of {', '.join(STAMPS)}")
        if self.ts is not None and not (np.isfinite(self.ts) and self.ts > 0):
            raise UsageError(f"`ts` must be a positive sample time in seconds, got {self.ts:g}")
        if self.decimal not in (None, ".", ","):
            raise UsageError(f"the decimal sign must be '.' or ',', got {self.decimal!r}")
        if self.encoding is not None:
            check_encoding(self.encoding)
        if self.pwm_max is not None:
            pwm_conversion(self.pwm_max)
        for channel, unit in self.units.items():
            # a unit of time, or an order of day and month, may be that of the time column
            if unit_of(unit) is None and unit not in ORDERS:
                conversion(unit, channel)

    @property
    def date_order(self) -> str | None:
        """The order of day and month that the dates are written in, None to see it from them."""
        return next((unit for unit in self.units.values() if unit in ORDERS), None)

    @property
    def periods(self) -> dict[str, float]:
        """Output → number after which its counter starts over, 0 where its jumps are real."""
        return {name: float(period or 0.0) for name, period in self.unwrap.items()}

    def to_json(self) -> dict[str, Any]:
        """The options as a JSON object; defaults are left out."""
        return {
            k: list(v) if isinstance(v, tuple) else v
            for k, v in by_field(self, defaults=False).items()
        }
