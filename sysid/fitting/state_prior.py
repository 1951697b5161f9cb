"""Prior on initial states that the data hardly determine, within what the outputs allow.

Each path from an input to an output has states of its own. At a record's head their free
responses are short and alike, and poles that lie close make them the same: a descent then walks
for hundreds of steps along a valley in which states of opposite sign grow beyond all measure and
the cost falls in its fifth digit. What holds them is what everybody knows: what a state does to
the output is no larger than the output itself. As a prior, x_k D_k ~ N(0, ‖y‖²) with D_k the norm
of the state's free response, next to errors of the variance σ² it adds the rows

    (σ/‖y‖) D_k x_k

to the residuals (ridge regression, Hoerl & Kennard 1970). States that the data do show are moved by
less than (σ/‖y‖)² of their value. Only descents that break the limit meet the prior at all.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.fitting.marquardt import loss
from sysid.fitting.problem import Problem, Wrapped
from sysid.fitting.solvers import Solution

ROUNDS = 4
"""Descents at most while the errors, from which the prior's weight comes, still fall."""

FALLEN = 0.5
"""Share of the assumed size of errors below which the weight is taken anew."""


class RunawayStatesError(Exception):
    """A state's free response has become larger than the measured output."""


class WatchedStates(Wrapped):
    """A problem that stops a descent whose states run away.

    Args:
        size: ‖y‖ of its outputs, the largest free response that a state may have.
    """

    def __init__(self, problem: Problem, size: float) -> None:
        super().__init__(problem)
        self.size = size

    def jacobian(self, p: Array) -> Array:
        """That of the problem.

        Raises:
            RunawayStatesError: the states at p are larger than the outputs allow.
        """
        J = self.problem.jacobian(p)
        n = len(self.index)
        response = np.linalg.norm(J[:, n:], axis=0) * np.abs(p[n:])
        if np.max(response, initial=0.0) > self.size:
            raise RunawayStatesError
        return J


class PriorStates(Wrapped):
    """A problem with one more residual a state: ``weight`` · x.

    Args:
        weight: of each state, (n_initial,).
    """

    def __init__(self, problem: Problem, weight: Array) -> None:
        super().__init__(problem)
        if problem.counts is not None:
            self.counts = np.append(problem.counts, np.ones(problem.n_initial, dtype=bool))
        self.weight = weight

    def residual(self, p: Array) -> Array:
        return np.concatenate([self.problem.residual(p), self.weight * p[len(self.index) :]])

    def jacobian(self, p: Array) -> Array:
        n = len(self.index)
        rows = np.hstack([np.zeros((self.n_initial, n)), np.diag(self.weight)])
        return np.vstack([self.problem.jacobian(p), rows])


def descend_with_prior(
    problem: Problem,
    start: Array,
    size: float,
    descend: Callable[[Problem, Array], Solution],
    huber: Array | None = None,
) -> Solution:
    """The descent under the prior.

    Args:
        problem: errors linear in the initial states, the last entries of p.
        size: ‖y‖ of the problem's outputs.
        descend: minimises any problem from any start.
        huber: threshold of the Huber loss for each residual, None for the quadratic one.

    Returns:
        Where it ended; residuals, Jacobian, weights and cost are those of the problem alone.
    """
    n, point = len(problem.index), start
    columns = problem.initial_columns(start)
    response = np.linalg.norm(columns, axis=0)
    at_rest = problem.residual(np.concatenate([start[:n], np.zeros(problem.n_initial)]))
    rows = len(at_rest)
    spread = float(np.linalg.norm(at_rest)) / np.sqrt(rows)
    for _ in range(2):  # the states that suit the start best, then again with the errors they leave
        weight = spread / size * response
        stacked = np.vstack([columns, np.diag(weight)])
        x = np.linalg.lstsq(stacked, -np.append(at_rest, np.zeros(len(weight))), rcond=None)[0]
        spread = float(np.linalg.norm(at_rest + columns @ x)) / np.sqrt(rows)
    point = np.concatenate([start[:n], x])
    for _ in range(ROUNDS):
        solution = descend(PriorStates(problem, spread / size * response), point)
        remaining = float(np.linalg.norm(solution.residual[:rows])) / np.sqrt(rows)
        if not remaining < FALLEN * spread:
            break
        point, spread = solution.p, remaining
    r = solution.residual[:rows]
    return replace(
        solution,
        cost=loss(r, huber),
        residual=r,
        jacobian=solution.jacobian[:rows],
        weights=solution.weights[:rows],
    )
