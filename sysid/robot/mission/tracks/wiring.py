"""Which inputs and outputs of a plant are the left and the right track."""

from collections.abc import Iterator
from dataclasses import dataclass

from sysid.data.column_words import left_and_right
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
    driven, read = (left_and_right([c.name for c in s]) for s in (plant.inputs, plant.outputs))
    if driven is not None and read is not None:
        yield Wiring(False, driven, read, named=True)
        return
    nu, ny = len(plant.inputs), len(plant.outputs)
    if min(nu, ny) >= 2:
        yield Wiring(False, (0, 1), (0, 1))
    for i in range(nu):
        for j in range(ny):
            yield Wiring(True, (i, i), (j, j))
