"""One time step of motors with dry friction: exact, implicit, or Runge-Kutta 4.

q holds the lumped motion: ``inertia`` (time constants and coupling), its ``decay`` over the step,
``coulomb`` [speed] and the shape of friction; w are speeds (motors, runs), net the speeds that
would be reached without friction.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from sysid.structures.grey_box.dry_friction import friction, sliding_rate, times

Signal = Any
"""An array of the namespace in use (numpy or jax.numpy)."""


def exact_step(xp: Any, q: Mapping[str, Signal], w: Signal, net: Signal, h: float) -> Signal:
    """One step: friction at the mean speed of sliding, then what follows a stop.

    Where a track stops inside the step, the step is cut there (by linear interpolation) and the
    rest of it starts from standstill, where friction may hold the track or let it go either way.
    """
    g = q["decay"]
    w_free = w + times(xp, g, net - w)

    def slid(at: Signal) -> Signal:
        """Speeds after the step if no sliding track stopped, friction as at the speeds ``at``."""
        low, high = _levels(xp, q, at)
        taken, stands = friction(
            xp, g, w_free, xp.where(w > 0.0, -high, low), xp.where(w < 0.0, -low, high)
        )
        return xp.where(stands, 0.0, w_free - times(xp, g, taken))

    first = slid(w)
    first = slid(0.5 * (w + xp.where(first * w < 0.0, 0.0, first)))
    crosses = first * w < 0.0
    share = xp.min(xp.where(crosses, w / xp.where(crosses, w - first, 1.0), 1.0), axis=0)
    cut = xp.max(xp.where(crosses, 1.0, 0.0), axis=0) > 0.0
    stop = w + share * (first - w)
    stop = xp.where(crosses & (stop * w <= 1e-12 * w * w), 0.0, stop)
    left = xp.where(cut, xp.maximum(1.0 - share, 1e-9), 1.0)
    rest = (left * g[0], left * g[1])
    free = stop + times(xp, rest, net - stop)
    taken, stands = friction(xp, rest, free, *_levels(xp, q, stop))
    resumed = xp.where(stands, 0.0, free - times(xp, rest, taken))
    return xp.where(cut, resumed, first)


def implicit_step(xp: Any, q: Mapping[str, Signal], w: Signal, net: Signal, h: float) -> Signal:
    """One step with the friction that its end needs, as large as at its beginning."""
    g = q["decay"]
    w_free = w + times(xp, g, net - w)
    taken, stands = friction(xp, g, w_free, *_levels(xp, q, w))
    return xp.where(stands, 0.0, w_free - times(xp, g, taken))


def _levels(xp: Any, q: Mapping[str, Signal], w: Signal) -> tuple[Signal, Signal]:
    """Largest friction against backward and forward motion at the speed w [speed]."""
    extra = 1.0 + (q["breakaway"] - 1.0) / (1.0 + (w / (q["stribeck"] + 1e-12)) ** 2)
    dry = xp.abs(q["coulomb"]) * extra
    drag = q["drag"] * w * w
    back = (q["viscous_back"] - 1.0) * xp.maximum(-w, 0.0)
    return xp.maximum(q["coulomb_back"] * dry + drag + back, 0.0), dry + drag


def runge_kutta_step(xp: Any, q: Mapping[str, Signal], w: Signal, net: Signal, h: float) -> Signal:
    """Classical Runge-Kutta 4 in the sense in which each track slides; it ends where it stops."""
    g = q["decay"]
    w_free = w + times(xp, g, net - w)
    taken, stands = friction(xp, g, w_free, *_levels(xp, q, w))
    leaving = xp.where(stands, 0.0, xp.sign(w_free - times(xp, g, taken)))
    sense = xp.where(w != 0.0, xp.sign(w), leaving)
    moving = xp.abs(sense)

    def rate(v: Signal) -> Signal:
        low, high = _levels(xp, q, v)
        taken = xp.where(sense >= 0.0, high, -low)
        return sliding_rate(xp, q["inertia"], net - v - taken, moving)

    a = rate(w)
    b = rate(w + 0.5 * h * a)
    c = rate(w + 0.5 * h * b)
    d = rate(w + h * c)
    after = w + h / 6.0 * (a + 2.0 * (b + c) + d)
    return xp.where(after * sense < 0.0, 0.0, after)


STEPS = MappingProxyType({"exact": exact_step, "rk4": runge_kutta_step, "implicit": implicit_step})
"""One step by the integrator's name."""
