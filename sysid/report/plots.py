"""Pictures of results: SVG or PNG by suffix, the same bytes for the same content.

This is the only module that imports matplotlib, inside its functions, because that import takes
longer than many a fit. What makes a picture reproducible:

- matplotlib's own defaults and the fixed style replace the user's ``matplotlibrc`` while drawing,
  and only then; nothing global changes.
- Text in an SVG is drawn as outlines of DejaVu Sans, which matplotlib carries with it, so a
  picture looks the same in a browser without that font. The text itself stays in comments.
- Element names are hashed with a fixed salt; date, software and version are left out.
- SVG coordinates are rounded to 0.01 pt, which also cuts the size by a third and hides the last
  digit in which processors differ.
"""

import html
import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sysid.data.files import write_atomic
from sysid.errors import UsageError
from sysid.report import (
    dynamics_drawing,
    fan_drawing,
    fit_drawing,
    mission_drawing,
    ranking_drawing,
    style,
    vehicle_drawing,
)
from sysid.report.correlation_panels import LagTest
from sysid.report.dynamics_drawing import DynamicsPicture, PoleZeroSet, StepResponse
from sysid.report.fan_drawing import FanPanel, FanPicture
from sysid.report.fit_picture import FitPicture, FitSegment
from sysid.report.mission_drawing import MissionPicture, Obstacle
from sysid.report.missions import (
    front_drawing,
    plan_drawing,
    response_drawing,
    runs_drawing,
)
from sysid.report.missions.front_drawing import FrontPicture, Mark, Trade
from sysid.report.missions.plan_drawing import CurvePanel, PlanPicture
from sysid.report.missions.response_drawing import Line, Panel, ResponsePicture
from sysid.report.missions.runs_drawing import RunsPicture
from sysid.report.ranking_drawing import RankingPicture, RankingRow
from sysid.report.vehicle_drawing import VehiclePicture, WheelMark

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

__all__ = [
    "CurvePanel",
    "DynamicsPicture",
    "FanPanel",
    "FanPicture",
    "FitPicture",
    "FitSegment",
    "FrontPicture",
    "LagTest",
    "Line",
    "Mark",
    "MissionPicture",
    "Obstacle",
    "Panel",
    "PlanPicture",
    "PoleZeroSet",
    "RankingPicture",
    "RankingRow",
    "ResponsePicture",
    "RunsPicture",
    "StepResponse",
    "Trade",
    "VehiclePicture",
    "WheelMark",
    "inline_svg",
    "picture_format",
    "plot_dynamics",
    "plot_fan",
    "plot_fit",
    "plot_front",
    "plot_mission",
    "plot_plan",
    "plot_ranking",
    "plot_responses",
    "plot_vehicle",
    "share_letters",
]

PictureFormat = Literal["svg", "png"]

_PNG_DPI = 200
"""Twice the 100 px/in at which a picture is 900 px wide: sharp on dense screens."""


def picture_format(path: Path) -> PictureFormat:
    """The format a file name asks for; call it before a long fit to refuse early.

    Raises:
        UsageError: the name ends neither in ``.svg`` nor in ``.png``.
    """
    suffix = path.suffix.lower()
    if suffix == ".svg":
        return "svg"
    if suffix == ".png":
        return "png"
    raise UsageError(f"cannot draw to {str(path)!r}: choose a file name that ends in .svg or .png")


def plot_fit(path: Path, picture: FitPicture) -> None:
    """Draw measured and simulated outputs, residuals, their tests and the inputs.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = fit_drawing.size_inches(picture)
    _write(path, size, lambda figure: fit_drawing.draw(figure, picture))


def plot_ranking(path: Path, picture: RankingPicture) -> None:
    """Draw models as bars in the order of a criterion, with their fits beside them.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = ranking_drawing.size_inches(picture)
    _write(path, size, lambda figure: ranking_drawing.draw(figure, picture))


def plot_mission(path: Path, picture: MissionPicture) -> None:
    """Draw the path among the obstacles, and speed, heading, PWM and distance over time.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = mission_drawing.size_inches(picture)
    _write(path, size, lambda figure: mission_drawing.draw(figure, picture))


def plot_fan(path: Path, picture: FanPicture) -> None:
    """Draw a measured drive over the runs that were predicted for it.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = fan_drawing.size_inches(picture)
    _write(path, size, lambda figure: fan_drawing.draw(figure, picture))


def plot_plan(path: Path, picture: PlanPicture) -> None:
    """Draw the field lines of a guidance law, its potential, forces and references of speed.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = plan_drawing.size_inches(picture)
    _write(path, size, lambda figure: plan_drawing.draw(figure, picture))


def plot_runs(path: Path, picture: RunsPicture) -> None:
    """Draw the paths of many runs, how they ended and what their time depends on.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = runs_drawing.size_inches(picture)
    _write(path, size, lambda figure: runs_drawing.draw(figure, picture))


def plot_front(path: Path, picture: FrontPicture) -> None:
    """Draw what sets of gains trade, and answers of the proposed one.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = front_drawing.size_inches(picture)
    _write(path, size, lambda figure: front_drawing.draw(figure, picture))


def plot_responses(path: Path, picture: ResponsePicture) -> None:
    """Draw answers over time beside their references, and paths in the plane.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = response_drawing.size_inches(picture)
    _write(path, size, lambda figure: response_drawing.draw(figure, picture))


