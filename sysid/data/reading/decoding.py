"""The text in the bytes of a log: its encoding, without the zero bytes of a serial line."""

import re

from sysid.errors import DataError, UsageError

_MAGIC = {
    b"PK\x03\x04": "a spreadsheet or zip archive; export the sheet as CSV",
    b"\x1f\x8b": "a gzip archive; unpack it first",
    b"\xd0\xcf\x11\xe0": "an Excel file; export the sheet as CSV",
    b"<": "a web page or XML; download or export the log as CSV",
    b"%PDF": "a PDF; export the numbers as CSV",
    b"\x89PNG": "a picture; name the log itself",
}
"""First bytes of what is no text log -> what it is and what to do."""
_HAN = "[\u3005\u4e00-\u9fff]+"
SCRIPTS = {
    "cp932": "[\u3040-\u30fe\u3005\u4e00-\u9fff]+",
    "euc-kr": "[\uac00-\ud7a3]+",
    "cp1251": "[\u0401\u0410-\u044f\u0451]{2,}",
    "gb2312": _HAN,
    "big5": _HAN,
    "gb18030": _HAN,
}
"""Encoding → words of its script; tried in this order where a text is not plausible in Western
letters. GB 18030 comes last: it has signs for nearly all bytes."""
SHOWN = 200
"""Lines with signs beyond ASCII that are looked at."""
OF_SCRIPT = 0.9
"""Share of the letters beyond ASCII that are of the script of their encoding."""
MOST_ZEROS = 0.05
"""Share of zero bytes up to which a text has them from a broken serial line."""


def decode(
    data: bytes, where: str, encoding: str | None = None
) -> tuple[str, tuple[str, ...], str]:
    """The text, what to know about its reading, and the encoding where it is a guess."""
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise DataError(f"{where} is {what}")
    if encoding is not None:
        try:
            return data.decode(encoding).lstrip("\ufeff"), (), ""
        except ValueError:
            raise DataError(f"{where} is not a text in {encoding}; omit `encoding`") from None
    wide = _wide(data)
    if wide:
        try:
            return data.decode(wide), (), ""
        except UnicodeDecodeError:
            raise DataError(f"{where} is damaged UTF-16 text; save it again as UTF-8") from None
    notes: tuple[str, ...] = ()
    zeros = data.count(b"\0")
    if zeros > MOST_ZEROS * len(data) or (zeros and _is_binary(data.replace(b"\0", b""))):
        raise DataError(f"{where} is not text (it holds zero bytes); give a CSV or Parquet log")
    if zeros:
        notes = (f"{where}: {zeros} zero byte{'s were' if zeros > 1 else ' was'} left out.",)
        data = data.replace(b"\0", b"")
    return _utf8(data, where, notes)


def _utf8(data: bytes, where: str, notes: tuple[str, ...]) -> tuple[str, tuple[str, ...], str]:
    """The text in UTF-8, or in the encoding that its letters suggest."""
    try:
        return data.decode("utf-8-sig"), notes, ""
    except UnicodeDecodeError as error:
        if _is_binary(data):
            raise DataError(f"{where} is binary; give a CSV or Parquet log") from None
        line = data[: error.start].count(b"\n") + 1
        guess = legacy(data)
        note = f"{where} is not UTF-8 (line {line}); read as {guess}, which is a guess."
        return data.decode(guess, "replace"), (*notes, note), guess


def check_encoding(encoding: str) -> None:
    """Refuse an encoding that there is not."""
    try:
        b"a".decode(encoding)
    except UnicodeError:  # of wider signs: a single byte is none
        return
    except (LookupError, ValueError):
        raise UsageError(
            f"unknown `encoding` {encoding!r}; write one such as utf-8, utf-16-le, cp1252, "
            "shift_jis or gb18030"
        ) from None


def legacy(data: bytes) -> str:
    """The encoding of a text of the time before Unicode: a guess by its letters.

    In Western text a letter beyond ASCII stands in a word of ASCII letters (``Größe``), and no byte
    is one that Windows-1252 lacks. Else the text is in the first encoding that has signs for all of
    its bytes, whose letters are of one script.
    """
    lines = [line for line in data.split(b"\n") if not line.isascii()]
    some = b"\n".join(lines[:SHOWN])
    try:
        letters = _foreign(some.decode("cp1252"))
        inside = sum(bool(re.search("[A-Za-z]", around)) for _, around in letters)
        if 2 * inside >= len(letters):
            return "cp1252"
    except UnicodeDecodeError:
        pass
    for encoding, script in SCRIPTS.items():
        try:
            text = some.decode(encoding)
        except UnicodeDecodeError:
            continue
        of_script = sum(map(len, re.findall(script, text)))
        if of_script and of_script >= OF_SCRIPT * len(_foreign(text)):
            return encoding
    return "cp1252"


def _foreign(text: str) -> list[tuple[str, str]]:
    """The letters beyond ASCII, each with the signs beside it; µ is a sign of a unit."""
    marked = enumerate(text)
    return [
        (c, text[max(k - 1, 0) : k + 2]) for k, c in marked if c > "~" and c.isalpha() and c != "µ"
    ]


def _wide(data: bytes) -> str:
    """The name of a two-byte encoding, by its mark or by zeros in every other byte."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = data[:400]
    zeros = [head[k::2].count(0) for k in (0, 1)]
    if max(zeros) <= len(head) // 4 or min(zeros) > len(head) // 40:
        return ""
    return "utf-16-be" if zeros[0] > zeros[1] else "utf-16-le"


def _is_binary(data: bytes) -> bool:
    """Whether the first bytes hold more control signs than a broken line would leave."""
    head = data[:4096]
    return sum(b < 9 or 13 < b < 32 for b in head) > 0.02 * len(head)
