"""Contents of a bag: its topics with types, rates and varying fields."""

from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.bags.fields import numbers
from sysid.data.bags.opening import opened
from sysid.data.bags.streams import FIRST_DATE
from sysid.data.record import Array

MOST_MESSAGES = 6000
"""Messages of one topic that are looked at; of longer ones blocks from all over the recording."""
BLOCK = 1000
"""Messages that are looked at in a row, so that what leads what can be seen."""
LARGEST = 20_000
"""Bytes beyond which a message is an image or a cloud, which no log of a plant holds."""


@dataclass(frozen=True, eq=False)
class Field:
    """A number of the messages of a topic.

    Attributes:
        path: behind the topic, ``twist.twist.linear.x``.
        t: when the messages that were looked at were recorded [s] since the start, (N,).
        values: (N,).
    """

    path: str
    t: Array
    values: Array

    @property
    def moves(self) -> bool:
        known = self.values[np.isfinite(self.values)]
        return len(known) > 1 and bool(np.ptp(known) > 0.0)

    def summary(self) -> dict[str, Any]:
        known = self.values[np.isfinite(self.values)]
        low, high = (float(np.min(known)), float(np.max(known))) if len(known) else (None, None)
        return {"path": self.path, "min": low, "max": high, "moves": self.moves}


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of a bag.

    Attributes:
        name: with its slash.
        kind: type of its messages.
        rate: usual messages a second; NaN for fewer than two.
        fields: its numbers; none where messages are large, or their type is not defined.
    """

    name: str
    kind: str
    count: int
    rate: float
    fields: tuple[Field, ...]

    @property
    def moving(self) -> tuple[Field, ...]:
        return tuple(f for f in self.fields if f.moves)


@dataclass(frozen=True, eq=False)
class Contents:
    """What is in a bag.

    Attributes:
        where: its name.
        length: time from the first message that was looked at to the last [s].
    """

    where: str
    length: float
    topics: tuple[Topic, ...]

    def summary(self) -> dict[str, Any]:
        topics = [
            {"name": t.name, "type": t.kind, "count": t.count, "rate_hz": t.rate,
             "fields": [f.summary() for f in t.fields]} for t in self.topics
        ]  # fmt: skip
        return {"name": self.where, "duration_s": self.length, "topics": topics}


def read_contents(path: Path) -> Contents:
    """Look into a bag.

    Raises:
        UsageError, DataError: it cannot be read.
    """
    with opened(path) as bag:
        origin = bag.start if bag.start > FIRST_DATE else 0
        parts = {t: _Part() for t in bag.types}
        for message in bag.some_messages(MOST_MESSAGES, BLOCK, LARGEST):
            parts[message.topic].add((message.received - origin) / 1e9, message.content)
        topics = tuple(
            Topic(t, bag.types[t], bag.counts[t], parts[t].rate, parts[t].fields())
            for t in sorted(bag.types)
        )
    ends = [p.t for p in parts.values() if len(p.t)]
    length = max((p[-1] for p in ends), default=0.0) - min((p[0] for p in ends), default=0.0)
    return Contents(path.name, length, topics)


@dataclass(eq=False)
class _Part:
    """One topic while its messages are looked at."""

    t: "array[float]" = field(default_factory=lambda: array("d"))
    found: "dict[str, tuple[array[float], array[float]]]" = field(default_factory=dict)

    def add(self, t: float, content: Any) -> None:
        self.t.append(t)
        for path, value in numbers(content):
            at, values = self.found.setdefault(path, (array("d"), array("d")))
            at.append(t)
            values.append(value)

    @property
    def rate(self) -> float:
        """Usual messages a second."""
        steps = np.diff(np.array(self.t))
        steps = steps[steps > 0.0]
        return 1.0 / float(np.median(steps)) if len(steps) else float("nan")

    def fields(self) -> tuple[Field, ...]:
        """The numbers seen, in the order of the message."""
        return tuple(
            Field(path, np.array(at), np.array(values)) for path, (at, values) in self.found.items()
        )
