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

import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

from sysid.data.files import write_atomic
from sysid.errors import UsageError
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

PictureFormat = Literal["svg", "png", "pdf"]


class Picture(Protocol):
    """What a picture shows; it gives a figure its size and draws it."""

    def draw(self, figure: "Figure") -> None:
        """Draw it."""


_PNG_DPI = 200
"""Twice the 100 px/in at which a picture is 900 px wide: sharp on dense screens."""


def picture_format(path: Path) -> PictureFormat:
    """The format a file name asks for; call it before a long fit to refuse early."""
    for kind in get_args(PictureFormat):
        if path.suffix.lower() == f".{kind}":
            return kind  # type: ignore[no-any-return]
    raise UsageError(
        f"cannot draw to {str(path)!r}: choose a file name that ends in .svg, .png or .pdf"
    )


def write_picture(path: Path, picture: Picture) -> None:
    """Draw a picture of any kind into a file."""
    write_atomic(path, _render(picture_format(path), picture.draw))


def figure_of(picture: Picture) -> "Figure":
    """A picture as a figure that a script or a notebook goes on with."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        look: Any = style.RC
        matplotlib.rcParams.update(look)
        figure = Figure(layout="constrained")
        FigureCanvasAgg(figure)
        picture.draw(figure)
    return figure


def _render(kind: PictureFormat, draw: Callable[..., None], *shown: Any, **options: Any) -> bytes:
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
        figure = Figure(layout="constrained")
        FigureCanvasAgg(figure)  # measures text, whatever the format
        draw(figure, *shown, **options)
        _make_printable(figure)
        if kind == "svg":
            # savefig draws twice where panels find their own places: once only to place them.
            canvas: Any = FigureCanvasSVG(figure)
            canvas.print_svg(buffer, metadata={"Date": None, "Creator": None})
            return _rounded(buffer.getvalue().decode()).encode()
        unsaid = {"png": ("Software",), "pdf": ("Creator", "Producer", "CreationDate")}[kind]
        figure.savefig(buffer, format=kind, dpi=_PNG_DPI, metadata=dict.fromkeys(unsaid))
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
    """Round coordinates to two decimals and drop needless blanks: paths, marks and letters.

    Clip paths are named by their numbers: their own names differ from one drawing to the next.
    """

    def number(match: re.Match[str]) -> str:
        return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")

    def place(match: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d+", number, match[0])

    def path(match: re.Match[str]) -> str:
        return re.sub(r"([A-Zz]) ", r"\1", place(match).replace(" \n", "\n"))

    for k, name in enumerate(dict.fromkeys(re.findall(r'<clipPath id="(\w+)"', svg))):
        svg = svg.replace(name, f"clip{k}")
    svg = re.sub(r' d="[^"]*"', path, svg)
    return re.sub(r' [xy]="[^"]*"|translate\([^)]*\)', place, svg)
