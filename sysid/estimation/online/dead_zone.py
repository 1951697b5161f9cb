"""Dead zone of a drive, estimated from the newest rows of a stream.

A dead zone shows in two ways, which agree while a drive turns the way it is commanded and differ
when it coasts or is braked:

    in the command   A y = B dz(u) + e,            dz(u) = sign(u) max(|u| − δ, 0)
    as friction      A y = B u − C sign(y(t−1)) + e,   δ = C(1)/B(1), while the output moves

(the first an H-bridge's dead time or threshold, the second Coulomb friction, whose δ is the command
that it eats). They are fitted to the rows in which the output moves, each alone and both together,
where δ is their sum; the one with the smallest errors is taken, both together only where that pays.
The first is linear but for δ: the best of a grid, then Gauss-Newton; the second is linear. Errors
are of the sandwich form where the residuals are coloured, that of C(1)/B(1) by the delta method.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.estimation.online.arx import regressors
from sysid.fitting import normal_equations as ne
from sysid.fitting.uncertainty import AR_ORDER, half_of, portmanteau_white, sandwich

LAWS = ("command", "friction", "both")
"""What makes a dead zone, the plainer ones first."""

GRID = 24
"""Places on the way from 0 to FARTHEST at which a search may begin."""

FARTHEST = 0.75
"""Largest dead zone as a share of the largest command: beyond it nothing is left to fit."""

GRID_ROWS = 4_000
"""Equations, evenly chosen, on which the places are compared."""

STEPS = 8
"""Steps of Gauss-Newton: from the grid, two or three are enough."""

SETTLED = 1e-9
"""Step of δ, as a share of the largest command, at which it has converged."""

STILL = 0.02
"""Share of the largest output below which it stands. No equation of motion holds there, nor in a
sample in which it starts, stops or turns round."""

MIN_ROWS = 8
"""Moving rows for each coefficient at least."""

SEEN = 3.0
"""Standard errors that a dead zone must be away from zero to be seen."""

COLOURED = 4.0
"""What noise with a memory may multiply a test of two parts by."""

BY_CHANCE = 1e-4
"""Chance below which two parts differ although the dead zone is the same."""

NARROWER = 16.0
"""By how much −2 ln L must fall: 1 in 10⁴ without a dead zone, as there are two laws to choose."""


@dataclass(frozen=True, eq=False)
class DeadZone:
    """The dead zone of one input as one output shows it.

    Attributes:
        law: one of ``LAWS``, see the module.
        value, std_error: δ, in the input's unit.
        seen: whether it is there at all.
        theta: coefficients of the regressors with it, (n,).
        covariance: of these, (n, n).
        edge: the part of δ that lies in the command; the rest is friction.
    """

    law: str
    value: float
    std_error: float
    seen: bool
    theta: Array = field(metadata={"exclude": True})
    covariance: Array = field(metadata={"exclude": True})
    edge: float = field(metadata={"exclude": True})


@dataclass(frozen=True, eq=False)
class _Rows:
    """Stretches of a stream as one equation sees them.

    Attributes:
        pieces: uninterrupted rows, outputs before inputs.
        signal: number of the input among the signals.
        terms: (signal, lag) of the regressors.
        start: first row of a piece with a whole past, also of the signs.
        still: output below which it stands.
    """

    pieces: Sequence[Array]
    output: int
    signal: int
    terms: Sequence[tuple[int, int]]
    start: int
    still: float

    @classmethod
    def of(
        cls,
        pieces: Sequence[Array],
        output: int,
        signal: int,
        terms: Sequence[tuple[int, int]],
        still: float,
    ) -> "_Rows":
        """Those of the pieces that are long enough."""
        start = max([1, *(lag for _, lag in terms), sum(s == signal for s, _ in terms)])
        return cls([p for p in pieces if len(p) > start], output, signal, terms, start, still)

    def equations(
        self, delta: float, friction: bool, theta: Array | None = None
    ) -> list[tuple[Array, Array, NDArray[np.bool_]]]:
        """Φ, y (N,) and which rows move (N,), for each piece.

        Args:
            friction: whether −sign(y(t−k)), k = 1 …, as many as the input has coefficients, stand
                behind the other columns of Φ.
            theta: where ∂(Φθ)/∂δ, which stands last, is that of this θ.
        """
        equations, output = [], self.output
        for p in self.pieces:
            u, y = p[:, self.signal], p[self.start :, output]
            beyond = np.maximum(np.abs(u) - delta, 0.0)
            columns = [self._columns(p, np.sign(u) * beyond)]
            if friction:
                lags = [(output, k) for k in range(1, int(self.own.sum()) + 1)]
                columns.append(regressors(-np.sign(p), output, lags, self.start)[:, :-1])
            if theta is not None:
                slopes = self._columns(np.zeros_like(p), -np.sign(u) * (beyond > 0.0))
                columns.append(slopes @ theta[: len(self.terms), None])
            past = p[self.start - 1 : -1, output]
            moving = (np.minimum(np.abs(y), np.abs(past)) > self.still) & (y * past > 0.0)
            equations.append((np.column_stack(columns), y, moving))
        return equations

    def _columns(self, rows: Array, u: Array) -> Array:
        """Φ with another input."""
        other = rows.copy()
        other[:, self.signal] = u
        return regressors(other, self.output, self.terms, self.start)[:, :-1]

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which regressors are lags of the input, (n,)."""
        return np.array([signal == self.signal for signal, _ in self.terms])


