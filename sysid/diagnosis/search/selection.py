"""Sets of effects in a search: candidate models, scored candidates, the selection."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.search.evidence import Evidence
from sysid.effects.catalogue import NOT_NAMED
from sysid.fitting.holdout import Errors
from sysid.fitting.profile import NORMAL


@dataclass(frozen=True)
class Interval:
    """A 95 % interval of one parameter.

    Attributes:
        low, high: its ends; None where the log does not contradict that there is no limit.
        visited: whether the log depends on the parameter at all.
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
            by: half of the 95 % interval that the other cause makes alone.
        """
        low = None if self.low is None else value - math.hypot(value - self.low, by)
        high = None if self.high is None else value + math.hypot(self.high - value, by)
        return Interval(low, high, self.visited)


@dataclass(frozen=True, eq=False)
class CandidateModel:
    """A set of effects with its fitted full model.

    Attributes:
        q: all parameters, (parameters,).
    """

    effects: tuple[str, ...]
    q: Array
    free: tuple[int, ...]
    errors: Errors
    touched: NDArray[np.bool_]

    @property
    def holdout_rmse(self) -> float:
        """Held-out RMSE over all outputs."""
        return float(np.sqrt(np.nanmean(np.concatenate(self.errors.holdout) ** 2)))


@dataclass(frozen=True, eq=False)
class SelectedEffect:
    """An accepted effect: its evidence and what cannot be distinguished from it.

    Attributes:
        rivals: the fitted models of it and of its ties, by id.
    """

    id: str
    evidence: Evidence
    ties: tuple[str, ...]
    touched: NDArray[np.bool_]
    rivals: Mapping[str, CandidateModel]
    rest: CandidateModel


@dataclass(frozen=True, eq=False)
class Selection:
    """Result of the search.

    Attributes:
        candidates: score of every effect at the first stage, best first: the likelihood ratio
            (in units of BIC) over both parts of the data.
        intervals: of parameters without a standard error from gradients, by index.
    """

    base: CandidateModel
    final: CandidateModel
    selected: tuple[SelectedEffect, ...]
    minor: tuple[tuple[str, Evidence], ...]
    candidates: tuple[tuple[str, float], ...]
    intervals: Mapping[int, Interval] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[SelectedEffect, ...]:
        """The selected effects, without what only differs between logs."""
        return tuple(n for n in self.selected if n.id not in NOT_NAMED)


def moved_to_base(selection: Selection, id: str, base: CandidateModel) -> Selection:
    """An effect that belongs to the base, which is fitted with it, instead of being named."""

    def apart(candidate: CandidateModel) -> CandidateModel:
        return replace(candidate, effects=tuple(e for e in candidate.effects if e != id))

    selected = tuple(
        replace(
            n,
            rest=apart(n.rest) if n.rest.effects else base,
            rivals={k: apart(r) for k, r in n.rivals.items()},
        )
        for n in selection.selected
        if n.id != id
    )
    return replace(
        selection,
        base=base,
        final=apart(selection.final) if selected else base,
        selected=selected,
        minor=tuple(m for m in selection.minor if m[0] != id),
        candidates=tuple(c for c in selection.candidates if c[0] != id),
    )


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate with its evidence and score."""

    model: CandidateModel
    evidence: Evidence
    score: float

    @property
    def id(self) -> str:
        """The newest effect."""
        return self.model.effects[-1]
