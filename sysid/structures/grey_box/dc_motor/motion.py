"""One time step of motors with dry friction: exact, implicit, or Runge-Kutta 4.

q holds the lumped motion: ``inertia`` (time constants and coupling), its ``decay`` over the step,
and of each motor ``coulomb`` [speed] and the shape of friction; w are the motors' speeds, net the
speeds that would be reached without friction.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.vehicle.dry_friction import (
    Motors,
    Pair,
    Signal,
    friction,
    sliding_rate,
    times,
)
from sysid.vehicle.motors import Motor, friction_limits


def of_motors(
    p: Mapping[str, Any], names: Sequence[str], motors: int
) -> tuple[tuple[Signal, ...], ...]:
    """These constants of each motor; those that both share stand with both."""
    return tuple(
        tuple(p[n][i] if np.ndim(p[n]) == 2 else p[n] for n in names) for i in range(motors)
    )


def friction_constants(xp: Any, p: Mapping[str, Any], motors: int) -> tuple[Motor, ...]:
    """Of each motor what ``friction_limits`` needs, in units of speed: its damping is 1."""
    shape = ("breakaway", "stribeck", "coulomb_back", "viscous_back", "drag")
    return tuple(
        Motor(1.0, 1.0, 0.0, xp.abs(dry), breakaway, stribeck, friction_back=back,
              damping_back=damped, drag=drag)
        for dry, breakaway, stribeck, back, damped, drag in of_motors(
            p, ("coulomb", *shape), motors
        )
    )  # fmt: skip


def exact_step(xp: Any, q: Mapping[str, Any], w: Motors, net: Motors, h: float) -> Motors:
    """One step: friction at the mean speed of sliding, then what follows a stop.

    Where a track stops inside the step, the step is cut there (by linear interpolation) and the
    rest of it starts from standstill, where friction may hold the track or let it go either way.
    """
    g = q["decay"]
    w_free = _free(g, w, net)

    def slid(at: Motors) -> Motors:
        """Speeds after the step if no sliding track stopped, friction as at the speeds ``at``."""
        low, high = [], []
        for v, (back, forth) in zip(w, _levels(xp, q, at), strict=True):
            low.append(xp.where(v > 0.0, -forth, back))
            high.append(xp.where(v < 0.0, -back, forth))
        return _braked(xp, g, w_free, low, high)

    first = slid(w)
    first = slid([0.5 * (v + xp.where(a * v < 0.0, 0.0, a)) for v, a in zip(w, first, strict=True)])
    crosses = [a * v < 0.0 for v, a in zip(w, first, strict=True)]
    cut = crosses[0] | crosses[-1]
    if cut is False:  # a single run in which no track stops: the rest would be thrown away
        return first
    shares = [
        xp.where(c, v / xp.where(c, v - a, 1.0), 1.0)
        for v, a, c in zip(w, first, crosses, strict=True)
    ]
    share = xp.minimum(shares[0], shares[-1])
    stop = [
        xp.where(c & (s * v <= 1e-12 * v * v), 0.0, s)
        for v, s, c in zip(w, _between(w, first, share), crosses, strict=True)
    ]
    left = xp.where(cut, xp.maximum(1.0 - share, 1e-9), 1.0)
    rest = ([left * own for own in g[0]], left * g[1])
    resumed = _braked(xp, rest, _free(rest, stop, net), *_limits(xp, q, stop))
    return [xp.where(cut, r, a) for r, a in zip(resumed, first, strict=True)]


def implicit_step(xp: Any, q: Mapping[str, Any], w: Motors, net: Motors, h: float) -> Motors:
    """One step with the friction that its end needs, as large as at its beginning."""
    g = q["decay"]
    return _braked(xp, g, _free(g, w, net), *_limits(xp, q, w))


def _free(g: Pair, w: Motors, net: Motors) -> Motors:
    """Speeds after a step without friction."""
    gained = times(g, [e - v for e, v in zip(net, w, strict=True)])
    return [v + d for v, d in zip(w, gained, strict=True)]


def _braked(xp: Any, g: Pair, free: Motors, low: Motors, high: Motors) -> Motors:
    """Speeds after a step with friction."""
    taken, stands = friction(xp, g, free, low, high)
    lost = times(g, taken)
    return [xp.where(s, 0.0, v - d) for s, v, d in zip(stands, free, lost, strict=True)]


def _between(w: Motors, after: Motors, share: Signal) -> Motors:
    return [v + share * (a - v) for v, a in zip(w, after, strict=True)]


def _limits(xp: Any, q: Mapping[str, Any], w: Motors) -> tuple[Motors, Motors]:
    """Largest friction of all motors against backward, and against forward motion."""
    low, high = zip(*_levels(xp, q, w), strict=True)
    return low, high


def _levels(xp: Any, q: Mapping[str, Any], w: Motors) -> Sequence[tuple[Signal, Signal]]:
    """Largest friction against backward and forward motion at the speed w [speed], by motor."""
    return [friction_limits(of, v, xp) for of, v in zip(q["friction"], w, strict=True)]


def runge_kutta_step(xp: Any, q: Mapping[str, Any], w: Motors, net: Motors, h: float) -> Motors:
    """Classical Runge-Kutta 4 in the sense in which each track slides; it ends where it stops."""
    leaving = [xp.sign(v) for v in implicit_step(xp, q, w, net, h)]
    sense = [xp.where(v != 0.0, xp.sign(v), s) for v, s in zip(w, leaving, strict=True)]
    moving = [xp.abs(s) for s in sense]

    def rate(v: Motors) -> Motors:
        force = [
            e - s - xp.where(f >= 0.0, high, -low)
            for e, s, f, (low, high) in zip(net, v, sense, _levels(xp, q, v), strict=True)
        ]
        return sliding_rate(q["inertia"], force, moving)

    def ahead(by: Motors, step: float) -> Motors:
        return [v + step * d for v, d in zip(w, by, strict=True)]

    a = rate(w)
    b = rate(ahead(a, 0.5 * h))
    c = rate(ahead(b, 0.5 * h))
    d = rate(ahead(c, h))
    after = [
        v + h / 6.0 * (k + 2.0 * (m + n) + o) for v, k, m, n, o in zip(w, a, b, c, d, strict=True)
    ]
    return [xp.where(v * s < 0.0, 0.0, v) for v, s in zip(after, sense, strict=True)]


STEPS = MappingProxyType({"exact": exact_step, "rk4": runge_kutta_step, "implicit": implicit_step})
"""One step by the integrator's name."""
