"""The picture of a fan: many simulated runs and the measured path."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style
from sysid.report.mission_drawing import MissionPicture
from sysid.report.missions.scene import draw_goal, draw_obstacles, draw_way, plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class FanPanel:
    """One quantity over time.

    Attributes:
        title: its name and unit.
        low, high: 5 % and 95 % of the runs, (M,).
        least, most: within them 95 % of the runs stay all the way, (M,).
        measured: (M,).
    """

    title: str
    low: Array
    high: Array
    least: Array
    most: Array
    measured: Array


@dataclass(frozen=True, eq=False)
class FanPicture:
    """A measured drive over the runs of its mission.

    Attributes:
        drive: the measured drive as a mission's picture shows it: path, goal, obstacles.
        ways: x, y of some runs, (K, M, 2) [m].
        t: instants [s], (M,).
        leaves: row at which the drive leaves the fan; None where it stays.
        headline, facts: title and what stands below it.
    """

    drive: MissionPicture
    ways: Array
    t: Array
    panels: tuple[FanPanel, ...]
    leaves: int | None
    headline: str
    facts: str

    def draw(self, figure: "Figure") -> None:
        """Draw the ways in the plane, and every quantity over time."""
        colour = style.GREEN if self.leaves is None else style.VERMILION
        style.heading(figure, 5.8, self.headline, self.facts, colour)
        grid = figure.add_gridspec(4, 2, width_ratios=(1.25, 1.0))
        _draw_plane(figure.add_subplot(grid[:, 0]), self)
        for k, panel in enumerate(self.panels):
            axes = figure.add_subplot(grid[k, 1])
            _draw_panel(axes, self, panel)
            last = k == len(self.panels) - 1
            axes.set_xlabel("time [s]") if last else axes.tick_params(labelbottom=False)
            if k == 0:
                style.legend_above(
                    axes,
                    {
                        "measured": (style.INK, 1.4),
                        "90 %": (_deep(0.55), 5.0),
                        "95 %, all the way": (_deep(0.22), 5.0),
                    },
                )


def _deep(share: float) -> str:
    """Blue on white, so opaque, as a colour of its own: legends have no transparency."""
    blue = [int(style.BLUE[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{round(255 + share * (c - 255)):02x}" for c in blue)


def _draw_plane(axes: "Axes", picture: FanPicture) -> None:
    drive = picture.drive
    draw_obstacles(axes, drive.scene)
    draw_way(axes, drive.scene)
    draw_goal(axes, drive.scene)
    for k, way in enumerate(picture.ways):
        axes.plot(
            way[:, 0],
            way[:, 1],
            color=style.BLUE,
            alpha=0.12,
            linewidth=1.0,
            label="_" if k else "predicted runs",
            zorder=2.8,
        )
    axes.plot(
        drive.pose[:, 0], drive.pose[:, 1], color=style.INK, linewidth=1.4, label="measured",
        zorder=4,
    )  # fmt: skip
    if picture.leaves is not None:
        x, y = drive.pose[picture.leaves, :2]
        axes.plot(
            x, y, marker="X", markersize=8, color=style.VERMILION, markeredgecolor="white",
            linestyle="none", label=f"leaves at {picture.t[picture.leaves]:.1f} s", zorder=6,
        )  # fmt: skip
    axes.margins(0.06)
    plane(axes, unnamed=("goal and tolerance", "range of the field"))


def _draw_panel(axes: "Axes", picture: FanPicture, panel: FanPanel) -> None:
    t = picture.t
    axes.fill_between(t, panel.least, panel.most, color=_deep(0.22), linewidth=0)
    axes.fill_between(t, panel.low, panel.high, color=_deep(0.55), linewidth=0)
    style.stroke(axes, t, panel.measured, style.INK, linewidth=1.1)
    if picture.leaves is not None:
        axes.axvline(t[picture.leaves], color=style.VERMILION, linewidth=1.0)
    axes.set_title(panel.title)
    axes.set_xlim(float(t[0]), max(float(t[-1]), float(t[0]) + 1e-9))
    span = np.concatenate([panel.low, panel.high, panel.measured])
    low, high = float(np.nanmin(span)), float(np.nanmax(span))
    pad = 0.12 * max(high - low, 1e-3)
    axes.set_ylim(low - pad, high + pad)
    axes.locator_params(axis="y", nbins=4)
