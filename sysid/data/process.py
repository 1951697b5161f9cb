"""Process model of one output: each input through two lags and a dead time, drift, and AR noise.

    y(t) = Σ_i K_i G_i(q) u_i(t − θ_i) + level + slow cosines + n(t),   A_n(q) n(t) = e(t)

G has unit gain and the poles of 1 + S s + ρ S² s²: the sum of its lags S, and a shape ρ that makes
them one lag (0), two alike (1/4) or an oscillation (more). The dead time θ is continuous: between
two samples the input is on the line. All of it is fitted to the errors that one sample leaves
unpredicted (prediction error method; Ljung 1999, §7.2), so that a controller does not bias it, by
Levenberg–Marquardt. Times are in samples.

The numerator of two lags behind a zero-order hold, b₁ + b₂q⁻¹, is that line's as well: of θ, one
sample and b₂ / (b₁ + b₂) are the hold's (``held``), and only the rest is dead time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import lfilter
from sysid.data.impulse import orthonormal, whitener
from sysid.data.record import Array, Record

NOISE_ORDER = 8
"""Lags of the noise model."""

COSINES = 6
"""Slow cosines that a drifting level may take in one record, …"""

SLOWER = 10.0
"""… each with a half period of so many lags at least."""

ROUNDS, STEPS = 3, 6
"""Times the noise is estimated anew, and steps of the search between two of them."""

SHAPES = (0.02, 0.2)
"""Shapes ρ that a search starts from."""

MIN_SAMPLES = 60

KNOWN_LAG, KNOWN_SHAPE = 2.0, 1.5
"""What is known of ln S and ln ρ beforehand: where a second lag is far below a sample its size is
open, but no dead time may hide in it."""

SAME_LAGS = 1e-6

LOWEST_SHAPE, HIGHEST_SHAPE = 1e-4, 30.0


@dataclass(frozen=True, eq=False)
class ProcessFit:
    """The fitted process.

    Attributes:
        gain: K of every input, (nu,), in units of output per input.
        lag, shape, dead: S [samples], ρ and θ [samples], (nu,); θ = 1 has no dead time.
        gain_error, lag_error, dead_error: standard errors of K, ln S and θ, (nu,).
        responses: what each input adds to the output, (N, nu), record after record.
        slopes: derivatives of these by ln S, (N, nu).
        white: the filter that whitens the noise, with the columns of levels and drift.
        level: what levels, drift and decaying starts add, (N,).
        drift: the part of it that drifts about its mean, (N,).
        residual: e, (N,).
        variance: of e.
    """

    gain: Array
    lag: Array
    shape: Array
    dead: Array
    gain_error: Array
    lag_error: Array
    dead_error: Array
    responses: Array
    slopes: Array
    white: "Whitened"
    level: Array
    drift: Array
    residual: Array
    variance: float

    def held(self, i: int) -> float:
        """What of θ of input i is no dead time but the hold of its lags [samples], 1 to 1.5."""
        return 1.0 + _second_share(float(self.lag[i]), float(self.shape[i]))

    def through(self, i: int, x: Sequence[Array]) -> Array:
        """What input i would add, by its lags and dead time at unit gain, were it x, (N,)."""
        a = _denominator(float(self.lag[i]), float(self.shape[i]))
        dead = float(self.dead[i])
        return np.concatenate([lfilter([a.sum()], a, _delayed(part, dead)) for part in x])


@dataclass(frozen=True, eq=False)
class _Problem:
    """Inputs (each at its own scale, from its first sample on) and output, record by record."""

    us: tuple[Array, ...]
    y: Array
    edges: tuple[int, ...]
    skip: int

    @property
    def rows(self) -> int:
        """Samples whose errors count."""
        return len(self.y) - self.skip * (len(self.edges) - 1)

    def each(self, i: int) -> list[Array]:
        return [u[:, i] for u in self.us]


def fit_process(
    records: Sequence[Record],
    j: int,
    dead: Sequence[Sequence[float] | Array],
    lags: Sequence[float | Array],
) -> ProcessFit | None:
    """The process of output ``j``; None where nothing of it can be determined.

    Args:
        records: experiments with the same channels.
        dead: dead times [samples] to start from, one an input each.
        lags: sums of lags [samples] to start from, one for all inputs or one each.
    """
    scale = np.concatenate([r.u for r in records]).std(axis=0)
    rows = np.array([len(r) for r in records])
    if not np.all(scale > 0.0):
        return None
    problem = _Problem(
        tuple((r.u - r.u[0]) / scale for r in records),
        np.concatenate([r.y[:, j] for r in records]),
        (0, *np.cumsum(rows).tolist()),
        max(NOISE_ORDER, 2 + int(np.ceil(max(float(np.max(d)) for d in dead)))),
    )
    nu = len(scale)
    if problem.rows < MIN_SAMPLES or problem.skip > min(rows) // 2:
        return None
    starts = [
        np.concatenate([np.log(np.broadcast_to(s, nu)), np.full(nu, np.log(shape)), theta])
        for s in lags
        for shape in SHAPES
        for theta in map(np.asarray, dead)
    ]
    plain = Whitened(problem, starts[0], np.zeros(0))
    by_error = sorted(starts, key=plain.error)
    fits = [_searched(problem, p) for p in (by_error[0], *_other(by_error, nu))]
    judge = fits[0][1]
    p, white = min(fits, key=lambda f: judge.error(f[0]))
    return _described(problem, p, white, scale)


def _other(by_error: Sequence[Array], nu: int) -> list[Array]:
    """The best start with other dead times than those of the best one."""
    best = by_error[0][2 * nu :]
    return [p for p in by_error if np.any(p[2 * nu :] != best)][:1]


def _searched(problem: _Problem, p: Array) -> "tuple[Array, Whitened]":
    """Parameters and noise from a start: Levenberg–Marquardt between estimates of the noise."""
    n = len(p)
    longest = np.repeat([0.7, 1.5, 4.0], n // 3)
    white = Whitened(problem, p, np.zeros(0)).reestimated(p)
    for _ in range(ROUNDS):
        error, damping = white.error(p), 1e-3
        for _ in range(STEPS):
            J, rest = white.jacobian(p)
            G, right = J.T @ J, J.T @ rest
            size = np.diag(G)[:n] + 1e-300
            for _ in range(4):
                H = G.copy()
                H[range(n), range(n)] += damping * size
                step = np.linalg.lstsq(H, right, rcond=1e-12)[0][:n]
                tried = _bounded(problem, p + np.clip(step, -longest, longest))
                better = white.error(tried)
                if better < error:
                    break
                damping *= 10.0
            else:
                break
            done = error - better < 1e-5 * error
            p, error, damping = tried, better, damping / 10.0
            if done:
                break
        white = white.reestimated(p)
    return p, white


class Whitened:
    """A problem behind the filter of its noise, levels and drift solved for once."""

    def __init__(self, problem: _Problem, p: Array, noise: Array) -> None:
        self.problem, self.noise = problem, noise
        self.base, self.drifting = _base(problem, p)
        self._basis, _ = orthonormal(self.filtered(self.base), 1e-9)
        self.target = self.beside(problem.y[:, None])[:, 0]

    def filtered(self, columns: Array) -> Array:
        """Columns (N, n) behind the filter, zero where what lies before the record acts."""
        white = columns.copy()
        for k, c in enumerate(self.noise, start=1):
            white[k:] += c * columns[:-k]
        for start in self.problem.edges[:-1]:
            white[start : start + self.problem.skip] = 0.0
        return white

    def beside(self, columns: Array) -> Array:
        """What levels and drift leave of columns behind the filter."""
        white = self.filtered(columns)
        return np.asarray(white - self._basis @ (self._basis.T @ white))

    def error(self, p: Array) -> float:
        """Sum of squares that the process leaves unpredicted."""
        X = self.beside(_values(self.problem, p))
        return float(np.sum((self.target - X @ _solved(X, self.target)) ** 2))

    def jacobian(self, p: Array) -> tuple[Array, Array]:
        """Derivatives of the prediction by p and by the gains, and the prediction's errors."""
        columns, slopes = _columns(self.problem, p)
        X = self.beside(columns)
        gain = _solved(X, self.target)
        J = self.beside(slopes * np.tile(gain, 3))
        return np.hstack([J, X]), self.target - X @ gain

    def reestimated(self, p: Array) -> "Whitened":
        """The same with the noise of what the process p leaves."""
        X = np.hstack([self.base, _values(self.problem, p)])
        rest = self.problem.y - X @ _solved(X, self.problem.y)
        return Whitened(self.problem, p, _noise(rest, self.problem.edges))


