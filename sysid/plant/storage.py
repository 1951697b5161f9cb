"""Folders and zips of plant packages: written atomically, read without unpacking."""

import io
import os
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from sysid.data.files import write_atomic
from sysid.errors import DataError, ModelError, UsageError

Files = Mapping[str, bytes]
"""Contents by name inside the package, with ``/`` between folder and file."""

MARK = "plant.json"
"""The file that makes a folder or a zip a plant package."""

MAX_MEMBER = 64 * 1024**2
"""Files inside a package beyond this size [bytes] are refused before they are unpacked."""

_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_files(path: Path, files: Files, known: frozenset[str]) -> Path:
    """Write a package as a folder, or as one zip where ``path`` ends in ``.zip``.

    A package that is there already is replaced; anything else is left alone and refused.

    Args:
        known: names a package may hold; other files in a folder belong to somebody else.

    Raises:
        UsageError: something that is no package stands at ``path``.
        DataError: the place cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() == ".zip":
        if path.is_file() and not _has_member(path, MARK):
            raise UsageError(
                f"{path} is not a plant package and was not changed; choose another name"
            )
        return write_atomic(path, zip_bytes(files))
    target = Path(os.path.realpath(path))
    _check_folder(path, target, known)
    try:
        _swap_in(target, files)
    except (FileExistsError, NotADirectoryError):
        raise UsageError(f"{path} cannot be created, because a parent is a file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DataError(f"{path} cannot be written ({reason}); choose another place") from None
    return path


def zip_bytes(files: Files) -> bytes:
    """A zip of the files whose bytes depend on nothing else: fixed times, order and modes.

    Members are stored, not deflated: deflate's output depends on the zlib in use, and the whole
    package is some tens of kB.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, _EPOCH)
            info.create_system = 3  # Unix wherever it is written, so that the bytes agree
            info.external_attr = 0o100644 << 16
            archive.writestr(info, files[name])
    return buffer.getvalue()


def read_member(path: Path, name: str) -> bytes:
    """One file of a package; zips are read in memory, nothing is ever unpacked onto the disk.

    Raises:
        ModelError: there is no package or no such file in it, or it cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            inside = path.joinpath(name)
            if inside.stat().st_size > MAX_MEMBER:
                raise ModelError(f"{inside} is too large for a plant package; export it again")
            return inside.read_bytes()
        if not path.exists():
            raise ModelError(f"there is no plant package {path}; run `sysid export` to make one")
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(name).file_size > MAX_MEMBER:
                raise ModelError(f"{name} in {path} is too large; export the plant again")
            return archive.read(name)
    except (KeyError, FileNotFoundError):
        raise ModelError(
            f"{path} is not a plant package, because it has no {name}; export it again"
        ) from None
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError):
        raise ModelError(
            f"{path} is not a plant package (neither a folder nor an intact zip); export it again"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path} cannot be read ({reason})") from None


def read_members(path: Path, names: Iterable[str]) -> Files:
    """Those of the files of a package that are there, by name.

    Raises:
        ModelError: a file is there and cannot be read.
    """
    return {name: read_member(path, name) for name in names if _has_member(Path(path), name)}


def names_in(path: Path) -> frozenset[str]:
    """Names of all files that lie in a zip, whatever its description says.

    Raises:
        ModelError: it cannot be read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(n for n in archive.namelist() if not n.endswith("/"))
    except (OSError, zipfile.BadZipFile) as error:
        raise ModelError(f"{path} cannot be read ({error})") from None


def _has_member(path: Path, name: str) -> bool:
    if path.is_dir():
        return path.joinpath(name).is_file()
    try:
        with zipfile.ZipFile(path) as archive:
            return name in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _check_folder(path: Path, target: Path, known: frozenset[str]) -> None:
    if target.exists() and not target.is_dir():
        raise UsageError(f"{path} is a file; name a folder or a .zip for the plant package")
    if not target.is_dir():
        return
    if target == Path.cwd() or target in Path.cwd().parents:
        raise UsageError(f"{path} is the current folder; give the plant package its own folder")
    there = {p.relative_to(target).as_posix() for p in target.rglob("*") if not p.is_dir()}
    foreign = sorted(there - known)
    if foreign:
        raise UsageError(
            f"{path} holds files that are not a plant package's ({foreign[0]}); it was not "
            "changed; choose another folder"
        )


def _swap_in(target: Path, files: Files) -> None:
    """Fill a folder beside the target, move the old one aside, and let the new take its name."""
    target.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=".part-", dir=target.parent))
    old = fresh.with_name(fresh.name + "-old")
    try:
        for name, content in files.items():
            write_atomic(fresh / name, content)
        os.chmod(fresh, 0o755)  # mkdtemp's 0700 would hide the package from everybody else
        if target.exists():
            os.rename(target, old)
        try:
            os.rename(fresh, target)
        except OSError:
            with suppress(OSError):
                os.rename(old, target)
            raise
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
