"""A battery from rests and loads: open-circuit voltage, resistance, and slow recovery.

    V = E − s q − R₀ I − Σ v_k,    τ_k v̇_k = R_k I − v_k,    q = ∫ I dt

After a load the voltage jumps by R₀ I and then creeps back by what the branches held: who reads the
resistance off rest and settled load takes both for it. Branches and slope are kept only where the
log pays for them (BIC on its independent samples).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from sysid.data.documents import by_field
from sysid.data.filtering import lfilter
from sysid.data.record import Array
from sysid.errors import DataError
from sysid.fitting.uncertainty import uncertainty

MIN_ROWS = 4
"""Rows of a table that a line with a standard error needs."""
MOVES = 0.05
"""Share of the largest current by which it must change for a resistance to be identifiable."""
AT_REST = 0.02
"""Share of the largest current below which a battery counts as resting."""
SLOWEST = 3.0
"""Time constants that a log holds fewer times than this are none of it: a branch so slow falls like
the open-circuit voltage does, and took the slope's place."""
TRIED = 24
"""Time constants tried, a decade in six steps or finer for logs of up to four decades."""
PAYS = 6.0
"""Fall of BIC from which a branch or slope is kept: strong evidence (Raftery 1995)."""
MOST_SAMPLES = 8_000
"""Measurements beyond which neighbours are averaged."""
HOUR = 3600.0


@dataclass(frozen=True)
class Branch:
    """What recovers slowly: a resistance and its time constant.

    Attributes:
        resistance, std_error: [Ω].
        tau, tau_std_error: [s].
    """

    resistance: float = field(metadata={"alias": "resistance_ohm"})
    std_error: float
    tau: float = field(metadata={"alias": "tau_s"})
    tau_std_error: float


@dataclass(frozen=True, eq=False)
class Battery:
    """A battery from rests and loads.

    Attributes:
        open_voltage, open_std_error: before anything was drawn [V].
        resistance, std_error: what answers at once [Ω].
        branches: what recovers slowly, fast ones first.
        settled, settled_std_error: all resistances together [Ω].
        slope, slope_std_error: fall of the open-circuit voltage per charge [V/Ah]; None where the
            log is too short.
        charge: drawn [Ah]; None for a table.
        currents: mean and largest current drawn [A].
        rests: whether it ever rested.
        turned: whether the current's sign was turned so that drawing is positive.
        noise: standard deviation of what is left [V].
        t, voltage, fitted: as fitted, (N,) [s, V, V]; rows instead of seconds for a table.
    """

    name: str
    open_voltage: float = field(metadata={"alias": "open_circuit_voltage_V"})
    open_std_error: float = field(metadata={"alias": "open_circuit_std_error"})
    resistance: float = field(metadata={"alias": "internal_resistance_ohm"})
    std_error: float = field(metadata={"alias": "internal_resistance_std_error"})
    branches: tuple[Branch, ...] = field(metadata={"alias": "recovery"})
    settled: float = field(metadata={"alias": "settled_resistance_ohm"})
    settled_std_error: float = field(metadata={"alias": "settled_resistance_std_error"})
    slope: float | None = field(metadata={"alias": "slope_V_per_Ah"})
    slope_std_error: float | None
    charge: float | None = field(metadata={"alias": "charge_Ah"})
    currents: tuple[float, float] = field(metadata={"exclude": True})
    rests: bool = field(metadata={"exclude": True})
    turned: bool = field(metadata={"exclude": True})
    noise: float = field(metadata={"alias": "noise_V"})
    t: Array = field(metadata={"exclude": True})
    voltage: Array = field(metadata={"exclude": True})
    fitted: Array = field(metadata={"exclude": True})

    def to_json(self) -> dict[str, Any]:
        mean, largest = self.currents
        return by_field(self) | {"mean_current_A": mean, "largest_current_A": largest}


@dataclass(frozen=True)
class _Shape:
    """Which parts a fit has: a slope, and branches with these time constants [s]."""

    slope: bool
    taus: tuple[float, ...]