@dataclass(frozen=True, eq=False)
class _Solved:
    theta: Array
    covariance: Array
    loss: float
    rows: int


def dead_zone(
    pieces: Sequence[Array], output: int, signal: int, terms: Sequence[tuple[int, int]]
) -> DeadZone | None:
    """The dead zone of an input.

    Args:
        pieces: uninterrupted stretches, outputs before inputs, (N, ny + nu) each.
        terms: (signal, lag) of the regressors of that output; lags of the output among them.

    Returns:
        What was found; None where too few rows move, or none of the input's lags is a regressor.
    """
    largest = max((float(np.max(np.abs(p[:, output]))) for p in pieces), default=0.0)
    command = max((float(np.max(np.abs(p[:, signal]))) for p in pieces), default=0.0)
    rows = _Rows.of(pieces, output, signal, terms, STILL * largest)
    if not rows.pieces or not rows.own.any():
        return None
    plain = _solve(rows, 0.0, False)
    if plain is None or command == 0.0 or largest == 0.0 or not plain.loss > 0.0:
        return None
    best: tuple[DeadZone, float] | None = None
    for law in LAWS:
        fitted = _law(rows, law, command)
        if fitted is None or not fitted[1] > 0.0:
            continue
        price = NARROWER if law == LAWS[-1] else 0.0  # numbers more
        if best is None or plain.rows * np.log(best[1] / fitted[1]) > price:
            best = fitted
    if best is None:
        return None
    zone, loss = best
    gain = plain.rows * np.log(plain.loss / loss)
    return replace(zone, seen=bool(zone.value > SEEN * zone.std_error and gain > NARROWER))


def changed_beyond(
    zone: DeadZone,
    parts: tuple[Sequence[Array], Sequence[Array]],
    where: tuple[int, int],
    terms: Sequence[tuple[int, int]],
) -> bool:
    """Whether what came after differs from what came before by more than one dead zone explains.

    A dead zone alone makes a linear equation differ between small and large commands, which is no
    change of the plant. With it both parts should agree (Chow 1960).

    Args:
        parts: the stretches before and after.
        where: numbers of the output, and of the input among the signals.
        terms: (signal, lag) of the regressors.
    """
    from scipy.special import fdtrc

    friction = zone.law != "command"
    largest = max(float(np.max(np.abs(p[:, where[0]]))) for part in parts for p in part)
    rows = [
        _Rows.of(part, *where, terms, STILL * largest) for part in (*parts, [*parts[0], *parts[1]])
    ]
    solutions = [_solve(r, zone.edge, friction) if r.pieces else None for r in rows]
    before, after, joint = solutions
    if before is None or after is None or joint is None:
        return False  # too little of either to distinguish a change from a dead zone
    n, loss = len(joint.theta), before.loss + after.loss
    free = before.rows + after.rows - 2 * n
    statistic = (joint.loss - loss) / n / (loss / free)
    return bool(fdtrc(n, free, max(statistic / COLOURED, 0.0)) < BY_CHANCE)