def plot_dynamics(path: Path, picture: DynamicsPicture) -> None:
    """Draw poles and zeros beside the unit circle, and the step responses.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = dynamics_drawing.size_inches(picture)
    _write(path, size, lambda figure: dynamics_drawing.draw(figure, picture))


def plot_vehicle(path: Path, picture: VehiclePicture) -> None:
    """Draw a vehicle from above, with its axles and the centre it turns about.

    Raises:
        UsageError: the suffix of ``path`` is neither ``.svg`` nor ``.png``.
    """
    size = vehicle_drawing.size_inches(picture)
    _write(path, size, lambda figure: vehicle_drawing.draw(figure, picture))


def inline_svg(
    name: str, size: tuple[float, float], draw: Callable[["Figure"], None], label: str
) -> str:
    """A picture as an ``<svg>`` element that can stand in a page beside others.

    Args:
        name: letters that no other picture of the page has: they head its ids.
        size: width and height [in].
        draw: draws on the figure.
        label: what it shows, for those who do not see it.
    """
    svg = _render("svg", size, draw).decode()
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.S)
    used = set(re.findall(r"url\(#([^)]+)\)|xlink:href=\"#([^\"]+)\"", svg))
    kept = {a or b for a, b in used}

    def own(match: re.Match[str]) -> str:
        return f' id="{name}-{match[1]}"' if match[1] in kept else ""

    svg = re.sub(r' id="([^"]*)"', own, svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    svg = re.sub(r'xlink:href="#', f'xlink:href="#{name}-', svg)
    svg = re.sub(r"\n\s*\n+", "\n", svg)
    described = f'<svg role="img" aria-label="{html.escape(label)}"'
    return svg.replace("<svg", described, 1).strip()


def share_letters(page: str) -> str:
    """Keep the outline of each letter once in a page of :func:`inline_svg` pictures.

    A dozen pictures have most letters in common: their outlines and the references to them were
    half of the page.

    Args:
        page: an HTML page with a ``<body>``.

    Returns:
        the page, the outlines in a first picture that has no size.
    """
    short: dict[str, str] = {}  # outline -> id

    def keep(match: re.Match[str]) -> str:
        outline = match[2]
        renamed[match[1]] = short.setdefault(outline, f"l{len(short)}")
        return ""

    renamed: dict[str, str] = {}
    page = re.sub(r'<path id="([^"]+-DejaVuSans[^"]*)"([^>]*?)/>\n?', keep, page)
    page = re.sub(
        r'<use xlink:href="#([^"]+-DejaVuSans[^"]*)"',
        lambda match: f'<use xlink:href="#{renamed[match[1]]}"',
        page,
    )
    letters = "".join(f'<path id="{id}"{outline}/>\n' for outline, id in short.items())
    shared = f'<svg width="0" height="0" aria-hidden="true" class="letters"><defs>\n{letters}'
    return page.replace("<body>\n", f"<body>\n{shared}</defs></svg>\n", 1)


def _write(path: Path, size: tuple[float, float], draw: Callable[["Figure"], None]) -> None:
    kind = picture_format(path)
    write_atomic(path, _render(kind, size, draw))


def _render(
    kind: PictureFormat, size: tuple[float, float], draw: Callable[["Figure"], None]
) -> bytes:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    look: Any = {**style.RC, "svg.fonttype": "path", "svg.hashsalt": "sysid"}
    buffer = io.BytesIO()
    with warnings.catch_warnings(), matplotlib.rc_context():
        matplotlib.rcdefaults()  # the user's matplotlibrc must not change the picture
        matplotlib.rcParams.update(look)
        # A name in a script DejaVu Sans lacks shows as boxes; that is no reason to warn.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from", category=UserWarning)
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)  # measures text, whatever the format
        draw(figure)
        _make_printable(figure)
        if kind == "svg":
            # savefig draws twice where panels find their own places: once only to place them.
            canvas: Any = FigureCanvasSVG(figure)
            canvas.print_svg(buffer, metadata={"Date": None, "Creator": None})
            return _rounded(buffer.getvalue().decode()).encode()
        figure.savefig(buffer, format="png", dpi=_PNG_DPI, metadata={"Software": None})
        return buffer.getvalue()


def _make_printable(figure: "Figure") -> None:
    """Every word of a figure but those at ticks: drawing writes these anew, and to make ticks only
    to look at them takes long.
    """
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    waiting: list[Artist] = [figure]
    while waiting:
        artist = waiting.pop()
        if isinstance(artist, Text):
            artist.set_text(style.printable(artist.get_text()))
        if isinstance(artist, Axis):
            waiting += [artist.label, artist.offsetText]
        else:
            waiting += artist.get_children()


def _rounded(svg: str) -> str:
    """Round coordinates to two decimals and drop needless blanks: paths, marks and letters."""

    def number(match: re.Match[str]) -> str:
        return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")

    def place(match: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d+", number, match[0])

    def path(match: re.Match[str]) -> str:
        return re.sub(r"([A-Zz]) ", r"\1", place(match).replace(" \n", "\n"))

    svg = re.sub(r' d="[^"]*"', path, svg)
    return re.sub(r' [xy]="[^"]*"|translate\([^)]*\)', place, svg)
