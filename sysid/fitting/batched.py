"""Levenberg–Marquardt of many small fits at once: what costs time is their runs, and these go
side by side.

Each fit has its own normal equations A = SᵀS, g = Sᵀε (S the slopes of what is predicted, ε the
errors) and its own damping λ (Marquardt 1963): the step is (A + λ diag A)⁻¹ g, found in columns of
unit norm. Bounds are kept by projection: a number on its bound whose slope points outside rests
for that step. Nothing is remembered but λ, so that slopes which are infinite at the start of one
fit do not spoil what follows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Damping:
    """How the damping of a fit moves, and when it ends.

    Attributes:
        first: damping of the first step.
        fall, rise: its factors after a step that gained, and after one that did not.
        least: it is kept above, where normal equations round.
        most: a fit is over beyond: steps have become too short to matter.
        loose: a step that gains little ends a fit below this damping only; a stiff one may just be
            short.
        alike: whether all numbers are damped alike (Levenberg 1944), by the largest diagonal entry:
            numbers in sizes of their own, of which those that are hardly felt shall stay.
    """

    first: float = 1e-3
    fall: float = 0.1
    rise: float = 10.0
    least: float = 1e-12
    most: float = 1e8
    loose: float = np.inf
    alike: bool = False


class Trial(Protocol):
    """Some of the fits, run at some place."""

    @property
    def cost(self) -> Array:
        """Squared errors of each of them, output by output, (k, outputs); infinite or NaN where a
        run failed.
        """

    def normal(self, of: Index) -> tuple[Array, Array]:
        """A (k, n, n) and g (k, n) of k of them there; what is not finite counts as zero."""


Run = Callable[[Array, Index], Trial]
"""(θ of all fits (fits, n), fits that are run) → what they did."""


def descend_together(
    run: Run,
    start: Array,
    free: Mask,
    bounds: tuple[Array, Array],
    rule: Damping,
    rounds: int,
    gain: float,
) -> tuple[Array, Array]:
    """Minimise ‖ε‖² of every fit over its own free numbers.

    Args:
        run: runs some of the fits.
        start: θ of all fits, (fits, n).
        free: which of it moves; a fit without any rests where it starts.
        bounds: least and greatest θ, each (fits, n) or broadcast to it.
        gain: a fit is over when a step lowers its cost by less than this share.

    Returns:
        (θ, cost), (fits, n) and (fits, outputs).
    """
    theta = start.copy()
    lower, upper = (np.broadcast_to(b, theta.shape) for b in bounds)
    first = run(theta, np.arange(len(theta)))
    cost = first.cost
    going = np.asarray(free.any(axis=1))
    A, g = first.normal(np.arange(len(theta)))
    damping = np.full(len(theta), rule.first)
    for left in reversed(range(rounds)):
        at = np.flatnonzero(going)
        if not len(at):
            break
        outward = ((theta <= lower) & (g < 0.0)) | ((theta >= upper) & (g > 0.0))
        step = damped_steps(A[at], g[at], (free & ~outward)[at], damping[at], rule.alike)
        trial = theta.copy()
        trial[at] = np.clip(theta[at] + step, lower[at], upper[at])
        tried = run(trial, at)
        reached = tried.cost
        old, new = (_sums(c) for c in (cost[at], reached))
        better = new < old
        settled = better & (new > (1.0 - gain) * old) & (damping[at] < rule.loose)
        theta[at[better]] = trial[at[better]]
        cost[at[better]] = reached[better]
        damping[at] *= np.where(better, rule.fall, rule.rise)
        damping = np.maximum(damping, rule.least)
        going[at] = ~settled & (damping[at] < rule.most)
        moved = np.flatnonzero(better & going[at])
        if left and len(moved):  # slopes after the last step would serve none
            A[at[moved]], g[at[moved]] = tried.normal(moved)
    return theta, cost


@dataclass(frozen=True, eq=False)
class OneTrial:
    """A single fit, run at some place.

    Attributes:
        errors: ε, (N,).
        slopes: gives S, (N, n), when they are asked for.
    """

    errors: Array
    slopes: Callable[[], Array]

    @property
    def cost(self) -> Array:
        """‖ε‖², (1, 1)."""
        return np.array([[self.errors @ self.errors]])

    def normal(self, of: Index) -> tuple[Array, Array]:
        """A and g; a number whose slopes are not finite is left where it is."""
        S = self.slopes()
        S = np.where(np.all(np.isfinite(S), axis=0), S, 0.0)
        return (S.T @ S)[None], (S.T @ np.nan_to_num(self.errors))[None]


def descend_alone(run: Run, start: Array, rounds: int, gain: float) -> Array:
    """Minimise ‖ε‖² of one fit over all its numbers, (n,); see ``descend_together``."""
    everywhere = (np.array(-np.inf), np.array(np.inf))
    free = np.ones((1, len(start)), dtype=bool)
    with np.errstate(over="ignore", invalid="ignore"):
        solution, _ = descend_together(run, start[None], free, everywhere, Damping(), rounds, gain)
    return np.asarray(solution[0])


def damped_steps(A: Array, g: Array, free: Mask, damping: Array, alike: bool = False) -> Array:
    """(A + λ D)⁻¹ g of each fit over its free numbers, zero elsewhere, (fits, n).

    D is diag A, or its largest entry for every number where they are damped ``alike``.
    """
    diagonal = np.where(free, np.einsum("gkk->gk", A), 0.0)
    if alike:
        diagonal = np.broadcast_to(diagonal.max(axis=1, keepdims=True), diagonal.shape)
    norms = np.sqrt(np.where(free & (diagonal > 0.0), diagonal, 1.0))
    both = free[:, :, None] & free[:, None, :]
    scaled = np.where(both, A / (norms[:, :, None] * norms[:, None, :]), 0.0)
    scaled += np.einsum("gk,kl->gkl", np.where(free, damping[:, None], 1.0), np.eye(g.shape[1]))
    steps = np.linalg.solve(scaled, np.where(free, g / norms, 0.0)[:, :, None])[:, :, 0] / norms
    return np.asarray(np.where(free, steps, 0.0))


def _sums(cost: Array) -> Array:
    whole = cost.sum(axis=1)
    return np.where(np.isnan(whole), np.inf, whole)
