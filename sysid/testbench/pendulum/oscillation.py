"""A fading swing fitted to an angle: its period with standard error, amplitude, damping, friction.

The amplitude falls by viscous damping δ, dry friction κ and the drag χ of the air, ȧ = −δ a − κ −
χ a² (averaged over a swing, Krylov and Bogoliubov); the phase runs as a pendulum's does at that
amplitude, φ̇ = ω₀ √(1 − (δ/ω₀)²) · agm(1, cos(a/2)), and the angle over
the phase is a pendulum's, θ = 2 asin(sin(a/2) sn(2Kφ/π)), Jacobi's elliptic sine. A damped sine is
the same without the last two: one period at all amplitudes. Both are fitted, since a log may hold
either.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares
from scipy.special import ellipj, ellipk

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.fitting.differences import propagated
from sysid.fitting.uncertainty import uncertainty
from sysid.testbench.pendulum.crossings import FreeSwing
from sysid.testbench.pendulum.inertia import small_swing_period

PARAMETERS = ("omega", "phase", "amplitude", "damping", "friction", "offset", "drift", "drag")
LOSSES = (3, 4, 7)
"""Places of damping, friction and drag, which are never negative."""
GRID = 600
"""Instants at which the phase is integrated; between them it is a straight line to 10⁻⁶ rad."""
FADING = 40
"""Steps of Runge and Kutta's method for the amplitude, between which it is a cubic."""
AVERAGED = 1e-3
"""Share of the amplitude's correction (T − T₀) by which averaging over a swing may be wrong: the
runs of a simulated pendulum at 30–60° with friction gave 0.5·10⁻³ and less."""
WILD = 6.0
"""Robust standard deviations beyond which a measurement is left out."""
ROUNDS = 4
"""Fits between which wild measurements are looked for again."""
LEAST_EXPLAINED = 0.5
"""Share of the angle's variance below which the fit is no oscillation of this log."""
CLEARLY = 10.0
"""Log-likelihood ratio (times two) by which the second choice must be better than the first."""
MOST_SAMPLES = 2_500
"""Measurements beyond which neighbours are averaged, as long as twenty a period are left: more only
take time."""
DEGREES = math.pi / 180.0
WIDEST = 0.9 * math.pi
"""Amplitude [rad] up to which a pendulum's fit is tried; near the top its period has no end."""


@dataclass(frozen=True, eq=False)
class Oscillation:
    """A fitted swing.

    Attributes:
        period: mean over the log [s].
        period_std_error: of it [s].
        small_period: the period that small swings without damping would have [s].
        small_std_error: of it [s].
        amplitudes: first, root mean square and last one [rad].
        scale: what an angle of the log is in rad.
        damping_ratio: δ/ω₀.
        friction: equilibrium's shift by dry friction [rad].
        kind: ``pendulum``, or ``sine`` where the period does not change with the amplitude.
        unit_identified: whether the log shows the kind of swing and the unit of its angle.
        noise: standard deviation of what is left [rad].
        left_out: wild measurements.
        t, angle, fitted: what was fitted, (N,) [s, rad, rad]; wild measurements NaN in ``angle``.
    """

    period: float
    period_std_error: float
    small_period: float
    small_std_error: float
    amplitudes: tuple[float, float, float]
    scale: float
    damping_ratio: float
    friction: float
    kind: str
    unit_identified: bool
    noise: float
    left_out: int
    t: Array
    angle: Array
    fitted: Array


@dataclass(frozen=True, eq=False)
class _Fit:
    """One shape fitted: parameters, residuals [rad], which measurements count."""

    pendulum: bool
    scale: float
    p: Array
    jacobian: Array
    residual: Array
    good: NDArray[np.bool_]

    def misfit(self, samples: float) -> float:
        """−2 log-likelihood up to a constant, in the unit of the log's own angle."""
        residual = self.residual[self.good] / self.scale
        return samples * math.log(float(residual @ residual) / len(residual) + 1e-300)


def fit_oscillation(
    t: Array, angle: Array, swing: FreeSwing, in_radians: bool, where: str
) -> Oscillation:
    """Fit a fading swing to the part of a log that swings freely.

    Standard errors are those of least squares with the residuals' own colour (sandwich of
    :func:`sysid.fitting.uncertainty.uncertainty`).

    Args:
        t: instants [s], (N,).
        angle: (N,) [rad], or in radians or degrees where ``in_radians`` is false.
    """
    inside = (t >= swing.passages[0]) & (t <= swing.passages[-1])
    t, angle = _thinned(t[inside], angle[inside], swing.period)
    largest = float(np.max(np.abs(swing.swings)))
    scales = [1.0] if in_radians else [1.0, DEGREES]
    shapes = [(True, s) for s in scales if s * largest < WIDEST]
    fits = [_fitted(t, angle, swing, *shape) for shape in (*shapes, (False, scales[-1]))]
    best, unit_identified = _best(fits)
    moved = angle[best.good] - np.mean(angle[best.good])
    residual = best.residual[best.good] / best.scale
    if not float(residual @ residual) < (1.0 - LEAST_EXPLAINED) * float(moved @ moved):
        raise DataError(
            f"{where} holds no oscillation: the best fading swing leaves "
            f"{100 * float(residual @ residual) / float(moved @ moved):.0f} % of the motion "
            "unexplained; let the body swing freely, and name the column of its angle"
        )
    return _result(t, angle, best, unit_identified)


