"""A page: a verdict in lines, then sections of panels, tables and text; one HTML file alone."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from sysid.data import documents
from sysid.data.schema import STORED, checked
from sysid.errors import DataError
from sysid.report.movement import instants
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
        files: names of files beside the page that it links to.
        note: a remark below everything.
        pairs: whether two panels stand beside each other, not three.
        within: whether it is a part of the section before it.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    title: str
    panels: tuple[Panel, ...] = ()
    text: tuple[str, ...] = ()
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    code: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    note: str = ""
    pairs: bool = field(default=False, kw_only=True)
    within: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, eq=False)
class Page:
    """What a page shows.

    Attributes:
        tiles: (figure, what it is) of the few figures that matter most.
        text: paragraphs above the first section.
    """

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    title: str
    subtitle: str
    checks: tuple[Check, ...]
    sections: tuple[Section, ...]
    tiles: tuple[tuple[str, str], ...] = ()
    text: tuple[str, ...] = ()

    def html(self, beside: str = ".") -> str:
        """The page as text; it needs no script, no network and no other file.

        Args:
            beside: the folder of the files that it links to, from where it will lie.
        """
        from jinja2 import Environment, PackageLoader, StrictUndefined

        place = Environment(
            loader=PackageLoader("sysid.report"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        text = place.get_template("page.html.j2").render(
            page=self, svg=svg, instants=instants, beside=beside
        )
        text = re.sub("ω\N{COMBINING DOT ABOVE}(_\\w+)?", r"dω\1/dt", text)  # few fonts have it
        return re.sub(r"(?<=\d) %(?!\w)", "\N{NO-BREAK SPACE}%", text)


def stored_page(path: Path) -> Page:
    """A page as ``documents.text`` has written it."""
    from sysid.data.files import contents

    try:
        return checked(Page, documents.parsed(contents(path)))
    except OSError as error:
        reason = error.strerror or error
    except ValueError as error:
        reason = f"damaged: {error}"
    raise DataError(f"{path}: {reason}; run `sysid diagnose` again")
