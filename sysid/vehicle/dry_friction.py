"""Dry friction with true sticking, for one motor or two coupled ones, exact within a time step.

Speeds w of a motor, or of two that one body couples, obey, in units of steady speed,

    T dw/dt = e − w − f          f_i ∈ [−low_i, high_i], at the end that opposes motion

with T symmetric and positive definite, e the speed that would be reached without friction and f
what friction takes from it. Over a step h in which e and f are constant

    w⁺ = Φ w + (I − Φ)(e − f)    Φ = exp(−T⁻¹ h)

exactly. The friction that this step needs is the solution of

    min ½ (f − f*)ᵀ (I − Φ)(f − f*)    −low ≤ f ≤ high    f* = (I − Φ)⁻¹ Φ w + e

whose optimality conditions are Coulomb's law: w⁺_i > 0 → f_i = high_i, w⁺_i < 0 → f_i = −low_i,
and a track stands (w⁺_i = 0) whenever an admissible f_i can hold it (Moreau 1988, implicit time
stepping; Acary & Brogliato 2008, ch. 10). Nothing chatters and nothing needs a threshold speed.
w⁺ is a continuous and piecewise smooth function of every parameter, so Gauss-Newton needs no
smoothed substitute: the derivative of a standing track is zero, as it is in truth.

Motors stand in a sequence, one array of runs for each, over ``xp`` = numpy or jax.numpy; a single
run has plain numbers in their place, and ``xp`` = :mod:`sysid.runners.floats`. Only ``decay``,
which a run needs once, works on arrays with the motors along axis 0.
"""

from collections.abc import Sequence
from typing import Any

Signal = Any
"""An array of the namespace in use, (runs,), or a number."""

Motors = Sequence[Signal]
"""A signal of each motor, one or two."""

Pair = tuple[Motors, Signal]
"""Diagonal and off-diagonal entry of a symmetric matrix."""


def decay(xp: Any, inertia: tuple[Any, Any], h: float) -> tuple[Any, Any]:
    """I − Φ = I − exp(−T⁻¹ h).

    Args:
        inertia: T: time constants [s], (motors, runs), and their coupling [s].
        h: step [s].
    """
    direct, cross = inertia
    if direct.shape[0] == 1:
        return -xp.expm1(-h / direct), cross
    a, d = direct[0], direct[1]
    det = a * d - cross * cross
    s, t, o = h * d / det, h * a / det, -h * cross / det
    mean, half = 0.5 * (s + t), 0.5 * (s - t)
    # the small number keeps the root differentiable where both eigenvalues are equal
    radius = xp.sqrt(half * half + o * o + 1e-24)
    low, high = xp.exp(-(mean - radius)), xp.exp(-(mean + radius))
    slope = high * xp.expm1(2.0 * radius) / (2.0 * radius)
    middle = 0.5 * (low + high)
    own_decay = xp.stack([1.0 - middle + slope * half, 1.0 - middle - slope * half])
    return own_decay, slope * o


def times(m: Pair, v: Motors) -> Motors:
    """Matrix times vector."""
    direct, cross = m
    if len(v) == 1:
        return (direct[0] * v[0],)
    return direct[0] * v[0] + cross * v[1], direct[1] * v[1] + cross * v[0]


def solved(m: Pair, v: Motors) -> Motors:
    """Inverse matrix times vector."""
    direct, cross = m
    if len(v) == 1:
        return (v[0] / direct[0],)
    det = direct[0] * direct[1] - cross * cross
    return (direct[1] * v[0] - cross * v[1]) / det, (direct[0] * v[1] - cross * v[0]) / det


def friction(
    xp: Any, gain: Pair, w_free: Motors, low: Motors, high: Motors
) -> tuple[Motors, Motors]:
    """(f, stands): what friction takes in one step, and which motors stand at its end.

    Args:
        gain: I − Φ.
        w_free: Φ w + (I − Φ) e, the speed reached without friction.
        low, high: largest friction against backward and against forward motion, both ≥ 0.
    """
    wanted = solved(gain, w_free)
    a, a_stands = _limited(xp, wanted[0], low[0], high[0])
    if len(wanted) == 1:
        return (a,), (a_stands,)
    b, b_stands = _limited(xp, wanted[1], low[1], high[1])
    # at least one violated limit is active at the solution: hold either motor's friction at its
    # limit, let the other one follow, take the better of the two
    (one, other), cross = gain
    d, e = wanted[0] - a, wanted[1] - b
    b_follows, b_may = _limited(xp, wanted[1] + cross / other * d, low[1], high[1])
    a_follows, a_may = _limited(xp, wanted[0] + cross / one * e, low[0], high[0])
    better = _distance(gain, a - wanted[0], b_follows - wanted[1]) <= _distance(
        gain, a_follows - wanted[0], b - wanted[1]
    )
    return (
        (xp.where(better, a, a_follows), xp.where(better, b_follows, b)),
        (xp.where(better, a_stands, a_may), xp.where(better, b_may, b_stands)),
    )


def _limited(xp: Any, wanted: Signal, low: Signal, high: Signal) -> tuple[Signal, Signal]:
    """Friction within its limits, and whether the motor stands: where it could take more.

    That is decided from the unlimited value, because a compiler may compute a limit twice with
    different rounding.
    """
    stands = (wanted > -low) & (wanted < high)
    return xp.minimum(xp.maximum(wanted, -low), high), stands


def _distance(m: Pair, a: Signal, b: Signal) -> Signal:
    direct, cross = m
    return direct[0] * (a * a) + direct[1] * (b * b) + 2.0 * cross * a * b


def sliding_rate(inertia: Pair, force: Motors, moving: Motors) -> Motors:
    """dw/dt = T⁻¹ force of the moving tracks while the others stand; ``moving`` is 0 or 1."""
    direct, cross = inertia
    if len(force) == 1:
        return (moving[0] * force[0] / direct[0],)
    a, b = moving
    left, right = solved((direct, cross * a * b), (a * force[0], b * force[1]))
    return a * left, b * right