def _bounded(problem: _Problem, p: Array) -> Array:
    nu, longest = len(p) // 3, max(np.diff(problem.edges))
    low = np.repeat([np.log(0.05), np.log(LOWEST_SHAPE), 0.0], nu)
    high = np.repeat([np.log(2.0 * longest), np.log(HIGHEST_SHAPE), longest / 3.0], nu)
    return np.clip(p, low, high)


def _described(problem: _Problem, p: Array, white: Whitened, scale: Array) -> ProcessFit | None:
    nu = len(scale)
    columns, slopes = _columns(problem, p)
    X = white.beside(columns)
    gain = _solved(X, white.target)
    J, e = white.jacobian(p)
    variance = float(e @ e) / max(problem.rows - J.shape[1] - white.base.shape[1], 1)
    size = np.sqrt(np.sum(J**2, axis=0)) + 1e-300
    G = (J / size).T @ (J / size)
    known = np.repeat([KNOWN_LAG, KNOWN_SHAPE], nu)
    G[range(2 * nu), range(2 * nu)] += variance / (known * size[: 2 * nu]) ** 2
    inverse = np.linalg.pinv(G, rcond=1e-12, hermitian=True)
    rest = problem.y - columns @ gain
    error = np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance) / size
    levels = _solved(white.filtered(white.base), white.filtered(rest[:, None])[:, 0])
    if not np.all(np.isfinite(error)):
        return None
    return ProcessFit(
        gain / scale, np.exp(p[:nu]), np.exp(p[nu : 2 * nu]), p[2 * nu :],
        error[3 * nu :] / scale, error[:nu], error[2 * nu : 3 * nu],
        columns * gain, slopes[:, :nu] * gain, white, white.base @ levels,
        white.base[:, white.drifting] @ levels[white.drifting], e, variance,
    )  # fmt: skip