def _law(rows: _Rows, law: str, command: float) -> tuple[DeadZone, float] | None:
    friction, edge = law != "command", law != "friction"
    farthest = FARTHEST * command
    delta, steps = 0.0, 0
    if edge:
        places = np.linspace(0.0, farthest, GRID)
        losses = np.array([_grid_loss(rows, float(d), friction) for d in places])
        delta, steps = float(places[int(losses.argmin())]), STEPS
    solved = _solve(rows, delta, friction)
    for _ in range(steps):
        wide = None if solved is None else _solve(rows, delta, friction, solved.theta)
        if wide is None:
            return None
        moved = float(np.clip(delta + wide.theta[-1], 0.0, farthest))
        done = abs(moved - delta) <= SETTLED * command
        delta, solved = moved, _solve(rows, moved, friction)
        if done:
            break
    wide = solved if solved is None or not edge else _solve(rows, delta, friction, solved.theta)
    if solved is None or wide is None:
        return None
    at, n, own = delta, len(rows.terms), rows.own
    gain = float(solved.theta[:n][own].sum())
    if gain == 0.0:
        return None
    slope = np.zeros(len(wide.theta))
    if edge:
        slope[-1] = 1.0
    if friction:
        c, signs = float(solved.theta[n:].sum()), slice(n, len(solved.theta))
        slope[:n][own] = -c / gain**2
        slope[signs] = 1.0 / gain
        delta += c / gain
    error = max(float(slope @ wide.covariance @ slope), 0.0) ** 0.5
    zone = DeadZone(law, delta, error, False, solved.theta[:n], wide.covariance[:n, :n], at)
    return zone, solved.loss


def _grid_loss(rows: _Rows, delta: float, friction: bool) -> float:
    """Sum of squares at one place, on some of the equations."""
    parts = [(phi[m], y[m]) for phi, y, m in rows.equations(delta, friction)]
    phi, y = np.concatenate([p for p, _ in parts]), np.concatenate([y for _, y in parts])
    every = max(len(y) // GRID_ROWS, 1)
    T = ne.triangle(np.column_stack([phi[::every], y[::every]]))
    return float(T[-1, -1] ** 2) if len(T) == T.shape[1] else 0.0


def _solve(rows: _Rows, delta: float, friction: bool, theta: Array | None = None) -> _Solved | None:
    """Least squares at one δ; with its slope at ``theta`` as one more column, what δ lacks."""
    return _least_squares(rows.equations(delta, friction, theta))


def _least_squares(equations: Sequence[tuple[Array, Array, NDArray[np.bool_]]]) -> _Solved | None:
    """θ and its covariance from the rows that move, None where these do not determine all of it."""
    phis = [phi[moving] for phi, _, moving in equations]
    ys = [y[moving] for _, y, moving in equations]
    samples, n = sum(map(len, ys)), phis[0].shape[1]
    if samples < MIN_ROWS * n:
        return None
    T = ne.triangle(np.column_stack([np.concatenate(phis), np.concatenate(ys)]))
    solved = ne.solve_triangular_form(T[:-1, :-1], T[:-1, -1])
    if solved.null.shape[1]:
        return None
    errors = [y - phi @ solved.theta for phi, y in zip(phis, ys, strict=True)]
    loss = float(T[-1, -1] ** 2)
    covariance = loss / (samples - n) * solved.inverse
    if not portmanteau_white(errors) and samples > 5 * AR_ORDER:
        covariance = sandwich(half_of(solved.inverse), phis, errors) * samples / (samples - n)
    return _Solved(solved.theta, covariance, loss, samples)
