"""The mapped fields of a bag as streams of numbers, one for each topic, at their own instants."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sysid.data.bags.fields import (
    NoSuchFieldError,
    Reader,
    nearest,
    pose_steps,
    reader,
    si_unit,
    written,
)
from sysid.data.bags.mapping import POSE, Source
from sysid.data.bags.opening import Bag, Message, opened
from sysid.data.record import Array
from sysid.errors import DataError, UsageError

CLOCK = "/clock"
"""Topic of a simulation's time."""

FIRST_DATE = 10**17
"""Stamps [ns] from here on count from 1970; smaller ones from the start of a simulation."""


@dataclass(frozen=True, eq=False)
class Stream:
    """What one topic says over time.

    Attributes:
        t: instants of its values [s], (N,): when they were recorded, from the bag's ``origin`` on,
            until ``clocks.timed`` puts all streams on one clock, each rising.
        stamped: what its header says [s], from the same origin; NaN where it has none, (N,).
        values: (N, n), NaN where a message did not hold a number.
        names, units: of the columns, (n,).
        angles: names of the columns that are angles with a jump at π.
        kind: type of its messages.
        paths: of the columns' fields in a message, (n,).
        frames: of the header and, where there is one, of the child: ``odom``, ``base_link``.
        by: what its instants are: ``header.stamp`` or ``the time of receipt``.
        way: median time from stamp to receipt [s]; NaN where clocks differ, or without stamps.
    """

    topic: str
    t: Array
    stamped: Array
    values: Array
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    kind: str = ""
    paths: tuple[str, ...] = ()
    frames: tuple[str, str] = ("", "")
    by: str = "the time of receipt"
    way: float = np.nan

    @property
    def step(self) -> float:
        """The usual step between values [s]; infinite where there are fewer than two."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def regular(self) -> bool:
        """Whether it comes at a steady rate: 80 % of the steps within half of the usual one."""
        if len(self.t) < 10:
            return False
        return bool(np.mean(np.abs(np.diff(self.t) / self.step - 1.0) <= 0.5) >= 0.8)

    def rows(self, kept: NDArray[np.intp] | NDArray[np.bool_]) -> "Stream":
        stamped, values = self.stamped[kept], self.values[kept]
        return replace(self, t=self.t[kept], stamped=stamped, values=values)


@dataclass(frozen=True, eq=False)
class Streams:
    """The mapped streams of a bag.

    Attributes:
        where: the bag, for messages.
        origin: what was subtracted from all stamps [s]: 0, or a time since 1970.
        streams: in the order of the mapping.
        clock: times of receipt and values of a simulation's clock [s], (M, 2); M = 0 without.
    """

    where: str
    origin: float
    streams: tuple[Stream, ...]
    clock: Array


def read_streams(path: Path, mapping: Sequence[Source]) -> Streams:
    """Read the mapped fields, message by message: only their numbers are kept."""
    with opened(path) as bag:
        topics = tuple(dict.fromkeys(s.topic for s in mapping))
        for topic in topics:
            if topic not in bag.types:
                near = nearest(topic, sorted(bag.types))
                raise UsageError(f"{bag.where} has no topic {topic}{near}")
            if not bag.counts[topic]:
                raise DataError(
                    f"{bag.where}: {topic} holds no messages; map another topic, or record it"
                )
        origin = bag.start if bag.start > FIRST_DATE else 0
        parts = {t: _Part(bag, t, [s for s in mapping if s.topic == t], origin) for t in topics}
        clock = array("d")
        wanted = {*topics, CLOCK} if CLOCK in bag.types else set(topics)
        for message in bag.messages(wanted):
            if message.topic in parts:
                parts[message.topic].add(message)
            if message.topic == CLOCK and hasattr(message.content, "clock"):
                stamp = _ns(message.content.clock)
                clock.extend(((message.received - origin) / 1e9, (stamp - origin) / 1e9))
        streams = tuple(part.stream() for part in parts.values())
    return Streams(bag.where, origin / 1e9, streams, np.array(clock).reshape(-1, 2))


@dataclass(eq=False)
class _Part:
    """One topic while its messages are read."""

    bag: Bag
    topic: str
    mapping: Sequence[Source]
    origin: int
    readers: list[Reader] = field(default_factory=list)
    columns: list[tuple[str, str, str]] = field(default_factory=list)
    received: "array[float]" = field(default_factory=lambda: array("d"))
    stamped: "array[float]" = field(default_factory=lambda: array("d"))
    values: "array[float]" = field(default_factory=lambda: array("d"))
    frames: tuple[str, str] = ("", "")

    def add(self, message: Message) -> None:
        content = message.content
        header = getattr(content, "header", None)
        if not self.readers:
            self._open(content)
            child = str(getattr(content, "child_frame_id", ""))
            self.frames = (str(getattr(header, "frame_id", "")), child)
        stamp = _ns(getattr(header, "stamp", None))
        self.received.append((message.received - self.origin) / 1e9)
        self.stamped.append((stamp - self.origin) / 1e9 if stamp else np.nan)
        self.values.extend(read(content) for read in self.readers)

    def _open(self, content: object) -> None:
        kind = self.bag.types[self.topic]
        for source in self.mapping:
            try:
                places = {source.name: source.steps}
                if source.name == POSE:
                    places = pose_steps(content, source.steps)
                for name, steps in places.items():
                    self.readers.append(_scaled(reader(content, steps), source.factor))
                    unit = source.unit or si_unit(kind, steps)
                    self.columns.append((name, unit, written(steps)))
            except NoSuchFieldError as error:
                raise UsageError(f"{self.bag.where}: {self.topic} ({kind}) {error}") from None

    def stream(self) -> Stream:
        values = np.frombuffer(self.values, dtype=np.float64).reshape(-1, len(self.columns))
        for k, (name, _, path) in enumerate(self.columns):
            if not np.isfinite(values[:, k]).any():
                raise DataError(
                    f"{self.bag.where}: no message of {self.topic} holds a number in {path}; map "
                    f"{name} to another field"
                )
        stamped = np.array(self.stamped)
        if self.origin == 0 and np.isnan(stamped[0]) and np.isfinite(stamped[1:]).all():
            stamped[0] = 0.0  # a simulation begins at zero; elsewhere that says "not stamped"
        return Stream(
            self.topic,
            np.frombuffer(self.received, dtype=np.float64),
            stamped,
            values,
            tuple(name for name, _, _ in self.columns),
            tuple(unit for _, unit, _ in self.columns),
            tuple(n for n, _, path in self.columns if path.endswith((".yaw", "yaw", "theta"))),
            self.bag.types[self.topic],
            tuple(path for _, _, path in self.columns),
            self.frames,
        )


def _ns(stamp: object) -> int:
    return int(getattr(stamp, "sec", 0)) * 10**9 + int(getattr(stamp, "nanosec", 0))


def _scaled(read: Reader, factor: float) -> Reader:
    return read if factor == 1.0 else lambda message: factor * read(message)
