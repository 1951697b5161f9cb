"""Sensitivity before a fit: which parameters a log would show, with which error, and when.

With white noise of variance σ² on the outputs the information that a log holds of θ is
F = Σ (∂ŷ/∂θ)ᵀ(∂ŷ/∂θ)/σ², and no unbiased estimate has a smaller covariance than F⁻¹ (Cramér–Rao;
Ljung 1999, §7.4 and §13). Initial states are estimated with θ, so they take their part of it. Of a
parameter counts what the others cannot imitate: the residual r of its column of slopes, regressed
on all others; 1/‖r‖² is its variance, and r² says at which instants it comes in.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.estimation.information.subject import Subject
from sysid.fitting.profile import LEVEL
from sysid.fitting.uncertainty import half_and_null, with_infinite
from sysid.structures.grey_box.structure import GreyBox

DOUBTFUL = 0.5
"""Relative standard error beyond which a parameter is doubtful: its 95 % interval holds zero."""

MOST = 0.8
"""Share of a parameter's information that its interval of time holds."""

LINKED = 0.95
"""Correlation beyond which two estimates are named as a pair."""

ASIDE = 3.0
"""Standard errors to a side at which runs are tried: by slopes they differ by nine or
more there, and must by ``LEVEL``, the end of a 95 % interval."""

TAKES_PART = 0.05
"""Weight from which a parameter is named as one of a direction without information."""


@dataclass(frozen=True, eq=False)
class Information:
    """What runs say of parameters.

    Attributes:
        covariance: smallest covariance of the estimates, (n, n), infinite where there is no
            information; initial states marginalised.
        null: directions without information, (n, k).
        condition: of the slopes, columns scaled to unit norm.
        own: r, what only this parameter explains, in noise standard deviations, (M, n).
    """

    covariance: Array
    null: Array
    condition: float
    own: Array

    @property
    def errors(self) -> Array:
        """Standard errors, (n,)."""
        return np.sqrt(np.diag(self.covariance))


