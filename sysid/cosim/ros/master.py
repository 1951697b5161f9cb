"""The ROS master, queried with a time limit: publishers and types of topics."""

import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from typing import Any, cast
from urllib.parse import urlsplit
from xmlrpc.client import Error, ServerProxy, Transport

from sysid.errors import ModelError

ANSWER = 3.0
"""A master or a node that is there answers within this time [s], on a busy machine, too."""

ASKING = "/sysid"
"""Name under which the master is asked; nothing is registered under it."""

LOOPBACK = ("localhost", "127.0.0.1", "::1")


class _Bounded(Transport):
    """Calls that end after :data:`ANSWER`."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = ANSWER
        return connection


@dataclass(frozen=True)
class Master:
    """A ROS master by its address, such as ``http://localhost:11311``."""

    uri: str

    def check(self) -> None:
        """Ask whether it is there.

        Raises:
            ModelError: nobody answers, or somebody who is no master.
        """
        self._call("getPid")

    def publishers(self, topic: str) -> tuple[str, ...]:
        """Names of the nodes that publish a topic and answer; the dead stay registered."""
        published = self._call("getSystemState")[0]
        names: list[str] = next((nodes for name, nodes in published if name == topic), [])
        return tuple(node for node in names if self._lives(node))

    def type_of(self, topic: str) -> str | None:
        """Type of a topic, e.g. ``nav_msgs/Odometry``; None if unknown."""
        types = dict(self._call("getTopicTypes"))
        type_name = types.get(topic)
        return None if type_name in (None, "*") else str(type_name)

    def check_types(self, wanted: Iterable[tuple[str, str]]) -> None:
        """Refuse topics that are of another type.

        Args:
            wanted: pairs of topic and type.

        Raises:
            ModelError: one is.
        """
        for topic, kind in wanted:
            type_name = self.type_of(topic)
            if type_name not in (None, kind):
                raise ModelError(
                    f"topic {topic} is of type {type_name} and {kind} is needed: end the node that "
                    f"uses it otherwise ({', '.join(self.publishers(topic)) or 'a subscriber'}), "
                    "or choose another topic"
                )

    def _lives(self, node: str) -> bool:
        try:
            address = urlsplit(self._call("lookupNode", node))
            place = (address.hostname or "", address.port or 0)
            socket.create_connection(place, timeout=ANSWER).close()
        except (OSError, ModelError):
            return False
        return True

    def _call(self, name: str, *arguments: object) -> Any:
        try:
            with ServerProxy(self.uri, transport=_Bounded()) as server:
                code, said, value = cast(Any, getattr(server, name)(ASKING, *arguments))
        except (OSError, Error, HTTPException, ValueError, TypeError) as error:
            raise ModelError(
                f"no ROS master answers at {self.uri} ({error}): start roscore, or set "
                "ROS_MASTER_URI to where it runs"
            ) from None
        if code != 1:
            raise ModelError(f"the ROS master at {self.uri} refuses {name}: {said}")
        return value


def master_here() -> Master:
    """The master that ``ROS_MASTER_URI`` names, there and answering.

    Raises:
        ModelError: it is not.
    """
    master = Master(os.environ.get("ROS_MASTER_URI", "http://localhost:11311"))
    master.check()
    return master
