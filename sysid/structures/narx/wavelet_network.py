"""The nonlinear map of a NARX model: linear part, low-degree products, and a network of units.

With z = (x − x̄)/σ the scaled regressors, z̃ the same kept inside the training range, and v = z̃ Q
their principal components,

    ŷ = y₀ + (x − x̄) L + Σ_k p_k Π z̃ + Σ_s a_s f(b_s (v − c_s)) + Σ_w a_w g(b_w (v − c_w)),
    f(v) = exp(−½ vvᵀ)          g(v) = (dim v − vvᵀ) exp(−½ vvᵀ)

(Zhang 1997, "Using wavelet network in nonparametric estimation", IEEE TNN 8(2), eq. 7). Outside the
data only the linear part goes on; everything else stays at its value on the edge. Other kinds of
unit stand in the places of f and g: boxes (piecewise constant), cosines, hyperbolic tangents.
Units may also see single entries of v, Q then being diagonal: an additive network, a curve for each
regressor, in which far fewer data suffice.
Everything here is written over an array namespace, numpy or jax.numpy.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.data.record import Array

Values = Any
"""An array of numpy or jax.numpy."""

DEGREE = 3
"""Largest degree of a product: higher ones win inside the data and ruin outside."""


@dataclass(frozen=True)
class Kind:
    """A kind of nonlinearity estimator.

    Attributes:
        unit: what one unit is called.
        shape: what its shape parameter is called.
        place: what the vector that places it is called.
        smooth: whether shape and place can be refined by a gradient.
        value: (xp, v (…, K, q), s (K,), c (K, q), flag (K,), dim (K,)) → unit values (…, K).
    """

    unit: str
    shape: str
    place: str
    smooth: bool
    value: Callable[..., Values]


def _radial(xp: Any, v: Values, s: Values, c: Values, flag: Values, dim: Values) -> Values:
    t = s[:, None] * (v - c)
    r = (t * t).sum(-1)
    return (1.0 + flag * (dim - 1.0 - r)) * xp.exp(-0.5 * r)


def _box(xp: Any, v: Values, s: Values, c: Values, flag: Values, dim: Values) -> Values:
    return xp.where(xp.max(xp.abs(s[:, None] * (v - c)), axis=-1) <= 1.0, 1.0, 0.0)


def _cosine(xp: Any, v: Values, s: Values, c: Values, flag: Values, dim: Values) -> Values:
    return xp.cos(xp.sum(v * c, axis=-1) + s)


def _tanh(xp: Any, v: Values, s: Values, c: Values, flag: Values, dim: Values) -> Values:
    return xp.tanh(xp.sum(v * c, axis=-1) + s)


KINDS: Mapping[str, Kind] = {
    # scaling functions and wavelets of a dyadic frame, then moved and stretched
    "wavelet": Kind("wavelet", "dilation", "centre", True, _radial),
    "piecewise-constant": Kind("cell", "inverse_width", "centre", False, _box),
    "fourier": Kind("harmonic", "phase", "frequency", True, _cosine),
    "neural": Kind("neuron", "bias", "weight", True, _tanh),
}
"""The estimators, by the name users type."""


class Frame(NamedTuple):
    """What of a row's map is fixed: scaling, support, products and projection, as arrays.

    Attributes:
        mean, scale: of the regressors, (d,).
        low, high: support of z, (d,).
        factors: factors of the products as rows of an identity of size d + 1 (the last entry is
            the constant 1), (3, T, d + 1).
        Q: what each unit sees, (d, K, q).
        flag: 1 for a wavelet, 0 for a scaling function, (K,).
        dim: number of entries of v that each unit sees, (K,).
    """

    mean: Values
    scale: Values
    low: Values
    high: Values
    factors: Values
    Q: Values
    flag: Values
    dim: Values


class Weights(NamedTuple):
    """A row's parameters: y₀, L (d,), p (T,), a (K,), s (K,), c (K, q)."""

    constant: Values
    linear: Values
    products: Values
    amplitude: Values
    shape: Values
    place: Values


def split(theta: Values, d: int, T: int, K: int, q: int) -> Weights:
    """Cut a row's parameter vector into its parts."""
    at = 1 + d + T
    return Weights(
        theta[0],
        theta[1 : 1 + d],
        theta[1 + d : at],
        theta[at : at + K],
        theta[at + K : at + 2 * K],
        theta[at + 2 * K : at + (2 + q) * K].reshape(K, q),
    )


