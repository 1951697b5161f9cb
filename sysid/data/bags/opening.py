"""Bags of ROS 1, folders of ROS 2 and MCAP files, opened for reading message by message."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sysid.data.files import open_regular
from sysid.errors import DataError, UsageError

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".mcap", ".db3")
"""Endings of the files of a recording; a folder that holds such files is a recording, too."""

DESCRIPTION = "metadata.yaml"
"""The file that describes a folder of ROS 2."""

REMEDIES = (
    ("not indexed", "repair it with `rosbag reindex`"),
    ("encrypt", "decrypt it first, with `rosbag decrypt`"),
    ("metadata", "write that file again with `ros2 bag reindex`"),
    ("Profile", "only MCAP files written by ROS 2 are read: convert it with `ros2 bag convert`"),
    ("ersion", "convert it with `rosbag fix` or `ros2 bag convert`"),
    ("ompression", "decompress it first, with `rosbag decompress` or `ros2 bag convert`"),
    ("end magic", "it was cut off when it was written; repair it with `mcap recover`"),
)
"""Phrase in the reader's error → what to do."""


class Message(NamedTuple):
    """One message of a bag: its topic, when it was recorded [ns], and its content."""

    topic: str
    received: int
    content: Any


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag.

    Attributes:
        where: what to call it in messages.
        types: topic → type of its messages, e.g. ``nav_msgs/msg/Odometry``.
        counts: topic → how many messages it holds.
        start: when the first message was recorded [ns].
    """

    where: str
    types: dict[str, str]
    counts: dict[str, int]
    start: int
    _reader: "AnyReader"

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """The messages of some topics in the order of their recording, one at a time."""
        for kind in {self.types[t] for t in topics if t in self.types} - self.defined:
            raise DataError(
                f"{self.where} does not say what a message of type {kind} holds; record it as "
                "MCAP, which keeps the definitions, or convert it with `ros2 bag convert` where "
                "that package is installed"
            )
        for topic, received, raw, kind in self._raw(topics):
            yield Message(topic, received, self._decoded(raw, kind))

    def some_messages(self, most: int, block: int, largest: int) -> Iterator[Message]:
        """Messages of all topics to look at: of long ones, blocks from all over the recording.

        Args:
            most: messages of a topic; of more, one block in so many that about these are left.
            block: messages in a row.
            largest: bytes; longer messages are left out, as are those of no known type.
        """
        seen = dict.fromkeys(self.types, 0)
        known = {t for t, kind in self.types.items() if kind in self.defined}
        for topic, received, raw, kind in self._raw(known):
            number, seen[topic] = seen[topic], seen[topic] + 1
            one_in = -(-self.counts[topic] // most)
            if len(raw) <= largest and number // block % one_in == 0:
                yield Message(topic, received, self._decoded(raw, kind))

    @property
    def defined(self) -> set[str]:
        """The types of messages of which it is known what they hold."""
        return set(self._reader.typestore.fielddefs)

    def _raw(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes, str]]:
        chosen = [c for c in self._reader.connections if c.topic in topics]
        try:
            for connection, received, raw in self._reader.messages(chosen) if chosen else ():
                yield connection.topic, received, raw, connection.msgtype
        except Exception as error:  # readers of every format have errors of their own
            raise DataError(_broken(self.where, error)) from None

    def _decoded(self, raw: bytes, kind: str) -> Any:
        try:
            return self._reader.deserialize(raw, kind)
        except Exception as error:  # as above
            raise DataError(_broken(self.where, error)) from None


def is_bag(path: Path) -> bool:
    """Whether a path is a recording of ROS: a file by its ending, or a folder of such files."""
    if path.is_dir():
        return (path / DESCRIPTION).exists() or bool(_files(path))
    return path.suffix.lower() in SUFFIXES


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """A bag, open while the context lasts."""
    if not path.exists():
        raise UsageError(f"{path}: file not found")
    try:
        from rosbags.highlevel import AnyReader
    except ImportError:
        raise UsageError(
            f"{path.name} is a bag, which the extra ros reads: pip install 'sysid-workbench[ros]'"
        ) from None
    whole = (path / DESCRIPTION).exists() or not path.is_dir()
    files = [path] if whole else _files(path)
    # those of ROS 1 and MCAP hold the definitions of their messages
    lacks_types = any(f.suffix.lower() not in (".bag", ".mcap") for f in files)
    try:
        for file in path.iterdir() if path.is_dir() else [path]:
            if not file.is_dir():
                open_regular(file).close()
        reader = AnyReader(files, default_typestore=_standard() if lacks_types else None)
        reader.open()
    except Exception as error:  # as in ``Bag.messages``
        raise DataError(_broken(path.name, error)) from None
    try:
        yield _checked(reader, path.name)
    finally:
        reader.close()


def _checked(reader: "AnyReader", where: str) -> Bag:
    infos = reader.topics
    counts = {name: info.msgcount for name, info in infos.items()}
    if not sum(counts.values()):
        raise DataError(f"{where} holds no messages; record it again")
    types = {c.topic: c.msgtype for c in reader.connections}
    known = reader.typestore.fielddefs
    if any(t not in known for t in types.values()):
        more = {n: d for n, d in _standard().fielddefs.items() if n not in known}
        reader.typestore.register(more)
    return Bag(where, types, counts, reader.start_time, reader)


def _standard() -> Any:
    """The message types that come with ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)


def _broken(where: str, error: Exception) -> str:
    reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    reason = reason if len(reason) <= 120 else reason[:117] + "…"
    remedy = next((advice for phrase, advice in REMEDIES if phrase in reason), "record it again")
    return f"{where} cannot be read as a bag ({reason}); {remedy}"
