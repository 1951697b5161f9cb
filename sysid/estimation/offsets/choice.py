"""Choose the offsets of a log: zero, the rest at its start, or estimated with the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.operating_point import Origin
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.data.rest import Rest
from sysid.errors import UsageError
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.soundness import bounded_run
from sysid.fitting.holdout import hold_out, longest_of
from sysid.methods.held_out_error import free_run_error
from sysid.structures.linear import least_squares
from sysid.structures.linear.constant_input import with_ones
from sysid.structures.linear.families import ARX
from sysid.structures.linear.least_squares import promising, solved_at_once

POLICIES = ("auto", "none", "mean", "linear", "level")

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
"""Standard errors within which an offset agrees with the rest at the head."""

EXPLAINS = 0.5
"""Held-out error relative to the spread, from which a model says nothing of an offset that is seen:
without the dead time of a plant an ARX errs as much with the true offset as without."""

DRIVE = "a drive rests without command"

LONGEST = 12
"""Order of the regression in which an offset is looked for: enough to whiten what disturbs."""

PER_COEFFICIENT = 20
"""Samples behind each of its coefficients."""


def choose_offsets(data: Sequence[Record] | LogFacts, policy: str = "auto", nk: Any = 1) -> Offsets:
    """How the offsets of these records are dealt with.

    ``auto``: the zeros of a robot log that comes near them are physical. A robot log that does not,
    and a log that rests at zero at its head, or whose signals are all on both sides of zero, keeps
    its zero unless an offset is seen; then both are tried on held-out data. Otherwise an offset is
    estimated with each model, counted from the rest at the head where there is one.

    Args:
        data: estimation data, or what is known of them.
        policy: ``auto``; ``none``; ``mean`` or ``linear``, which are removed; ``level``, which is
            estimated whatever the log looks like.
        nk: input delay, a number or a matrix (outputs x inputs).
    """
    facts = LogFacts.of(data)
    start = start_of(facts, policy)
    if not any(start.estimated) or facts.records[0].nu == 0:
        return start
    rest = facts.rest
    evidence = _Evidence(facts.sample, nk)
    if policy == "auto":
        kept = _zero(evidence, rest, start)
        if kept is not None:
            return kept
    return _about(evidence, rest, start)


def start_of(facts: LogFacts, policy: str) -> Offsets:
    """Offsets before anything is known of the plant: an offset about the rest or the means."""
    known_policy(policy)
    records = facts.outliers.records
    first = records[0]
    ny = first.ny
    if policy == "none" or (policy == "auto" and first.is_robot_log and _shows_zero(records)):
        return Offsets.none(first.nu, ny)
    if policy == "mean" or not first.nu:  # nothing to count an offset from but the signal itself
        return Offsets(Detrend.means(records), Origin.MEANS)
    if policy == "linear":
        return Offsets(Detrend.linear(records), Origin.LINES)
    rest = facts.rest
    if rest is None:
        return Offsets(Detrend.means(records), Origin.ESTIMATED, (True,) * ny)
    return Offsets(
        Detrend(rest.u, rest.y), Origin.ESTIMATED, (True,) * ny, tuple(rest.y_error.tolist()),
        at_rest=True,
    )  # fmt: skip


def known_policy(policy: str) -> None:
    """Refuse a policy that does not exist."""
    if policy not in POLICIES:
        raise UsageError(f"no detrending {policy!r}; choose one of {', '.join(POLICIES)}")


def _zero(evidence: "_Evidence", rest: Rest | None, start: Offsets) -> Offsets | None:
    """Zero, where that is plausible and does as well as an estimated offset."""
    records = evidence.records
    nu, ny = records[0].nu, records[0].ny
    none = Offsets.none(nu, ny)
    at_rest = rest is not None and rest.at_zero
    if at_rest:
        words, seen = "the log rests there before the first command", SEEN_AT_REST
    elif _both_sides(records):
        words, seen = "the log has both signs", SEEN_BALANCED
    elif records[0].is_robot_log:
        words, seen = DRIVE, SEEN_BALANCED
    else:
        return None
    none = replace(none, unseen=not at_rest and words != DRIVE)
    regression = evidence.regression(none)
    if regression is None or np.all(np.abs(regression.constant) < seen * regression.constant_error):
        return replace(none, why=words)
    zero, free = evidence.held_out_error(none), evidence.held_out_error(start)
    if zero <= free and zero < EXPLAINS:
        return replace(
            none,
            why=f"{words}, and an offset does not lower the held-out error "
            f"({_share(free)} with one, {_share(zero)} without)",
        )
    return None


def _about(evidence: "_Evidence", rest: Rest | None, start: Offsets) -> Offsets:
    """An offset that is estimated, or that of the rest where only that one can be right."""
    regression = evidence.regression(start)
    if regression is None:
        return start if rest is None else replace(start, origin=Origin.REST, estimated=())
    if rest is None:
        return replace(start, detrend=regression.balanced(start.detrend))
    as_is = replace(start, origin=Origin.REST, estimated=())
    drift_unseen = np.abs(regression.constant) < SEEN_BALANCED * regression.constant_error
    if np.all(regression.integrates & drift_unseen):
        return as_is
    offset, error = regression.offset
    limit = AGREES * np.hypot(error, rest.y_error)
    if np.all(np.abs(offset) <= limit):
        return replace(start, why="the log rests there before the first command")
    fixed, free = evidence.held_out_error(as_is), evidence.held_out_error(start)
    if fixed <= free:
        return replace(
            as_is,
            why=f"an estimated offset contradicts it and does not lower the held-out error "
            f"({_share(free)} with one, {_share(fixed)} without)",
        )
    return start


def _both_sides(records: Sequence[Record]) -> bool:
    joined = np.concatenate([np.column_stack([r.u, r.y]) for r in records])
    low, high = np.quantile(joined, [STRADDLES, 1.0 - STRADDLES], axis=0)
    return bool(np.all((low < 0.0) & (high > 0.0)))


def _shows_zero(records: Sequence[Record]) -> bool:
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
        """By output, whether A(1) cannot be distinguished from zero."""
        return np.asarray(np.abs(np.diag(self.A)) < SEEN_BALANCED * self.own_error)

    @property
    def offset(self) -> tuple[Array, Array]:
        """A(1)⁻¹ c and its error, infinite where the output integrates."""
        diagonal = np.where(self.integrates, np.nan, np.diag(self.A))
        offset = np.nan_to_num(self.constant / diagonal)
        error = np.nan_to_num(self.constant_error / np.abs(diagonal), nan=np.inf)
        return offset, error

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
    """What ARX models of some records say about their offsets."""

    def __init__(self, records: Sequence[Record], nk: Any) -> None:
        self.records, self._nk = tuple(records), nk

    def regression(self, offsets: Offsets) -> _Regression | None:
        """A long ARX about these offsets, None where the data do not determine the constant."""
        first = self.records[0]
        nu, ny = first.nu, first.ny
        samples = sum(len(r) for r in self.records)
        n = int(np.clip(samples // (PER_COEFFICIENT * (ny + nu)), 1, LONGEST))
        na = [[n] * ny for _ in range(ny)] if n >= 2 else n
        plain = ARX.from_orders({"na": na, "nb": n, "nk": self._nk}, nu, ny)
        wide = plain.with_constant((True,) * ny)
        records = [
            with_ones(offsets.detrend.remove(r))
            for r in self.records
            if len(r) > wide.first_sample()
        ]
        equations = sum(len(r) - wide.first_sample() for r in records)
        if equations <= 2 * wide.layout(0).n:
            return None
        places, _ = wide.constant_places()
        along = np.zeros((sum(wide.layout(i).n for i in range(ny)), 2 * ny))
        along[places, range(ny)] = 1.0
        for i in range(ny):  # A(1) of each output's own
            along[wide.row_index(i)[wide.layout(i).slices()[0][i]], ny + i] = 1.0
        theta, covariance, _ = least_squares.solve(wide, records, along)
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
            structures = [s.with_constant(offsets.estimated) for s in structures]
            data = data.of(with_ones)
        errors = [
            free_run_error(a.structure, a.theta, data.whole, data.counted)
            for a in (promising(solved_at_once(structures, data)) if structures else ())
            if bounded_run(a.structure, a.theta)
        ]
        return min(errors, default=float("inf"))
