"""The picture of a linear model's dynamics: poles, zeros and step responses."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, frozen
from sysid.errors import DataError
from sysid.report import style
from sysid.report.envelope import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VIEW = 1.35
"""Half-width of the view of the z-plane; what lies beyond is named in words."""

_CLOSE = 0.15
"""When all poles lie this close to z = 1 (fast sampling), that corner is shown enlarged."""


@dataclass(frozen=True, eq=False)
class PoleZeroSet:
    """Poles and zeros in the z-plane that belong together.

    Attributes:
        label: what they belong to, for instance ``pwm_l → omega_l``.
        poles: poles, complex.
        zeros: finite zeros, complex.
    """

    label: str
    poles: NDArray[np.complex128]
    zeros: NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Responses of all outputs to a step on one input at a time.

    Attributes:
        t: instants [s], shape (M,).
        values: shape (M, ny, nu).
        std_error: standard error of the values, same shape, or None.

    Raises:
        DataError: the shapes do not fit.
    """

    t: Array
    values: Array
    std_error: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", frozen(self.t, 1)[:, 0])
        values = np.asarray(self.values, dtype=np.float64)
        object.__setattr__(self, "values", values)
        spread = values if self.std_error is None else np.asarray(self.std_error)
        if values.ndim != 3 or len(values) != len(self.t) or spread.shape != values.shape:
            raise DataError(
                f"step responses need shape ({len(self.t)}, ny, nu), got {values.shape}"
                + (f" with standard errors {spread.shape}" if spread is not values else "")
            )


@dataclass(frozen=True, eq=False)
class DynamicsPicture:
    """What a picture of a linear model's dynamics shows.

    Attributes:
        title: the model.
        inputs: the nu input channels.
        outputs: the ny output channels.
        dt: sample time [s].
        sets: poles and zeros, at most one colour each.
        step: step responses.

    Raises:
        DataError: the step responses do not have the channels named.
    """

    title: str
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    dt: float
    sets: tuple[PoleZeroSet, ...]
    step: StepResponse

    def __post_init__(self) -> None:
        wanted = (len(self.outputs), len(self.inputs))
        if self.step.values.shape[1:] != wanted:
            raise DataError(
                f"step responses are for {self.step.values.shape[1:]} outputs and inputs, "
                f"{wanted} are named"
            )


def size_inches(picture: DynamicsPicture) -> tuple[float, float]:
    """Width and height of the picture [in]."""
    return style.WIDTH, max(4.6, 1.0 + 1.7 * len(picture.outputs))


def draw(figure: "Figure", picture: DynamicsPicture) -> None:
    """Draw the z-plane at the left and a step response per output and input at the right."""
    style.heading(figure, picture.title, _summary(picture))
    ny, nu = len(picture.outputs), len(picture.inputs)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.15))
    _draw_plane(figure.add_subplot(grid[0]), picture.sets)
    steps = grid[1].subgridspec(ny, nu)
    for i in range(ny):
        row: list[Axes] = []
        for j in range(nu):
            axes = figure.add_subplot(steps[i, j], sharey=row[0] if row else None)
            row.append(axes)
            _draw_step(axes, picture, i, j)
            axes.tick_params(labelbottom=i == ny - 1, labelleft=j == 0)
            if i == ny - 1:
                axes.set_xlabel("time [s]")


def _summary(picture: DynamicsPicture) -> str:
    poles = _all("poles", picture.sets)
    words = f"sample time {picture.dt:g} s"
    if not poles.size:
        return f"{words}, no poles"
    largest = float(np.abs(poles).max())
    verdict = "stable" if largest < 1.0 else "not stable"
    return f"{words}, {verdict}: largest pole magnitude {largest:.4f}"


def _all(kind: str, sets: tuple[PoleZeroSet, ...]) -> NDArray[np.complex128]:
    groups = [np.asarray(getattr(s, kind), dtype=np.complex128) for s in sets]
    return np.concatenate([*groups, np.zeros(0, dtype=np.complex128)])


