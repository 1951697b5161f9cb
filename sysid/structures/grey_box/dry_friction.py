"""Dry friction that really sticks, for one motor or two coupled ones, exact within a time step.

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

Everything works on arrays with the motors along axis 0 and any number of runs along axis 1, over
``xp`` = numpy or jax.numpy.
"""

from typing import Any

Signal = Any
"""An array of the namespace in use, (motors, runs)."""

Pair = tuple[Signal, Signal]
"""Diagonal (motors, runs) and off-diagonal entry (runs) of a symmetric matrix."""


def decay(xp: Any, inertia: Pair, h: float) -> Pair:
    """I − Φ = I − exp(−T⁻¹ h).

    Args:
        xp: numpy or jax.numpy.
        inertia: T: time constants [s] and their coupling [s].
        h: step [s].
    """
    own, cross = inertia
    if own.shape[0] == 1:
        return -xp.expm1(-h / own), cross
    a, d = own[0], own[1]
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


def times(xp: Any, m: Pair, v: Signal) -> Signal:
    """Matrix times vector."""
    own, cross = m
    return own * v + cross * v[::-1] if own.shape[0] == 2 else own * v


def solved(xp: Any, m: Pair, v: Signal) -> Signal:
    """Inverse matrix times vector."""
    own, cross = m
    if own.shape[0] == 1:
        return v / own
    return (own[::-1] * v - cross * v[::-1]) / (own[0] * own[1] - cross * cross)


def friction(
    xp: Any, gain: Pair, w_free: Signal, low: Signal, high: Signal
) -> tuple[Signal, Signal]:
    """(f, stands): what friction takes in one step, and which motors stand at its end.

    Args:
        xp: numpy or jax.numpy.
        gain: I − Φ.
        w_free: Φ w + (I − Φ) e, the speed reached without friction, (motors, runs).
        low, high: largest friction against backward and against forward motion, both ≥ 0.
    """
    wanted = solved(xp, gain, w_free)
    # a motor stands where friction could take more: told from the unclipped value, because a
    # compiler may compute a limit twice with different rounding
    inside = (wanted > -low) & (wanted < high)
    held = xp.minimum(xp.maximum(wanted, -low), high)
    if wanted.shape[0] == 1:
        return held, inside
    # at least one violated limit is active at the solution: hold either motor's friction at its
    # limit, let the other one follow, take the better of the two
    own, cross = gain
    follow = wanted + (cross / own) * (wanted - held)[::-1]
    follow_inside = (follow > -low) & (follow < high)
    follow = xp.minimum(xp.maximum(follow, -low), high)
    first = xp.stack([held[0], follow[1]])
    second = xp.stack([follow[0], held[1]])
    better = _distance(xp, gain, first - wanted) <= _distance(xp, gain, second - wanted)
    stands = xp.where(
        better,
        xp.stack([inside[0], follow_inside[1]]),
        xp.stack([follow_inside[0], inside[1]]),
    )
    return xp.where(better, first, second), stands


def _distance(xp: Any, m: Pair, v: Signal) -> Signal:
    return m[0][0] * v[0] ** 2 + m[0][1] * v[1] ** 2 + 2.0 * m[1] * v[0] * v[1]


def sliding_rate(xp: Any, inertia: Pair, force: Signal, moving: Signal) -> Signal:
    """dw/dt = T⁻¹ force of the moving tracks while the others stand; ``moving`` is 0 or 1."""
    own, cross = inertia
    if own.shape[0] == 1:
        return moving * force / own
    return moving * solved(xp, (own, cross * moving[0] * moving[1]), moving * force)
