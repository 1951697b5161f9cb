"""Starts of a NARX network: scaled regressors, a dictionary of units, forward selection.

The regressors of one output are scaled, those the network is to see are turned to their principal
components and stretched over [−1, 1]. A dictionary of units covers the data there; products and
units are then added to the linear part one by one, the one that explains most first (orthogonal
least squares: Zhang 1997; Chen, Billings & Luo 1989). The number of them is bounded by generalised
cross-validation, N V/(N − p)² with p parameters (Craven & Wahba 1979).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement, product

import numpy as np

from sysid.data.record import Array, Index
from sysid.structures.difference_equations.frols import Path, forward, gram_beyond
from sysid.structures.narx.wavelet_network import KINDS, RowDesign, linear_in

POOL = 400
"""Candidate products at most."""

CELLS = 80
"""Cells of one level of the frame at most; a draw decides between more."""

LEVELS = 4
SAMPLES = 2000
"""Rows that choose the units; amplitudes come from all of them."""

DRAWN = 300
"""Random neurons to choose from."""

UNITS = 700
"""Candidate units of all groups at most."""

SMALL = 0.02
"""Principal components below this share of the largest carry nothing but noise."""

LIKELY = 0.5
"""Usual amplitude of a unit or product in spreads of the output."""

RIDGE = 1e-7
"""Ridge on columns of unit norm: amplitudes of neighbouring units must not cancel each other."""


def scaled_design(x: Array, margin: float) -> RowDesign:
    """A linear row with the scaling and the support of regressors x (N, d)."""
    mean, scale = x.mean(axis=0), x.std(axis=0)
    scale = np.where(scale > 1e-12 * np.maximum(np.abs(mean), 1e-300), scale, 1.0)
    low, high = x.min(axis=0), x.max(axis=0)
    slack = margin * (high - low)
    return RowDesign(
        tuple(mean.tolist()),
        tuple(scale.tolist()),
        tuple(((low - slack - mean) / scale).tolist()),
        tuple(((high + slack - mean) / scale).tolist()),
    )


def scaled(design: RowDesign, x: Array) -> Array:
    """z = (x − x̄)/σ inside the support."""
    z = (x - np.array(design.mean)) / np.array(design.scale)
    return np.asarray(np.clip(z, design.low, design.high))


def projected(design: RowDesign, x: Array, seen: Sequence[int], most: int) -> RowDesign:
    """The design with Q: the first principal components of some regressors, scaled to [−1, 1]."""
    z = scaled(design, x)
    where = np.asarray(seen, dtype=int)
    _, s, Vt = np.linalg.svd(np.linalg.qr(z[:, where], mode="r"))
    keep = int(np.sum(s > SMALL * s.max(initial=0.0)))
    Q = np.zeros((z.shape[1], max(min(keep, most), 1)))
    # the sign of a principal component is arbitrary: fixed, so that it does not depend on LAPACK
    V = Vt[: Q.shape[1]].T
    V = V * np.where(V[np.argmax(np.abs(V), axis=0), np.arange(V.shape[1])] < 0, -1.0, 1.0)
    Q[where] = V
    reach = np.abs(z @ Q).max(axis=0)
    Q /= np.where(reach > 0.0, reach, 1.0)
    return replace(design, projection=tuple(tuple(row) for row in Q.tolist()))


def separate(design: RowDesign, x: Array) -> RowDesign:
    """The design with Q: each regressor by itself, scaled to [−1, 1]."""
    reach = np.abs(scaled(design, x)).max(axis=0)
    Q = np.diag(1.0 / np.where(reach > 0.0, reach, 1.0))
    return replace(design, projection=tuple(tuple(row) for row in Q.tolist()))


# ----------------------------------------------------------------------------- dictionaries

Units = tuple[Array, Array, Array]
"""Shape (M,), place (M, q) and flag (M,) of candidate units."""


def _cells(v: Array, width: float, rng: np.random.Generator) -> Array:
    """Centres of the grid cells of this width that hold data, (M, q)."""
    codes = np.round(v / width).astype(int)
    low = codes.min(axis=0)
    spans = codes.max(axis=0) - low + 1
    # one number a cell, in the same order: numpy finds unique rows far more slowly
    flat = np.ravel_multi_index(tuple((codes - low).T), tuple(spans.tolist()))
    cells, count = np.unique(flat, return_counts=True)
    indices = np.stack(np.unravel_index(cells, tuple(spans.tolist())), axis=1) + low
    enough = indices[count >= max(3, len(v) // 1000)]
    if len(enough) > CELLS:
        enough = enough[np.sort(rng.choice(len(enough), CELLS, replace=False))]
    return np.asarray(enough * width)


def _dyadic(v: Array, rng: np.random.Generator) -> Units:
    """Scaling functions and wavelets at dilations 1, 2, 4 … on grids as wide as they are."""
    shape, place, flag = [], [], []
    for level in range(LEVELS):
        dilation = 2.0**level
        centres = _cells(v, 1.0 / dilation, rng)
        for kind in (0.0, 1.0):
            shape.append(np.full(len(centres), dilation))
            place.append(centres)
            flag.append(np.full(len(centres), kind))
    return np.concatenate(shape), np.concatenate(place), np.concatenate(flag)


def _boxes(v: Array, rng: np.random.Generator) -> Units:
    """Cells of dyadic grids."""
    shape, place = [], []
    for level in range(LEVELS + 1):
        width = 2.0**-level
        centres = _cells(v, width, rng)
        shape.append(np.full(len(centres), 2.0 / width))
        place.append(centres)
    s = np.concatenate(shape)
    return s, np.concatenate(place), np.zeros_like(s)


def _harmonics(v: Array, rng: np.random.Generator) -> Units:
    """cos and sin of (π/2) k·v for small whole k, one of k and −k."""
    q = v.shape[1]
    waves = [k for k in product(range(-3, 4), repeat=q) if 0 < sum(map(abs, k)) <= 4]
    waves = [k for k in waves if next(n for n in k if n) > 0]
    place = np.pi / 2.0 * np.array(waves, dtype=np.float64)
    if len(place) > DRAWN:
        place = place[np.sort(rng.choice(len(place), DRAWN, replace=False))]
    shape = np.repeat([0.0, -np.pi / 2.0], len(place))
    return shape, np.concatenate([place, place]), np.zeros(len(shape))


def _neurons(v: Array, rng: np.random.Generator) -> Units:
    """Tangents of random direction and steepness whose middle lies at a random sample."""
    direction = rng.normal(size=(DRAWN, v.shape[1]))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    place = direction * 2.0 ** rng.integers(0, 4, DRAWN)[:, None]
    middle = v[rng.integers(0, len(v), DRAWN)]
    return -np.sum(place * middle, axis=1), place, np.zeros(DRAWN)


DICTIONARIES: Mapping[str, Callable[[Array, np.random.Generator], Units]] = {
    "wavelet": _dyadic,
    "piecewise-constant": _boxes,
    "fourier": _harmonics,
    "neural": _neurons,
}
"""Candidate units of each estimator for data v (N, q)."""


# ----------------------------------------------------------------------------- selection


def product_pool(d: int, degree: int) -> list[tuple[int, ...]]:
    """Products of degree 2 … ``degree`` of the first regressors, as many as the pool can hold."""
    most = d
    while True:
        pool = [
            t for k in range(2, degree + 1) for t in combinations_with_replacement(range(most), k)
        ]
        if len(pool) <= POOL or most <= 2:
            return pool
        most -= 1


def product_columns(z: Array, terms: Sequence[tuple[int, ...]]) -> Array:
    """Values of products for z (N, d), (N, T)."""
    out = np.ones((len(z), len(terms)))
    for k, t in enumerate(terms):
        for j in t:
            out[:, k] *= z[:, j]
    return out


def select_products(
    design: RowDesign, x: Array, y: Array, degree: int, most: int
) -> tuple[tuple[tuple[int, ...], ...], int]:
    """Products in the order of what they explain beyond the linear part, and how many of them
    generalised cross-validation allows."""
    pool = product_pool(x.shape[1], degree)
    if not pool:
        return (), 0
    rows = _rows(len(y))
    z = scaled(design, x[rows])
    columns = Candidates(product_columns(z, pool))
    order, allowed = _ordered(z, columns, y[rows], None, most)
    return tuple(pool[k] for k in order), allowed


@dataclass(frozen=True, eq=False)
class Candidates:
    """Columns to select from.

    Attributes:
        values: on the rows that choose, (rows, M).
    """

    values: Array

    @cached_property
    def products(self) -> Array:
        """valuesᵀ values, (M, M)."""
        return self.values.T @ self.values


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Candidate units and their values.

    Attributes:
        shape, place, flag: of the units, (M,), (M, q), (M,).
        owners: columns of Q that each unit sees.
        separate: whether units see different columns.
    """

    shape: Array
    place: Array
    flag: Array
    owners: tuple[tuple[int, ...], ...]
    columns: Candidates
    separate: bool


