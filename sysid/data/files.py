"""Reading and writing whole files: one sentence on failure, and never half a file on the disk."""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from sysid.errors import DataError, UsageError
from sysid.outside_text import visible

MAX_BYTES = 4 * 1024**3
"""Files beyond this size [bytes] are refused before they fill the memory."""


def read_bytes(path: str | Path) -> bytes:
    """The bytes of one file.

    Raises:
        UsageError: there is no such file, or the path names a folder.
        DataError: the file may not be read, or is larger than MAX_BYTES.
    """
    path = Path(path)
    if "\0" in str(path):
        raise UsageError(f"{str(path)!r} is not a valid path; check it")
    try:
        if path.is_dir():
            raise UsageError(f"{path} is a folder; name the log file inside it")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise DataError(f"{path} is {size / 1e9:.1f} GB; cut it into parts below 4 GB")
        return path.read_bytes()
    except FileNotFoundError:
        raise UsageError(f"file not found: {path}; check the path{_beside(path)}") from None
    except PermissionError:
        raise DataError(f"{path} is not readable; change its permissions") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); check the path") from None


def write_atomic(path: str | Path, content: str | bytes) -> Path:
    """Write a whole file so that a reader sees the old content or the new one, never a part.

    The content goes to a temporary name in the same folder, is flushed to the disk, and takes the
    final name by ``os.replace``. Missing parent folders are made. Text is UTF-8 with ``\\n`` ends,
    its control characters escaped.

    Returns:
        The path written.

    Raises:
        UsageError: the path names a folder, or a parent of it is a file.
        DataError: the folder may not be written, or the disk refuses (full, too long a name).
    """
    path = Path(path)
    data = visible(content, "\n\t\r").encode("utf-8") if isinstance(content, str) else content
    temporary: str | None = None
    try:
        if path.is_dir():
            raise UsageError(f"{path} is a folder; name a file to write")
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".part-", suffix=".tmp", dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, _mode(path))
        os.replace(temporary, path)
        temporary = None
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
    finally:
        if temporary is not None:
            with suppress(OSError):
                os.unlink(temporary)
    return path


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
    return f" (did you mean {path.parent / near[0]}?)" if near else ""
