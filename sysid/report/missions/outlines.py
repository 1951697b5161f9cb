"""Outlines in the plane: circles, 95 % ellipses, the tube that most of many paths keep to."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array

NINETY_FIVE = 5.991464547107979
"""Quantile 0.95 of χ² with two degrees of freedom, −2 ln 0.05."""

STATIONS = 160
"""Places along the way at which the paths are compared."""

SHARE = 0.9
"""Of the paths that a tube holds, at each place."""

MIN_PATHS = 20
"""With fewer the ends of 90 % are the outermost paths themselves."""


def circle(x: float, y: float, radius: float) -> tuple[Array, Array]:
    """x and y of a closed circle, (73,) each."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    return x + radius * np.cos(angle), y + radius * np.sin(angle)


def ellipse(centre: Array, covariance: Array, count: int = 49) -> Array:
    """The outline that holds 95 % of a Gaussian, (count, 2).

    Args:
        centre: x, y [m].
        covariance: P_xx, P_xy, P_yy [m²].
    """
    xx, xy, yy = covariance
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    radii = np.sqrt(NINETY_FIVE * np.maximum(values, 0.0))
    outline: Array = centre[:, None] + vectors @ (radii[:, None] * [np.cos(angle), np.sin(angle)])
    return outline.T


def tube(paths: Sequence[Array]) -> Array | None:
    """The outline of 90 % of the paths at equal distances travelled s, (n, 2) [m].

    m(s) is the median of the places reached after s, and n(s) the normal of its way; the edges are
    m + n q, with q the 5 % and 95 % quantiles of (p − m)·n. It ends where half of the paths have.

    Args:
        paths: X, Y of each, (N, 2) [m].

    Returns:
        None for fewer paths than a quantile needs, or for such as go nowhere.
    """
    driven = [p for p in paths if len(p) > 1]
    lengths = [np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(p, axis=0).T))]) for p in driven]
    if len(driven) < MIN_PATHS or not (far := float(np.median([s[-1] for s in lengths]))) > 0.0:
        return None
    s = np.linspace(0.0, far, STATIONS)
    places = np.full((len(driven), STATIONS, 2), np.nan)
    for k, (path, way) in enumerate(zip(driven, lengths, strict=True)):
        for j in range(2):
            places[k, :, j] = np.interp(s, way, path[:, j], right=np.nan)
    middle = np.nanmedian(places, axis=0)
    along = np.gradient(middle, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    aside = np.sum((places - middle) * normal, axis=2)
    low, high = np.nanquantile(aside, (0.5 * (1.0 - SHARE), 0.5 * (1.0 + SHARE)), axis=0)
    left, right = middle + normal * high[:, None], middle + normal * low[:, None]
    return np.asarray(np.vstack([left, right[::-1]]))