def dictionary(
    design: RowDesign, x: Array, estimator: str, seed: int, views: Sequence[tuple[int, ...]] = ()
) -> Dictionary:
    """Candidate units over the design's Q; with ``views`` each sees the columns one of them names.

    It does not depend on the products of the design: one serves maps of all degrees.
    """
    z = scaled(design, x[_rows(len(x))])
    v, kind = z @ np.array(design.projection), KINDS[estimator]
    units_of_dictionary: list[Units] = []
    values: list[Array] = []
    owners: list[tuple[int, ...]] = []
    rng = np.random.default_rng(seed)
    for view in views or [tuple(range(v.shape[1]))]:
        part = v[:, view]
        units = _thinned(DICTIONARIES[estimator](part, rng), max(len(views), 1), rng)
        dim = np.full(len(units[0]), float(len(view)))
        values.append(kind.value(np, part[:, None, :], *units, dim))
        units_of_dictionary.append(units)
        owners += [view] * len(units[0])
    shape, place, flag = (np.concatenate(parts) for parts in zip(*units_of_dictionary, strict=True))
    columns = Candidates(np.concatenate(values, axis=1))
    return Dictionary(shape, place, flag, tuple(owners), columns, bool(views))


@dataclass(frozen=True, eq=False)
class Selection:
    """Units in the order in which they were added.

    Attributes:
        candidates: all units.
        order: indices into them.
        most: number that generalised cross-validation allows.
    """

    candidates: Dictionary
    order: Sequence[int]
    most: int

    def leading(self, design: RowDesign, count: int) -> tuple[RowDesign, Units]:
        """The design with the first ``count`` units, and these."""
        c, kept = self.candidates, list(self.order[:count])
        units = (c.shape[kept], c.place[kept], c.flag[kept])
        views = tuple(c.owners[k] for k in kept) if c.separate else ()
        return replace(design, flags=tuple(int(f) for f in units[2]), views=views), units


