"""Trials of equations on held-out data."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

SEARCH_SAMPLES = 8_000
"""Samples that choose what an equation holds; its parameters come from all of them."""

RUN_SAMPLES = 40_000
"""Samples over which free runs are refined at last, at most."""

TIE = 0.01
"""Held-out errors closer than this are the same; the smaller equation wins. Two records of one
machine rank such equations in either order."""


class Judged(Protocol):
    """An equation: its free-run error on held-out data over the spread of the output, how many of
    its parameters count, where it came from, and the iterations spent on it."""

    @property
    def error(self) -> float: ...
    @property
    def size(self) -> int: ...
    @property
    def how(self) -> str: ...
    @property
    def evaluations(self) -> int: ...


Trial = TypeVar("Trial", bound=Judged)


def as_good_as(error: float, trials: Sequence[Trial], tie: float = TIE) -> list[Trial]:
    """The trials with errors that are not larger but for ``tie``, or all; the smallest first."""
    close = [t for t in trials if t.error <= (1.0 + tie) * error] or list(trials)
    return sorted(close, key=lambda t: (t.size, t.error))
