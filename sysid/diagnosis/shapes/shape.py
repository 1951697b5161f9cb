"""What a shape is: terms without physics at one place of the chain, with a curve to look at."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.shapes.smoother import Fit
from sysid.diagnosis.shapes.track import Mask, Track


class ShapePlace(Enum):
    """Where errors come from, as far as a shape shows it."""

    COMMAND = "command"
    TORQUE = "torque"
    SPEED = "speed"
    READING = "reading"
    TIME = "time"
    UNUSED = "unused column"


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve with its 95 % band; axes with their units.

    Attributes:
        x, y, low, high: (n,) each.
        steps: whether it jumps rather than bends.
    """

    x_label: str
    y_label: str
    x: Array
    y: Array
    low: Array
    high: Array
    steps: bool = False

    def to_json(self) -> dict[str, Any]:
        """{x_label, y_label, x, y, low, high}."""
        lists = {k: np.round(getattr(self, k), 6).tolist() for k in ("x", "y", "low", "high")}
        return {"x_label": self.x_label, "y_label": self.y_label, **lists}


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of a shape on one track.

    Attributes:
        columns: what they do to the output, one set a value that is scanned, (V, N, k); of one set
            nothing is scanned.
        penalty: on the bend of a curve, (k, k); None for plain terms.
        beside: columns that the terms are judged beside and that are not theirs, (N, q).
        says: fit and index of the scanned value → a sentence and the curve; the noise's standard
            deviation is the third argument.
    """

    columns: Array
    says: "Callable[[Fit, int, float], tuple[str, Curve | None]]"
    penalty: Array | None = None
    beside: Array | None = None


@dataclass(frozen=True)
class Shape:
    """One kind of shape.

    Attributes:
        of_motion: whether it needs something that turns or moves.
        of_speed: whether its terms hold the speed, and are fitted again with the one simulated.
        of_level: whether it moves the level of the output all along, as a drift does.
        terms: a track → its terms; None where the log cannot show the shape.
    """

    id: str
    place: ShapePlace
    terms: Callable[[Track], Terms | None]
    of_motion: bool = False
    of_speed: bool = False
    of_level: bool = False

    @property
    def in_time(self) -> bool:
        """Whether it belongs to the clock of one log."""
        return self.place is ShapePlace.TIME


def best_of_scan(error: Array, own: Array, columns: Array, rows: Mask) -> tuple[int, Array]:
    """(index, rss) of sets of columns, each fitted beside the unpenalised ones.

    Args:
        columns: (V, N, k).
    """
    from sysid.diagnosis.validation.error_tests import orthonormal

    V, _, k = columns.shape
    Q = orthonormal(own[rows])
    e = error[rows] - Q @ (Q.T @ error[rows])
    X = np.moveaxis(columns[:, rows], 0, 1).reshape(len(e), V * k)
    X = X - Q @ (Q.T @ X)
    size = np.sqrt(np.sum(X**2, axis=0))
    X = np.divide(X, size, out=np.zeros_like(X), where=size > 1e-9 * max(float(size.max()), 1e-300))
    sets = X.reshape(len(e), V, k)
    gram = np.einsum("nvi,nvj->vij", sets, sets) + 1e-9 * np.eye(k)
    side = np.einsum("nvi,n->vi", sets, e)
    gain = np.einsum("vi,vi->v", side, np.linalg.solve(gram, side[..., None])[..., 0])
    rss = float(e @ e) - gain
    return int(np.argmin(rss)), rss
