"""Topics as timed rows, and as the lines of a log, followed like a growing file."""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

from sysid.cosim.ros.node import Node, open_node
from sysid.data.bags.fields import si_unit, written
from sysid.data.bags.mapping import POSE, Source, sources
from sysid.data.following.lines import Lines
from sysid.errors import DataError, ModelError, SysidError, UsageError

Row = tuple[float, tuple[float, ...]]
"""Time [s] and values."""


def subscribe(topic: str, fields: Sequence[str], silence: float = 10.0) -> Iterator[Row]:
    """Yield (t, values) for every message of a topic, until nothing comes any more.

    The time is the header's stamp where a message has one, else the simulated time of ``/clock``
    where that is used, else the time of arrival [s]. Rows come in the order of their arrival. For
    an estimator that takes rows::

        with contextlib.closing(subscribe("/joint_states", ["velocity[0]", "effort[0]"])) as rows:
            for t, (speed, torque) in rows:
                ...

    Closing the iterator ends the subscription. Ctrl-C comes through as ``KeyboardInterrupt``.

    Args:
        topic: its name, with or without the leading slash.
        fields: paths into the message: ``twist.twist.linear.x``, ``data[3]``, ``velocity[0]``.
        silence: with no message for this long [s] the rows end; infinite to wait for ever. Nothing
            at all within it is an error.
    """
    node = open_node("sysid_listener")
    topic = topic if topic.startswith("/") else f"/{topic}"
    kind, deadline = None, time.monotonic() + silence
    while kind is None:
        kind = node.master.type_of(topic)
        if kind is None and time.monotonic() > deadline:
            raise ModelError(
                f"no node publishes the topic {topic} at {node.master.uri}: start its node, or "
                "check the name with rostopic list"
            )
        if kind is None:
            time.sleep(0.1)
    message_class = node.ros.message_class(kind)
    if message_class is None:
        raise ModelError(
            f"messages of type {kind} are not installed here: install the package of "
            f"{kind.partition('/')[0]}"
        )
    take = tuple(_reader(path, kind) for path in fields)
    return _rows(node, (topic, message_class), take, silence)


def _rows(
    node: Node,
    source: tuple[str, Any],
    take: tuple[Callable[[Any], float], ...],
    silence: float,
) -> Iterator[Row]:
    came: queue.Queue[tuple[float, Any]] = queue.Queue()
    topic, message_class = source
    rospy, limit = node.ros.rospy, None if math.isinf(silence) else silence

    def keep(message: Any) -> None:
        came.put((rospy.get_time(), message))

    listening = rospy.Subscriber(topic, message_class, keep, tcp_nodelay=True)
    any_came = False
    try:
        while True:
            try:
                arrival, message = came.get(timeout=limit)
            except queue.Empty:
                if any_came:
                    return
                raise ModelError(
                    f"no message came on {topic} within {silence:g} s: start what publishes it"
                ) from None
            any_came = True
            yield _stamp(message) or arrival, tuple(read(message) for read in take)
    finally:
        with contextlib.suppress(Exception):  # the master may be gone
            listening.unregister()


def _stamp(message: Any) -> float:
    """Stamp of the header [s]; 0 where there is none."""
    header = getattr(message, "header", None)
    return 0.0 if header is None else float(header.stamp.to_sec())


def _reader(path: str, kind: str) -> Callable[[Any], float]:
    """What takes a number out of a message by ``a.b[2].c``."""
    steps = [s for s in path.replace("[", ".[").split(".") if s]

    def into(part: Any, step: str) -> Any:
        return part[int(step[1:-1])] if step.startswith("[") else getattr(part, step)

    def read(message: Any) -> float:
        try:
            return float(reduce(into, steps, message))
        except (AttributeError, IndexError, TypeError, ValueError):
            raise DataError(
                f"a message of {kind} has no number at {path!r}: look at its fields with rosmsg "
                f"show {kind}"
            ) from None

    return read


class TopicLines(Lines):
    """A line for every message of one topic; what other topics said last stands beside it."""

    def __init__(self, topic: str, mapping: Mapping[str, str]) -> None:
        """Args:
        topic: whose messages make the rows, a measurement's.
        mapping: column → field, as recordings are read (see ``bags.mapping``).
        """
        super().__init__(topic)
        self._topic = topic if topic.startswith("/") else f"/{topic}"
        topics = sources(mapping)
        by_topic: dict[str, list[Source]] = {}
        for s in topics:
            if s.name == POSE and not s.steps:
                raise UsageError("a whole pose cannot be followed; map x, y and psi separately")
            by_topic.setdefault(s.topic, []).append(s)
        if self._topic not in by_topic:
            raise UsageError(
                f"{self._topic} is a topic: say which of its fields are columns with "
                f"`map=NAME`, such as omega={self._topic}.velocity[0]"
            )
        node = open_node("sysid_listener")
        self._came: queue.Queue[tuple[str, Row | SysidError]] = queue.Queue()
        self._newest: dict[str, tuple[float, ...]] = {}
        self._sources = by_topic
        self._kinds = node.master.type_of
        self._headed = False
        for name, mapped in by_topic.items():
            threading.Thread(target=self._listen, args=(name, mapped), daemon=True).start()

    def new(self) -> list[str]:
        """The lines of what has come since the last call."""
        lines: list[str] = []
        while True:
            try:
                topic, row = self._came.get_nowait()
            except queue.Empty:
                return lines
            if isinstance(row, SysidError):
                raise row
            t, values = row
            factors = [s.factor for s in self._sources[topic]]
            self._newest[topic] = tuple(f * v for f, v in zip(factors, values, strict=True))
            if topic == self._topic and len(self._newest) == len(self._sources):
                if not self._headed:
                    lines.append(self._header())
                    self._headed = True
                numbers = [v for name in self._sources for v in self._newest[name]]
                lines.append(",".join(repr(float(v)) for v in (t, *numbers)))

    def close(self) -> None:
        """Nothing: those who listen end with the process."""

    def _read(self) -> bytes:
        return b""

    def _header(self) -> str:
        """The names of the columns, each with its given unit or that of ROS."""
        names = ["t"]
        for topic, mapped in self._sources.items():
            kind = self._kinds(topic) or ""
            for s in mapped:
                unit = s.unit or si_unit(kind, s.steps)
                names.append(f"{s.name} [{unit}]" if unit else s.name)
        return ",".join(names)

    def _listen(self, topic: str, mapped: Sequence[Source]) -> None:
        try:
            for row in subscribe(topic, [written(s.steps) for s in mapped], silence=math.inf):
                self._came.put((topic, row))
        except SysidError as error:
            self._came.put((topic, error))
