"""Static nonlinearities of one channel: a closed table of kinds, and their compositions.

A static is a chain of stages, each of one kind with parameters of its own:

    identity           x
    abs                |x − c|
    dead-zone          x − d_high above d_high, x − d_low below d_low, 0 between
    dead-zone-upper    x − d_high above d_high, 0 below      (dead-zone-lower: the other side)
    saturation         x limited to s_low … s_high
    saturation-upper   x limited to at most s_high           (saturation-lower: at least s_low)
    polynomial:n       p₁ x + p₂ x² + … + p_n xⁿ
    piecewise:n        straight lines through (x₁, y₁) … (x_n, y_n), the last ones extended
    spline:n           natural cubic spline through n points at given abscissae, extended straight

As text stages are joined by commas, the first one first: ``abs,polynomial:3``. Extensions beyond
the data are straight lines, because a cubic's go wherever they like (Schoukens & Tiels 2017).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.errors import UsageError

MAX_SIZE = 40
"""Largest number of points or highest degree: more than any log of a machine supports."""

EXAMPLES = "dead-zone, piecewise:8 or abs,polynomial:3"


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
        """Names of its parameters."""
        return KINDS[self.kind].names(self.size)

    def evaluated(self, x: Array, p: Array) -> tuple[Array, Array, Array]:
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
    evaluate: Callable[[Array, Array, Stage], tuple[Array, Array, Array]]
    smallest: int = 0
    has_gain: bool = False
    has_offset: bool = False
    ordered: Callable[[int], int] = lambda size: 0  # noqa: E731 (a field's default)


@dataclass(frozen=True)
class Static:
    """A chain of stages; its parameters p are those of the stages, one after the other."""

    stages: tuple[Stage, ...] = ()

    @property
    def text(self) -> str:
        """The static as users type it."""
        return ",".join(s.text for s in self.stages) or "identity"

    @property
    def is_identity(self) -> bool:
        """Whether nothing is done."""
        return not self.stages

    @property
    def has_gain(self) -> bool:
        """Whether a factor of the signal could be moved into its parameters."""
        return any(KINDS[s.kind].has_gain for s in self.stages)

    @property
    def has_offset(self) -> bool:
        """Whether its parameters can add any constant to its value."""
        return bool(self.stages) and KINDS[self.stages[-1].kind].has_offset

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(n for s in self.stages for n in s.names)

    @property
    def n(self) -> int:
        """Number of parameters."""
        return len(self.names)

    def slices(self) -> tuple[slice, ...]:
        """Where each stage's parameters stand."""
        edges = np.cumsum([0, *(len(s.names) for s in self.stages)]).tolist()
        return tuple(slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True))

    def value(self, x: Any, p: Any, xp: Any = np) -> Any:
        """f(x), over any array namespace."""
        for stage, part in zip(self.stages, self.slices(), strict=True):
            x = stage.value(x, p[part], xp)
        return x

    def evaluated(self, x: Array, p: Array) -> tuple[Array, Array, Array]:
        """(f(x), ∂f/∂x, ∂f/∂p (n, …)) by the chain rule."""
        slope = np.ones_like(x)
        partials: list[Array] = []
        for stage, part in zip(self.stages, self.slices(), strict=True):
            x, inner, own = stage.evaluated(x, p[part])
            partials = [*(d * inner for d in partials), own]
            slope = slope * inner
        return x, slope, np.concatenate(partials) if partials else np.zeros((0, *x.shape))

    def admissible(self, p: Array) -> bool:
        """Whether limits and points stand in increasing order."""
        for stage, part in zip(self.stages, self.slices(), strict=True):
            rising = p[part][: KINDS[stage.kind].ordered(stage.size)]
            if np.any(np.diff(rising) <= 0.0):
                return False
        return True

    def to_json(self) -> dict[str, Any]:
        """{text, knots}: what ``from_json`` needs."""
        return {"text": self.text, "knots": [list(s.knots) for s in self.stages]}

    @staticmethod
    def from_json(raw: Mapping[str, Any]) -> "Static":
        """Undo ``to_json``."""
        plain = parse_static(str(raw["text"]))
        knots = [tuple(float(t) for t in row) for row in raw["knots"]]
        return Static(tuple(replace(s, knots=k) for s, k in zip(plain.stages, knots, strict=True)))


