"""Texts that come from outside: made harmless to show and to write, and whole numbers in them."""

import html
import re
from collections.abc import Sequence

_HIDDEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)
"""What steers a terminal or turns the order of others instead of being seen: controls, marks and
overrides of direction, invisible spaces and tags, separators of lines, lone surrogates."""

_BREAKS = re.compile(r"[\t\n\v\f\r]+")


def visible(text: str, keep: str = "\n\t") -> str:
    r"""The text with escapes such as ``\x1b`` and ``\u202e`` for what would act instead of show.

    visible(visible(text)) = visible(text), and what has no such characters is returned as it is.

    Args:
        keep: control characters that stay: ends of lines and tabs of a whole text, none of a name.
    """
    return _HIDDEN.sub(lambda m: m[0] if m[0] in keep else _escape(m[0]), text)


def name_of(text: str) -> str:
    """A name from a file as the workbench calls it: one line, everything in it visible."""
    return visible(_BREAKS.sub(" ", text), keep="")


def csv_text(text: str) -> str:
    """A text as a cell that no spreadsheet takes for a formula: ``'=cmd|…``; others as they are."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def html_table(rows: Sequence[Sequence[str]], heads: Sequence[str] = ()) -> str:
    """Texts as a table of a notebook."""
    top = "".join(f'<th scope="col">{html.escape(h)}</th>' for h in heads)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(c)}</td>' for c in row)}</tr>" for row in rows)
    return f"<table>{f'<tr>{top}</tr>' if heads else ''}{body}</table>"


def html_lines(*lines: str) -> str:
    """Texts as paragraphs of a notebook."""
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines if line)


def whole(text: str) -> int | None:
    """The whole number from 0 that a text writes in up to nine digits; None where it is none."""
    return int(text) if re.fullmatch(r"\d{1,9}", text) else None


def _escape(character: str) -> str:
    code = ord(character)
    form, digits = ("x", 2) if code < 0x100 else ("u", 4) if code < 0x10000 else ("U", 8)
    return f"\\{form}{code:0{digits}x}"