def _columns(problem: _Problem, p: Array) -> tuple[Array, Array]:
    """G_i u_i, (N, nu), and its derivatives by ln S, ln ρ and θ of each, (N, 3 nu)."""
    nu = len(p) // 3
    values, by_lag, by_shape, by_dead = (list[Array]() for _ in range(4))
    for i in range(nu):
        s, shape, dead = np.exp(p[i]), np.exp(p[nu + i]), p[2 * nu + i]
        a, da = _denominator(s, shape), _denominator_slopes(s, shape)
        c, dc = a.sum(), da.sum(axis=1)
        w = [lfilter([1.0], a, _delayed(u, dead)) for u in problem.each(i)]
        v = np.concatenate([lfilter([1.0], a, x) for x in w])
        later = np.concatenate([_delayed(x, 1) for x in w])
        v1 = _shifted(v, 1, problem.edges)
        v2 = _shifted(v, 2, problem.edges)
        x = np.concatenate(w)
        values.append(c * x)
        for k, into in ((0, by_lag), (1, by_shape)):
            into.append(dc[k] * x - c * (da[k, 1] * v1 + da[k, 2] * v2))
        by_dead.append(c * (later - x))
    return np.column_stack(values), np.column_stack([*by_lag, *by_shape, *by_dead])


def _denominator(s: float, shape: float) -> Array:
    """1 + a₁q⁻¹ + a₂q⁻² of lags of sum S and shape ρ, (3,)."""
    poles = np.exp(np.array(_rates(s, shape)))
    return np.array([1.0, -poles.sum().real, poles.prod().real])