def parse_static(text: str) -> Static:
    """Read ``dead-zone``, ``piecewise:8`` or ``abs,polynomial:3``.

    Raises:
        UsageError: a kind does not exist, occurs twice, or its size is missing or absurd.
    """
    stages: list[Stage] = []
    for item in text.replace(" ", "").lower().split(","):
        kind, colon, number = item.partition(":")
        if kind not in KINDS:
            raise UsageError(
                f"--option: there is no static {item!r}; the kinds are {', '.join(KINDS)}, joined "
                f"by commas, e.g. {EXAMPLES}"
            )
        least = KINDS[kind].smallest
        if least and not (number.isdigit() and least <= int(number) <= MAX_SIZE):
            raise UsageError(
                f"--option: {item!r} needs a size from {least} to {MAX_SIZE}, "
                f"e.g. {kind}:{max(least, 5)}"
            )
        if colon and not least:
            raise UsageError(f"--option: {kind} has no size; write {kind} instead of {item!r}")
        if kind == "identity":
            continue
        stage = Stage(kind, int(number) if least else 0)
        if set(stage.names) & {n for s in stages for n in s.names}:
            raise UsageError(f"--option: {text!r} has two stages with the same parameters")
        stages.append(stage)
    return Static(tuple(stages))


IDENTITY = Static()


def _none(size: int) -> tuple[str, ...]:
    return ()


def _identity(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
    return x, np.ones_like(x), np.zeros((0, *x.shape))


def _abs(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
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


def _dead_zone(low: bool, high: bool) -> Callable[..., tuple[Array, Array, Array]]:
    def evaluate(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
        sides = []
        if low:
            sides.append((x < p[0]).astype(np.float64))
        if high:
            sides.append((x > p[-1]).astype(np.float64))
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


def _saturation(low: bool, high: bool) -> Callable[..., tuple[Array, Array, Array]]:
    def evaluate(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
        sides = []
        if low:
            sides.append((x < p[0]).astype(np.float64))
        if high:
            sides.append((x > p[-1]).astype(np.float64))
        slope = 1.0 - np.sum(sides, axis=0)
        value = slope * x + np.sum([s * t for s, t in zip(sides, p, strict=True)], axis=0)
        return value, slope, np.array(sides)

    return evaluate


def _polynomial_value(x: Any, p: Any, stage: Stage, xp: Any) -> Any:
    total = x * 0.0
    for k in range(stage.size - 1, -1, -1):
        total = (total + p[k]) * x
    return total


def _polynomial(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
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


def _piecewise(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
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
    return np.linalg.solve(left, right)


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


def _spline(x: Array, p: Array, stage: Stage) -> tuple[Array, Array, Array]:
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


def _two(size: int) -> int:
    return 2


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "identity": Kind(_none, lambda x, p, s, xp: x, _identity),
        "abs": Kind(_named("c"), lambda x, p, s, xp: xp.abs(x - p[0]), _abs),
        "dead-zone": Kind(
            _named("d_low", "d_high"),
            _dead_zone_value(True, True),
            _dead_zone(True, True),
            ordered=_two,
        ),
        "dead-zone-lower": Kind(
            _named("d_low"), _dead_zone_value(True, False), _dead_zone(True, False)
        ),
        "dead-zone-upper": Kind(
            _named("d_high"), _dead_zone_value(False, True), _dead_zone(False, True)
        ),
        "saturation": Kind(
            _named("s_low", "s_high"),
            _saturation_value(True, True),
            _saturation(True, True),
            ordered=_two,
        ),
        "saturation-lower": Kind(
            _named("s_low"), _saturation_value(True, False), _saturation(True, False)
        ),
        "saturation-upper": Kind(
            _named("s_high"), _saturation_value(False, True), _saturation(False, True)
        ),
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
