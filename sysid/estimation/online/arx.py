"""ARX estimated recursively, with the results of the batch fit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.estimation.online.change import FALSE_ALARMS, Alarm, ChangeWatch
from sysid.estimation.online.factor import Factor
from sysid.estimation.online.rows_kept import RowsKept
from sysid.fitting import normal_equations as ne
from sysid.fitting.uncertainty import (
    AR_ORDER,
    half_of,
    portmanteau_white,
    sandwich,
    with_infinite,
)
from sysid.structures.linear.families import ARX

ROWS_A_COEFFICIENT = 4
"""Rows of a block for each coefficient: its own information is then of full rank."""

SHORTEST_BLOCK = 16
"""Rows of a block at least: fewer would cost more than they add."""

LOOKED_AT = 5_000
"""Newest rows on which whiteness and coloured noise are judged while a stream runs."""


@dataclass(frozen=True, eq=False)
class RecursiveEstimate:
    """What a stream has shown so far.

    Attributes:
        theta: as of the structure, (n,).
        covariance: (n, n); infinite where there is no information.
        null: directions without information, (n, n_null).
        noise_variance: mean squared one-step error of each output, (ny,).
        rows: rows taken in since the beginning, or the last change.
    """

    theta: Array
    covariance: Array
    null: Array
    noise_variance: Array
    rows: int


@dataclass(frozen=True, eq=False)
class Changed:
    """A change of the plant.

    Attributes:
        after: number of rows before it, counted from the first row of the stream.
        within: rows within which that number is known.
        seen: number of rows after which it was seen.
        output: number of the output that shows it.
        alarm: how sure and how large it is.
    """

    after: int
    within: int
    seen: int
    output: int
    alarm: Alarm
    before: RecursiveEstimate


class RecursiveARX:
    """A(q) y = B(q) u + e from a stream of rows (Ljung 1999, §11.2), in square-root form.

    With forgetting 1 and no change the estimate is that of the batch fit on the same rows. Rows are
    gathered in blocks, which change nothing about the estimate; a change of the plant is looked
    for at the end of each.

    Attributes:
        structure: orders; with the constant as its last input (``with_constant``) it has a level.
        forgetting: λ, 1 for none; its memory is 1/(1 − λ) rows.
        changes: the changes seen so far.
    """

    def __init__(
        self,
        structure: ARX,
        forgetting: float = 1.0,
        *,
        watch: bool = True,
        false_alarms: float = FALSE_ALARMS,
        looks: Sequence[int] = (),
        confirm: Callable[[int, int], bool] | None = None,
    ) -> None:
        """Args:
        structure: what to estimate.
        forgetting: in (0, 1].
        watch: whether to look for changes, and to begin anew after one.
        false_alarms: chance of ever seeing one where there is none.
        confirm: asked about every alarm, with the output and the rows since then; what is no
            change by it is none.
        looks: of the watches of an estimate that this one goes on for, see ``looks``.
        """
        if not 0.0 < forgetting <= 1.0:
            raise UsageError(f"`forgetting` must be above 0 and at most 1, got {forgetting:g}")
        if not 0.0 < false_alarms < 1.0:
            raise UsageError(f"`false_alarms` must lie between 0 and 1, got {false_alarms:g}")
        self.structure, self.forgetting = structure, forgetting
        self._layouts = [structure.layout(i) for i in range(structure.ny)]
        self._terms = [lay.terms for lay in self._layouts]
        self.block = max(SHORTEST_BLOCK, ROWS_A_COEFFICIENT * max(map(len, self._terms)))
        width = structure.ny + structure.nu
        self._kept = RowsKept()
        self.changes: tuple[Changed, ...] = ()
        self.total = 0
        self._pending: list[Array] = []
        self._waiting = 0
        self._factors = [Factor.empty(len(t)) for t in self._terms]
        self._confirm = confirm
        self._lags = max(lay.start for lay in self._layouts)
        self._history: Array = np.zeros((0, width))
        self._watches = [
            ChangeWatch(
                [k for k, (s, _) in enumerate(terms) if s >= structure.ny],
                false_alarms / structure.ny,
                looks[i] if looks else 0,
            )
            for i, terms in enumerate(self._terms if watch else ())
        ]

    @property
    def waiting(self) -> int:
        """Rows that wait for their block to be full; every estimate counts them in."""
        return self._waiting

    @property
    def since(self) -> int:
        return self._kept.since + self._waiting

    @property
    def looks(self) -> tuple[int, ...]:
        """How often each output was looked at for a change: what the false alarm rate counts."""
        return tuple(w.looks for w in self._watches)

    def update(self, u: ArrayLike, y: ArrayLike) -> tuple[Changed, ...]:
        """One row, or several.

        Args:
            u: inputs, (nu,) or (N, nu).
            y: outputs, (ny,) or (N, ny).

        Returns:
            The changes of the plant that these rows made certain.
        """
        rows = self.rows(u, y)
        before = len(self.changes)
        while len(rows):
            room = self.block - self._waiting
            self._pending.append(rows[:room])
            self._waiting += len(rows[:room])
            rows = rows[room:]
            if self._waiting == self.block:
                self._take()
        return self.changes[before:]

    def interrupt(self) -> None:
        """Rows are missing: those that follow have nothing to do with the past before."""
        self._take()
        self._kept.interrupt()
        self._history = self._history[:0]

    def estimate(self, whole: bool = False) -> RecursiveEstimate:
        """What the rows so far show.

        Args:
            whole: look at all kept rows for coloured noise, not only at the newest.
        """
        waiting = self._stacked()
        factors = self._grown(waiting) if len(waiting) else self._factors
        return self._estimate(factors, self.pieces(None if whole else LOOKED_AT), self.since)

    def factor(self, output: int) -> Factor:
        """What is known of one output's equation, rows that wait for their block included."""
        waiting = self._stacked()
        return (self._grown(waiting) if len(waiting) else self._factors)[output]

    def rows(self, u: ArrayLike, y: ArrayLike) -> Array:
        """Outputs, inputs and the constant of rows, (N, ny + nu)."""
        s = self.structure
        nu = s.nu - int(s.orders.constant)
        inputs = np.asarray(u, dtype=np.float64).reshape(-1, nu) if nu else None
        outputs = np.asarray(y, dtype=np.float64)
        outputs = outputs.reshape(-1, s.ny)
        n = len(outputs)
        if inputs is not None and len(inputs) != n:
            raise UsageError(f"{len(inputs)} rows of inputs but {n} of outputs")
        rows = np.ones((n, s.ny + s.nu))
        rows[:, : s.ny] = outputs
        if inputs is not None:
            rows[:, s.ny : s.ny + nu] = inputs
        if not np.isfinite(rows).all():
            raise UsageError(
                "a row holds a number that is not finite; leave it out and call interrupt"
            )
        return rows

    def _stacked(self) -> Array:
        return np.concatenate(self._pending) if self._pending else self._history[:0]

    def _equations(self, rows: Array) -> list[Array]:
        joined = np.concatenate([self._history, rows])
        return [
            regressors(joined, i, terms, max(lay.start, len(self._history)))
            for i, (lay, terms) in enumerate(zip(self._layouts, self._terms, strict=True))
        ]

    def _grown(self, rows: Array) -> list[Factor]:
        pairs = zip(self._factors, self._equations(rows), strict=True)
        return [f.taking(e, self.forgetting) for f, e in pairs]

    def _take(self) -> None:
        """The rows that wait, into the factors; then a look for changes."""
        rows = self._stacked()
        self._pending, self._waiting = [], 0
        if not len(rows):
            return
        equations = self._equations(rows)
        before = self._factors
        self._factors = [
            f.taking(e, self.forgetting) for f, e in zip(before, equations, strict=True)
        ]
        self._history = np.concatenate([self._history, rows])[-max(self._lags, 1) :]
        self._kept.add(rows)
        self.total += len(rows)
        for i, watch in enumerate(self._watches):
            if not len(equations[i]):
                continue
            alarm = watch.take(before[i], equations[i])
            if alarm is None:
                continue
            if self._confirm is not None and not self._confirm(i, alarm.blocks * self.block):
                watch.tolerate(alarm)
            else:
                self._begin_anew(i, alarm)
                return

    def _estimate(
        self, factors: Sequence[Factor], pieces: Sequence[Array], rows: int
    ) -> RecursiveEstimate:
        n = sum(f.n for f in factors)
        theta, covariance = np.zeros(n), np.zeros((n, n))
        null, variance = [], []
        for i, factor in enumerate(factors):
            index, sign = self.structure.row_index(i), self._layouts[i].signs
            solved = factor.solution()
            theta[index] = sign * solved.theta
            block = self._covariance(i, factor, solved, pieces)
            covariance[np.ix_(index, index)] = np.outer(sign, sign) * block
            for direction in solved.null.T:
                spread = np.zeros(n)
                spread[index] = sign * direction
                null.append(spread)
            variance.append(factor.loss / factor.weight if factor.weight else np.nan)
        directions = np.array(null).T if null else np.zeros((n, 0))
        return RecursiveEstimate(theta, covariance, directions, np.array(variance), rows)

    def _begin_anew(self, output: int, alarm: Alarm) -> None:
        """Keep only what came after a change, less the block in which it happened."""
        back = alarm.blocks - 1
        after = self.total - alarm.blocks * self.block
        earlier = [w.before(alarm.blocks) for w in self._watches]
        pieces = self._kept.pieces(self._history[:0], LOOKED_AT, alarm.blocks * self.block)
        before = self._estimate(earlier, pieces, self._kept.since - alarm.blocks * self.block)
        change = Changed(max(after, 0), self.block, self.total, output, alarm, before)
        self.changes = (*self.changes, change)
        self._kept.only_last(back * self.block)
        factors = []
        for watch, f in zip(self._watches, self._factors, strict=True):
            empty = Factor.empty(f.n)
            factors.append(empty.taking(watch.window(back), 1.0))
            watch.begin()
        rows = float(back * self.block)
        self._factors = [
            Factor(f.T, rows, rows, f.best, f.volume) if back else Factor.empty(f.n)
            for f in factors
        ]

    def pieces(self, most: int | None = None, but: int = 0) -> list[Array]:
        """Uninterrupted stretches of the rows kept, outputs before inputs, the oldest first.

        Args:
            most: newest rows wanted, None for all that are kept.
            but: newest rows that are passed over.
        """
        return self._kept.pieces(self._stacked(), most, but)

    def _covariance(
        self, i: int, factor: Factor, solved: ne.LeastSquares, pieces: Sequence[Array]
    ) -> Array:
        """σ²(RᵀR)⁻¹, or the sandwich form where the errors are not white, as in the batch fit."""
        lay, terms = self._layouts[i], self._terms[i]
        if not factor.weight:
            return with_infinite(np.zeros((factor.n, factor.n)), solved.null)
        worth = factor.squared / factor.weight
        known = factor.n - solved.null.shape[1]
        dof = max(factor.weight - known * worth, 1.0)
        variance = max(solved.loss / dof, factor.noise)
        covariance = variance * worth * solved.inverse
        equations = [regressors(p, i, terms, lay.start) for p in pieces if len(p) > lay.start]
        errors = [e[:, -1] - e[:, :-1] @ solved.theta for e in equations]
        samples = sum(map(len, errors))
        if not portmanteau_white(errors) and samples > 5 * AR_ORDER:
            phis = [e[:, :-1] for e in equations]
            covariance = sandwich(half_of(solved.inverse), phis, errors)
            covariance *= factor.weight / samples * factor.weight / dof * worth
        return with_infinite(covariance, solved.null)


def regressors(rows: Array, output: int, terms: Sequence[tuple[int, int]], first: int) -> Array:
    """[φᵀ y] of one output for the rows from ``first`` on, (N − first, n + 1).

    Args:
        rows: outputs, then inputs, (N, ny + nu).
        terms: (signal, lag) of the regressors.
        first: first row with a whole past.
    """
    n = len(rows)
    columns = np.empty((max(n - first, 0), len(terms) + 1))
    for c, (signal, lag) in enumerate(terms):
        columns[:, c] = rows[first - lag : n - lag, signal]
    columns[:, -1] = rows[first:, output]
    return columns
