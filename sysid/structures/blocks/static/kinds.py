"""The closed table of kinds of static stages: parameter names, value, slope and derivatives.

    identity           x
    abs                |x − c|
    dead-zone          x − d_high above d_high, x − d_low below d_low, 0 between
    dead-zone-upper    x − d_high above d_high, 0 below      (dead-zone-lower: the other side)
    saturation         x limited to s_low … s_high
    saturation-upper   x limited to at most s_high           (saturation-lower: at least s_low)
    polynomial:n       p₁ x + p₂ x² + … + p_n xⁿ
    piecewise:n        straight lines through (x₁, y₁) … (x_n, y_n), the last ones extended
    spline:n           natural cubic spline through n points at given abscissae, extended straight

Extensions beyond the data are straight lines, because a cubic's go wherever they like
(Schoukens & Tiels 2017).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.data.record import Array

Evaluation = tuple[Array, Array, Array]
"""Value, slope ∂/∂x and partial derivatives ∂/∂p (n, …)."""


@dataclass(frozen=True)
class Stage:
    """One kind with its size and, for a spline, the abscissae read off the data."""

    kind: str
    size: int = 0
    knots: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """The stage as users type it."""
        return f"{self.kind}:{self.size}" if self.size else self.kind

    @cached_property
    def names(self) -> tuple[str, ...]:
        return KINDS[self.kind].names(self.size)

    def evaluated(self, x: Array, p: Array) -> Evaluation:
        """(value, slope ∂/∂x, partial derivatives ∂/∂p (n, …)) at the points x."""
        return KINDS[self.kind].evaluate(x, p, self)

    def value(self, x: Any, p: Any, xp: Any = np) -> Any:
        """The value alone, over any array namespace."""
        return KINDS[self.kind].value(x, p, self, xp)


@dataclass(frozen=True)
class Kind:
    """What there is to know about one kind of stage.

    Attributes:
        names: parameter names for a size.
        value: (x, p, stage, namespace) → value.
        evaluate: (x, p, stage) → value, slope, partial derivatives.
        smallest: least size, 0 for kinds without one.
        has_gain: whether its own parameters can multiply it by any factor.
        has_offset: whether they can add any constant.
        ordered: how many of the first parameters must increase, for a size.
    """

    names: Callable[[int], tuple[str, ...]]
    value: Callable[[Any, Any, Stage, Any], Any]
    evaluate: Callable[[Array, Array, Stage], Evaluation]
    smallest: int = 0
    has_gain: bool = False
    has_offset: bool = False
    ordered: Callable[[int], int] = lambda size: 0


def _identity(x: Array, p: Array, stage: Stage) -> Evaluation:
    return x, np.ones_like(x), np.zeros((0, *x.shape))


def _abs(x: Array, p: Array, stage: Stage) -> Evaluation:
    # +1 at the kink itself: a derivative of zero there would hide the stage from the search
    sign = np.where(x >= p[0], 1.0, -1.0)
    return sign * (x - p[0]), sign, -sign[None]


def _dead_zone_value(low: bool, high: bool) -> Callable[[Any, Any, Stage, Any], Any]:
    def value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
        out = x * 0.0
        if low:
            out = out + xp.minimum(x - p[0], 0.0)
        if high:
            out = out + xp.maximum(x - p[-1], 0.0)
        return out

    return value


def _beyond(x: Array, p: Array, low: bool, high: bool) -> list[Array]:
    """1 where x lies below the lower edge, and where it lies above the upper one."""
    return [(x < p[0]).astype(np.float64)] * low + [(x > p[-1]).astype(np.float64)] * high


def _dead_zone(low: bool, high: bool) -> Callable[..., Evaluation]:
    def evaluate(x: Array, p: Array, stage: Stage) -> Evaluation:
        sides = _beyond(x, p, low, high)
        slope = np.sum(sides, axis=0)
        value = np.sum([s * (x - t) for s, t in zip(sides, p, strict=True)], axis=0)
        return value, slope, -np.array(sides)

    return evaluate


def _saturation_value(low: bool, high: bool) -> Callable[[Any, Any, Stage, Any], Any]:
    def value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
        if low:
            x = xp.maximum(x, p[0])
        return xp.minimum(x, p[-1]) if high else x

    return value


def _saturation(low: bool, high: bool) -> Callable[..., Evaluation]:
    def evaluate(x: Array, p: Array, stage: Stage) -> Evaluation:
        sides = _beyond(x, p, low, high)
        slope = 1.0 - np.sum(sides, axis=0)
        value = slope * x + np.sum([s * t for s, t in zip(sides, p, strict=True)], axis=0)
        return value, slope, np.array(sides)

    return evaluate


def _polynomial_value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
    total = x * 0.0
    for k in range(stage.size - 1, -1, -1):
        total = (total + p[k]) * x
    return total


def _polynomial(x: Array, p: Array, stage: Stage) -> Evaluation:
    powers = np.ones((stage.size + 1, *x.shape))
    for k in range(stage.size):
        powers[k + 1] = powers[k] * x
    degrees = np.arange(1.0, stage.size + 1)
    return (
        np.tensordot(p, powers[1:], 1),
        np.tensordot(degrees * p, powers[:-1], 1),
        powers[1:],
    )


def _segment(x: Any, t: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Segment k of each x (the outer ones extended), its width, and λ with x = t_k + λ width."""
    k = xp.clip(xp.searchsorted(t, x, side="right") - 1, 0, len(t) - 2)
    width = t[k + 1] - t[k]
    return k, width, (x - t[k]) / width