def information(slopes: Sequence[Array], n: int) -> Information:
    """What runs with these slopes say of n parameters.

    Args:
        slopes: of each run, (ny, N, n + its initial states), in noise standard deviations.
    """
    J = joined(slopes, n)
    size = np.linalg.norm(J, axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.svd(J / size, compute_uv=False)
    half, null = half_and_null(J)
    inverse = half @ half.T
    covariance = with_infinite(inverse, null)[:n, :n]
    variance = np.diag(inverse)[:n]
    own = J @ inverse[:, :n] / np.where(variance > 0.0, variance, 1.0)
    own[:, ~np.isfinite(np.diag(covariance))] = 0.0
    least = float(values.min(initial=np.inf))
    condition = float(values.max(initial=0.0)) / least if least > 0.0 else np.inf
    return Information(covariance, null[:n], condition, own)


def joined(slopes: Sequence[Array], n: int) -> Array:
    """Slopes of all runs as rows; every run has columns of its own for its initial state."""
    states = [D.shape[2] - n for D in slopes]
    rows = []
    for k, D in enumerate(slopes):
        flat = D.reshape(-1, D.shape[2])
        left, right = sum(states[:k]), sum(states[k + 1 :])
        before, after = (np.zeros((len(flat), w)) for w in (left, right))
        rows.append(np.hstack([flat[:, :n], before, flat[:, n:], after]))
    return np.concatenate(rows)


@dataclass(frozen=True)
class ShownParameter:
    """One parameter, and what the log would show of it.

    Attributes:
        std_error: smallest standard error; infinite where the log does not show it.
        when: interval of time [s] that holds ``MOST`` of its information; None where it has none.
        log: name of the log of that interval.
        partner: the parameter whose estimate is most correlated, where beyond ``LINKED``.
    """

    name: str
    unit: str
    value: float
    std_error: float
    when: tuple[float, float] | None
    log: str
    partner: str

    @property
    def relative(self) -> float:
        """Standard error over the value; infinite at zero."""
        return self.std_error / abs(self.value) if self.value else np.inf

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if not np.isfinite(self.std_error):
            return "not shown"
        return "doubtful" if self.relative > DOUBTFUL and self.value else "shown"


@dataclass(frozen=True, kw_only=True)
class Distinguished:
    """How well slopes tell unknowns, parameters and initial states, apart.

    Attributes:
        rank, count: of the slopes by all unknowns; directions without information are
            ``count − rank``.
        condition: of the slopes, columns scaled to unit norm.
        null: groups of parameters that take part in these directions, as {name: part}.
    """

    rank: int
    count: int
    condition: float
    null: tuple[Mapping[str, float], ...]

    @property
    def words(self) -> str:
        """Rank and condition as a sentence."""
        return (
            f"Rank {self.rank} of {self.count} unknowns (initial states included), condition "
            f"{self.condition:.3g}."
        )

    def to_json(self) -> dict[str, Any]:
        """As a document holds it."""
        return {
            "rank": self.rank,
            "unknowns": self.count,
            "condition": self.condition,
            "null_directions": list(self.null),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensitivity(Distinguished):
    """What logs would show of a plant's parameters."""

    parameters: tuple[ShownParameter, ...]

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Parameters that the log does not show well."""
        return tuple(p.name for p in self.parameters if p.verdict != "shown")

    def to_json(self) -> dict[str, Any]:
        shown = [{**vars(p), "relative": p.relative, "verdict": p.verdict} for p in self.parameters]
        return {"parameters": shown, **super().to_json()}


def hidden(names: Sequence[str], null: Array) -> tuple[dict[str, float], ...]:
    """Groups of parameters that only show together, as {name: part}, 1 where one never shows.

    Groups that have nothing to do with each other are distinguished, whatever basis ``null`` is in.
    """
    from scipy.sparse.csgraph import connected_components

    part = np.linalg.norm(null, axis=1)
    count, group = connected_components(np.abs(null @ null.T) > TAKES_PART**2, directed=False)
    every = (
        {
            name: float(p)
            for name, p, g in zip(names, part, group, strict=True)
            if g == k and p > TAKES_PART
        }
        for k in range(count)
    )
    return tuple(d for d in every if d)


def hidden_words(names: Collection[str]) -> str:
    """Which parameters a direction without information hides, as a sentence."""
    what = "only show together" if len(names) > 1 else "does not act"
    return f"{', '.join(names)} {what} on this log."


def sensitivity(subject: Subject, records: Sequence[Record]) -> Sensitivity:
    """Which parameters of a plant logs would show, with which error, at which time."""
    u, y = [np.asarray(r.u) for r in records], [np.asarray(r.y) for r in records]
    states = [subject.state(a, b) for a, b in zip(u, y, strict=True)]
    names, n = subject.names, len(subject.names)
    slopes = subject.slopes(u, states)
    found = information(slopes, n)
    errors = np.where(straight(subject, u, states, found), found.errors, np.inf)
    size = np.where(np.isfinite(errors) & (errors > 0.0), errors, np.inf)
    correlation = np.nan_to_num(found.covariance, posinf=0.0) / np.outer(size, size)
    ny = len(subject.outputs)
    edges = np.cumsum([0, *(len(r) * ny for r in records)]).tolist()
    power = [(found.own[a:b] ** 2).reshape(ny, -1, n).sum(axis=0) for a, b in pairwise(edges)]
    parameters = []
    for k, name in enumerate(names):
        at = int(np.argmax([p[:, k].sum() for p in power]))
        others = np.where(np.arange(n) == k, 0.0, np.abs(correlation[k]))
        other = int(np.argmax(others)) if n > 1 else k
        p = subject.parameters[subject.free[k]]
        parameters.append(
            ShownParameter(
                name,
                p.unit,
                float(subject.theta[subject.free[k]]),
                float(errors[k]),
                _when(power[at][:, k], records[at]),
                records[at].name,
                names[other] if others[other] > LINKED else "",
            )
        )
    count = n + sum(D.shape[2] - n for D in slopes)
    return Sensitivity(
        parameters=tuple(parameters),
        rank=count - found.null.shape[1],
        count=count,
        condition=found.condition,
        null=hidden(names, found.null),
    )


def straight(
    subject: Subject, u: Sequence[Array], states: Sequence[Array], found: Information
) -> NDArray[np.bool_]:
    """By parameter, whether runs change to both sides about as slopes say; beyond a kink, such as a
    limit that the run just touches, they do not: the parameter may be anything there."""
    good, errors = np.ones(len(subject.free), dtype=bool), found.errors
    if not isinstance(subject.structure, GreyBox):
        return good  # of linear ones runs have no kinks
    at = subject.runs(u, states)
    for k in np.flatnonzero(np.isfinite(errors) & (errors > 0.0)):
        for side in (-ASIDE, ASIDE):
            theta, i = subject.theta.copy(), int(subject.free[k])
            theta[i] += side * errors[k]
            if not subject.parameters[i].lower < theta[i] < subject.parameters[i].upper:
                continue
            with np.errstate(all="ignore"):
                moved = replace(subject, theta=theta).runs(u, states)
                pairs = zip(moved, at, strict=True)
                far = sum(float(np.sum(((y - x) / subject.noise) ** 2)) for y, x in pairs)
            good[k] &= not far < LEVEL
    return good


def _when(power: Array, record: Record) -> tuple[float, float] | None:
    """The shortest interval that holds ``MOST`` of the information."""
    total = float(power.sum())
    if total <= 0.0:
        return None
    come = np.concatenate([[0.0], np.cumsum(power)])
    ends = np.searchsorted(come, come + MOST * total * (1.0 - 1e-9))
    inside = ends < len(come)
    first = int(np.argmin(np.where(inside, ends - np.arange(len(come)), len(come))))
    t = record.t
    return float(t[first]), float(t[min(int(ends[first]), len(t)) - 1])