def _thinned(t: Array, angle: Array, period: float) -> tuple[Array, Array]:
    """Means of neighbours where there are far more measurements than a period needs."""
    several = min(len(t) // MOST_SAMPLES, int(len(t) * period / float(t[-1] - t[0]) / 20.0))
    if several < 2:
        return t, angle
    whole = len(t) // several * several
    thin = np.median if several > 4 else np.mean  # a wild measurement must not spread
    return (
        t[:whole].reshape(-1, several).mean(axis=1),
        thin(angle[:whole].reshape(-1, several), axis=1),
    )


def _best(fits: list[_Fit]) -> tuple[_Fit, bool]:
    """The shape that explains the log: a pendulum in radians unless another is clearly better.

    Returns:
        it, and whether the log itself prefers it.
    """
    least = min(fits, key=lambda f: f.misfit(1.0))
    samples = _effective(least.residual[least.good])
    gains = [f.misfit(samples) - least.misfit(samples) for f in fits]
    chosen = 0 if gains[0] < CLEARLY else int(np.argmin(gains))
    others = [g for k, g in enumerate(gains) if k != chosen]
    return fits[chosen], bool(min(others) - gains[chosen] >= CLEARLY)


def _effective(residual: Array) -> float:
    """Independent samples that coloured residuals are worth: N (1 − ρ)/(1 + ρ), at least 10."""
    power = float(residual @ residual)
    near = float(residual[1:] @ residual[:-1]) / power if power > 0.0 else 0.0
    return max(len(residual) * (1.0 - near) / (1.0 + max(near, 0.0)), 10.0)


def _fitted(t: Array, angle: Array, swing: FreeSwing, pendulum: bool, scale: float) -> _Fit:
    """One shape by least squares, wild measurements left out in rounds."""
    y = scale * angle
    s = t - t[0]
    start = _start(s, y, swing, scale)
    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    lower[list(LOSSES)] = 0.0
    for at, least, most in ((0, 0.2, 5.0), (2, 0.1, 3.0)):
        lower[at], upper[at] = least * start[at], most * start[at]
    if pendulum:
        upper[2] = min(upper[2], WIDEST)
    good = np.ones(len(s), dtype=bool)
    p = start
    for k in range(ROUNDS):
        solution = least_squares(
            partial(_errors, s=s[good], y=y[good], span=float(s[-1]), pendulum=pendulum),
            p,
            "2-point",
            bounds=(lower, upper),
            x_scale=_scales(start, s[-1]),
            loss="soft_l1" if k == 0 else "linear",
            f_scale=0.02 * start[2],
            ftol=1e-8 if k else 1e-4,
        )
        p = solution.x
        residuals = y - _angle(p, s, s[-1], pendulum)
        usual = 1.4826 * float(np.median(np.abs(residuals)))
        now = np.abs(residuals) <= WILD * max(usual, 1e-9 * start[2])
        if k and np.array_equal(now, good):
            break
        good = now
    return _Fit(pendulum, scale, p, -np.asarray(solution.jac), residuals, good)


def _errors(p: Array, s: Array, y: Array, span: float, pendulum: bool) -> Array:
    return _angle(p, s, span, pendulum) - y


def _start(s: Array, y: Array, swing: FreeSwing, scale: float) -> Array:
    """Parameters as counted: period, first amplitude, half of its fall by damping."""
    size = np.abs(swing.swings) * scale
    span = float(s[-1])
    first, last = float(np.mean(size[:2])), float(np.mean(size[-2:]))
    rate = max(math.log(max(first / max(last, 1e-9), 1.0)), 1e-3) / span
    upward = 0.0 if swing.swings[0] > 0 else math.pi
    middle = scale * swing.middle
    omega = 2.0 * math.pi / swing.from_passages.period
    return np.array(
        [omega, upward, first, rate, 0.05 * first * rate, middle, 0.0, 0.05 * rate / first]
    )


def _scales(start: Array, span: float) -> Array:
    """Sizes of the parameters' likely changes."""
    size = float(start[2])
    each = 1.0 / span
    return np.array([each, 1.0, size, each, size * each, size, size * each, each / size])


def _envelope(p: Array, s: Array, span: float) -> Array:
    """a(t) of ȧ = −δ a − κ − χ a² [rad]."""
    first, damping, friction, drag = (float(p[k]) for k in (2, *LOSSES))
    h = span / FADING

    def slope(a: float) -> float:
        return -(damping + drag * a) * a - friction if a > 0.0 else 0.0

    a = [first]
    for _ in range(FADING):
        k1 = slope(a[-1])
        k2 = slope(a[-1] + 0.5 * h * k1)
        k3 = slope(a[-1] + 0.5 * h * k2)
        k4 = slope(a[-1] + h * k3)
        a.append(max(a[-1] + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), 0.0))
    course = CubicHermiteSpline(np.linspace(0.0, span, FADING + 1), a, [slope(v) for v in a])
    return np.asarray(np.maximum(course(s), 0.0))


