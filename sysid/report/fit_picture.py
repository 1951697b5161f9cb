"""A picture of a fit: outputs and residuals over time, their tests at the right, inputs below."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from sysid.data.record import Array, Channel, frozen
from sysid.errors import DataError
from sysid.report import style
from sysid.report.correlation_panels import LagTest, draw_independence, draw_whiteness
from sysid.report.envelope import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class FitSegment:
    """A stretch of one record that played one part.

    Attributes:
        t: sample instants [s], increasing, shape (N,), N ≥ 1.
        measured: measured outputs, shape (N, ny); NaN where nothing was measured.
        simulated: outputs of the model, shape (N, ny); NaN where it gave none.
        u: inputs, shape (N, nu); nu may be 0.
        part: whether the model was fitted to these samples or only judged on them.
        label: what to call the stretch, as a rule the record's name; empty for nothing.

    Raises:
        DataError: the lengths or widths differ, or there is no sample.
    """

    t: Array
    measured: Array
    simulated: Array
    u: Array
    part: Literal["estimation", "validation"] = "estimation"
    label: str = ""

    def __post_init__(self) -> None:
        for name in ("measured", "simulated", "u"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "t", frozen(self.t, 1)[:, 0])
        shapes = {len(self.t), len(self.measured), len(self.simulated), len(self.u)}
        if len(shapes) != 1 or self.measured.shape != self.simulated.shape or 0 in shapes:
            raise DataError(
                f"segment {self.label!r}: t {self.t.shape}, measured {self.measured.shape}, "
                f"simulated {self.simulated.shape} and u {self.u.shape} have incompatible shapes"
            )

    @property
    def step(self) -> float:
        """Usual distance of two samples [s]; 1 for a single sample."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 1.0

    def follows(self, other: "FitSegment") -> bool:
        """Whether this stretch starts where ``other`` ended, within half a sample."""
        return bool(abs(self.t[0] - other.t[-1] - other.step) < 0.5 * other.step)


@dataclass(frozen=True, eq=False)
class FitPicture:
    """What a picture of a fit shows.

    Attributes:
        title: the model, for instance ``oe-1: OE, nb = 2, nf = 2, nk = 1``.
        segments: stretches of data in the order drawn. A stretch that starts where the one
            before it ended continues it (a split record); any other starts behind a separator.
        horizon: how the model's output was made; shown in the subtitle.
        initial_state: how its initial state was found; shown in the subtitle.
        estimation_fit: fit % per output on the estimation data, or empty.
        validation_fit: fit % per output on the validation data, or empty.
        whiteness: the test of the residuals against their past, one per output, or empty.
        independence: that against past inputs, one per output, or empty.
        feedback: that against future inputs, one per output, or empty.

    Raises:
        DataError: a segment does not have the channels named.
    """

    title: str
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    segments: tuple[FitSegment, ...]
    horizon: str = "free-run simulation"
    initial_state: str = ""
    estimation_fit: tuple[float, ...] = ()
    validation_fit: tuple[float, ...] = ()
    whiteness: tuple[LagTest, ...] = ()
    independence: tuple[LagTest, ...] = ()
    feedback: tuple[LagTest, ...] = ()

    def draw(self, figure: "Figure") -> None:
        """Draw a block of panels per output, then the inputs, all on one time axis."""
        _draw(figure, self)

    def __post_init__(self) -> None:
        ny, nu = len(self.outputs), len(self.inputs)
        if ny == 0 or not self.segments:
            raise DataError("a picture of a fit needs an output and a segment of data")
        for segment in self.segments:
            if segment.measured.shape[1] != ny or segment.u.shape[1] != nu:
                raise DataError(
                    f"segment {segment.label!r} has {segment.measured.shape[1]} outputs and "
                    f"{segment.u.shape[1]} inputs; {ny} and {nu} are named"
                )
        fits = ("estimation_fit", "validation_fit")
        per_output = (*fits, "whiteness", "independence", "feedback")
        for name in per_output:
            if len(getattr(self, name)) not in (0, ny):
                raise DataError(f"{name} needs one entry per output ({ny}), or none")


_PIXELS = 700
"""Width of a time axis in pixels when the picture is shown 900 px wide."""

_POINTS = 9000
"""Points all signals of a picture share: about 17 bytes each in an SVG."""

_REACH = 1.5
"""How far the axis follows a simulation out of the measured range, in widths of that range."""


class _Piece(NamedTuple):
    """A segment with its place on the common time axis."""

    segment: FitSegment
    t: Array
    end: float
    bins: int
    joined: bool