def _draw_plane(axes: "Axes", sets: tuple[PoleZeroSet, ...]) -> None:
    _mark(axes, sets)
    axes.set_xlim(-_VIEW, _VIEW)
    axes.set_ylim(-_VIEW, _VIEW)
    axes.set_aspect("equal", adjustable="box")
    axes.set_anchor("N")
    axes.set_title("poles × and zeros ○ in the z-plane")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    axes.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0])
    axes.set_yticks([-1.0, -0.5, 0.0, 0.5, 1.0])
    poles = _all("poles", sets)
    if poles.size and np.abs(poles - 1.0).max() < _CLOSE:
        _enlarge(axes, sets, float(np.abs(poles - 1.0).max()))
    if len(sets) > 1:
        handles = [
            axes.plot([], [], color=style.SERIES[k % len(style.SERIES)], linewidth=1.4)[0]
            for k in range(len(sets))
        ]
        legend = axes.legend(
            handles,
            [s.label for s in sets],
            loc="upper left",
            bbox_to_anchor=(0.0, -0.16),
            ncols=2,
        )
        for text in legend.get_texts():
            style.shorten(text, 1.5)
    axes.text(
        0.02,
        0.02,
        _beyond(sets),
        transform=axes.transAxes,
        size=style.SMALL - 0.5,
        color=style.MUTED,
    )


def _mark(axes: "Axes", sets: tuple[PoleZeroSet, ...]) -> None:
    """Unit circle, poles and zeros; later sets are drawn larger, so that equal ones show."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.fill(np.cos(angle), np.sin(angle), color="#f4f5f7", linewidth=0, zorder=0)
    axes.plot(np.cos(angle), np.sin(angle), color=style.MUTED, linewidth=1.0)
    axes.axhline(0.0, color=style.FAINT, linewidth=0.8)
    axes.axvline(0.0, color=style.FAINT, linewidth=0.8)
    for k, group in enumerate(sets):
        colour = style.SERIES[k % len(style.SERIES)]
        marks = (("x", np.asarray(group.poles)), ("o", np.asarray(group.zeros)))
        for marker, points in marks:
            axes.plot(
                points.real,
                points.imag,
                linestyle="none",
                marker=marker,
                color=colour,
                markerfacecolor="none",
                markersize=6.0 + 2.0 * k,
                markeredgewidth=1.4,
                zorder=4,
            )


def _enlarge(axes: "Axes", sets: tuple[PoleZeroSet, ...], spread: float) -> None:
    half = max(1.6 * spread, 1e-6)
    inset = axes.inset_axes((0.30, 0.33, 0.34, 0.34))
    _mark(inset, sets)
    inset.set_xlim(1.0 - 1.4 * half, 1.0 + 0.6 * half)
    inset.set_ylim(-half, half)
    inset.set_title("around z = 1", size=style.SMALL, color=style.MUTED, pad=3.0)
    inset.tick_params(labelsize=6.5)
    inset.locator_params(nbins=3)
    for spine in inset.spines.values():
        spine.set_visible(True)
    axes.indicate_inset_zoom(inset, edgecolor=style.MUTED, alpha=0.6)


def _beyond(sets: tuple[PoleZeroSet, ...]) -> str:
    """Name the poles and zeros outside the view."""
    lines = []
    for kind in ("poles", "zeros"):
        points = _all(kind, sets)
        far = points[(np.abs(points.real) > _VIEW) | (np.abs(points.imag) > _VIEW)]
        if far.size:
            shown = ", ".join(_complex(z) for z in far[:4]) + (" …" if far.size > 4 else "")
            lines.append(f"{kind} beyond: {shown}")
    return "; ".join(lines)


def _complex(z: complex) -> str:
    words = f"{z.real:.3g}" + (f"{z.imag:+.3g}i" if z.imag else "")
    return words.replace("-", "−")


def _draw_step(axes: "Axes", picture: DynamicsPicture, i: int, j: int) -> None:
    step, output, source = picture.step, picture.outputs[i], picture.inputs[j]
    t, y = envelope(step.t, step.values[:, i, j], 400)
    if step.std_error is not None and len(t) == len(step.t):
        half = 1.96 * step.std_error[:, i, j]
        axes.fill_between(t, y - half, y + half, color="#bcd9ea", linewidth=0, step="post")
    kind = "steps-post" if len(t) == len(step.t) else "default"
    style.stroke(axes, t, y, style.BLUE, linewidth=1.3, drawstyle=kind)
    axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
    unit = f"{output.unit} per {source.unit}" if output.unit and source.unit else output.unit
    room = 4.2 / len(picture.inputs) - 0.15
    style.title(axes, f"{source.name} → {output.name}", room)
    if j == 0:
        axes.set_ylabel(unit[:40])
    axes.locator_params(nbins=4)
