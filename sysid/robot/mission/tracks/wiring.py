"""Which inputs and outputs of a plant are the left and the right track."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.data.record import Channel
from sysid.robot.mission.contracts import SteppablePlant


@dataclass(frozen=True)
class Wiring:
    """Which input drives and which output is read for the left and for the right track.

    Attributes:
        twins: whether each track has its own copy of the plant.
        driven, read: index of the input and of the output of the left and of the right track.
        named: whether the names of the channels say so.
    """

    twins: bool
    driven: tuple[int, int]
    read: tuple[int, int]
    named: bool = False

    @property
    def tracks(self) -> tuple[int, ...]:
        """The tracks that differ: copies of one plant say everything once."""
        return (0,) if self.twins else (0, 1)


def wirings(plant: SteppablePlant) -> Iterator[Wiring]:
    """The ways to wire the plant, the most natural first."""
    driven, read = _sides(plant.inputs), _sides(plant.outputs)
    if min(*driven, *read) >= 0:
        yield Wiring(False, driven, read, named=True)
        return
    nu, ny = len(plant.inputs), len(plant.outputs)
    if min(nu, ny) >= 2:
        yield Wiring(False, (0, 1), (0, 1))
    for i in range(nu):
        for j in range(ny):
            yield Wiring(True, (i, i), (j, j))


def _sides(channels: Sequence[Channel]) -> tuple[int, int]:
    """Index of the one channel whose name says left and of the one that says right; -1: none."""

    def only(*sides: str) -> int:
        hits = [
            i
            for i, channel in enumerate(channels)
            if any(w.lower() in sides for w in re.findall(r"[A-Z]?[a-z]+|[A-Z]", channel.name))
        ]
        return hits[0] if len(hits) == 1 else -1

    return only("l", "left"), only("r", "right")
