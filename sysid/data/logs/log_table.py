"""Read the table of a log of any kind: text, Parquet or a bag of ROS."""

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.data.files import read_bytes
from sysid.data.finding import Finding
from sysid.data.reading.long_form import wide
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Table, read_table
from sysid.errors import UsageError

if TYPE_CHECKING:
    from hashlib import _Hash


@dataclass(frozen=True, eq=False)
class LogTable:
    """A log before its columns are read.

    Attributes:
        table: its columns.
        findings: what was done to make a table of it.
        digest: the checksum of its bytes, to be continued with those of a second file.
    """

    table: Table
    findings: tuple[Finding, ...]
    digest: "_Hash"


def read_log_table(path: Path, options: ReadOptions, *, even: bool = True) -> LogTable:
    """The table of a log.

    Args:
        path: CSV, Parquet, or a bag, for which ``options.map`` says what is which column.
        options: how to read it.
        even: whether streams of a bag are to share even rows; other files are as they are.

    Raises:
        UsageError: there is no such file, or an option does not fit it.
        DataError: it cannot be read.
    """
    from sysid.data.bags.opening import digest, is_bag

    if is_bag(path):
        from sysid.data.bags.log import bag_table

        table, said = bag_table(path, options, even=even)
        return LogTable(table, said, digest(path))
    data = read_bytes(path)
    _check_no_bag_options(path, options)
    table = read_table(data, path.name, *options.of_text)
    return LogTable(
        replace(wide(table), date_order=options.date_order), table.findings, sha256(data)
    )


def _check_no_bag_options(path: Path, options: ReadOptions) -> None:
    """Refuse what only a bag can take.

    Raises:
        UsageError: something of it is given.
    """
    if options.map:
        raise UsageError(f"{path.name} is not a bag, and `map` is for bags only; name its columns")
    plain = ReadOptions()
    for name in ("stamps", "latency"):
        if getattr(options, name) != getattr(plain, name):
            raise UsageError(f"{path.name} is not a bag, and `{name}` is for bags only; omit it")
