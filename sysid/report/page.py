"""A page: a verdict in lines, then sections of panels, tables and text; one HTML file alone."""

from dataclasses import dataclass
from typing import Literal

from sysid.report.panels import Panel
from sysid.report.svg_panels import svg

Check = tuple[Literal["good", "bad", "note"], str]
"""What speaks for or against something, and the sentence."""


@dataclass(frozen=True, eq=False)
class Section:
    """A part of a page.

    Attributes:
        text: paragraphs above the panels.
        heads, rows: of a table below them.
        code: blocks of code at the end.
    """

    title: str
    panels: tuple[Panel, ...] = ()
    text: tuple[str, ...] = ()
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    code: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Page:
    """What a page shows."""

    title: str
    subtitle: str
    checks: tuple[Check, ...]
    sections: tuple[Section, ...]

    def html(self) -> str:
        """The page as text; it needs no script, no network and no other file."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        place = Environment(
            loader=PackageLoader("sysid.report"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        return place.get_template("page.html.j2").render(page=self, svg=svg)