def _piecewise_value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
    t, v = p[: stage.size], p[stage.size :]
    k, _, part = _segment(x, t, xp)
    return v[k] + part * (v[k + 1] - v[k])


def _piecewise(x: Array, p: Array, stage: Stage) -> Evaluation:
    n = stage.size
    t, v = p[:n], p[n:]
    k, width, part = _segment(x, t, np)
    slope = (v[k + 1] - v[k]) / width
    hats = np.zeros((n, x.size))
    at = np.arange(x.size)
    hats[k.ravel(), at] = 1.0 - part.ravel()
    hats[k.ravel() + 1, at] = part.ravel()
    hats = hats.reshape(n, *x.shape)
    # moving a point sideways by δ moves the line there by −slope δ
    return v[k] + part * (v[k + 1] - v[k]), slope, np.concatenate([-slope * hats, hats])


@lru_cache(maxsize=64)
def _curvatures(knots: tuple[float, ...]) -> Array:
    """Matrix K with s″(t_k) = (K v)_k of the natural cubic spline (de Boor 1978, ch. IV)."""
    n, h = len(knots), np.diff(knots)
    left, right = np.eye(n), np.zeros((n, n))
    for k in range(1, n - 1):
        left[k, k - 1 : k + 2] = h[k - 1], 2.0 * (h[k - 1] + h[k]), h[k]
        right[k, k - 1 : k + 2] = (
            6.0 / h[k - 1],
            -6.0 / h[k - 1] - 6.0 / h[k],
            6.0 / h[k],
        )
    return np.asarray(np.linalg.solve(left, right), dtype=np.float64)


def spline_knots(stage: Stage) -> Array:
    """Abscissae of a spline; −1 … 1 as long as none were read off the data."""
    return np.array(stage.knots or np.linspace(-1.0, 1.0, stage.size))


def _spline_value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
    knots = spline_knots(stage)
    m = xp.asarray(_curvatures(tuple(knots.tolist()))) @ p
    t = xp.asarray(knots)
    k, h, part = _segment(x, t, xp)
    inside = xp.clip(part, 0.0, 1.0)
    beyond = (part - inside) * h
    a, b = 1.0 - inside, inside
    value = a * p[k] + b * p[k + 1] + ((a**3 - a) * m[k] + (b**3 - b) * m[k + 1]) * h**2 / 6.0
    slope = (p[k + 1] - p[k]) / h + ((1 - 3 * a**2) * m[k] + (3 * b**2 - 1) * m[k + 1]) * h / 6.0
    return value + slope * beyond


def _spline(x: Array, p: Array, stage: Stage) -> Evaluation:
    t = spline_knots(stage)
    K = _curvatures(tuple(t.tolist()))
    m = K @ p
    k, h, part = _segment(x, t, np)
    inside = np.clip(part, 0.0, 1.0)
    beyond = (part - inside) * h
    a, b = 1.0 - inside, inside
    # weights of v_k, v_{k+1} and of the curvatures there, in the value extended straight on
    slope_a, slope_b = (1.0 - 3.0 * a**2) * h / 6.0, (3.0 * b**2 - 1.0) * h / 6.0
    wa, wb = a - beyond / h, b + beyond / h
    ca = (a**3 - a) * h**2 / 6.0 + beyond * slope_a
    cb = (b**3 - b) * h**2 / 6.0 + beyond * slope_b
    value = wa * p[k] + wb * p[k + 1] + ca * m[k] + cb * m[k + 1]
    slope = (p[k + 1] - p[k]) / h + slope_a * m[k] + slope_b * m[k + 1]
    partials = K[k.ravel()].T * ca.ravel() + K[k.ravel() + 1].T * cb.ravel()
    at = np.arange(x.size)
    partials[k.ravel(), at] += wa.ravel()
    partials[k.ravel() + 1, at] += wb.ravel()
    return value, slope, partials.reshape(len(t), *x.shape)


def _numbered(letter: str) -> Callable[[int], tuple[str, ...]]:
    return lambda size: tuple(f"{letter}{k}" for k in range(1, size + 1))


def _points(size: int) -> tuple[str, ...]:
    return (*_numbered("x")(size), *_numbered("y")(size))


def _named(*names: str) -> Callable[[int], tuple[str, ...]]:
    return lambda size: names


def _edged(
    name: str, letter: str, value: Callable[..., Any], evaluate: Callable[..., Any]
) -> dict[str, Kind]:
    """A kind with a lower and an upper edge, and those with one of them alone."""
    low, high = f"{letter}_low", f"{letter}_high"
    both = Kind(_named(low, high), value(True, True), evaluate(True, True), ordered=lambda size: 2)
    return {
        name: both,
        f"{name}-lower": Kind(_named(low), value(True, False), evaluate(True, False)),
        f"{name}-upper": Kind(_named(high), value(False, True), evaluate(False, True)),
    }


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "identity": Kind(lambda size: (), lambda x, p, s, xp: x, _identity),
        "abs": Kind(_named("c"), lambda x, p, s, xp: xp.abs(x - p[0]), _abs),
        **_edged("dead-zone", "d", _dead_zone_value, _dead_zone),
        **_edged("saturation", "s", _saturation_value, _saturation),
        "polynomial": Kind(
            _numbered("p"), _polynomial_value, _polynomial, smallest=1, has_gain=True
        ),
        "piecewise": Kind(
            _points,
            _piecewise_value,
            _piecewise,
            smallest=2,
            has_gain=True,
            has_offset=True,
            ordered=lambda size: size,
        ),
        "spline": Kind(
            _numbered("y"), _spline_value, _spline, smallest=3, has_gain=True, has_offset=True
        ),
    }
)
