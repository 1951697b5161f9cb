"""The picture of a plan: field lines, potential, forces and references of speed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.record import Array
from sysid.report import style
from sysid.report.missions.outlines import circle
from sysid.report.panels import Panels, draw_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FIRST_ROW, _OTHER_ROW = 4.1, 2.3
"""Heights of the rows [in]."""


@dataclass(frozen=True, eq=False)
class PlanPicture:
    """What a picture of a plan shows.

    Attributes:
        x, y: the map, (M,) each [m].
        psi: direction of the references on the map, (M, M) [rad].
        potential: on the map, (M, M), or None.
        way: the way from the start, (N, 2) [m].
        goal: x, y [m].
        tolerance: [m].
        discs: obstacles, (x, y, radius) [m].
        walls: (ax, ay, bx, by) [m].
        ends: places besides the goal where ways end [m].
    """

    title: str
    subtitle: str
    x: Array
    y: Array
    psi: Array
    potential: Array | None
    way: Array
    goal: tuple[float, float]
    tolerance: float
    discs: tuple[tuple[float, float, float], ...]
    walls: tuple[tuple[float, float, float, float], ...]
    ends: tuple[tuple[float, float], ...]
    panels: Panels

    def draw(self, figure: "Figure") -> None:
        """Draw the map and the potential above the forces and the references of speed."""
        rows = [row for row in (self.panels[:2], self.panels[2:]) if row]  # forces, speeds
        height = 0.7 + _FIRST_ROW + _OTHER_ROW * len(rows)
        style.heading(figure, height, self.title, self.subtitle)
        grid = figure.add_gridspec(
            1 + len(rows), 6, height_ratios=[_FIRST_ROW, *(_OTHER_ROW,) * len(rows)]
        )
        if self.potential is None:
            _draw_map(figure.add_subplot(grid[0, :]), self)
        else:
            _draw_map(figure.add_subplot(grid[0, :3]), self)
            _draw_surface(figure.add_subplot(grid[0, 3:], projection="3d"), self)
        for k, row in enumerate(rows, start=1):
            width = 6 // len(row)
            for j, panel in enumerate(row):
                draw_panel(figure.add_subplot(grid[k, j * width : (j + 1) * width]), panel)


def _draw_map(axes: "Axes", picture: PlanPicture) -> None:
    if picture.potential is not None:
        levels = _levels(picture.potential)
        field = (picture.x, picture.y, picture.potential)
        axes.contourf(*field, levels, cmap="Blues_r", alpha=0.5, extend="max")
    u, v = np.cos(picture.psi), np.sin(picture.psi)
    axes.streamplot(
        picture.x, picture.y, u, v, density=1.1, color=style.MUTED, linewidth=0.6, arrowsize=0.7
    )
    for x, y, radius in picture.discs:
        axes.fill(*circle(x, y, radius), color="#52606d", zorder=3)
    for ax, ay, bx, by in picture.walls:
        axes.plot([ax, bx], [ay, by], color="#52606d", linewidth=2.5, zorder=3)
    axes.fill(*circle(*picture.goal, picture.tolerance), color=style.GREEN, zorder=3)
    axes.plot([], [], color=style.GREEN, linewidth=5, label="goal and tolerance")
    bold: dict[str, Any] = {"color": style.VERMILION, "zorder": 4, "linewidth": 1.8}
    axes.plot(*picture.way.T, label="way from the start", **bold)
    axes.plot(*picture.way[0], marker="o", markersize=6, markerfacecolor="white", **bold)
    cross: dict[str, Any] = {"color": style.INK, "marker": "X", "markersize": 8, "zorder": 6}
    for k, end in enumerate(picture.ends):
        label = "ways end here" if k == 0 else "_"
        axes.plot(*end, label=label, linestyle="none", **cross)
    axes.set_xlim(picture.x[0], picture.x[-1])
    axes.set_ylim(picture.y[0], picture.y[-1])
    axes.grid(visible=False)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(" ")
    legend = axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.5)
    legend.set_in_layout(False)


def _levels(potential: Array) -> Array:
    """Levels of equal share of the map up to the walls of the obstacles, which end it."""
    finite = potential[np.isfinite(potential)]
    return np.unique(np.quantile(finite, np.linspace(0.0, 0.97, 16)))


def _draw_surface(axes: Any, picture: PlanPicture) -> None:
    """The potential as a surface, cut where the obstacles' walls begin."""
    assert picture.potential is not None
    top = _levels(picture.potential)[-1]
    x, y = np.meshgrid(picture.x, picture.y)
    height = np.minimum(picture.potential, top)
    axes.plot_surface(
        x, y, height, cmap="Blues_r", linewidth=0.1, edgecolor="#7b8794", rcount=40, ccount=40
    )
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("potential")
    axes.set_title("potential, cut at its top")
    axes.view_init(elev=38, azim=-120)
    axes.locator_params(nbins=5)
    axes.tick_params(labelsize=style.SMALL - 1, pad=-1)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color("#ffffff")
