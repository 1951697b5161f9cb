"""The picture of a localized path with its 95 % ellipses."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array, frozen
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ELLIPSES = 9
"""As many along a path as darts that show the heading."""
NINETY_FIVE = 5.991464547107979
"""Quantile 0.95 of χ² with two degrees of freedom, −2 ln 0.05."""
COLOUR = style.SERIES[3]


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """What navigation believed at each sample.

    Attributes:
        path: x, y [m], shape (N, 2).
        covariance: P_xx, P_xy, P_yy [m²], shape (N, 3).
    """

    path: Array
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", frozen(self.path, 2))
        object.__setattr__(self, "covariance", frozen(self.covariance, 3))


def draw(axes: "Axes", estimate: PoseEstimate) -> None:
    """Draw the path, and ellipses at equal distances along it."""
    path = estimate.path
    axes.plot(
        *path.T,
        color=COLOUR,
        linewidth=1.3,
        linestyle=(0, (5, 2)),
        label="estimate",
        zorder=3.5,
    )
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    stations = np.linspace(0.0, travelled[-1], ELLIPSES)[1:]
    at = np.unique(np.minimum(np.searchsorted(travelled, stations), len(path) - 1))
    for k, sample in enumerate(at):
        outline = ellipse(path[sample], estimate.covariance[sample])
        label = "95 % of its error" if k == 0 else "_"
        axes.fill(*outline, color=COLOUR, alpha=0.15, linewidth=0, zorder=3.3)
        axes.plot(*outline, color=COLOUR, linewidth=0.8, label=label, zorder=3.4)


def ellipse(centre: Array, covariance: Array, count: int = 73) -> Array:
    """The outline that holds 95 % of a Gaussian, shape (2, count).

    Args:
        centre: x, y [m].
        covariance: P_xx, P_xy, P_yy [m²].
    """
    xx, xy, yy = covariance
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    radii = np.sqrt(NINETY_FIVE * np.maximum(values, 0.0))
    outline: Array = centre[:, None] + vectors @ (radii[:, None] * [np.cos(angle), np.sin(angle)])
    return outline
