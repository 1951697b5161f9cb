"""Constancy over time: whether gain, lag or level of a process change within a log, and when.

Score test (Andrews 1993, Econometrica 61): the errors of the process (``process.py``) are tested
for what a change of each gain, of the lags and of the level at a time τ, or in proportion to time,
would add; the largest of these statistics over τ has the law of the supremum of a Bessel process

    P(sup W > x) ≈ x^{q/2} e^{−x/2} / (2^{q/2} Γ(q/2)) · [(1 − q/x) ln λ + 2/x],  λ = (1/π₀ − 1)²

(DeLong 1981; Estrella 2003). The sums of scores over blocks of time estimate their covariance
whatever correlates them (HAC), and the smaller of this statistic and of the classical one counts.
Like is compared with like: static curves of the inputs and of the response, lags that depend on it,
and limits of a rate stand beside the process, so that another operating region is no
change.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.fft import dct
from scipy.special import fdtrc, gammaln

from sysid.data.impulse import orthonormal
from sysid.data.process import ProcessFit, fit_process
from sysid.data.record import Array, Record

BLOCKS = 80
"""Stretches of time whose edges are the candidates for a change."""

EDGE = 0.1
"""Share of the log at either end in which no change is looked for (π₀)."""

ALARM = 1e-4
"""Level of the test: with what shapes do to it, below one false alarm in a hundred."""

KNOTS = (0.03, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97)
"""Quantiles at which static curves may bend."""

RAMPS = (0.5, 1.0, 2.0, 4.0)
"""Times, in lags, in which a signal whose rate is limited goes over its whole range."""

WIDER, ASIDE = 1.35, 0.5
"""Ratio of an input's spreads, and distance of its means in spreads, from which on two parts of a
log visit different regions."""

DRIFTS = 50.0
"""Power of the slow cosines in a level over that of the next ones (noise of any colour has a few
times as much) from which on it drifts."""

DRIFT_ALARM = 1e-6
"""Level of that comparison, were the noise white there."""

MIN_SLOW = 3
"""Slow curves that a log must have room for: thirty lags."""

MATTERS = 0.03
"""Change of a gain or lag, relative, that matters, and range of a drift over that of the output."""

CLEAR = 4.0
"""Standard errors from which on it is said."""

WITHIN = 7.35
"""Sums of squares, over the variance, within which the time of a step lies at 95 % (Hansen 2000,
Econometrica 68)."""

MIN_SAMPLES = 240
MIN_LAGS = 10.0
"""Lags that either side of a step must last."""


@dataclass(frozen=True)
class Part:
    """One thing that changes: a gain, or the sum of lags [s], before and after.

    Attributes:
        is_gain: else the lags.
        before, after: their values, at the ends of the log where they change all along.
        error: standard error of ``change``.
    """

    input: str
    is_gain: bool
    before: float
    after: float
    error: float

    @property
    def change(self) -> float:
        """Relative change."""
        return self.after / self.before - 1.0

    @property
    def clear(self) -> bool:
        """Whether it matters and is beyond doubt."""
        return abs(self.change) > max(MATTERS, CLEAR * self.error)


@dataclass(frozen=True)
class Change:
    """What changes within a log.

    Attributes:
        output: channel name.
        record: name of the record.
        parts: the gains and lags that change.
        at, error: when [s], and half of the interval of 95 %; NaN where it changes all along.
        column: the unused column that they go with, else time; and its values before and after.
        level: whether the output's level moves with it.
    """

    output: str
    record: str
    parts: tuple[Part, ...]
    at: float
    error: float
    column: tuple[str, float, float] | None = None
    level: bool = False

    @property
    def is_step(self) -> bool:
        return bool(np.isfinite(self.at))


class Beside:
    """The process of an output with static curves beside it, and what they leave of the output."""

    def __init__(self, records: Sequence[Record], j: int, fit: ProcessFit) -> None:
        """Args:
        records: what the process of output ``j`` was fitted to.
        """
        self.records, self.j, self.fit = records, j, fit
        self.y = np.concatenate([r.y[:, j] for r in records])
        self.lags = fit.slopes.sum(axis=1, keepdims=True)

    @cached_property
    def columns(self) -> Array:
        """Levels and drift, responses, their slopes, and static curves, (N, n)."""
        fit = self.fit
        return np.hstack([fit.white.base, fit.responses, fit.slopes, curves(self.records, fit)])

    @cached_property
    def white(self) -> tuple[Array, Array]:
        """``whitened`` of these columns."""
        return self.whitened(self.columns)

    def whitened(self, columns: Array) -> tuple[Array, Array]:
        """Orthonormal basis of columns behind the filter of the noise, and the errors it leaves."""
        filtered = self.fit.white.filtered
        X, _ = orthonormal(filtered(columns), 1e-9)
        target = filtered(self.y[:, None])[:, 0]
        return X, target - X @ (X.T @ target)

    def statistics(
        self, white: tuple[Array, Array], columns: Array, profiles: Array
    ) -> tuple[Array, Array, Array]:
        """``statistics`` of columns (N, q) and of the level in proportion to profiles of time."""
        Z = self.fit.white.filtered(np.column_stack([columns, np.ones(len(self.y))]))
        size = np.sqrt(np.mean(Z**2, axis=0)) + 1e-300
        edges = np.linspace(0, len(self.y), BLOCKS + 1).astype(int)
        stats, effects, errors = statistics(white[0], Z / size, white[1], profiles, edges)
        return stats, effects / size, errors / size

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """The basis of a free run, and its errors."""
        basis = orthonormal(self.columns, 1e-9)[0]
        return basis, self.y - basis @ (basis.T @ self.y)

    def left(self, *columns: Array) -> float:
        """Squared errors of a free run, with these columns besides."""
        basis, rest = self._free
        for more in columns:
            beside = orthonormal(more - basis @ (basis.T @ more), 1e-9)[0]
            rest = rest - beside @ (beside.T @ rest)
        return float(rest @ rest)


def change_within(beside: Beside) -> Change | None:
    """The change of an output; None where it is constant, or the log is too short to say."""
    records, j, fit = beside.records, beside.j, beside.fit
    n = len(fit.residual)
    first = max(round(EDGE * BLOCKS), int(np.ceil(MIN_LAGS * float(fit.lag.max()) / n * BLOCKS)))
    if n < MIN_SAMPLES or 2 * first >= BLOCKS:
        return None
    edges = np.linspace(0, n, BLOCKS + 1).astype(int)
    inner = np.arange(first, BLOCKS - first + 1)
    profiles = np.vstack(
        [np.arange(BLOCKS) >= inner[:, None], (np.arange(BLOCKS) + 0.5) / BLOCKS - 0.5]
    )
    tested = np.hstack([fit.responses, beside.lags])
    for limited in (False, True):
        white = beside.white
        if limited:
            white = beside.whitened(np.hstack([beside.columns, _ramps(records, fit)]))
        stats, effects, errors = beside.statistics(white, tested, profiles)
        if _chance(float(stats.min(axis=1).max()), tested.shape[1]) > ALARM:
            return None
    best = int(np.argmax(stats[:, 0]))  # where the errors are least
    if stats[-1, 0] >= stats[best, 0] - WITHIN:
        return _trend(records, j, fit, effects[-1], errors[-1])
    return _step(records, j, fit, int(edges[inner[best]]))


def level_drifts(records: Sequence[Record], j: int, fit: ProcessFit) -> float:
    """Range of the drift of output j's level, in its unit; 0 where it does not drift.

    The slow cosines of what inputs and static curves leave are compared with the next ones.
    """
    r, base = records[0], fit.white.base
    slow = int(np.sum(fit.white.drifting)) // len(records)
    y = r.y[:, j]
    moved = float(np.ptp(fit.drift[: len(r)]))
    if slow < MIN_SLOW or len(r) < 8 * slow or moved < MATTERS * float(np.ptp(y)):
        return 0.0
    still = base[:, ~fit.white.drifting]  # levels and decays
    X = np.hstack([still, fit.slopes, curves(records, fit), base[:, fit.white.drifting]])[: len(r)]
    X = X / (np.sqrt(np.mean(X**2, axis=0)) + 1e-300)
    rest = y - fit.responses[: len(r)].sum(axis=1)
    added = np.linalg.lstsq(X, rest, rcond=1e-9)[0]
    added[X.shape[1] - int(fit.white.drifting.sum()) :] = 0.0
    power = dct(rest - X @ added)[1 : 4 * slow + 1] ** 2
    ratio = power[:slow].mean() / max(power[slow:].mean(), 1e-300)
    sure = fdtrc(slow, 3 * slow, ratio) < DRIFT_ALARM
    return moved if sure and ratio > DRIFTS else 0.0


def regions_differ(records: Sequence[Record], at: float) -> bool:
    """Whether the inputs visit other regions before and after a time [s]."""
    u, t = np.concatenate([r.u for r in records]), np.concatenate([r.t for r in records])
    early = t < at
    if early.all() or not early.any():
        return False
    one, two = (u[rows] for rows in (early, ~early))
    spread, other = one.std(axis=0), two.std(axis=0)
    wider = np.maximum(spread, other) > WIDER * np.minimum(spread, other)
    aside = np.abs(one.mean(axis=0) - two.mean(axis=0)) > ASIDE * np.maximum(spread, other)
    return bool(np.any(wider | aside))


def statistics(
    X: Array, Z: Array, e: Array, profiles: Array, edges: Array
) -> tuple[Array, Array, Array]:
    """The classical and the robust statistic of each profile; effects and errors, (profiles, q).

    Profiles are weights of the blocks, (profiles, BLOCKS).
    """
    everything = np.hstack([X, Z])
    p, q = X.shape[1], Z.shape[1]
    gram, score = np.empty((BLOCKS, p + q, p + q)), np.empty((BLOCKS, p + q))
    for b, (start, stop) in enumerate(pairwise(edges)):
        rows = everything[start:stop]
        gram[b], score[b] = rows.T @ rows, rows.T @ e[start:stop]
    variance = float(e @ e) / max(len(e) - p - q, 1)
    beside = np.tensordot(profiles, gram[:, :p, p:], 1)  # X'(wZ), X orthonormal
    A = np.tensordot(profiles**2, gram[:, p:, p:], 1) - beside.swapaxes(1, 2) @ beside
    inverse = np.linalg.pinv(A, rcond=1e-4, hermitian=True)
    g = profiles @ score[:, p:] - score[:, :p].sum(axis=0) @ beside
    effects = (inverse @ g[:, :, None])[:, :, 0]
    # what z is beside X, in each block as a combination of the columns
    weights = profiles[:, :, None]
    shares = np.broadcast_to(-(beside @ effects[:, :, None]).swapaxes(1, 2), (*profiles.shape, p))
    taken = np.concatenate([shares, weights * effects[:, None]], 2)
    rest = score - (taken.swapaxes(0, 1) @ gram).swapaxes(0, 1)
    part = (weights * rest[:, :, p:] - rest[:, :, :p] @ beside) @ inverse
    both = np.stack([variance * inverse, part.swapaxes(1, 2) @ part])
    errors = np.sqrt(np.diagonal(both, axis1=2, axis2=3).max(axis=0))
    tested = effects[:, :-1]  # whatever the level does
    tight = np.linalg.pinv(both[:, :, :-1, :-1], rcond=1e-8, hermitian=True)
    stats = np.einsum("ki,skij,kj->ks", tested, tight, tested)
    return stats, effects, errors


def _chance(x: float, q: int) -> float:
    if x <= q + 2.0:
        return 1.0
    log = 0.5 * q * np.log(x) - 0.5 * x - 0.5 * q * np.log(2.0) - gammaln(0.5 * q)
    tail = (1.0 - q / x) * 2.0 * np.log(1.0 / EDGE - 1.0) + 2.0 / x
    return float(min(np.exp(log) * tail, 1.0))


def curves(records: Sequence[Record], fit: ProcessFit) -> Array:
    """Static curves of inputs and response, and lags that depend on the response, (N, n)."""
    columns = []
    for i in range(records[0].nu):
        u = np.concatenate([r.u[:, i] for r in records])
        if len(knots := np.unique([*np.quantile(u, KNOTS), 0.0])) and np.ptp(u) > 0.0:
            inside = knots[(knots > u.min()) & (knots < u.max())]
            columns += [
                fit.through(i, [np.maximum(r.u[:, i] - k, 0.0) for r in records]) for k in inside
            ]
            if u.min() < 0.0 < u.max():
                columns.append(fit.through(i, [np.sign(r.u[:, i]) for r in records]))
    x = fit.responses.sum(axis=1) + fit.level
    d = fit.slopes.sum(axis=1)
    hinges = [np.maximum(x - k, 0.0) for k in np.quantile(x, KNOTS)]
    columns += [*hinges, np.sign(x), *(d * h for h in hinges), d * x, d * np.sign(x)]
    return np.column_stack(columns)


def _ramps(records: Sequence[Record], fit: ProcessFit) -> Array:
    """What a limit of each input's rate, and one of the output's, would change, (N, n).

    A ramp makes the lag of a large step longer than that of a small one: two parts of a log with
    few large steps differ by it. Looked at only where a change would be said.
    """
    lag = float(fit.lag[main_input(fit)])
    rates = 1.0 / (np.array(RAMPS) * lag)
    x, starts = fit.responses.sum(axis=1), np.cumsum([len(r) for r in records])[:-1]
    wanted = np.split(x + lag * np.diff(x, append=x[-1:]), starts)
    columns = [np.concatenate(c) - x for c in _slower(wanted, rates, lag)]
    for i in range(records[0].nu):
        us = [r.u[:, i] for r in records]
        columns += [
            fit.through(i, [c - u for c, u in zip(limited, us, strict=True)])
            for limited in _slower(us, rates, 1.0)
        ]
    return np.column_stack(columns)


def _slower(xs: Sequence[Array], rates: Array, lag: float) -> Iterator[list[Array]]:
    """What follows each signal by a lag [samples], at each rate (as a share of the range a sample)
    at most."""
    widest = float(max(map(np.max, xs)) - min(map(np.min, xs)))
    for rate in (rates * widest).tolist():
        yield [_limited(x, rate, lag) for x in xs]


def _limited(x: Array, rate: float, lag: float) -> Array:
    out, y = np.empty(len(x)), float(x[0])
    for k, wanted in enumerate(x.tolist()):
        y += min(max((wanted - y) / lag, -rate), rate)
        out[k] = y
    return out


def main_input(fit: ProcessFit) -> int:
    """The input that moves the output most."""
    return int(np.argmax(fit.responses.std(axis=0)))


def _trend(
    records: Sequence[Record], j: int, fit: ProcessFit, effect: Array, error: Array
) -> Change | None:
    """Gains and lags that change in proportion to time, at both ends of the log."""
    nu, dt, main = len(fit.gain), records[0].dt, main_input(fit)
    ends = np.maximum(1.0 + np.outer([-0.5, 0.5], effect), 1e-3)
    values = [*fit.gain, fit.lag[main] * dt]
    parts = [
        Part(
            records[0].input_names[i if i < nu else main],
            i < nu,
            float(v * ends[0, i]),
            float(v * ends[1, i]),
            float(error[i] / ends[0, i]),
        )
        for i, v in enumerate(values)
    ]
    return _said(records[0], j, parts, np.nan, np.nan)


def _said(r: Record, j: int, parts: Sequence[Part], at: float, error: float) -> Change | None:
    clear = tuple(part for part in parts if part.clear)
    return Change(r.output_names[j], r.name, clear, at, error) if clear else None


def _step(records: Sequence[Record], j: int, fit: ProcessFit, row: int) -> Change | None:
    """Gains and lags fitted on either side of a row, and the time between them."""
    starts = np.concatenate([[0], np.cumsum([len(r) for r in records])])
    k = int(np.searchsorted(starts, row, side="right")) - 1
    r, at, block = records[k], row - int(starts[k]), len(fit.residual) // BLOCKS
    for _ in range(ROUNDS):
        sides = [*records[:k], r.rows(0, at)], [r.rows(at, len(r)), *records[k + 1 :]]
        long = [[part for part in side if len(part) > MIN_ROWS] for side in sides]
        if not all(long):
            return None
        fits = [fit_process(side, j, [fit.dead], [fit.lag]) for side in long]
        if fits[0] is None or fits[1] is None:
            return None
        before, after = fits[0], fits[1]
        last, reach = at, REACH * block
        at, half = _when(r, j, before, after, max(at - reach, 0), min(at + reach, len(r) - 1))
        if abs(at - last) <= block // 4:
            break
    main, parts = main_input(fit), []
    for i, name in enumerate(r.input_names):
        one, two = (float(f.gain[i]) for f in (before, after))
        errors = before.gain_error[i] / one, after.gain_error[i] / two
        parts.append(Part(name, True, one, two, float(abs(two / one) * np.hypot(*errors))))
    one, two = (float(f.lag[main] * r.dt) for f in (before, after))
    error = two / one * np.hypot(before.lag_error[main], after.lag_error[main])
    parts.append(Part(r.input_names[main], False, one, two, float(error)))
    return _said(r, j, parts, r.t0 + at * r.dt, half * r.dt)


ROUNDS, REACH = 4, 3
"""Times that both sides are fitted anew, and blocks that the step may move at once."""

MIN_ROWS = 60


def _when(
    r: Record, j: int, before: ProcessFit, after: ProcessFit, first: int, last: int
) -> tuple[int, float]:
    """The row between two processes, and half of its interval of 95 %.

    From the row on the output runs by the later process, from where the earlier one left it.
    """
    rest = [
        r.y[:, j] - sum(f.gain[i] * f.through(i, [u - u[0]]) for i, u in enumerate(r.u.T))
        for f in (before, after)
    ]
    lag = float(after.lag[main_input(after)])
    near = round(5.0 * lag) + 5
    stop = min(last + near, len(r))
    levels = [
        float(np.mean(rest[0][max(first - near, 0) : max(first, 1)])),
        float(np.mean(rest[1][last:stop])),
    ]
    early, late = (x - v for x, v in zip(rest, levels, strict=True))
    decay = np.exp(-np.arange(len(r)) / max(lag, 1e-3))
    whitener = np.concatenate([[1.0], before.white.noise])
    tried = np.unique(np.linspace(first, last, MOST_TIMES).astype(int))
    begin = max(first - len(whitener), 0)
    errors = np.empty(len(tried))
    for k, row in enumerate(tried):
        e = early[begin:stop].copy()
        e[row - begin :] = late[row:stop] + (early[row] - late[row]) * decay[: stop - row]
        errors[k] = np.sum(np.convolve(e, whitener)[len(whitener) : len(e)] ** 2)
    within = tried[errors <= errors.min() + WITHIN * max(before.variance, after.variance)]
    spacing = float(np.median(np.diff(tried)))
    half = 0.5 * float(within[-1] - within[0]) + 0.5 * spacing
    return int(tried[np.argmin(errors)]), half


MOST_TIMES = 200
"""Rows that are tried for the time of a step."""