class _InputPanel(NamedTuple):
    title: str
    columns: tuple[int, ...]
    scaled: bool


def _draw(figure: "Figure", picture: FitPicture) -> None:
    """Draw a block of panels per output, then the inputs, all on one time axis."""
    start = f"initial state {picture.initial_state}" if picture.initial_state else ""
    subtitle = ", ".join(s for s in (picture.horizon, start) if s)
    pieces, panels, ny = _pieces(picture), _input_panels(picture), len(picture.outputs)
    style.heading(figure, 0.9 + 2.8 * ny + 1.0 * len(panels), picture.title, subtitle)
    kinds = [k for k in (picture.whiteness, picture.independence) if k]
    grid = figure.add_gridspec(
        2 * ny + len(panels),
        2 if kinds else 1,
        width_ratios=(2.9, 1.0) if kinds else (1.0,),
        height_ratios=(1.65, 1.1) * ny + (1.0,) * len(panels),
    )
    timed: list[Axes] = []
    for i in range(ny):
        timed += [figure.add_subplot(grid[2 * i + k, 0]) for k in (0, 1)]
        _draw_output(timed[-2], picture, pieces, i)
        _draw_residual(timed[-1], picture, pieces, i)
        beside = [figure.add_subplot(grid[2 * i + k, 1]) for k in range(len(kinds))]
        if picture.whiteness:
            draw_whiteness(beside[0], picture.whiteness[i])
        if picture.independence:
            future = picture.feedback[i] if picture.feedback else None
            draw_independence(beside[-1], picture.independence[i], future)
        if kinds and i == ny - 1:
            beside[-1].set_xlabel("lag τ [samples]")
    for k, panel in enumerate(panels):
        timed.append(figure.add_subplot(grid[2 * ny + k, 0]))
        _draw_inputs(timed[-1], picture, pieces, panel)
    for axes in timed:
        _shade_parts(axes, pieces)
        axes.set_xlim(float(pieces[0].t[0]), pieces[-1].end)
        axes.tick_params(labelbottom=axes is timed[-1])
    apart = not all(p.joined for p in pieces)
    timed[-1].set_xlabel("time, records one after another [s]" if apart else "time [s]")
    _name_parts(timed[0], pieces, 6.0 if kinds else 8.3)


def _pieces(picture: FitPicture) -> list[_Piece]:
    """Place the segments one after another and share the points between them."""
    segments = picture.segments
    gap = 0.015 * sum(float(s.t[-1] - s.t[0]) + s.step for s in segments)
    signals = 3 * len(picture.outputs) + len(picture.inputs)
    per_sample = min(_PIXELS, _POINTS / (2 * signals)) / sum(len(s.t) for s in segments)
    pieces: list[_Piece] = []
    shift = 0.0
    for segment in segments:
        joined = not pieces or segment.follows(pieces[-1].segment)
        if not joined:
            shift = pieces[-1].end + gap - float(segment.t[0])
        t = segment.t + shift
        bins = max(1, round(per_sample * len(t)))
        pieces.append(_Piece(segment, t, float(t[-1]) + segment.step, bins, joined))
    return pieces


def _input_panels(picture: FitPicture) -> list[_InputPanel]:
    """One panel per unit; inputs too unlike for that share one, each scaled to its range."""
    units = list(dict.fromkeys(c.unit for c in picture.inputs))
    if len(picture.inputs) == 1:
        return [_InputPanel(style.labelled(picture.inputs[0].name, units[0]), (0,), False)]
    ranges = [_range(picture, j) for j in range(len(picture.inputs))]
    unlike = "" in units and max(ranges) > 20.0 * min(r for r in (*ranges, np.inf) if r > 0)
    if len(units) > 2 or unlike:
        title = "inputs, each scaled to its own range"
        return [_InputPanel(title, tuple(range(len(picture.inputs))), True)]
    return [
        _InputPanel(
            style.labelled("inputs", unit),
            tuple(j for j, c in enumerate(picture.inputs) if c.unit == unit),
            False,
        )
        for unit in units
    ]


def _range(picture: FitPicture, j: int) -> float:
    low, high = _extent(s.u[:, j] for s in picture.segments)
    return high - low


def _extent(signals: Iterator[Array]) -> tuple[float, float]:
    """Smallest and largest finite value; (0, 0) when there is none."""
    values = np.concatenate([*signals])
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)


