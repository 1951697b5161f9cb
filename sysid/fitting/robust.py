"""Parts of robust fits: the scale of errors, Huber's width, and weighted residuals."""

from collections.abc import Sequence

import numpy as np

from sysid.data.noise import ROBUST
from sysid.data.record import HARDLY, Array, Record
from sysid.errors import DataError
from sysid.fitting.problem import Problem, Wrapped

HUBER_WIDTH = 1.345
"""Huber's threshold in standard deviations: 95 % efficiency on Gaussian errors (Huber 1981)."""

PAYS = 0.05
"""Share of the variance of estimates that Huber's loss must save: as much as it loses on Gaussian
errors, and a standard error (1/√N of N independent errors) more, so that chance hardly ever takes
these for errors of a heavier tail."""

NOTHING = 1e-9
"""Errors below this share of the largest are zero to rounding: a track at rest, exact data. They
say nothing about the size of the errors of the others."""

UNBOUNDED = 1e100
"""Huber's width of a residual whose loss is quadratic throughout."""

FEW = 0.1
"""Errors that are not zero are taken for outliers of exact data when there are no more than this
share of them: no sensor misreads every tenth sample."""


def robust_scale(errors: Array, least: float = 0.0) -> float:
    """Standard deviation of the bulk of the errors: 1.4826 median |ε| of those that are not zero.

    Args:
        errors: ε, any shape; NaN are left out.
        least: smallest scale to answer, such as what the resolution of a sensor gives.

    Returns:
        A positive number, however many errors are zero.
    """
    size = np.abs(errors[np.isfinite(errors)])
    largest = float(np.max(size, initial=0.0))
    moving = size[size > NOTHING * largest]
    floor = max(least, NOTHING * largest, 1e-300)
    if len(moving) <= FEW * len(size):
        return floor
    return max(ROBUST * float(np.median(moving)), floor)


def huber_widths(problem: Problem, errors: Array) -> Array:
    """Huber's threshold of every residual of a problem, (M,): outputs have scales of their own.

    Args:
        errors: residuals near the solution, (M,).
    """
    width = np.full(len(errors), UNBOUNDED)
    channel = _channels(problem)
    counts = problem.counts
    for i in np.unique(channel):
        where = np.flatnonzero(channel == i)
        seen = where if counts is None else where[counts[where]]
        width[where] = HUBER_WIDTH * robust_scale(errors[seen])
    return width


def huber_pays(errors: Array) -> bool:
    """Whether Huber's loss promises clearly smaller errors of the parameters than least squares.

    Both have a covariance in proportion to (JᵀJ)⁻¹: Huber's by E ψ²/(E ψ′)², least squares' by
    E ε² (Huber 1981, §7.6). The first is 5 % larger for Gaussian errors and nearly a third smaller
    for errors of Laplace's distribution.

    Args:
        errors: of the model, (N, ny); NaN do not count. Outputs are judged together.
    """
    gained, needed = 0.0, 0.0
    for column in errors.T:
        e = column[np.isfinite(column)]
        width = HUBER_WIDTH * robust_scale(e)
        inside = np.abs(e) <= width
        if inside.any() and np.any(e):
            bounded = np.mean(np.minimum(np.abs(e), width) ** 2) / np.mean(inside) ** 2
            gained += float(np.log(np.mean(e**2) / bounded))
            alike = min(float(e[1:] @ e[:-1]) / float(e @ e), 1.0) ** 2
            needed += PAYS + np.sqrt((1.0 + alike) / ((1.0 - alike) * len(e) + 1.0))
    return gained > needed


class Weighted(Wrapped):
    """A problem whose residuals are multiplied by √w; those of hardly any weight do not count.

    Args:
        weights: w of its residuals, (M,).
    """

    def __init__(self, problem: Problem, weights: Array) -> None:
        super().__init__(problem)
        self._weights, self._root = weights, np.sqrt(weights)
        self.counts = weights > HARDLY

    def residual(self, p: Array) -> Array:
        return self._root * self.problem.residual(p)

    def jacobian(self, p: Array) -> Array:
        return self._root[:, None] * self.problem.jacobian(p)

    def initial_columns(self, p: Array) -> Array:
        return self._root[:, None] * self.problem.initial_columns(p)

    def given(self, theta: Array) -> Problem:
        return Weighted(self.problem.given(theta), self._weights)


def weighted(problem: Problem, records: Sequence[Record], more: int = 0) -> Problem:
    """The problem with the weights its records carry; itself where they carry none.

    Args:
        more: residuals after those of the data, which count fully.
    """
    if all(r.weights is None for r in records):
        return problem
    channel = _channels(problem)
    weights = np.ones(len(channel) + more)
    for i in np.unique(channel):
        where = np.flatnonzero(channel == i)
        weights[where] = _from_first(records, int(i), len(where))
    return Weighted(problem, weights)


def _channels(problem: Problem) -> Array:
    """Output of each residual of the data, (M,)."""
    return np.repeat(np.array(problem.channels, dtype=np.float64), problem.lengths)


def _from_first(records: Sequence[Record], output: int, count: int) -> Array:
    """Weights of one output in the samples that ``count`` residuals belong to.

    A problem's residuals reach from one sample on, the same in each record, to the record's end.
    """
    lengths = np.array([len(r) for r in records])
    first = next(
        (k for k in range(int(lengths.max()) + 1) if np.maximum(lengths - k, 0).sum() <= count), 0
    )
    parts = [
        np.ones(max(len(r) - first, 0)) if r.weights is None else r.weights[first:, output]
        for r in records
    ]
    joined = np.concatenate(parts)
    if len(joined) != count:
        raise DataError(
            f"{records[0].name}: {count} errors do not belong to {lengths.sum()} samples in a "
            "known way, so that outliers cannot be left out"
        )
    return joined
