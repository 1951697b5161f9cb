"""Reasons against a model: an unbounded run, an unobservably slow mode, an unfinished search, bias.

A model can be ahead by its figures and still be of no use for what comes next. Four things show
it:

- its free run grows for ever, or nearly so: a pole outside the unit circle;
- it has a mode slower than the longest record is long: over that record the mode is a level or a
  drift that it stands for, and elsewhere it does something else;
- its parameter search ended before convergence;
- a controller was running, and it was fitted by free runs although its residuals are not white: the
  input follows from them, and the parameters do, too (Forssell & Ljung 1999, Automatica 35, 1215).

Such a model leads only where no settled one is as good.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from sysid.criteria.table import criterion
from sysid.data.record import Array
from sysid.errors import Termination
from sysid.fitting.uncertainty import Determined
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.motion import poles, time_constants

BIASED = "biased_by_feedback"
"""What the provenance of a model has that feedback biases, where that was asked."""

INTEGRATING = 1.0005
"""Poles up to this radius are an integrator's, seen through noise."""


@dataclass(frozen=True)
class Doubts:
    """What speaks against letting a model lead.

    Attributes:
        unbounded: whether its free run grows faster than an integrator's within a log.
        clauses: each as what the model does, e.g. "its search was given up".
    """

    unbounded: bool
    clauses: tuple[str, ...]

    @property
    def settled(self) -> bool:
        return not self.clauses

    @property
    def words(self) -> str:
        return " and ".join(self.clauses)


def doubts_about(model: Model) -> Doubts:
    """What speaks against a fitted model."""
    longest = max((s.samples for s in model.provenance.data), default=0)
    doubts = list(motion_doubts(model.structure, model.theta, longest, model.dt))
    if model.termination is Termination.MAX_ITERATIONS:
        doubts.append("its parameter search ended before convergence")
    if model.provenance.options.get(BIASED):
        doubts.append(
            "feedback biases it: a controller was running, its residuals are not white, and it was "
            "fitted without noise model"
        )
    return Doubts(not bounded_run(model.structure, model.theta), tuple(doubts))


def motion_doubts(s: Structure, theta: Array, longest: int, dt: float) -> tuple[str, ...]:
    """What speaks against the motion of a structure with these parameters.

    Args:
        longest: samples of the longest record it was fitted to.
        dt: sample time [s].
    """
    if not s.stable(theta):
        radius = largest_radius(s, theta)
        size = "" if not np.isfinite(radius) else f" (largest pole at radius {radius:.5f})"
        return (f"its free run does not settle{size}",)
    modes = time_constants(s, theta)
    # a structure that counts as stable although it integrates, such as a position, means to
    slowest = float(np.max(modes[np.isfinite(modes)], initial=0.0))
    if slowest <= longest or not longest:
        return ()
    return (
        f"its slowest mode takes {slowest * dt:.4g} s, longer than the log of {longest * dt:.4g} s",
    )


def undetermined(model: Model) -> Model:
    """The model without a statement on the errors of its free parameters: all directions are open.

    For a log whose input a controller alone moves. Parameters follow from it only where noise and
    delay are those of the structure exactly (Söderström & Stoica 1989, ch. 10), which no test of
    the same log confirms; their usual errors are then small and wrong.
    """
    free = np.array([p.fixed is None for p in model.parameters], dtype=np.float64)
    covariance = np.diag(np.where(free > 0.0, np.inf, 0.0))
    unknown = Determined(np.zeros((len(free), len(free))), np.diag(free))
    return replace(model, covariance=covariance, determined=unknown)


def bounded_run(s: Structure, theta: Array) -> bool:
    """Whether the free run is bounded, or grows no faster than an integrator's within a log."""
    if s.stable(theta):
        return True
    return largest_radius(s, theta) < INTEGRATING


def largest_radius(s: Structure, theta: Array) -> float:
    """Radius of the largest pole; infinite where the structure has none."""
    radii = np.abs(poles(s, theta))
    return float(np.max(radii)) if len(radii) else float("inf")


def relative_gap(name: str, value: float, best: float, samples: int, ny: int) -> float:
    """By which fraction RMS errors exceed the best ones, as a criterion sees them.

    Args:
        value, best: of the model and of the best one.
        samples: N behind them.
    """
    ratio = criterion(name).ratio(value, best, samples, ny)
    return ratio - 1.0 if np.isfinite(ratio) else float("inf")


def excess(name: str, cost: float, best: float, equations: tuple[int, int]) -> float:
    """By which fraction a cost, smaller is better, exceeds the best one as errors go.

    Args:
        equations: samples and outputs behind them.
    """
    ranks = criterion(name)
    if ranks.of_free_run:
        return cost / best - 1.0 if best else float(cost > 0.0)
    return relative_gap(name, ranks.cost(cost), ranks.cost(best), *equations)


Entry = TypeVar("Entry")


def leader(
    ranked: Sequence[Entry],
    able: Callable[[Entry], bool],
    ties: Callable[[Entry, Entry], bool],
    settled: Callable[[Entry], bool],
    rank: Callable[[Entry], Any] | None = None,
) -> Entry:
    """The one of a ranking to take.

    What is not able to lead does not while something else is. Of those left that tie with the first
    the ones that nothing speaks against come before others; among these the ranking decides.

    Args:
        ranked: best first.
        able: whether an entry may lead, such as one whose run is bounded.
        ties: whether an entry is as good as the best of those that may lead, but for chance.
        settled: whether nothing speaks against an entry.
        rank: what ranks those that tie, the smallest first; the ranking itself unless given.
    """
    pool = [e for e in ranked if able(e)] or list(ranked)
    tied = [e for e in pool if ties(e, pool[0])] or pool[:1]
    places = {id(e): k if rank is None else rank(e) for k, e in enumerate(tied)}
    return min(tied, key=lambda e: (not settled(e), places[id(e)]))