def _draw_output(axes: "Axes", picture: FitPicture, pieces: list[_Piece], i: int) -> None:
    channel = picture.outputs[i]
    parts = (("estimation", picture.estimation_fit), ("validation", picture.validation_fit))
    fits = ", ".join(f"{style.percent(fit[i])} {part}" for part, fit in parts if fit)
    low, high = _extent(p.segment.measured[:, i] for p in pieces)
    span = (high - low) or 1.0
    floor, ceiling = low - _REACH * span, high + _REACH * span
    for piece in pieces:
        for values, colour, width in (
            (piece.segment.measured, style.MEASURED, 2.6),
            (piece.segment.simulated, style.SIMULATED, 1.1),
        ):
            t, y = envelope(piece.t, values[:, i], piece.bins)
            style.stroke(axes, t, np.clip(y, floor, ceiling), colour, linewidth=width)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.13 * (high - low))  # room for the names of the parts
    style.title(axes, style.labelled(channel.name, channel.unit), 1.65).set_fontweight("bold")
    style.legend_above(
        axes,
        {
            "measured": (style.MEASURED, 2.6),
            "simulated" + (f", fit {fits}" if fits else ""): (style.SIMULATED, 1.4),
        },
    )


def _draw_residual(axes: "Axes", picture: FitPicture, pieces: list[_Piece], i: int) -> None:
    low, high = _extent(p.segment.measured[:, i] for p in pieces)
    reach = (1.0 + _REACH) * ((high - low) or 1.0)
    for piece in pieces:
        with np.errstate(invalid="ignore", over="ignore"):  # a model that diverged
            residual = piece.segment.measured[:, i] - piece.segment.simulated[:, i]
        t, e = envelope(piece.t, residual, piece.bins)
        style.stroke(axes, t, np.clip(e, -reach, reach), style.RESIDUAL, linewidth=0.8)
    axes.axhline(0.0, color=style.INK, linewidth=0.6, zorder=1.5)
    words = style.labelled("residual", picture.outputs[i].unit)
    style.title(axes, words, 5.0, color=style.MUTED, pad=3.0)
    axes.locator_params(axis="y", nbins=4)


def _draw_inputs(
    axes: "Axes", picture: FitPicture, pieces: list[_Piece], panel: _InputPanel
) -> None:
    entries: dict[str, tuple[str, float]] = {}
    for j in panel.columns:
        colour = style.SERIES[j % len(style.SERIES)]
        low, high = _extent(p.segment.u[:, j] for p in pieces)
        scale = (high - low) or 1.0
        for piece in pieces:
            t, u = envelope(piece.t, piece.segment.u[:, j], piece.bins)
            if len(t) == len(piece.t):  # not thinned: show that each value is held
                t, u = np.append(t, piece.end), np.append(u, u[-1])
                kind = "steps-post"
            else:
                kind = "default"
            if panel.scaled:
                u = (u - low) / scale
            style.stroke(axes, t, u, colour, linewidth=1.0, drawstyle=kind, alpha=0.9)
        entries[style.labelled(picture.inputs[j].name, picture.inputs[j].unit * panel.scaled)] = (
            colour,
            1.4,
        )
    room = 5.0 if len(picture.inputs) == 1 else 2.6
    style.title(axes, panel.title, room, color=style.MUTED, pad=3.0)
    axes.locator_params(axis="y", nbins=3)
    if len(picture.inputs) > 1:
        style.legend_above(axes, entries, room=3.2)


def _shade_parts(axes: "Axes", pieces: list[_Piece]) -> None:
    for piece in pieces:
        colour = style.PARTS[piece.segment.part]
        axes.axvspan(float(piece.t[0]), piece.end, color=colour, linewidth=0, zorder=0)
    for before, piece in pairwise(pieces):
        if not piece.joined:
            axes.axvspan(before.end, float(piece.t[0]), color="white", linewidth=0, zorder=1.6)
        elif before.segment.part != piece.segment.part:
            axes.axvline(float(piece.t[0]), color=style.MUTED, linewidth=0.7, linestyle=(0, (3, 3)))


def _name_parts(axes: "Axes", pieces: list[_Piece], inches: float) -> None:
    """Write part and record at the top of each stretch, as far as they fit into it."""
    whole = pieces[-1].end - float(pieces[0].t[0])
    for piece in pieces:
        room = inches * (piece.end - float(piece.t[0])) / whole - 0.08
        name = " · ".join(s for s in (piece.segment.part, piece.segment.label) if s)
        look = {"va": "top", "size": style.SMALL - 0.5, "color": style.MUTED}
        at = (float(piece.t[0]), 1.0)
        text = style.words(axes, name, at, (3.0, -3.0), style.FROM_TOP, **look)
        text.set_in_layout(False)
        style.shorten(text, room)
        if len(text.get_text()) < 4:
            text.remove()
