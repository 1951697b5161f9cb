"""What a log's levels are: zero, the rest at its head, or to be estimated with the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.level import Origin
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.data.rest import Rest, rest_head
from sysid.errors import UsageError
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.soundness import bounded_run
from sysid.fitting.holdout import hold_out, longest_of, shortened
from sysid.structures.held_out_error import free_run_error
from sysid.structures.linear import closed_form
from sysid.structures.linear.arx import ARX
from sysid.structures.linear.arx_at_once import promising, solved_at_once
from sysid.structures.linear.constant_input import constant_places, with_constant, with_ones

POLICIES = ("auto", "none", "mean", "linear", "level")

SAMPLES = 12_000
"""Samples that choose: as many as an order search looks at."""

STRADDLES = 0.1
"""A signal is on both sides of zero when at least this share of its samples is on either."""

SEEN_BALANCED = 3.0
"""Standard errors from which an offset is seen in a log on both sides of zero: what is not seen
there biases no gain, because such inputs are nearly uncorrelated with a constant."""

NEAR_ZERO = 0.1
"""A log shows its zero where an input comes within this share of its largest size. One that does
not says nothing about zero: between them lie the friction and the dead zone of the drive."""

SEEN_AT_REST = 2.0
"""The same for a log of one side that rests at zero: an unseen offset biases the gain, and one
estimated without need costs next to nothing."""

AGREES = 3.0
"""Standard errors within which a level agrees with the rest at the head."""

LONGEST = 12
"""Order of the regression in which an offset is looked for: enough to whiten what disturbs."""

PER_COEFFICIENT = 20
"""Samples behind each of its coefficients."""


def choose_offsets(records: Sequence[Record], policy: str = "auto", nk: Any = 1) -> Offsets:
    """How the levels of these records are dealt with.

    ``auto``: the zeros of a robot log that comes near them are physical. A robot log that does not,
    and a log that rests at zero at its head, or whose signals are all on both sides of zero, keeps
    its zero unless an offset is seen; then both are tried on held-out data. Otherwise a level is
    estimated with each model, counted from the rest at the head where there is one.

    Args:
        records: estimation data.
        policy: ``auto``; ``none``; ``mean`` or ``linear``, which are removed; ``level``, which is
            estimated whatever the log looks like.
        nk: input delay, a number or a matrix (outputs x inputs).

    Raises:
        UsageError: the policy is unknown.
    """
    start = start_of(records, policy)
    if not any(start.estimated) or records[0].nu == 0:
        return start
    rest = rest_head(records[0]) if start.at_rest else None
    evidence = _Evidence(shortened(records, SAMPLES), nk)
    if policy == "auto":
        kept = _zero(evidence, rest, start)
        if kept is not None:
            return kept
    return _about(evidence, rest, start)


def start_of(records: Sequence[Record], policy: str) -> Offsets:
    """Offsets before anything is known of the plant: a level about the rest or the means.

    Raises:
        UsageError: the policy is unknown.
    """
    known_policy(policy)
    first = records[0]
    ny = first.ny
    if policy == "none" or (policy == "auto" and first.is_robot_log and _shows_zero(records)):
        return Offsets.none(first.nu, ny)
    if policy == "mean" or not first.nu:  # nothing to count a level from but the signal itself
        return Offsets(Detrend.means(records), Origin.MEANS)
    if policy == "linear":
        return Offsets(Detrend.linear(records), Origin.LINES)
    rest = rest_head(first)
    if rest is None:
        return Offsets(Detrend.means(records), Origin.ESTIMATED, (True,) * ny)
    return Offsets(
        Detrend(rest.u, rest.y), Origin.ESTIMATED, (True,) * ny, tuple(rest.y_error.tolist()),
        at_rest=True,
    )  # fmt: skip


def known_policy(policy: str) -> None:
    """Refuse a policy that does not exist.

    Raises:
        UsageError: it is unknown.
    """
    if policy not in POLICIES:
        raise UsageError(f"no detrending {policy!r}; choose one of {', '.join(POLICIES)}")


def _zero(evidence: "_Evidence", rest: Rest | None, start: Offsets) -> Offsets | None:
    """Zero, where that is plausible and does as well as an estimated level."""
    records = evidence.records
    nu, ny = records[0].nu, records[0].ny
    none = Offsets.none(nu, ny)
    at_rest = rest is not None and rest.at_zero
    if at_rest:
        words, seen = "the log rests there before the first command", SEEN_AT_REST
    elif _both_sides(records):
        words, seen = "the log is on both sides of it", SEEN_BALANCED
    elif records[0].is_robot_log:
        words, seen = "a drive without command stands still", SEEN_BALANCED
    else:
        return None
    found = evidence.regression(none)
    if found is None or np.all(np.abs(found.constant) < seen * found.constant_error):
        return replace(none, why=words)
    zero, level = evidence.held_out_error(none), evidence.held_out_error(start)
    if zero <= level:
        return replace(
            none,
            why=f"{words}, and held-out data are met no better with an offset "
            f"({_share(level)} of their spread missed, {_share(zero)} without)",
        )
    return None


def _about(evidence: "_Evidence", rest: Rest | None, start: Offsets) -> Offsets:
    """A level that is estimated, or that of the rest where only that one can be right."""
    found = evidence.regression(start)
    if found is None:
        return start if rest is None else replace(start, origin=Origin.REST, estimated=())
    if rest is None:
        return replace(start, detrend=found.balanced(start.detrend))
    as_is = replace(start, origin=Origin.REST, estimated=())
    drift_unseen = np.abs(found.constant) < SEEN_BALANCED * found.constant_error
    if np.all(found.integrates & drift_unseen):
        return as_is
    level, error = found.level
    limit = AGREES * np.hypot(error, rest.y_error)
    if np.all(np.abs(level) <= limit):
        return replace(start, why="the log rests there before the first command")
    fixed, free = evidence.held_out_error(as_is), evidence.held_out_error(start)
    if fixed <= free:
        return replace(
            as_is,
            why=f"a fitted level would contradict it and meets held-out data no better "
            f"({_share(free)} of their spread missed, {_share(fixed)} without)",
        )
    return start


def _both_sides(records: Sequence[Record]) -> bool:
    """Whether every channel spends a fair share of the samples on either side of zero."""
    joined = np.concatenate([np.column_stack([r.u, r.y]) for r in records])
    low, high = np.quantile(joined, [STRADDLES, 1.0 - STRADDLES], axis=0)
    return bool(np.all((low < 0.0) & (high > 0.0)))


def _shows_zero(records: Sequence[Record]) -> bool:
    """Whether every input comes near zero, or changes its side."""
    u = np.concatenate([r.u for r in records])
    near = np.min(np.abs(u), axis=0) <= NEAR_ZERO * np.max(np.abs(u), axis=0)
    return bool(np.all(near | ((u.min(axis=0) < 0.0) & (u.max(axis=0) > 0.0))))


def _share(error: float) -> str:
    return f"{100.0 * error:.3g} %"


@dataclass(frozen=True, eq=False)
class _Regression:
    """A long ARX with a constant, A y = B u + c + e.

    Attributes:
        A, B: A(1) (ny, ny) and B(1) (ny, nu).
        own_error: standard errors of A's diagonal, (ny,).
        constant, constant_error: c and its standard errors, (ny,).
    """

    A: Array
    B: Array
    own_error: Array
    constant: Array
    constant_error: Array

    @property
    def integrates(self) -> NDArray[np.bool_]:
        """By output, whether A(1) cannot be told from zero."""
        return np.asarray(np.abs(np.diag(self.A)) < SEEN_BALANCED * self.own_error)

    @property
    def level(self) -> tuple[Array, Array]:
        """A(1)⁻¹ c and its error, infinite where the output integrates."""
        own = np.where(self.integrates, np.nan, np.diag(self.A))
        level = np.nan_to_num(self.constant / own)
        error = np.nan_to_num(self.constant_error / np.abs(own), nan=np.inf)
        return level, error

    def balanced(self, detrend: Detrend) -> Detrend:
        """Offsets about which an integrating output does not drift.

        The mean input of such a log is no operating point: with it the output would run away.
        """
        rows = np.flatnonzero(self.integrates)
        if not len(rows):
            return detrend
        move = -np.linalg.pinv(self.B[rows]) @ self.constant[rows]
        return replace(detrend, u_offset=detrend.u_offset + move)


class _Evidence:
    """What ARX models of some records say about their levels."""

    def __init__(self, records: Sequence[Record], nk: Any) -> None:
        self.records, self._nk = tuple(records), nk

    def regression(self, offsets: Offsets) -> _Regression | None:
        """A long ARX about these offsets, None where the data cannot tell the constant."""
        first = self.records[0]
        nu, ny = first.nu, first.ny
        samples = sum(len(r) for r in self.records)
        n = int(np.clip(samples // (PER_COEFFICIENT * (ny + nu)), 1, LONGEST))
        na = [[n] * ny for _ in range(ny)] if n >= 2 else n
        plain = ARX.from_orders({"na": na, "nb": n, "nk": self._nk}, nu, ny)
        wide = with_constant(plain, (True,) * ny)
        records = [
            with_ones(offsets.detrend.remove(r))
            for r in self.records
            if len(r) > wide.first_sample()
        ]
        equations = sum(len(r) - wide.first_sample() for r in records)
        if equations <= 2 * wide.layout(0).n:
            return None
        places, _ = constant_places(wide)
        along = np.zeros((sum(wide.layout(i).n for i in range(ny)), 2 * ny))
        along[places, range(ny)] = 1.0
        for i in range(ny):  # A(1) of each output's own
            along[wide.row_index(i)[wide.layout(i).slices()[0][i]], ny + i] = 1.0
        theta, covariance, _ = closed_form.solve(wide, records, along)
        errors, own_error = np.split(np.sqrt(np.maximum(np.diag(covariance), 0.0)), 2)
        if not np.all(np.isfinite(errors)):
            return None
        p = wide.polynomials(theta)
        return _Regression(
            np.array([[float(x.sum()) for x in row] for row in p.A]),
            np.array([[float(x.sum()) for x in row[:-1]] for row in p.B]),
            own_error,
            theta[places],
            errors,
        )

    def held_out_error(self, offsets: Offsets) -> float:
        """Free-run error on held-out samples of the best ARX, relative to their spread."""
        plain = [offsets.detrend.remove(r) for r in self.records]
        data = hold_out(plain, longest_of(self._nk))
        first = self.records[0]
        grid = ARX.candidate_orders(first.nu, first.ny, data.samples, self._nk)
        structures = [ARX.from_orders(o, first.nu, first.ny) for o in grid]
        if any(offsets.estimated):
            structures = [with_constant(s, offsets.estimated) for s in structures]
            data = data.of(with_ones)
        errors = [
            free_run_error(a.structure, a.theta, data.whole, data.counted)
            for a in (promising(solved_at_once(structures, data)) if structures else ())
            if bounded_run(a.structure, a.theta)
        ]
        return min(errors, default=float("inf"))