def _rate(p: Array, amplitude: Array, pendulum: bool) -> Array:
    """φ̇ at an amplitude [rad/s]."""
    damped = p[0] * math.sqrt(max(1.0 - (p[3] / p[0]) ** 2, 1e-6))
    if not pendulum:
        return np.full(len(amplitude), damped)
    shape = 2.0 / np.pi * ellipk(np.sin(0.5 * np.minimum(amplitude, WIDEST)) ** 2)
    return np.asarray(damped / shape)


def _phase(p: Array, s: Array, span: float, pendulum: bool) -> Array:
    """φ(t) [rad]."""
    grid = np.linspace(0.0, span, GRID)
    rate = _rate(p, _envelope(p, grid, span), pendulum)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * (grid[1] - grid[0])])
    return np.asarray(p[1] + np.interp(s, grid, turned))


def _angle(p: Array, s: Array, span: float, pendulum: bool) -> Array:
    """θ(t) of either shape [rad].

    Dry friction shifts the middle of each half-swing by κπ/(2ω) against the motion, which makes
    its course differ from a(t) sin φ between the turning points.
    """
    a, phase = _envelope(p, s, span), _phase(p, s, span, pendulum)
    if pendulum:
        k2 = np.sin(0.5 * np.minimum(a, WIDEST)) ** 2
        sn = ellipj(2.0 / np.pi * ellipk(k2) * phase, k2)[0]
        course = 2.0 * np.arcsin(np.clip(np.sqrt(k2) * sn, -1.0, 1.0))
    else:
        course = a * np.sin(phase)
    half = np.floor((phase - 0.5 * np.pi) / np.pi)
    since = phase - 0.5 * np.pi - half * np.pi
    shift = 0.5 * np.pi * p[4] / p[0] * (1.0 - 2.0 * (half % 2.0))
    course = course + shift * (1.0 - np.cos(since) * (1.0 - 2.0 * since / np.pi))
    return np.asarray(course + p[5] + p[6] * (s - 0.5 * span))


def _result(t: Array, angle: Array, fit: _Fit, unit_identified: bool) -> Oscillation:
    s, span = t - t[0], float(t[-1] - t[0])
    scales = _scales(fit.p, span)
    free = np.array(
        [k not in LOSSES or fit.p[k] > 1e-6 * scales[k] for k in range(len(PARAMETERS))]
    )
    weights = np.ones(int(np.sum(fit.good)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = uncertainty(
        fit.jacobian[:, free], fit.residual[fit.good], [(0, len(weights))], weights
    ).covariance
    figures = _figures(fit, span)
    errors = propagated(
        lambda p: _figures(replace(fit, p=p), span),
        fit.p,
        covariance,
        np.where(free, 1e-4 * scales, 0.0),
    )
    errors[1] = math.hypot(errors[1], AVERAGED * (figures[0] - figures[1]))
    good = fit.residual[fit.good]
    return Oscillation(
        period=float(figures[0]),
        period_std_error=float(errors[0]),
        small_period=float(figures[1]),
        small_std_error=float(errors[1]),
        amplitudes=_amplitudes(fit.p, span),
        scale=fit.scale,
        damping_ratio=float(fit.p[3] / fit.p[0]) if free[3] else 0.0,
        friction=float(0.5 * math.pi * fit.p[4] / fit.p[0]) if free[4] else 0.0,
        kind="pendulum" if fit.pendulum else "sine",
        unit_identified=unit_identified,
        noise=float(np.std(good)),
        left_out=int(np.sum(~fit.good)),
        t=t,
        angle=np.where(fit.good, fit.scale * angle, np.nan),
        fitted=_angle(fit.p, s, span, fit.pendulum),
    )


def _figures(fit: _Fit, span: float) -> Array:
    """Mean period over the log and the period of small swings without damping [s]."""
    turned = _phase(fit.p, np.array([0.0, span]), span, fit.pendulum)
    mean = 2.0 * math.pi * span / float(turned[1] - turned[0])
    small = 2.0 * math.pi / fit.p[0]
    if not fit.pendulum:
        small = small_swing_period(float(small), _amplitudes(fit.p, span)[1])
    return np.array([mean, small])


def _amplitudes(p: Array, span: float) -> tuple[float, float, float]:
    """First, root mean square and last amplitude [rad]."""
    a = _envelope(p, np.linspace(0.0, span, GRID), span)
    return float(a[0]), float(np.sqrt(np.mean(a**2))), float(a[-1])
