"""Programmes of commands that show one kind of effect each, as shares of the largest command.

A programme is a list of rows (time [s], left share, right share); each holds until the next. All
begin with a second of rest, end at rest, and last at most two minutes; where a machine is slower
than a robot all times are stretched. An effect names those that show it (``Hints.programmes``); one
of another package may bring a programme of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

Row = tuple[float, float, float]
Block = tuple[float, float, float]
"""(seconds, left share, right share)."""

LONGEST = 120.0
"""Longest programme [s]."""


@dataclass(frozen=True)
class Programme:
    """Commands that show an effect.

    Attributes:
        words: what it does, as an order to a robot with two sides.
        blocks: what is driven, one block after the other.
        plain: the same words for a log that is no robot's; ``words`` where empty.
    """

    words: str
    blocks: Callable[[], Sequence[Block]]
    plain: str = ""

    @property
    def rows(self) -> tuple[Row, ...]:
        """The blocks on a clock, what would last longer than ``LONGEST`` left out."""
        return _rows(self.blocks())


def _rows(blocks: Sequence[Block]) -> tuple[Row, ...]:
    """Blocks one after the other, a second of rest before and a rest at the end."""
    t, rows = 1.0, [(0.0, 0.0, 0.0)]
    for seconds, left, right in blocks:
        if t + seconds > LONGEST - 1.0:
            break
        rows.append((round(t, 6), left, right))
        t += seconds
    return (*rows, (round(t, 6), 0.0, 0.0), (round(t + 1.0, 6), 0.0, 0.0))


def _staircase() -> list[Block]:
    """±40 % in steps of 4 %, one track two steps ahead of the other."""
    up = [0.04 * k for k in range(11)]
    path = [*up, *up[-2::-1], *(-v for v in up[1:]), *(-v for v in up[-2::-1])]
    other = [*path[2:], 0.0, 0.0]
    return [(2.0, round(a, 4), round(b, 4)) for a, b in zip(path, other, strict=True)]


def _levels() -> list[Block]:
    """Eight sizes in both directions in mixed order, the right track through another order."""
    left = (0.5, -0.25, 1.0, -0.75, 0.12, -1.0, 0.75, -0.5, 0.25, -0.12, 0.9, -0.35)
    right = (-0.75, 0.5, -0.12, 1.0, -0.5, 0.25, -1.0, 0.12, 0.75, -0.25, -0.9, 0.6)
    blocks: list[Block] = []
    for k, (a, b) in enumerate(zip(left, right, strict=True)):
        blocks += [(2.5, a, b)] + ([(1.5, 0.0, 0.0)] if k % 3 == 2 else [])
    return blocks * 2


def _one_and_other() -> list[Block]:
    blocks: list[Block] = []
    steps = (0.0, 1.0, 0.0, -1.0, 0.5, -0.5, 0.0)
    for hold in (0.6, -0.6, 0.0):
        blocks += [(2.5, hold, s) for s in steps]
        blocks += [(2.5, s, hold) for s in steps]
    return blocks


_TEST = [(2.0, 0.8, 0.8), (1.5, 0.0, 0.0), (2.0, -0.8, -0.8), (1.5, 0.0, 0.0), (2.0, 0.4, 0.4)]


def _reversals() -> list[Block]:
    """Irregular holds of 0.3 to 1.1 s, both tracks reversing at different instants."""
    holds = (0.3, 0.7, 0.4, 1.1, 0.5, 0.9, 0.35, 0.6)
    blocks: list[Block] = []
    for size in (1.0, 0.5, 0.25, 0.75):
        sign = 1.0
        for k, hold in enumerate(holds * 2):
            sign = -sign
            other = size if k % 4 < 2 else -size
            blocks.append((hold, sign * size, other))
    return blocks


def _ramps() -> list[Block]:
    """Triangles of ±35 % in steps of 1 % every 0.3 s, the right track backward."""
    up = [0.01 * k for k in range(1, 36)]
    path = [*up, *up[-2::-1], 0.0, 0.0, *(-v for v in up), *(-v for v in up[-2::-1]), 0.0, 0.0]
    return [(0.3, round(v, 4), round(-v, 4)) for v in path * 2]


def _coasting() -> list[Block]:
    blocks: list[Block] = []
    for size in (1.0, 0.7, 0.4, 0.2):
        for sign in (1.0, -1.0):
            v = sign * size
            blocks += [(2.0, v, v), (2.0, 0.0, 0.0), (2.0, v, -v), (2.0, 0.4 * v, -0.4 * v)]
            blocks += [(2.0, 0.0, 0.0)]
    return blocks


def _top() -> list[Block]:
    blocks: list[Block] = []
    for size in (0.6, 0.8, 0.9, 1.0):
        blocks += [(2.5, size, -size), (2.0, 0.0, 0.0), (2.5, -size, size), (2.0, 0.0, 0.0)]
        blocks += [(1.0, size, 0.5 * size), (1.0, -size, -0.5 * size), (1.5, 0.2, -0.2)]
    return blocks


STAIRCASE = Programme(
    "climb a slow staircase through zero in both directions, both sides in turn.",
    _staircase,
    "climb a slow staircase through the whole range of the input and down again.",
)
LEVELS = Programme(
    "step to many levels in both directions, with rests between.",
    _levels,
    "step to many levels over the whole range of the input, with rests between.",
)
ONE_AND_OTHER = Programme(
    "hold one side at a constant command while the other steps, then swap.",
    _one_and_other,
    "hold one input constant while the other steps, then swap.",
)
REPEAT = Programme(
    "run the same short sequence at the start and the end of a long run.",
    lambda: [*_TEST, *[(4.0, 0.5, 0.5), (4.0, -0.5, -0.5)] * 11, *_TEST],
)
HOT = Programme(
    "drive hard for long between two equal tests, then rest and test again.",
    lambda: [*_TEST, *[(5.0, 1.0, 1.0), (5.0, -1.0, -1.0)] * 4, *_TEST, (40.0, 0.0, 0.0), *_TEST],
)
REVERSALS = Programme(
    "reverse often, at several speeds and at irregular instants.",
    _reversals,
    "step up and down often, by several heights and at irregular instants.",
)
RAMPS = Programme(
    "ramp up slowly from rest and down to rest again, in both directions.",
    _ramps,
    "ramp up slowly from zero and down to zero again.",
)
COASTING = Programme(
    "let go from several speeds, and step down to lower ones for comparison.",
    _coasting,
    "switch off from several levels, and step down to lower ones for comparison.",
)
CRUISE = Programme(
    "hold several constant speeds for a long time.",
    lambda: [(14.0, v, v) for v in (0.3, 0.5, 0.7, 0.9, -0.4, -0.6, -0.8)],
    "hold several constant levels for a long time.",
)
TOP = Programme(
    "step to the highest commands, in small and in large steps.",
    _top,
    "step to the largest inputs, in small and in large steps.",
)
TURNS = Programme(
    "drive straight, turn at several radii and on the spot, in both directions.",
    lambda: [
        block
        for a, b in ((0.6, 0.6), (0.6, 0.3), (0.3, 0.6), (0.6, 0.0), (0.0, 0.6), (0.5, -0.5))
        for block in ((4.0, a, b), (1.5, 0.0, 0.0), (4.0, -a, -b), (1.5, 0.0, 0.0))
    ],
)
RESTS = Programme(
    "rest for long between equal steps in both directions.",
    lambda: [
        *(
            block
            for v in (0.7, 0.3)
            for block in ((10.0, 0.0, 0.0), (3.0, v, -v), (10.0, 0.0, 0.0), (3.0, -v, v))
        ),
        (10.0, 0.0, 0.0),
    ],
)
