"""What a mission has in the plane, drawn alike in every picture of it: goal, obstacles, way."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SOLID = "#8d99a6"
"""What must not be touched."""


@dataclass(frozen=True)
class Obstacle:
    """A round obstacle.

    Attributes:
        x, y, radius: its centre at the beginning, and its radius [m].
        moved: how far its centre has come by the end, in x and y [m].
    """

    x: float
    y: float
    radius: float
    moved: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands in the plane [m].

    Attributes:
        goal: x, y.
        tolerance: distance to the goal at which the robot has arrived.
        walls, polygons: lines and areas to keep clear of, each by its points, shape (n, 2).
        waypoints, course: points to pass, and those of the line to follow, shape (n, 2).
        influence: range of the repulsive field around an obstacle's centre; 0 draws none.
    """

    goal: tuple[float, float]
    tolerance: float
    obstacles: tuple[Obstacle, ...] = ()
    walls: tuple[Array, ...] = ()
    polygons: tuple[Array, ...] = ()
    waypoints: Array | None = None
    course: Array | None = None
    influence: float = 0.0

    def corners(self) -> Array:
        """Points that the scene covers, (n, 2)."""
        circles = [(*self.goal, self.tolerance)]
        circles += [(o.x, o.y, o.radius) for o in self.obstacles]
        centres, radii = np.array(circles)[:, :2], np.array(circles)[:, 2:]
        lines = (*self.walls, *self.polygons, self.waypoints, self.course)
        points = [line for line in lines if line is not None]
        return np.vstack([*points, centres - radii, centres + radii])


def circle(x: float, y: float, radius: float) -> tuple[Array, Array]:
    """x and y of a closed circle, (73,) each."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    return x + radius * np.cos(angle), y + radius * np.sin(angle)


def draw_goal(axes: "Axes", scene: Scene) -> None:
    """The goal with its tolerance."""
    goal = circle(*scene.goal, scene.tolerance)
    axes.fill(*goal, color=style.GREEN, alpha=0.18, linewidth=0, zorder=2)
    axes.plot(*goal, color=style.GREEN, linewidth=1.0, label="goal and tolerance", zorder=2)
    axes.plot(*scene.goal, color=style.GREEN, marker="+", markersize=6, linestyle="none")


def draw_obstacles(axes: "Axes", scene: Scene) -> None:
    """Obstacles, walls and areas; one that moves where it began, and fainter where it ended."""
    for polygon in scene.polygons:
        axes.fill(*polygon.T, color=_SOLID, linewidth=0, zorder=2)
    for wall in scene.walls:
        axes.plot(*wall.T, color=_SOLID, linewidth=2.2, solid_capstyle="round", zorder=2)
    range_named = False
    for o in scene.obstacles:
        axes.fill(*circle(o.x, o.y, o.radius), color=_SOLID, linewidth=0, zorder=2)
        if any(o.moved):
            end = o.x + o.moved[0], o.y + o.moved[1]
            axes.fill(*circle(*end, o.radius), color=_SOLID, alpha=0.45, linewidth=0, zorder=2)
            style.arrow(axes, (o.x, o.y), end, color="#5d6b79", zorder=2.5)
        elif scene.influence > 0:
            ring = circle(o.x, o.y, scene.influence)
            axes.plot(
                *ring,
                color="#9fb0bf",
                linewidth=0.8,
                linestyle=(0, (4, 3)),
                label="_" if range_named else "range of the field",
            )
            range_named = True


def draw_way(axes: "Axes", scene: Scene) -> None:
    """The line to follow and the places to pass."""
    if scene.course is not None:
        axes.plot(
            *scene.course.T,
            color=style.VERMILION,
            linewidth=1.0,
            linestyle=(0, (5, 3)),
            label="line to follow",
            zorder=2.6,
        )
    if scene.waypoints is not None:
        axes.plot(
            *scene.waypoints.T,
            color=style.VERMILION,
            marker="D",
            markersize=5,
            markerfacecolor="white",
            linestyle="none",
            label="waypoints",
            zorder=2.7,
        )


def plane(axes: "Axes", columns: int = 4, unnamed: Collection[str] = ()) -> None:
    """Equal scales, the names of the axes, and a legend above the panel.

    Args:
        unnamed: entries that it leaves out.
    """
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    handles, names = axes.get_legend_handles_labels()
    kept = [k for k, name in enumerate(names) if name not in unnamed]
    legend = axes.legend(
        [handles[k] for k in kept],
        [names[k] for k in kept],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.5,
    )
    for handle in legend.get_lines():
        handle.set_alpha(1.0)
    legend.set_in_layout(False)
    axes.set_title(" ")
