"""Topics as the lines of a log, so that a topic is followed like a growing file."""

import math
import queue
import threading
from collections.abc import Mapping, Sequence

from sysid.cosim.ros.node import open_node
from sysid.cosim.ros.topic_rows import Row, subscribe
from sysid.data.bags.fields import si_unit, written
from sysid.data.bags.mapping import POSE, Source, sources
from sysid.data.following.lines import Lines
from sysid.errors import SysidError, UsageError


class TopicLines(Lines):
    """A line for every message of one topic; what other topics said last stands beside it."""

    def __init__(self, topic: str, mapping: Mapping[str, str]) -> None:
        """Args:
            topic: whose messages make the rows, a measurement's.
            mapping: column → field, as recordings are read (see ``bags.mapping``).

        Raises:
            UsageError: nothing of the topic is mapped.
            ModelError: there is no ROS here, or no master.
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
        """The lines of what has come since the last call.

        Raises:
            SysidError: a topic cannot be listened to.
        """
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
