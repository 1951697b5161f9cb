"""What a parameter search asks of the family whose parameters it looks for, and what it reports."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Index, Record
from sysid.fitting.problem import Focus, Initial, Problem

InitialGuesses = Sequence[tuple[str, Array]]
"""Starting values of θ, each with a name."""


@dataclass(frozen=True)
class StartReport:
    """One starting value of the search and what became of it.

    ``cost_at_start`` is None where the cost is not finite or nothing was searched, ``cost`` where
    the search was not run from this start.
    """

    output: str
    start: str
    cost_at_start: float | None
    cost: float | None
    evaluations: int


class Searchable(ABC):
    """The problems that determine θ, and where their search begins."""

    @abstractmethod
    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        """The independent least-squares problems that together determine θ.

        They are solved in order; a later one may need the θ found before (``Problem.given``).
        """

    def starts(self, records: Sequence[Record], focus: Focus) -> InitialGuesses:
        """Named starting values of θ."""
        return ()

    def stabilised(self, theta: Array) -> Array:
        """The nearest known θ whose free run is bounded; θ itself where none is known."""
        return theta

    def offset_entries(self) -> Index:
        """Entries of θ that are offsets: coefficients of a constant input."""
        return np.zeros(0, dtype=np.intp)

    def open_directions(self, records: Sequence[Record]) -> Array:
        """Directions of θ that such inputs leave open although slopes do not show it, (n, k)."""
        return np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class FreeRunSearch(Searchable):
    """The search of θ by the errors of its free run, all outputs together, whatever the focus.

    Attributes:
        errors: ((u, y) of each experiment, whether initial states are estimated) → the problem.
    """

    errors: Callable[[Sequence[tuple[Array, Array]], bool], Problem]

    def problems(
        self, records: Sequence[Record], focus: Focus, initial: Initial, stable: bool
    ) -> tuple[Problem, ...]:
        return (self.errors([(r.u, r.y) for r in records], initial is not Initial.ZERO),)
