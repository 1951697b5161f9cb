"""The picture of many runs of a mission: fan of paths, distributions, variance shares."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report import style
from sysid.report.missions.scene import Scene, draw_goal, draw_obstacles, plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BARS = 40
_MOST_DRIVERS = 8


@dataclass(frozen=True, eq=False)
class RunsPicture:
    """What a picture of many runs shows.

    Attributes:
        paths: X, Y of some runs, (n, 2) each [m].
        worst: figures of the worst runs.
        times: of the runs that arrived [s].
        clearances: of all runs [m]; empty without obstacles.
        drivers: names of what varies, and their share of the variance of the time.
    """

    title: str
    subtitle: str
    paths: tuple[Array, ...]
    worst: tuple[Array, ...]
    scene: Scene
    times: Array
    clearances: Array
    drivers: tuple[tuple[str, float], ...]

    def draw(self, figure: "Figure") -> None:
        """Draw the fan beside the distributions."""
        style.heading(figure, 5.6, self.title, self.subtitle)
        panels = [p for p, shown in ((_times, len(self.times)), (_clearances,
                  len(self.clearances)), (_drivers, len(self.drivers))) if shown]  # fmt: skip
        grid = figure.add_gridspec(max(len(panels), 1), 2, width_ratios=(1.35, 1.0))
        _fan(figure.add_subplot(grid[:, 0]), self)
        for k, panel in enumerate(panels):
            panel(figure.add_subplot(grid[k, 1]), self)


def _fan(axes: "Axes", picture: RunsPicture) -> None:
    draw_obstacles(axes, picture.scene)
    draw_goal(axes, picture.scene)
    # faint enough that many on one line are no darker than the worst on top of them
    for paths, colour, width, alpha, name in (
        (picture.paths, style.BLUE, 0.8, 0.25, f"{len(picture.paths)} runs"),
        (picture.worst, style.VERMILION, 1.2, 0.9, f"the {len(picture.worst)} worst"),
    ):
        for k, path in enumerate(paths):
            label = "_" if k else name
            axes.plot(*path.T, color=colour, linewidth=width, alpha=alpha, label=label, zorder=3)
    axes.margins(0.05)
    plane(axes, columns=3)


def _times(axes: "Axes", picture: RunsPicture) -> None:
    _histogram(axes, picture.times, "time of arrival [s]", (0.05, 0.5, 0.95))


def _clearances(axes: "Axes", picture: RunsPicture) -> None:
    _histogram(axes, picture.clearances, "smallest clearance [m]", (0.01, 0.5))


def bar_edges(values: Array) -> Array:
    """Edges of bars as wide as what the values are rounded to, or narrower than their spread."""
    known = np.unique(np.round(values, 9))
    step = float(np.min(np.diff(known), initial=np.inf))
    low, high = float(known[0]), float(known[-1])
    if len(known) == 1:
        return np.array([low - 0.5, low + 0.5])
    if (high - low) / step <= _BARS:
        return np.arange(low - 0.5 * step, high + step, step)
    return np.linspace(low, high, _BARS + 1)


def _histogram(axes: "Axes", values: Array, title: str, shares: tuple[float, ...]) -> None:
    axes.hist(values, bins=bar_edges(values).tolist(), color=style.BLUE, alpha=0.55, linewidth=0)
    for share in shares:
        at = float(np.quantile(values, share))
        axes.axvline(at, color=style.INK, linewidth=0.8, linestyle=(0, (4, 3)))
        percent = f"{100 * share:g} %"
        style.words(axes, percent, (at, 1.0), (2, -7), style.FROM_TOP, color=style.MUTED)
    axes.set_title(title)
    axes.set_ylabel("runs")
    axes.locator_params(axis="y", nbins=4)


def _drivers(axes: "Axes", picture: RunsPicture) -> None:
    shown = picture.drivers[:_MOST_DRIVERS][::-1]
    names, shares = [n for n, _ in shown], [100 * s for _, s in shown]
    axes.barh(range(len(shown)), shares, color=style.BLUE, alpha=0.55, height=0.7)
    axes.set_yticks(range(len(shown)), labels=names)
    axes.grid(False, axis="y")
    axes.set_title("contributions to the variance of the time [%]")
