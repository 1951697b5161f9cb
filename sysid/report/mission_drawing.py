"""The picture of a mission: the path among the obstacles and what the robot did over time."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array, frozen
from sysid.errors import DataError
from sysid.report import style
from sysid.report.envelope import envelope
from sysid.report.missions import localization_drawing
from sysid.report.missions.localization_drawing import PoseEstimate
from sysid.report.missions.scene import Scene, draw_goal, draw_obstacles, draw_way, plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpecBase

_BINS = 500
_PATH_POINTS = 1500
_WIDE = 2.2
"""A scene this many times wider than high is drawn above the time plots, not beside them."""

_ENDINGS = {
    "arrived": ("arrived after", style.GREEN),
    "missed": ("missed the goal after", style.VERMILION),
    "timeout": ("timed out after", style.VERMILION),
    "collision": ("collided after", style.VERMILION),
    "stuck": ("stuck after", style.VERMILION),
}


@dataclass(frozen=True, eq=False)
class MissionPicture:
    """What a picture of a mission shows.

    Attributes:
        outcome: ``arrived``, ``missed``, ``timeout``, ``collision`` or ``stuck``.
        t: instants [s], shape (N,), N ≥ 1.
        pose: x [m], y [m], ψ [rad, counter-clockwise], shape (N, 3).
        speed: forward speed Vx [m/s], shape (N,).
        pwm: left and right pulse width [µs], shape (N, 2).
        speed_reference: Vd [m/s], shape (N,), or None.
        heading_reference: ψd [rad], shape (N,), any winding, or None.
        min_clearance: smallest distance of the robot's centre to a surface [m], or None.
        estimate: where navigation believed to be, of the same length; None where it shows nothing.

    Raises:
        DataError: the lengths differ, or there is no sample.
    """

    name: str
    outcome: str
    t: Array
    pose: Array
    speed: Array
    pwm: Array
    scene: Scene
    speed_reference: Array | None = None
    heading_reference: Array | None = None
    min_clearance: float | None = None
    estimate: PoseEstimate | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "pose", frozen(self.pose, 3))
        put(self, "pwm", frozen(self.pwm, 2))
        for name in ("t", "speed", "speed_reference", "heading_reference"):
            if getattr(self, name) is not None:
                put(self, name, frozen(getattr(self, name), 1)[:, 0])
        signals = (self.pose, self.pwm, self.speed, self.speed_reference, self.heading_reference)
        lengths = {len(self.t), *(len(s) for s in signals if s is not None)}
        lengths |= {len(self.estimate.path)} if self.estimate else set()
        if len(lengths) != 1 or 0 in lengths:
            raise DataError(f"the signals of a mission must be equally long, got {sorted(lengths)}")

    def draw(self, figure: "Figure") -> None:
        """Draw the scene, and speed, heading, PWM and distance to the goal over time."""
        words, colour = _ENDINGS.get(self.outcome, (f"{self.outcome} after", style.INK))
        end = self.pose[-1]
        facts = [
            f"ends at x = {end[0]:.2f} m, y = {end[1]:.2f} m, ψ = {end[2]:.2f} rad",
            f"path {_travelled(self)[-1]:.2f} m",
        ]
        if self.min_clearance is not None:
            facts.append(f"{self.min_clearance:.2f} m clear of the nearest obstacle")
        title = f"{self.name}: {words} {self.t[-1] - self.t[0]:.1f} s"
        left, right, bottom, top = _scene(self)
        wide = right - left > _WIDE * (top - bottom)
        height = 4.6 + min(8.3 * (top - bottom) / (right - left), 3.4) if wide else 5.6
        style.heading(figure, height, title, ", ".join(facts), colour)
        scene, panels = (_wide_layout if wide else _square_layout)(figure)
        _draw_scene(scene, self)
        for axes, fill in zip(
            panels, (_draw_speed, _draw_heading, _draw_pwm, _draw_distance), strict=True
        ):
            fill(axes, self)
            axes.set_xlim(*_span(self.t))
            axes.locator_params(axis="y", nbins=5)


def _square_layout(figure: "Figure") -> "tuple[Axes, list[Axes]]":
    grid: GridSpecBase = figure.add_gridspec(4, 2, width_ratios=(1.25, 1.0))
    panels = [figure.add_subplot(grid[k, 1]) for k in range(4)]
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time [s]")
    return figure.add_subplot(grid[:, 0]), panels


def _wide_layout(figure: "Figure") -> "tuple[Axes, list[Axes]]":
    height = float(figure.get_size_inches()[1])
    grid: GridSpecBase = figure.add_gridspec(3, 2, height_ratios=(height - 3.9, 1.55, 1.55))
    panels = [figure.add_subplot(grid[1 + k % 2, k // 2]) for k in range(4)]
    for axes in panels[::2]:
        axes.tick_params(labelbottom=False)
    for axes in panels[1::2]:
        axes.set_xlabel("time [s]")
    return figure.add_subplot(grid[0, :]), panels


def _scene(picture: MissionPicture) -> tuple[float, float, float, float]:
    """The part of the plane that matters: path, goal with tolerance, obstacles [m]."""
    points = picture.pose[np.isfinite(picture.pose[:, :2]).all(axis=1), :2]
    estimate = [picture.estimate.path] if picture.estimate else []
    corners = np.vstack([points, *estimate, picture.scene.corners()])
    left, bottom = (float(v) for v in corners.min(axis=0))
    right, top = (float(v) for v in corners.max(axis=0))
    pad = 0.05 * max(right - left, top - bottom, 0.1)
    return left - pad, right + pad, bottom - pad, top + pad


def _draw_scene(axes: "Axes", picture: MissionPicture) -> None:
    draw_obstacles(axes, picture.scene)
    draw_way(axes, picture.scene)
    draw_goal(axes, picture.scene)
    every = max(1, len(picture.pose) // _PATH_POINTS)
    path = np.vstack([picture.pose[::every], picture.pose[-1:]])
    axes.plot(path[:, 0], path[:, 1], color=style.BLUE, linewidth=1.6, label="path", zorder=3)
    axes.plot(
        *picture.pose[0, :2],
        color=style.BLUE,
        marker="o",
        markersize=6,
        markerfacecolor="white",
        markeredgewidth=1.5,
        linestyle="none",
        label="start",
        zorder=5,
    )
    if picture.estimate is not None:
        localization_drawing.draw(axes, picture.estimate)
    _draw_headings(axes, picture)
    left, right, bottom, top = _scene(picture)
    axes.set_xlim(left, right, auto=True)  # "auto": the equal scale may widen the view
    axes.set_ylim(bottom, top, auto=True)
    plane(axes)


def _draw_headings(axes: "Axes", picture: MissionPicture) -> None:
    """Darts along the path at equal distances, the last one at its end, pointing along ψ."""
    travelled = _travelled(picture)
    count = 9 if travelled[-1] > 0 else 1
    stations = np.linspace(0.0, travelled[-1], count)[1:] if count > 1 else travelled[-1:]
    darts = np.array([(-0.8, -0.6), (1.2, 0.0), (-0.8, 0.6), (-0.4, 0.0), (-0.8, -0.6)])
    for k in np.minimum(np.searchsorted(travelled, stations), len(travelled) - 1):
        x, y, psi = picture.pose[k]
        if not np.isfinite(psi):
            continue
        turn = np.array([(np.cos(psi), np.sin(psi)), (-np.sin(psi), np.cos(psi))])
        axes.plot(
            x,
            y,
            marker=[tuple(v) for v in darts @ turn],
            markersize=9 if k == len(travelled) - 1 else 7,
            color=style.INK if k == len(travelled) - 1 else style.BLUE,
            markeredgewidth=0,
            zorder=6,
        )


def _travelled(picture: MissionPicture) -> Array:
    """Length of the path up to each sample [m]; missing poses add nothing."""
    steps = np.hypot(*np.diff(picture.pose[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])


def _span(t: Array) -> tuple[float, float]:
    return (float(t[0]), float(t[-1])) if t[-1] > t[0] else (float(t[0]) - 0.5, float(t[0]) + 0.5)


def _signal(axes: "Axes", picture: MissionPicture, y: Array, colour: str, width: float) -> None:
    style.stroke(axes, *envelope(picture.t, y, _BINS), colour, linewidth=width)


def _against_reference(
    axes: "Axes", picture: MissionPicture, y: Array, reference: Array | None, names: tuple[str, str]
) -> None:
    entries = {names[0]: (style.BLUE, 1.4)}
    if reference is not None:
        _signal(axes, picture, reference, style.VERMILION, 1.0)
        entries[names[1]] = (style.VERMILION, 1.2)
    _signal(axes, picture, y, style.BLUE, 1.3)
    style.legend_above(axes, entries)


def _draw_speed(axes: "Axes", picture: MissionPicture) -> None:
    _against_reference(
        axes, picture, picture.speed, picture.speed_reference, ("Vx", "reference Vd")
    )
    axes.set_title("speed [m/s]")


def _draw_heading(axes: "Axes", picture: MissionPicture) -> None:
    psi = picture.pose[:, 2].copy()
    known = np.isfinite(psi)
    psi[known] = np.unwrap(psi[known])
    reference = picture.heading_reference
    if reference is not None:  # the winding of the reference nearest to the heading
        reference = psi + np.remainder(reference - psi + np.pi, 2.0 * np.pi) - np.pi
    _against_reference(axes, picture, psi, reference, ("ψ", "reference ψd"))
    axes.set_title("heading [rad]")


def _draw_pwm(axes: "Axes", picture: MissionPicture) -> None:
    colours = (style.SERIES[0], style.SERIES[1])
    for k, colour in enumerate(colours):
        _signal(axes, picture, picture.pwm[:, k], colour, 1.1)
    style.legend_above(axes, {"left": (colours[0], 1.4), "right": (colours[1], 1.4)})
    axes.set_title("PWM [µs]")


def _draw_distance(axes: "Axes", picture: MissionPicture) -> None:
    gap = picture.pose[:, :2] - np.asarray(picture.scene.goal)
    _signal(axes, picture, np.hypot(gap[:, 0], gap[:, 1]), style.BLUE, 1.3)
    axes.axhline(picture.scene.tolerance, color=style.GREEN, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_ylim(bottom=0.0)
    style.legend_above(axes, {"tolerance": (style.GREEN, 1.2)})
    axes.set_title("distance to goal [m]")
