"""Complete lines of a growing file, a pipe or a serial port, read without blocking."""

import os
import select
import stat
import sys
from abc import ABC, abstractmethod
from pathlib import Path
from typing import IO

from sysid.data.files import open_regular
from sysid.data.reading.decoding import MOST_ZEROS
from sysid.errors import DataError, UsageError

CHUNK = 1 << 16
"""Bytes read at once."""

LONGEST_LINE = 1 << 20
"""Bytes without a line end after which this is no log."""


class Lines(ABC):
    """Where lines come from.

    Attributes:
        where: its name, for messages.
        restarted: whether the lines of the last ``new`` begin a file anew: it was cut to nothing,
            or another took its place.
        ended: whether nothing can come any more.
    """

    def __init__(self, where: str) -> None:
        self.where = where
        self.restarted = False
        self.ended = False
        self._rest = b""

    def new(self) -> list[str]:
        """The lines that have become whole since the last call, without their ends."""
        data = self._read()
        if not data:
            return []
        zeros = data.count(b"\0")
        *whole, self._rest = (self._rest + data.replace(b"\0", b"")).split(b"\n")
        if len(self._rest) > LONGEST_LINE or zeros > MOST_ZEROS * len(data):
            raise DataError(f"{self.where} is not text in lines; follow a CSV log")
        return [line.decode("utf-8", "replace").rstrip("\r") for line in whole]

    def last(self) -> list[str]:
        """The line that has no end, once nothing follows it."""
        rest, self._rest = self._rest, b""
        return [rest.decode("utf-8", "replace").rstrip("\r")] if rest.strip() else []

    @abstractmethod
    def _read(self) -> bytes:
        """The bytes that are there now."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it."""


class FileLines(Lines):
    """A file that grows; it may not be there yet, be cut to nothing, or be replaced by another."""

    def __init__(self, path: Path) -> None:
        super().__init__(path.name)
        if path.is_dir():
            raise UsageError(f"{path} is a folder; name the log that is written in it")
        if not path.parent.is_dir():
            raise UsageError(f"folder not found: {path.parent}; check the path")
        self._path = path
        self._file: IO[bytes] | None = None

    def _read(self) -> bytes:
        self.restarted = False
        try:
            if self._file is None:
                self._file = open_regular(self._path)
            data = self._file.read(CHUNK)
            if data:
                return data
            return self._after_a_change()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise DataError(f"{self._path} cannot be read ({error.strerror})") from None

    def _after_a_change(self) -> bytes:
        """What a file holds that took the place of the one read to its end, or was cut."""
        assert self._file is not None
        own, there = os.fstat(self._file.fileno()), os.stat(self._path)
        if (own.st_ino, own.st_dev) != (there.st_ino, there.st_dev):
            self._file.close()
            self._file = open_regular(self._path)
        elif there.st_size < self._file.tell():
            self._file.seek(0)
        else:
            return b""
        self.restarted, self._rest = True, b""
        return self._file.read(CHUNK)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


class PipeLines(Lines):
    """A pipe, the standard input, or a device such as a serial port."""

    def __init__(self, path: Path | None) -> None:
        super().__init__("the standard input" if path is None else path.name)
        self._own = path is not None
        try:
            self._descriptor = (
                sys.stdin.fileno() if path is None else os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            )
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is closed"
            raise DataError(f"{self.where} cannot be read ({reason})") from None
        self._fed = not self._own  # a named pipe is at its end until somebody writes

    def _read(self) -> bytes:
        try:
            ready, _, _ = select.select([self._descriptor], [], [], 0.0)
            data = os.read(self._descriptor, CHUNK) if ready else b""
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise DataError(f"{self.where} cannot be read ({error})") from None
        self._fed = self._fed or bool(data)
        self.ended = bool(ready) and not data and self._fed
        return data

    def close(self) -> None:
        if self._own:
            os.close(self._descriptor)


def lines_of(source: str) -> Lines:
    """The lines of ``-``, a pipe, a device or a file, which need not be there yet."""
    if source == "-":
        return PipeLines(None)
    path = Path(source)
    try:
        mode = path.stat().st_mode
    except OSError:
        return FileLines(path)
    if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode):
        return PipeLines(path)
    return FileLines(path)