def select_units(
    design: RowDesign, x: Array, y: Array, candidates: Dictionary, most: int
) -> Selection:
    """Units added to the linear part and the design's products."""
    rows = _rows(len(y))
    z = scaled(design, x[rows])
    given = product_columns(z, design.terms)
    return Selection(candidates, *_ordered(z, candidates.columns, y[rows], given, most))


def _thinned(units: Units, groups: int, rng: np.random.Generator) -> Units:
    """At most UNITS candidates in all groups together."""
    most = max(UNITS // groups, 8)
    if len(units[0]) <= most:
        return units
    kept = np.sort(rng.choice(len(units[0]), most, replace=False))
    return units[0][kept], units[1][kept], units[2][kept]


def _rows(count: int) -> Index:
    if count <= SAMPLES:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, SAMPLES).astype(int))


def _ordered(
    z: Array, candidates: Candidates, y: Array, given: Array | None, most: int
) -> tuple[list[int], int]:
    """Candidates in the order chosen, and how many generalised cross-validation allows."""
    # what the linear part explains is taken out first: it is always there
    fixed = [np.ones((len(z), 1)), z, *(() if given is None else (given,))]
    always = np.concatenate(fixed, axis=1)
    gram, usable, rank = gram_beyond(always, candidates.values, y, candidates.products)
    path = forward(gram, usable, min(most, len(y) // 4))
    return path.order.tolist(), cross_validated_size(path, rank, len(y))


def cross_validated_size(path: Path, given: int, samples: int) -> int:
    """Number of added columns at which N V/(N − p)² is smallest."""
    count = np.arange(len(path.order) + 1)
    unexplained = np.concatenate([[1.0], path.unexplained()])
    return int(np.argmin(unexplained / np.maximum(1.0 - (given + count) / samples, 1e-3) ** 2))


def least_squares(design: RowDesign, estimator: str, x: Array, y: Array, units: Units) -> Array:
    """θ of a row with these units: amplitudes by least squares, lightly ridged."""
    shape, place, flag = units
    f = design.frame()._replace(flag=flag)
    blocks = linear_in(np, KINDS[estimator], f, shape, place, x)
    A = np.concatenate([np.ones((len(x), 1)), *blocks.values()], axis=1)
    norms = np.linalg.norm(A, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    A = A / norms
    n, linear = A.shape[1], 1 + x.shape[1]
    ridge = np.full(n, RIDGE)
    ridge[:linear] = 1e-14
    c = _ridged(A, y, ridge)
    if n > linear:
        # amplitudes of about LIKELY spreads of the output are as likely as noise of the size found
        noise = float(np.sum((y - A @ c) ** 2)) / max(len(y) - n, 1)
        prior = noise / (LIKELY * max(float(np.std(y)), 1e-300)) ** 2
        ridge[linear:] = np.maximum(RIDGE, prior / norms[linear:] ** 2)
        c = _ridged(A, y, ridge)
    return np.concatenate([c / norms, shape, place.ravel()])


def _ridged(A: Array, y: Array, ridge: Array) -> Array:
    """argmin ‖y − A c‖² + Σ ridge c², one step of refinement after the normal equations."""
    G = A.T @ A + np.diag(ridge)
    c = np.linalg.solve(G, A.T @ y)
    return np.asarray(c + np.linalg.solve(G, A.T @ (y - A @ c) - ridge * c))