def fit_battery(name: str, t: Array | None, voltage: Array, current: Array) -> Battery:
    """Fit a battery to a log of rests and loads, or to a table of steady measurements.

    Args:
        t: instants [s], (N,); None for a table.
        voltage, current: [V, A], (N,); the sign of the current is found.
    """
    good = np.isfinite(voltage) & np.isfinite(current)
    good &= np.isfinite(t) if t is not None else True
    v, i = voltage[good], current[good]
    if len(v) < MIN_ROWS:
        raise DataError(f"{name} holds {len(v)} measurements of the battery; {MIN_ROWS} are needed")
    largest = float(np.max(np.abs(i)))
    if largest == 0.0 or float(np.ptp(i)) < MOVES * largest:
        what = "0 A throughout" if largest == 0.0 else f"{float(np.mean(i)):.3g} A throughout"
        raise DataError(
            f"{name}: the current is {what}, so no resistance can be determined; "
            "record rest and load alternately"
        )
    turned = float(np.cov(v, i)[0, 1]) > 0.0
    i = -i if turned else i
    if t is None:
        when, even = np.arange(len(v), dtype=np.float64), None
    else:
        when, v, i = _even(t[good], v, i)
        even = float(when[1] - when[0])
    shape = _Shape(False, ()) if even is None else _chosen(v, i, even)
    return _result(name, when, v, i, even, shape, turned)


