"""Topics as lines of a log, without ROS: what rospy would hand over is handed over by the test."""

import queue
import time
from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import pytest

from sysid.cosim.ros import topic_lines
from sysid.cosim.ros.topic_lines import TopicLines
from sysid.data.following.rows import RowReader
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import ModelError, UsageError

KINDS = {"/wheel": "geometry_msgs/TwistStamped", "/volts": "std_msgs/Float64"}
MAP = {"volts [V]": "/volts.data", "speed": "-/wheel.twist.angular.z"}


def topics(monkeypatch: pytest.MonkeyPatch) -> dict[str, queue.Queue[object]]:
    """Queues in the place of the topics."""
    feeds: dict[str, queue.Queue[object]] = {name: queue.Queue() for name in KINDS}

    def subscribe(topic: str, fields: Sequence[str], silence: float) -> Iterator[object]:
        assert fields == {"/wheel": ["twist.angular.z"], "/volts": ["data"]}[topic]
        while True:
            row = feeds[topic].get(timeout=10.0)
            if isinstance(row, Exception):
                raise row
            if row is None:
                return
            yield row

    node = SimpleNamespace(master=SimpleNamespace(type_of=KINDS.get))
    monkeypatch.setattr(topic_lines, "subscribe", subscribe)
    monkeypatch.setattr(topic_lines, "open_node", lambda _name: node)
    return feeds


def lines_when(source: TopicLines, count: int) -> list[str]:
    """The next so many lines."""
    collected: list[str] = []
    for _ in range(1000):
        collected += source.new()
        if len(collected) >= count:
            return collected
        time.sleep(0.005)
    raise AssertionError(collected)


def test_the_newest_command_stands_beside_each_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    feeds = topics(monkeypatch)
    source = TopicLines("/wheel", MAP)
    feeds["/volts"].put((0.0, (3.0,)))
    while not feeds["/volts"].empty():
        time.sleep(0.005)
    time.sleep(0.02)
    assert source.new() == []  # no measurement so far
    for k in range(5):
        feeds["/wheel"].put((1.7e9 + 0.1 * k, (-2.0 * k,)))
    lines = lines_when(source, 6)
    for feed in feeds.values():
        feed.put(None)
    reader = RowReader(source.where, ReadOptions(inputs=("volts",), outputs=("speed",)))
    rows = reader.read(lines, last=True)
    assert rows is not None
    assert reader.inputs[0].unit == "V"
    assert reader.outputs[0].unit == "rad/s"  # as ROS prescribes
    assert reader.dt == pytest.approx(0.1, abs=1e-6)
    assert rows.u[:, 0].tolist() == [3.0] * 5
    assert rows.y[:, 0].tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_an_error_of_a_topic_is_raised_where_rows_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    feeds = topics(monkeypatch)
    source = TopicLines("wheel", MAP)
    feeds["/wheel"].put(ModelError("no node publishes it"))
    feeds["/volts"].put(None)
    with pytest.raises(ModelError, match="no node publishes"):
        lines_when(source, 1)


def test_a_topic_without_columns_is_refused() -> None:
    with pytest.raises(UsageError, match="is a topic"):
        TopicLines("/odom", MAP)
