"""The text in the bytes of a log: its encoding, without the zero bytes of a serial line."""

from sysid.errors import DataError

_MAGIC = {
    b"PK\x03\x04": "a spreadsheet or zip archive; export the sheet as CSV",
    b"\x1f\x8b": "a gzip archive; unpack it first",
    b"\xd0\xcf\x11\xe0": "an Excel file; export the sheet as CSV",
    b"<": "a web page or XML; download or export the log as CSV",
    b"%PDF": "a PDF; export the numbers as CSV",
    b"\x89PNG": "a picture; name the log itself",
}
"""First bytes of what is no text log -> what it is and what to do."""
MOST_ZEROS = 0.05
"""Share of zero bytes up to which a text has them from a broken serial line."""


def decode(data: bytes, where: str) -> tuple[str, tuple[str, ...]]:
    """The text, and what a person should know about its reading.

    Raises:
        DataError: it is no text.
    """
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise DataError(f"{where} is {what}")
    wide = _wide(data)
    if wide:
        try:
            return data.decode(wide), ()
        except UnicodeDecodeError:
            raise DataError(f"{where} is damaged UTF-16 text; save it again as UTF-8") from None
    notes: tuple[str, ...] = ()
    zeros = data.count(b"\0")
    if zeros > MOST_ZEROS * len(data) or (zeros and _is_binary(data.replace(b"\0", b""))):
        raise DataError(f"{where} is not text (it holds zero bytes); give a CSV or Parquet log")
    if zeros:
        notes = (f"{where}: {zeros} zero byte{'s were' if zeros > 1 else ' was'} left out.",)
        data = data.replace(b"\0", b"")
    try:
        return data.decode("utf-8-sig"), notes
    except UnicodeDecodeError as error:
        if _is_binary(data):
            raise DataError(f"{where} is binary; give a CSV or Parquet log") from None
        line = data[: error.start].count(b"\n") + 1
        return data.decode("cp1252", "replace"), (
            *notes,
            f"{where} is not UTF-8 (line {line}); read as Windows-1252.",
        )


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
