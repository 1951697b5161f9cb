"""Sets of effects in the course of a search: fitted, judged, named."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.search.evidence import Evidence
from sysid.fitting.holdout import Errors
from sysid.fitting.profile import NORMAL


@dataclass(frozen=True)
class Interval:
    """A 95 % interval of one number.

    Attributes:
        low, high: its ends; None where the log does not contradict that there is no limit.
        visited: whether the log depends on the number at all.
    """

    low: float | None
    high: float | None
    visited: bool = True

    def std_error(self, value: float) -> float | None:
        """The longer side in standard errors of a normal law; None where an end is open."""
        if self.low is None or self.high is None or not self.visited:
            return None
        return max(self.high - value, value - self.low) / NORMAL

    def holding(self, value: float) -> "Interval":
        """The same, stretched to hold a value that nothing contradicts: the best there is."""
        low = None if self.low is None else min(self.low, value)
        high = None if self.high is None else max(self.high, value)
        return Interval(low, high, self.visited)

    def widened(self, value: float, by: float) -> "Interval":
        """With another cause of error, independent of the log's.

        Args:
            value: the estimate.
            by: half of the 95 % interval that the other cause makes alone.
        """
        low = None if self.low is None else value - math.hypot(value - self.low, by)
        high = None if self.high is None else value + math.hypot(self.high - value, by)
        return Interval(low, high, self.visited)

    def times(self, factor: float) -> "Interval":
        """That of the number in another unit."""
        low, high = (None if v is None else factor * v for v in (self.low, self.high))
        return Interval(low, high, self.visited)


@dataclass(frozen=True, eq=False)
class Node:
    """A set of effects with its fitted super-model.

    Attributes:
        effects: ids in order of acceptance.
        q: all slots, (slots,).
        free: estimated slots.
        errors: free-run errors of both parts.
        touched: outputs that the newest effect changes.
        excluded: effects that could not be told from an accepted one, not looked for again.
    """

    effects: tuple[str, ...]
    q: Array
    free: tuple[int, ...]
    errors: Errors
    touched: NDArray[np.bool_]
    excluded: tuple[str, ...] = ()

    @property
    def held_rmse(self) -> float:
        """Held-out RMSE over all outputs."""
        return float(np.sqrt(np.nanmean(np.concatenate(self.errors.held) ** 2)))


@dataclass(frozen=True, eq=False)
class Named:
    """An accepted effect: its evidence and what cannot be told from it.

    Attributes:
        id: in the catalogue.
        evidence: against the model without it.
        ties: effects that cannot be told from it.
        touched: outputs on which it shows.
        rivals: the fitted models of it and of its ties, by id.
        rest: the model without it.
    """

    id: str
    evidence: Evidence
    ties: tuple[str, ...]
    touched: NDArray[np.bool_]
    rivals: Mapping[str, Node]
    rest: Node


@dataclass(frozen=True, eq=False)
class Naming:
    """Outcome of the search.

    Attributes:
        base: the model before.
        final: the model with all accepted effects.
        named: accepted effects in order.
        minor: effects that help a little but not enough to be proven, with their evidence.
        candidates: score of every effect at the first stage, best first: the likelihood ratio
            (in units of BIC) over both parts of the data.
        intervals: of numbers whose standard error no slope tells, by slot.
    """

    base: Node
    final: Node
    named: tuple[Named, ...]
    minor: tuple[tuple[str, Evidence], ...]
    candidates: tuple[tuple[str, float], ...]
    intervals: Mapping[int, Interval] = field(default_factory=dict)


def without_name(naming: Naming, id: str, base: Node) -> Naming:
    """An effect that belongs to the base, which is fitted with it, instead of being named."""

    def apart(node: Node) -> Node:
        return replace(node, effects=tuple(e for e in node.effects if e != id))

    named = tuple(
        replace(
            n,
            rest=apart(n.rest) if n.rest.effects else base,
            rivals={k: apart(r) for k, r in n.rivals.items()},
        )
        for n in naming.named
        if n.id != id
    )
    return replace(
        naming,
        base=base,
        final=apart(naming.final) if named else base,
        named=named,
        minor=tuple(m for m in naming.minor if m[0] != id),
        candidates=tuple(c for c in naming.candidates if c[0] != id),
    )


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate with its evidence and score."""

    node: Node
    evidence: Evidence
    score: float

    @property
    def id(self) -> str:
        """The newest effect."""
        return self.node.effects[-1]