def _even(t: Array, v: Array, i: Array) -> tuple[Array, Array, Array]:
    """Both signals on an even grid; of many measurements, means of neighbours."""
    step = float(np.median(np.diff(t)))
    span = float(t[-1] - t[0])
    if not step > 0.0:
        step = span / (len(t) - 1)
    each = float(step * max(len(t) // MOST_SAMPLES, 1))
    n = max(round(span / each) + 1, MIN_ROWS)
    which = np.clip(np.rint((t - t[0]) / each).astype(int), 0, n - 1)
    count = np.bincount(which, minlength=n)
    filled = count > 0
    middle = each * np.arange(n, dtype=np.float64)
    out = []
    for x in (v, i):
        mean = np.bincount(which, x, minlength=n)[filled] / count[filled]
        out.append(np.interp(middle, middle[filled], mean))
    return np.asarray(middle), out[0], out[1]


def _chosen(v: Array, i: Array, dt: float) -> _Shape:
    """The parts the log pays for: none, a slope, one or two branches, and both."""
    span = dt * len(v)
    taus = np.geomspace(2.0 * dt, max(span / SLOWEST, 4.0 * dt), TRIED).tolist()
    best = _Shape(False, ())
    samples = _worth(v, i, dt, taus)
    score = _bic(v, i, dt, best, samples)
    for _ in range(3):
        grown = [_Shape(True, best.taus)] if not best.slope else []
        if len(best.taus) < 2:
            slower = [_Shape(best.slope, (*best.taus, tau)) for tau in taus]
            grown.append(min(slower, key=lambda s: _bic(v, i, dt, s, samples)))
        # each with its own time constants, or one part would mend what is off in another
        refined = [_refined(v, i, dt, s) for s in grown]
        scores = [_bic(v, i, dt, s, samples) for s in refined]
        if min(scores) > score - PAYS:
            break
        score, best = min(scores), refined[int(np.argmin(scores))]
    return best


def _worth(v: Array, i: Array, dt: float, taus: Sequence[float]) -> float:
    """Independent samples of the log, N(1 − ρ)/(1 + ρ) of a generous fit's errors, at least 20."""
    generous = _Shape(True, (taus[len(taus) // 4], taus[3 * len(taus) // 4]))
    residual = v - _columns(i, dt, generous) @ _solved(v, i, dt, generous)
    power = float(residual @ residual)
    near = float(residual[1:] @ residual[:-1]) / power if power > 0.0 else 0.0
    worth = len(v) * (1.0 - max(near, 0.0)) / (1.0 + max(near, 0.0))
    return max(worth, 20.0)


def _bic(v: Array, i: Array, dt: float, shape: _Shape, samples: float) -> float:
    theta = _solved(v, i, dt, shape)
    if np.any(theta[2 : 2 + shape.slope + len(shape.taus)] <= 0.0):
        return math.inf  # a part that is nothing
    residual = v - _columns(i, dt, shape) @ theta
    resolution = 1e-12 * float(v @ v)
    numbers = len(theta) + len(shape.taus)
    return samples * math.log(
        (float(residual @ residual) + resolution) / len(v)
    ) + numbers * math.log(samples)


def _columns(i: Array, dt: float | None, shape: _Shape) -> Array:
    """What E, R₀, s, R_k and the branches' first voltages multiply, (N, n)."""
    columns = [np.ones(len(i)), -i]
    if dt is not None:
        if shape.slope:
            columns.append(-(np.cumsum(i) - 0.5 * (i + i[0])) * dt / HOUR)
        for tau in shape.taus:
            a = math.exp(-dt / tau)
            columns.append(-lfilter([0.0, 1.0 - a], [1.0, -a], i))
        columns += [-np.exp(-np.arange(len(i)) * dt / tau) for tau in shape.taus]
    return np.column_stack(columns)


def _solved(v: Array, i: Array, dt: float | None, shape: _Shape) -> Array:
    """Least squares with no resistance and no slope below 0."""
    X = _columns(i, dt, shape)
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0
    lower = np.full(X.shape[1], -np.inf)
    lower[1 : 2 + shape.slope + len(shape.taus)] = 0.0
    Q, R = np.linalg.qr(X / size)
    theta = np.linalg.lstsq(R, Q.T @ v, rcond=None)[0]
    if np.any(theta < lower):
        theta = lsq_linear(R, Q.T @ v, (lower, np.full(len(lower), np.inf))).x
    return np.asarray(theta / size)


def _result(
    name: str, t: Array, v: Array, i: Array, dt: float | None, shape: _Shape, turned: bool
) -> Battery:
    theta = _solved(v, i, dt, shape)
    X = _columns(i, dt, shape)
    fitted = X @ theta
    slopes = [X]
    k = 2 + shape.slope
    for b in range(len(shape.taus)):  # ∂V/∂ log τ
        moved = tuple(x * 1.001 if n == b else x for n, x in enumerate(shape.taus))
        other = _columns(i, dt, _Shape(shape.slope, moved)) @ theta
        slopes.append(((other - fitted) / math.log(1.001))[:, None])
    J = -np.hstack(slopes)
    cov = uncertainty(J, v - fitted, [(0, len(v))], np.ones(len(v))).covariance
    error = np.sqrt(np.diag(cov))
    branches = tuple(
        Branch(float(theta[k + b]), float(error[k + b]), tau, float(tau * error[X.shape[1] + b]))
        for b, tau in enumerate(shape.taus)
    )
    resistances = [1, *range(k, k + len(shape.taus))]
    every = float(np.sum(cov[np.ix_(resistances, resistances)]))
    largest = float(np.quantile(i, 0.99))
    return Battery(
        name=name,
        open_voltage=float(theta[0]),
        open_std_error=float(error[0]),
        resistance=float(theta[1]),
        std_error=float(error[1]),
        branches=branches,
        settled=float(np.sum(theta[resistances])),
        settled_std_error=math.sqrt(max(every, 0.0)),
        slope=float(theta[2]) if shape.slope else None,
        slope_std_error=float(error[2]) if shape.slope else None,
        charge=None if dt is None else float(np.sum(i)) * dt / HOUR,
        currents=(float(np.mean(i)), largest),
        rests=bool(np.min(np.abs(i)) <= AT_REST * largest),
        turned=turned,
        noise=float(np.std(v - fitted)),
        t=t,
        voltage=v,
        fitted=fitted,
    )


def _refined(v: Array, i: Array, dt: float, shape: _Shape) -> _Shape:
    """Time constants between those tried, everything else solved for each (Golub and Pereyra)."""
    if not shape.taus:
        return shape

    def left(logs: Array) -> Array:
        tried = _Shape(shape.slope, tuple(np.exp(logs).tolist()))
        return np.asarray(v - _columns(i, dt, tried) @ _solved(v, i, dt, tried))

    start = np.log(shape.taus)
    most = max(dt * len(v) / SLOWEST, 4.0 * dt)
    bounds = (np.full(len(start), math.log(dt)), np.full(len(start), math.log(most)))
    start = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    solution = least_squares(left, start, bounds=bounds, x_scale=0.1)
    return _Shape(shape.slope, tuple(sorted(np.exp(solution.x).tolist())))
