"""Reading and writing whole files: one sentence on failure, and never half a file on the disk."""

import errno
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from sysid.errors import DataError, UsageError
from sysid.outside_text import visible

if TYPE_CHECKING:
    from hashlib import _Hash

MAX_BYTES = 4 * 1024**3
"""Files beyond this size [bytes] are refused before they fill the memory."""

PART = ".part-sysid-"
"""Begins the name of a folder in which something is made before it takes its place."""

_BLOCK = 1 << 20


def open_regular(path: str | Path) -> IO[bytes]:
    """A regular file, open for reading.

    Raises:
        OSError: there is none, it may not be read, or it is a folder, a device or a pipe, which may
            never end.
    """
    _require_regular(os.stat(path))  # before it is opened: that alone starts some devices
    wanted = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    stream = os.fdopen(os.open(path, wanted), "rb")
    try:
        _require_regular(os.fstat(stream.fileno()))
    except OSError:
        stream.close()
        raise
    return stream


def contents(path: str | Path, most: int = MAX_BYTES) -> bytes:
    """The bytes of a regular file, counted while they are read.

    Raises:
        OSError: see :func:`open_regular`; or there are more than ``most``.
    """
    too_large = OSError(errno.EFBIG, f"it is larger than {most / 1e6:.4g} MB; cut it into parts")
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > most:
            raise too_large
        blocks = [stream.read(size)]
        while block := stream.read(_BLOCK):  # it grew, or does not know its size
            blocks.append(block)
            if len(blocks) * _BLOCK + size > most + _BLOCK:
                raise too_large
    return blocks[0] if len(blocks) == 1 else b"".join(blocks)


def read_bytes(path: str | Path) -> bytes:
    """The bytes of one file.

    Raises:
        UsageError: there is no such file, or the path names a folder.
        DataError: the file may not be read, is a device or a pipe, or is larger than MAX_BYTES.
    """
    path = Path(path)
    if "\0" in str(path):
        raise UsageError(f"{str(path)!r} is not a valid path; check it")
    try:
        return contents(path)
    except IsADirectoryError:
        raise UsageError(f"{path} is a folder; name the log file inside it") from None
    except FileNotFoundError:
        raise UsageError(f"{path}: file not found{_beside(path)}") from None
    except PermissionError:
        raise DataError(f"{path} is not readable; change its permissions") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); check the path") from None


def checksum(path: Path) -> "_Hash":
    """SHA-256 of a file, or of the files of a folder one after the other, read in blocks."""
    total = hashlib.sha256()
    for file in sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]:
        with open_regular(file) as stream:
            while block := stream.read(_BLOCK):
                total.update(block)
    return total


def write_atomic(path: str | Path, content: str | bytes) -> Path:
    """Write a whole file so that a reader sees the old content or the new one, never a part.

    Text is UTF-8 with ``\n`` ends, its control characters escaped. See :func:`replacing` for the
    rest.

    Returns:
        The path written.

    Raises:
        UsageError, DataError: see :func:`replacing`.
    """
    data = visible(content, "\n\t\r").encode("utf-8") if isinstance(content, str) else content
    with replacing(path) as new:
        write_new(new, data)
    return Path(path)


def write_new(path: Path, data: bytes) -> None:
    """Write a file down to the disk, inside of what :func:`replacing` makes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


@contextmanager
def replacing(path: str | Path, folder: bool = False) -> Iterator[Path]:
    """A name for a file or a folder to be made, which takes the place of ``path`` at the end.

    It lies in a folder of its own beside the target, so that a file takes its place in one rename.
    An old folder is moved aside first; :func:`settle` puts it back after a kill between the two
    renames. Links are followed, and missing parent folders made.

    Args:
        folder: whether it is a folder, which may replace a folder; else it is a file.

    Raises:
        UsageError: the path names a folder, a device or a pipe, or a parent of it is a file.
        DataError: the folder may not be written, or the disk refuses (full, too long a name).
    """
    path = Path(path)
    try:
        target = Path(os.path.realpath(path))
        _require_replaceable(path, target, folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        settle(target.parent)
        with _part(target.parent) as part:
            new, old = part / "new" / target.name, part / "old" / target.name
            new.parent.mkdir()
            yield new
            if new.is_dir():
                old.parent.mkdir()
                with suppress(FileNotFoundError):
                    os.rename(target, old)
                os.rename(new, target)
            else:
                os.chmod(new, _mode(target))
                os.replace(new, target)
    except (FileExistsError, NotADirectoryError):
        raise UsageError(
            f"{path} cannot be written: {path.parent} is not a folder; choose another path"
        ) from None
    except PermissionError:
        raise DataError(
            f"{path} cannot be written: no permission in {path.parent}; choose another path"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DataError(f"{path} cannot be written ({reason}); choose another path") from None


def settle(folder: Path) -> None:
    """Remove what a killed command left in a folder, and put back what it had moved aside.

    A command that is still running holds a lock on what it makes, which is left alone.
    """
    try:
        left = [e.path for e in os.scandir(folder) if e.name.startswith(PART)]
    except OSError:
        return
    for part in map(Path, left):
        held = _hold(part, wait=False)
        if held is not None:
            with suppress(OSError):
                _clear(part)
            os.close(held)


@contextmanager
def _part(folder: Path) -> Iterator[Path]:
    """A folder in another one, locked as long as it is needed and then cleared."""
    while True:
        part = Path(tempfile.mkdtemp(prefix=PART, dir=folder))
        held = _hold(part, wait=True)
        if part.exists():
            break
        if held is not None:  # another command took it for a leftover before it was locked
            os.close(held)
    try:
        yield part
    finally:
        with suppress(OSError):
            _clear(part)
        if held is not None:
            os.close(held)


def _clear(part: Path) -> None:
    """Put back what was moved aside and not replaced, then remove the rest."""
    for old in part.glob("old/*"):
        if not os.path.lexists(part.parent / old.name):
            os.rename(old, part.parent / old.name)
    shutil.rmtree(part, ignore_errors=True)


if sys.platform == "win32":

    def _hold(folder: Path, wait: bool) -> int | None:
        return None  # folders know no locks there: what is left stays
else:
    import fcntl

    def _hold(folder: Path, wait: bool) -> int | None:
        """A descriptor that locks a folder; None where another has it, or the disk has no locks."""
        try:
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            return None
        try:
            if os.fstat(descriptor).st_uid == os.geteuid():
                fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
                return descriptor
        except OSError:
            pass
        os.close(descriptor)
        return None


def _require_regular(status: os.stat_result) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is a device or a pipe, not a file")


def _require_replaceable(path: Path, target: Path, folder: bool) -> None:
    if target.is_dir() and not folder:
        raise UsageError(f"{path} is a folder; name a file to write")
    if target.exists() and not target.is_dir() and (folder or not target.is_file()):
        what = "is there and no folder" if folder else "is a device or a pipe, not a file"
        raise UsageError(f"{path} {what}; choose another path")


def _mode(path: Path) -> int:
    """The permissions of the file replaced, else those a plain ``open`` would give."""
    try:
        return path.stat().st_mode & 0o777
    except OSError:
        # The mask can only be read by setting it; mkstemp's 0600 would hide results from a group.
        mask = os.umask(0o022)
        os.umask(mask)
        return 0o666 & ~mask


def _beside(path: Path) -> str:
    """A hint naming a file of a similar name in the same folder, or nothing."""
    import difflib

    try:
        names = [p.name for p in path.parent.iterdir()]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.75)
    return f"; did you mean {path.parent / near[0]}?" if near else ""
