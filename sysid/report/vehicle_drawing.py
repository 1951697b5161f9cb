"""The picture of a vehicle from above: body, wheels, their axles and the centre of rotation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Point = tuple[float, float]

_HEIGHT = 6.2
_MARGIN = 0.25
"""Room around what is drawn, as a share of it."""
_FARTHEST = 2.0
"""Sizes of the vehicle up to which a centre of turning is shown in its place, not by an arrow."""

KINDS = {
    "fixed": ("fixed", style.BLUE),
    "steerable": ("steerable", style.VERMILION),
    "caster": ("caster", style.MUTED),
    "swedish": ("Swedish", style.GREEN),
}


@dataclass(frozen=True)
class WheelMark:
    """One wheel as it is drawn.

    Attributes:
        axis: x, y of its axis [m].
        contact: x, y of its contact [m].
        direction: in which it rolls [rad].
        radius, width: [m].
        roller: of a Swedish wheel [rad].
        note: a line below its name, such as its speed.
        velocity: of its contact [m/s], where a motion is drawn.
    """

    name: str
    kind: str
    axis: Point
    contact: Point
    direction: float
    radius: float
    width: float
    roller: float = 0.0
    note: str = ""
    velocity: Point | None = None


@dataclass(frozen=True, eq=False)
class VehiclePicture:
    """What a picture of a vehicle shows.

    Attributes:
        box: x and y of the body's middle, length, width [m]; None where it is not known.
        centre: of turning [m], or a point of the line of possible ones.
        line: direction of that line, or None.
        mass_centre: x, y [m].
        tracks: x and y of the middle, length and width of each [m].
    """

    title: str
    subtitle: str
    wheels: Sequence[WheelMark]
    box: tuple[float, float, float, float] | None = None
    centre: Point | None = None
    line: Point | None = None
    mass_centre: Point | None = None
    tracks: Sequence[tuple[float, float, float, float]] = ()

    def draw(self, figure: "Figure") -> None:
        """Draw the vehicle with x to the right and y up, in metres."""
        style.heading(figure, 0.7 + _HEIGHT, self.title, self.subtitle)
        axes = figure.add_subplot()
        low, high = _extent(self)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal", adjustable="box")
        _draw_body(axes, self)
        shown = [k for k in KINDS if any(w.kind == k for w in self.wheels)]
        for mark in self.wheels:
            _draw_wheel(axes, mark, _size(self))
        _draw_names(axes, self)
        _draw_velocities(axes, self)
        entries = {f"{KINDS[k][0]} wheel": (KINDS[k][1], 5.0) for k in shown}
        if any(w.kind in ("fixed", "steerable") for w in self.wheels):
            entries["axle"] = (style.FAINT, 1.2)
        if self.line is not None:
            entries["possible centres of turning"] = (style.INK, 1.4)
        if any(w.velocity for w in self.wheels):
            entries["velocity"] = (style.INK, 1.4)
        style.legend_above(axes, entries)
        _draw_centre(axes, self, low, high)
        axes.set_xlabel("x, forward [m]")
        axes.set_ylabel("y, to the left [m]")


def _corners(picture: VehiclePicture) -> Array:
    """Points that the vehicle itself covers, (n, 2)."""
    points = []
    for wheel in picture.wheels:
        (x, y), reach = wheel.contact, max(wheel.radius, wheel.width)
        points += [(x - reach, y - reach), (x + reach, y + reach), wheel.axis]
    for x, y, length, width in (*picture.tracks, *([picture.box] if picture.box else [])):
        points += [(x - length / 2, y - width / 2), (x + length / 2, y + width / 2)]
    return np.array([*points, (0.0, 0.0)])


def _size(picture: VehiclePicture) -> float:
    return float(np.ptp(_corners(picture), axis=0).max())


def _near(picture: VehiclePicture) -> bool:
    """Whether the centre of turning has its place in the picture."""
    if picture.centre is None:
        return False
    middle = _corners(picture).mean(axis=0)
    return math.dist(picture.centre, tuple(middle)) <= _FARTHEST * _size(picture)


def _extent(picture: VehiclePicture) -> tuple[Array, Array]:
    points = _corners(picture)
    if picture.centre is not None and _near(picture):
        points = np.vstack([points, picture.centre])
    low, high = points.min(axis=0), points.max(axis=0)
    room = _MARGIN * float((high - low).max())
    return low - room, high + room


def _draw_body(axes: "Axes", picture: VehiclePicture) -> None:
    boxes = [(picture.box, style.BAND)] if picture.box else []
    for (x, y, length, width), colour in (*boxes, *((t, style.FAINT) for t in picture.tracks)):
        across = np.array([-1, 1, 1, -1]) * length / 2
        up = np.array([-1, -1, 1, 1]) * width / 2
        axes.fill(x + across, y + up, facecolor=colour, edgecolor=style.MUTED, zorder=1)
    reach = 0.12 * _size(picture)
    for tip, word in (((reach, 0.0), "x"), ((0.0, reach), "y")):
        style.arrow(axes, (0.0, 0.0), tip, color=style.MUTED)
        style.words(axes, word, tip, (3, 3), color=style.MUTED)
    if picture.mass_centre is not None:
        axes.plot(*picture.mass_centre, "P", markersize=7, color=style.INK, zorder=4)
        at = picture.mass_centre
        style.words(axes, "centre of mass", at, (6, -6), va="top", color=style.MUTED)


def _draw_wheel(axes: "Axes", mark: WheelMark, size: float) -> None:
    colour = KINDS[mark.kind][1]
    along = np.array([math.cos(mark.direction), math.sin(mark.direction)])
    left = np.array([-along[1], along[0]])
    middle, half = np.array(mark.contact), (mark.radius, mark.width / 2)
    corners = [
        middle + a * half[0] * along + b * half[1] * left
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    axes.fill(*np.array(corners).T, facecolor=colour, edgecolor=style.INK, linewidth=0.6, zorder=3)
    if mark.kind in ("fixed", "steerable"):
        axes.axline(
            tuple(middle), tuple(middle + size * left), color=style.FAINT, linewidth=1.2, zorder=0.5
        )
    if mark.kind in ("steerable", "caster"):
        axes.plot(*zip(mark.axis, mark.contact, strict=True), color=style.INK, zorder=4)
        axes.plot(*mark.axis, marker="o", markersize=4, color=style.INK, zorder=5)
    if mark.kind == "swedish":
        turned = mark.direction + mark.roller
        roller = np.array([math.cos(turned), math.sin(turned)])
        reach = min(half[1] / max(abs(float(roller @ left)), 1e-9), half[0] / 2)
        for share in (-0.6, -0.2, 0.2, 0.6):
            ends = middle + share * half[0] * along + np.outer((-reach, reach), roller)
            axes.plot(*ends.T, color="white", linewidth=1.2, zorder=4)


def _draw_names(axes: "Axes", picture: VehiclePicture) -> None:
    """Names stand outside: away from the middle of the wheels."""
    middle = np.mean([w.contact for w in picture.wheels], axis=0)
    for mark in picture.wheels:
        up = mark.contact[1] >= middle[1] - 1e-9
        reach = abs(math.sin(mark.direction)) * mark.radius
        reach += abs(math.cos(mark.direction)) * mark.width / 2
        for k, words in enumerate((mark.note, mark.name) if up else (mark.name, mark.note)):
            away = 4 + (k if mark.note else 0) * 1.3 * style.SMALL
            at = (mark.contact[0], mark.contact[1] + (reach if up else -reach))
            shift, side = (0, away if up else -away), "bottom" if up else "top"
            style.words(axes, words, at, shift, ha="center", va=side, zorder=6)


def _draw_velocities(axes: "Axes", picture: VehiclePicture) -> None:
    fastest = max((math.hypot(*w.velocity) for w in picture.wheels if w.velocity), default=0.0)
    if fastest == 0.0:
        return
    scale = 0.3 * _size(picture) / fastest
    for mark in picture.wheels:
        if mark.velocity is not None:
            tip = np.array(mark.contact) + scale * np.array(mark.velocity)
            style.arrow(axes, mark.contact, tip, "-|>", 7, color=style.INK, linewidth=1.4)


def _draw_centre(axes: "Axes", picture: VehiclePicture, low: Array, high: Array) -> None:
    if picture.centre is None:
        return
    if picture.line is not None:
        x, y = picture.centre
        dx, dy = picture.line
        axes.axline((x, y), (x + dx, y + dy), color=style.INK, linewidth=1.4, dashes=(5, 3))
        return
    if _near(picture):
        axes.plot(
            *picture.centre, marker="X", markersize=9, color=style.INK, linestyle="none", zorder=6
        )
        style.words(axes, "centre of turning", picture.centre, (8, 6), zorder=6)
        return
    middle = (low + high) / 2
    way = np.array(picture.centre) - middle
    tip = middle + 0.46 * float((high - low).min()) * way / float(np.linalg.norm(way))
    x, y = picture.centre
    style.arrow(axes, middle, tip, color=style.INK)
    style.words(axes, f"centre of turning at ({x:.3g}, {y:.3g}) m", tuple(tip), ha="center")
