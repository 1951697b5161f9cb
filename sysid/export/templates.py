"""Files written from templates: jinja2, with marks that neither C nor CMake nor make uses.

``@{ x }@`` is a value, ``%% for``, ``%% if`` … stand alone in their line.
"""

import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from sysid.export.c.fields import members
from sysid.runners.trace.writing import comment, listed, number, wrapped
from sysid.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment


def fill(template: str, **values: Any) -> str:
    """A template of ``sysid/export`` with its values, e.g. ``c/plant.h``.

    Filters: ``number`` and ``numbers`` (literals of C), ``rows_of_numbers`` (lines of a table),
    ``members`` (of a struct), ``comment`` (text that ends no comment), ``xml`` (a quoted
    attribute).
    """
    return _environment().get_template(template).render(version=__version__, **values)


_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]+")


def plain(text: str) -> str:
    """Text without what XML, or a name of the standard, cannot hold: lines become blanks."""
    return _CONTROL.sub(" ", text).strip()


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    made = Environment(
        loader=FunctionLoader(_text),
        undefined=StrictUndefined,
        variable_start_string="@{",
        variable_end_string="}@",
        block_start_string="@%",
        block_end_string="%@",
        comment_start_string="@#",
        comment_end_string="#@",
        line_statement_prefix="%%",
        keep_trailing_newline=True,
        autoescape=False,
    )
    made.filters |= {
        "number": number,
        "numbers": listed,
        "rows_of_numbers": lambda values: wrapped([number(v) for v in values]),
        "comment": comment,
        "members": lambda fields: "\n".join(members(fields)),
        "xml": lambda text: quoteattr(plain(str(text))),
    }
    return made


def _text(template: str) -> str:
    folder, _, name = template.partition("/")
    return files("sysid.export").joinpath(folder, "templates", name).read_text(encoding="utf-8")
