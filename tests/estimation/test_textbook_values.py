"""Estimates and stated standard errors against values of textbooks in closed form.

Every formula is for many samples; u is white of ±1 and e normal unless said otherwise, N samples.
Ljung: System Identification, 2nd ed. (1999). Söderström & Stoica: System Identification (1989).
Åström: Introduction to Stochastic Control Theory (1970). Pintelon & Schoukens: System
Identification, 2nd ed. (2012).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from estimation_cases import estimated
from scipy.signal import lfilter

from sysid.data.record import Array, Record
from sysid.structures.model import Model

N, RUNS = 1000, 60

FAR = 4.0
"""Standard errors beyond which an average of runs differs from what it is compared with."""

STATED = 0.08
"""Relative: the terms in 1/N that the formulas leave out, and the spread of 60 stated variances."""

Signals = tuple[Array, Array]


def white(rng: np.random.Generator) -> Signals:
    """u of ±1, e with variance 1, both (N,)."""
    return rng.choice([-1.0, 1.0], N), rng.standard_normal(N)


def fits(
    make: Callable[[np.random.Generator], Signals],
    name: str,
    orders: dict[str, object],
    **options: object,
) -> list[Model]:
    """One model for each of RUNS logs that ``make`` gives as u and y."""
    found = []
    for seed in range(RUNS):
        u, y = make(np.random.default_rng(seed))
        record = Record(u[:, None], y[:, None], 1.0)
        found.append(estimated(name, orders, [record], detrend="none", **options))
    return found


def far(values: Array, expected: Array) -> Array:
    """Distance of means of values (runs, n) from the expected (n,), in their standard errors."""
    spread = np.std(values, axis=0, ddof=1) / np.sqrt(len(values))
    return np.abs(np.mean(values, axis=0) - expected) / spread


@dataclass(frozen=True)
class Case:
    """A model in the true structure.

    Attributes:
        make: u and y of a random generator.
        truth: θ.
        variances: N times those of θ, by the formula of the book.
    """

    name: str
    orders: dict[str, object]
    make: Callable[[np.random.Generator], Signals]
    truth: tuple[float, ...]
    variances: tuple[float, ...]
    method: str = "levenberg-marquardt"


def arx(rng: np.random.Generator) -> Signals:
    u, e = white(rng)
    return u, lfilter([0.0, 1.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], e)


def moving_average(rng: np.random.Generator) -> Signals:
    u, e = white(rng)
    return u, 0.5 * u + lfilter([1.0, 0.6], [1.0], e)


def armax(rng: np.random.Generator) -> Signals:
    u, e = white(rng)
    return u, lfilter([0.0, 1.0], [1.0, -0.8], u) + lfilter([1.0, 0.5], [1.0, -0.8], e)


def output_error(rng: np.random.Generator) -> Signals:
    u, e = white(rng)
    return u, lfilter([0.0, 1.0], [1.0, -0.8], u) + e


def looped(a: float, b: float, c: float, k: float, s: float) -> Callable[..., Signals]:
    """y + a y(t−1) = b u(t−1) + e + c e(t−1) with u = r − k y, r white with variance s."""

    def make(rng: np.random.Generator) -> Signals:
        r, e = np.sqrt(s) * rng.standard_normal(N), rng.standard_normal(N)
        pole = [1.0, a + b * k]
        y = lfilter([0.0, b], pole, r) + lfilter([1.0, c], pole, e)
        return r - k * y, y

    return make


def output_error_variances(b: float, f: float) -> tuple[float, float]:
    """Of b and f, times N: ψ = (u(t−1)/F, −b u(t−2)/F²), E ψψᵀ = [1/(1−f²), b f/(1−f²)²; …,
    b²(1+f²)/(1−f²)³], whose determinant is b²/(1−f²)⁴."""
    return (1.0 + f**2) * (1.0 - f**2), (1.0 - f**2) ** 3 / b**2


CASES = {
    # Ljung, §9.3 (least squares): E y² = (b² + λ)/(1 − a²) = 2/0.36, u and y
    # of the same instant uncorrelated, thus var a = 1/E y², var b = 1/E u²
    "ARX": Case("arx", {"na": 1, "nb": 1, "nk": 1}, arx, (-0.8, 1.0), (0.36 / 2.0, 1.0)),
    # Söderström & Stoica, ch. 7: ψ_b = u/C, ψ_c = e(t−1)/C, uncorrelated: 1 − c² both
    "moving average": Case(
        "armax",
        {"na": 0, "nb": 1, "nc": 1, "nk": 0},
        moving_average,
        (0.5, 0.6),
        (1.0 - 0.36, 1.0 - 0.36),
    ),
    # Ljung, §9.3: the gradient as in the docstring above
    "output error": Case(
        "oe",
        {"nb": 1, "nf": 1, "nk": 1},
        output_error,
        (1.0, -0.8),
        output_error_variances(1.0, -0.8),
    ),
    # Söderström & Stoica, ch. 8: of all instruments the best ones have, where the noise is white at
    # the output, the covariance of the output-error method
    "instruments": Case(
        "arx",
        {"na": 1, "nb": 1, "nk": 1},
        output_error,
        (-0.8, 1.0),
        output_error_variances(1.0, -0.8)[::-1],
        "iv4",
    ),
    # Söderström & Stoica, ch. 10, and Ljung, ch. 13: E φφᵀ = [ry, k ry; k ry, k² ry + s] with
    # ry = (b² s + 1)/(1 − (a + b k)²): var a = 1/ry + k²/s, var b = 1/s
    "closed loop": Case(
        "arx",
        {"na": 1, "nb": 1, "nk": 1},
        looped(-0.8, 1.0, 0.0, 0.5, 0.25),
        (-0.8, 1.0),
        ((1.0 - 0.3**2) / 1.25 + 0.5**2 / 0.25, 1.0 / 0.25),
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=list(CASES))
def test_variances_are_those_of_the_book(case: Case) -> None:
    models = fits(case.make, case.name, case.orders, method=case.method)
    theta = np.array([m.theta for m in models])
    expected = np.array(case.variances) / N
    assert np.all(far(theta, np.array(case.truth)) < FAR)
    stated = np.mean([np.diag(m.covariance) for m in models], axis=0)
    assert stated == pytest.approx(expected, rel=STATED)
    # a variance of 60 runs has a standard error of √(2/60)
    met = np.mean((theta - case.truth) ** 2, axis=0)
    assert met == pytest.approx(expected, rel=FAR * np.sqrt(2.0 / RUNS))


def test_the_covariance_of_an_arma_model() -> None:
    """Söderström & Stoica, ch. 7: y + a y(t−1) = e + c e(t−1) has the information
    [1/(1−a²), −1/(1−ac); −1/(1−ac), 1/(1−c²)], with u at another place: ψ_a = −y(t−1)/C."""
    a, c = -0.8, 0.5
    models = fits(armax, "armax", {"na": 1, "nb": 1, "nc": 1, "nk": 1})
    # ψ_a = −(e(t−1)/A + u(t−2)/(A C)), ψ_b = u(t−1)/C, ψ_c = e(t−1)/C
    k = np.arange(200)
    to_a = np.convolve((-a) ** k, (-c) ** k)[:200]
    shifted = float(np.sum(to_a[:-1] * (-c) ** k[1:]))
    information = np.array(
        [
            [1.0 / (1.0 - a**2) + np.sum(to_a**2), -shifted, -1.0 / (1.0 - a * c)],
            [-shifted, 1.0 / (1.0 - c**2), 0.0],
            [-1.0 / (1.0 - a * c), 0.0, 1.0 / (1.0 - c**2)],
        ]
    )
    expected = np.linalg.inv(information) / N
    stated = np.mean([m.covariance for m in models], axis=0)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(stated - expected) / scale) < STATED
    assert np.all(far(np.array([m.theta for m in models]), np.array([a, 1.0, c])) < FAR)


def test_the_bias_of_least_squares() -> None:
    """Ljung, example 8.1: ARX on data of ARMAX goes to a − c/r and b, with
    r = E y² = (b² + 1 + c² − 2ac)/(1 − a²), and its errors have the variance 1 + c² − c²/r."""
    a, b, c = -0.8, 1.0, 0.5
    r = (b**2 + 1.0 + c**2 - 2.0 * a * c) / (1.0 - a**2)
    models = fits(armax, "arx", {"na": 1, "nb": 1, "nk": 1})
    found = np.array([[*m.theta, m.noise_covariance[0, 0]] for m in models])
    assert np.all(far(found, np.array([a - c / r, b, 1.0 + c**2 - c**2 / r])) < FAR)


def test_the_bias_of_a_loop_without_a_noise_model() -> None:
    """Ljung, ch. 13: y = b u(t−1) + e + c e(t−1) under u = r − k y. Without noise model b goes to
    b − k c/E u², E u² = k² E y² + s, E y² = (b² s + 1 + c² − 2 b k c)/(1 − (b k)²);
    with it to b."""
    b, c, k, s = 1.0, 0.7, 0.5, 0.5
    power = k**2 * (b**2 * s + 1.0 + c**2 - 2.0 * b * k * c) / (1.0 - (b * k) ** 2) + s
    make = looped(0.0, b, c, k, s)
    plain = fits(make, "oe", {"nb": 1, "nf": 0, "nk": 1})
    assert far(np.array([m.theta for m in plain]), np.array([b - k * c / power])) < FAR
    modelled = fits(make, "armax", {"na": 0, "nb": 1, "nc": 1, "nk": 1})
    assert np.all(far(np.array([m.theta for m in modelled]), np.array([b, c])) < FAR)


def test_a_proportional_loop_that_nothing_moves() -> None:
    """Söderström & Stoica, ch. 10: of y + a y(t−1) = b u(t−1) + e under u = −k y only
    p = a + b k is determined, with the variance (1 − p²)/N."""
    k, p = 0.5, -0.3
    models = fits(looped(-0.8, 1.0, 0.0, k, 0.0), "arx", {"na": 1, "nb": 1, "nk": 1})
    assert all(np.all(np.diag(m.covariance) > 1.0) for m in models)
    found = np.array([[m.theta[0] + k * m.theta[1]] for m in models])
    assert far(found, np.array([p])) < FAR
    assert np.var(found) == pytest.approx((1.0 - p**2) / N, rel=FAR * np.sqrt(2.0 / RUNS))


def test_the_kalman_gain() -> None:
    """Åström, ch. 7: x(t+1) = a x + u + w, y = x + v with the variances q and 1. The error of the
    foreseen state has the variance p = a² p/(p + 1) + q; K = a p/(p + 1), errors of y p + 1."""
    a, q = 0.8, 0.5
    half = (a**2 - 1.0 + q) / 2.0
    p = half + np.sqrt(half**2 + q)

    def make(rng: np.random.Generator) -> Signals:
        u, v = white(rng)
        w = np.sqrt(q) * rng.standard_normal(N)
        return u, lfilter([0.0, 1.0], [1.0, -a], u + w) + v

    models = fits(make, "ss", {"n": 1})
    found = np.array([[*np.sort(m.theta), m.noise_covariance[0, 0]] for m in models])
    expected = np.array([*np.sort([a, 1.0, a * p / (p + 1.0)]), p + 1.0])
    assert np.all(far(found, expected) < FAR)


def test_a_resistor_whose_current_is_measured_with_noise() -> None:
    """Pintelon & Schoukens, ch. 1: least squares go to R/(1 + σ²/E i²), whatever N."""

    def make(rng: np.random.Generator) -> Signals:
        i, e = white(rng)
        return i + 0.5 * rng.standard_normal(N), 2.0 * i + 0.1 * e

    models = fits(make, "arx", {"na": 0, "nb": 1, "nk": 0})
    assert far(np.array([m.theta for m in models]), np.array([2.0 / 1.25])) < FAR


def test_the_best_linear_approximation_of_a_cube() -> None:
    """Pintelon & Schoukens, ch. 3 (Bussgang): u³ has for normal u of variance s the gain 3 s, and
    what is left has the variance 15 s³ − 9 s³."""
    s = 0.5

    def make(rng: np.random.Generator) -> Signals:
        u = np.sqrt(s) * rng.standard_normal(N)
        return u, u**3

    models = fits(make, "arx", {"na": 0, "nb": 1, "nk": 0})
    found = np.array([[*m.theta, m.noise_covariance[0, 0]] for m in models])
    assert np.all(far(found, np.array([3.0 * s, 6.0 * s**3])) < FAR)