def _denominator_slopes(s: float, shape: float) -> Array:
    """Its derivatives by ln S and ln ρ, (2, 3)."""
    h = 1e-5
    more, less = np.exp(h), np.exp(-h)
    by_s = _denominator(s * more, shape) - _denominator(s * less, shape)
    by_shape = _denominator(s, shape * more) - _denominator(s, shape * less)
    return np.array([by_s, by_shape]) / (2.0 * h)


def _rates(s: float, shape: float) -> tuple[complex, complex]:
    """The roots of 1 + S s + ρ S² s², the slow one first."""
    root = np.sqrt(complex(1.0 - 4.0 * shape))
    slow = -2.0 / (s * (1.0 + root))
    return slow, 1.0 / (shape * s * s * slow)


def _second_share(s: float, shape: float) -> float:
    """b₂ / (b₁ + b₂) of the zero-order hold, from the step response after a sample, which is b₁.

    Source: Åström & Wittenmark (1997), Computer-Controlled Systems, §2.6.
    """
    if abs(4.0 * shape - 1.0) < SAME_LAGS:  # two lags alike, where the step response is 0/0
        shape = 0.25 * (1.0 - SAME_LAGS)
    slow, fast = _rates(s, shape)
    one, two = np.exp(slow), np.exp(fast)
    first = (1.0 + (fast * one - slow * two) / (slow - fast)).real
    return float(1.0 - first / ((1.0 - one) * (1.0 - two)).real)


def _delayed(u: Array, dead: float) -> Array:
    """u(t − θ), zero before the record; on the line between two samples."""
    k = int(np.floor(dead))
    f = dead - k
    whole = np.zeros(len(u))
    whole[k:] = (1.0 - f) * u[: len(u) - k] if k < len(u) else 0.0
    if f > 0.0:
        whole[k + 1 :] += f * u[: max(len(u) - k - 1, 0)]
    return whole


def _shifted(x: Array, k: int, edges: Sequence[int]) -> Array:
    """x(t − k), zero before each record."""
    moved = np.zeros_like(x)
    moved[k:] = x[:-k]
    for start in edges[:-1]:
        moved[start : start + k] = 0.0
    return moved


def _base(problem: _Problem, p: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Columns of each record's own level, slow drift, and decays from where it began.

    And which of them drift.
    """
    nu = len(p) // 3
    slowest = float(np.exp(np.max(p[:nu])))
    rows = [_denominator(np.exp(p[i]), np.exp(p[nu + i])) for i in range(nu)]
    columns, drifting = [], list[bool]()
    for start, stop in pairwise(problem.edges):
        n = stop - start
        x = (np.arange(n) + 0.5) / n
        count = int(np.clip(n / (SLOWER * slowest), 0, COSINES))
        some = [np.ones(n), *(np.cos(np.pi * m * x) for m in range(1, count + 1))]
        some += [2.0 * x - 1.0] if count else []
        drifting += [k > 0 for k in range(len(some))] + [False] * (2 * nu)
        for a in rows:
            decay = lfilter([1.0], a, np.eye(1, n)[0])
            some += [decay, _delayed(decay, 1)]
        block = np.zeros((problem.edges[-1], len(some)))
        block[start:stop] = np.array(some).T
        columns.append(block)
    return np.hstack(columns), np.array(drifting)


def _values(problem: _Problem, p: Array) -> Array:
    nu = len(p) // 3
    columns = []
    for i in range(nu):
        a = _denominator(np.exp(p[i]), np.exp(p[nu + i]))
        parts = [lfilter([a.sum()], a, _delayed(u, p[2 * nu + i])) for u in problem.each(i)]
        columns.append(np.concatenate(parts))
    return np.column_stack(columns)


def _solved(X: Array, y: Array) -> Array:
    size = np.sqrt(np.sum(X**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = X / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-11, hermitian=True)
    return np.asarray(inverse @ (scaled.T @ y) / size)


def _noise(rest: Array, edges: Sequence[int]) -> Array:
    """Coefficients of the autoregression of the errors (Yule–Walker), (NOISE_ORDER,)."""
    order = min(NOISE_ORDER, len(rest) // 40)
    parts = [rest[a:b] for a, b in pairwise(edges)]
    white = whitener(parts, order, 1e-9)
    return np.zeros(0) if white is None else white[1:]
