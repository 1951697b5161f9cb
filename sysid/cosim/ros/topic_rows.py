"""Numbers of a topic as timed rows, as they arrive."""

import contextlib
import math
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import Any

from sysid.cosim.ros.node import Node, open_node
from sysid.errors import DataError, ModelError

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

    Raises:
        ModelError: there is no ROS, no master, nobody who publishes the topic, or its package of
            messages is not installed.
        DataError: a field is not in the message or is no number.
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