def size(d: int, T: int, K: int, q: int) -> int:
    """Length of a row's parameter vector."""
    return 1 + d + T + K * (2 + q)


def value(xp: Any, kind: Kind, f: Frame, w: Weights, x: Values) -> Values:
    """ŷ for regressors x (…, d), shape (…)."""
    blocks = linear_in(xp, kind, f, w.shape, w.place, x)
    return w.constant + sum(block @ getattr(w, name) for name, block in blocks.items())


def linear_in(
    xp: Any, kind: Kind, f: Frame, shape: Values, place: Values, x: Values
) -> dict[str, Values]:
    """What ŷ is linear in besides y₀, by the name of its coefficients in ``Weights``: x − x̄ (…, d),
    products (…, T) and values of units (…, K), where there are any.
    """
    away = x - f.mean
    blocks = {"linear": away}
    T, K = f.factors.shape[1], f.flag.shape[0]
    if not T and not K:
        return blocks
    z = xp.minimum(xp.maximum(away / f.scale, f.low), f.high)
    if T:
        zx = xp.concatenate([z, xp.ones_like(z[..., :1])], axis=-1)
        a, b, c = (zx @ f.factors[k].T for k in range(DEGREE))
        blocks["products"] = a * b * c
    if K:
        blocks["amplitude"] = kind.value(xp, seen(f.Q, z), shape, place, f.flag, f.dim)
    return blocks


def seen(Q: Values, z: Values) -> Values:
    """v of every unit for scaled regressors z (…, d), (…, K, q)."""
    d, K, q = Q.shape
    return (z @ Q.reshape(d, K * q)).reshape(*z.shape[:-1], K, q)


@dataclass(frozen=True)
class RowDesign:
    """What of one output's map was read off the data, as plain numbers.

    Attributes:
        mean, scale, low, high: of the regressors, see ``Frame``.
        terms: products as indices of their regressors, ascending, two or three each.
        projection: Q row by row; empty rows where there are no units.
        flags: 1 for a wavelet, 0 for a scaling function, one a unit.
        views: columns of Q that each unit sees, equally many; empty where all see all.
    """

    mean: tuple[float, ...]
    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    terms: tuple[tuple[int, ...], ...] = ()
    projection: tuple[tuple[float, ...], ...] = ()
    flags: tuple[int, ...] = ()
    views: tuple[tuple[int, ...], ...] = ()

    @staticmethod
    def plain(d: int) -> "RowDesign":
        """Linear in d regressors, not scaled."""
        return RowDesign((0.0,) * d, (1.0,) * d, (-np.inf,) * d, (np.inf,) * d)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Regressors d, products T, units K, entries q of v that a unit sees."""
        q = len(self.views[0] if self.views else self.projection[0]) if self.flags else 0
        return len(self.mean), len(self.terms), len(self.flags), q

    @property
    def n(self) -> int:
        return size(*self.sizes)

    def frame(self) -> Frame:
        """The same as arrays."""
        d, _, K, q = self.sizes
        Q = np.zeros((d, K, q))
        if K:
            P = np.array(self.projection)
            Q[:] = P[:, list(self.views)] if self.views else P[:, None, :]
        return Frame(
            np.array(self.mean),
            np.array(self.scale),
            np.array(self.low),
            np.array(self.high),
            one_hot(self.terms, d),
            Q,
            np.array(self.flags, dtype=np.float64),
            np.any(Q != 0.0, axis=0).sum(axis=1).astype(np.float64),
        )

    def seen_by_units(self) -> list[int]:
        """Regressors that some unit sees."""
        return np.flatnonzero(np.any(self.frame().Q != 0.0, axis=(1, 2))).tolist()

    def weights(self, theta: Array) -> Weights:
        """A row's parameter vector in parts."""
        return split(theta, *self.sizes)


def one_hot(terms: Sequence[Sequence[int]], d: int) -> Array:
    """Factors of the products as rows of an identity, (DEGREE, T, d + 1)."""
    out = np.zeros((DEGREE, len(terms), d + 1))
    for k, t in enumerate(terms):
        for j in range(DEGREE):
            out[j, k, t[j] if j < len(t) else d] = 1.0
    return out
