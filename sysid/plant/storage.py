"""Folders and zips of plant packages: written atomically, read without unpacking."""

import errno
import io
import os
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from sysid.data.files import contents, replacing, settle, write_atomic, write_new
from sysid.errors import ModelError, UsageError

Files = Mapping[str, bytes]
"""Contents by name inside the package, with ``/`` between folder and file."""

MARK = "plant.json"
"""The file that makes a folder or a zip a plant package."""

MOST_BYTES = 32 * 1024**2
"""More bytes, packed or read, than any package has: the largest of ours are some hundred kB."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)

_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_files(path: Path, files: Files, known: frozenset[str]) -> Path:
    """Write a package as a folder, or as one zip where ``path`` ends in ``.zip``.

    A package that is there already is replaced; anything else is left alone and refused.

    Args:
        known: names a package may hold; other files in a folder belong to somebody else.
    """
    path = Path(path)
    if path.suffix.lower() == ".zip":
        if path.is_file() and not _is_package(path):
            raise UsageError(
                f"{path} is not a plant package and was not changed; choose another name"
            )
        return write_atomic(path, zip_bytes(files))
    _check_folder(path, Path(os.path.realpath(path)), known)
    with replacing(path, folder=True) as new:
        for name, content in files.items():
            write_new(new / name, content)
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
    """One file of a package; zips are read in memory, nothing is ever unpacked onto the disk."""
    with _opened(Path(path)) as package:
        if name not in package:
            raise ModelError(
                f"{path} is not a plant package, because it has no {name}; export it again"
            )
        return package.read(name)


def read_members(path: Path, names: Iterable[str]) -> Files:
    """Those of the files of a package that are there, by name."""
    read: dict[str, bytes] = {}
    with _opened(Path(path)) as package:
        for name in (n for n in names if n in package):
            read[name] = package.read(name)
            if sum(map(len, read.values())) > MOST_BYTES:
                raise ModelError(f"{path} is too large for a plant package; export it again")
    return read


def names_in(path: Path) -> frozenset[str]:
    """Names of all files that lie in a zip, whatever its description says."""
    with _opened(Path(path)) as package:
        return frozenset(n for n in package.names() if not n.endswith("/"))


class _Folder:
    """The files of a package in a folder."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __contains__(self, name: object) -> bool:
        return self._path.joinpath(str(name)).is_file()

    def names(self) -> Iterable[str]:
        return (
            p.relative_to(self._path).as_posix() for p in self._path.rglob("*") if not p.is_dir()
        )

    def read(self, name: str) -> bytes:
        place = self._path / name
        if not Path(os.path.realpath(place)).is_relative_to(os.path.realpath(self._path)):
            raise ModelError(f"{place} is a link that leads out of the package; export it again")
        return contents(place, MOST_BYTES)


class _Zip:
    """The files of a package in a zip; the bytes of each are counted while they are unpacked."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive, self._names = archive, frozenset(archive.namelist())

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def names(self) -> Iterable[str]:
        return self._names

    def read(self, name: str) -> bytes:
        if self._archive.getinfo(name).compress_type not in _METHODS:
            raise zipfile.BadZipFile
        with self._archive.open(name) as member:
            content = member.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise OSError(errno.EFBIG, "it holds too much")
        return content


@contextmanager
def _opened(path: Path) -> Iterator[_Folder | _Zip]:
    """A package, open for reading."""
    try:
        if not path.exists():
            settle(path.parent)  # a command that was killed may have moved it aside
        if not path.exists():
            raise ModelError(f"there is no plant package {path}; run `sysid export` to make one")
        if path.is_dir():
            yield _Folder(path)
            return
        with zipfile.ZipFile(io.BytesIO(contents(path, MOST_BYTES))) as archive:
            yield _Zip(archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError):
        raise ModelError(
            f"{path} is not a plant package (neither a folder nor an intact zip); export it again"
        ) from None
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == errno.EFBIG:
            raise ModelError(f"{path} is too large for a plant package; export it again") from None
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path} cannot be read ({reason})") from None


def _is_package(path: Path) -> bool:
    try:
        with _opened(path) as package:
            return MARK in package
    except ModelError:
        return False


def _check_folder(path: Path, target: Path, known: frozenset[str]) -> None:
    if target.exists() and not target.is_dir():
        raise UsageError(f"{path} is a file; name a folder or a .zip for the plant package")
    if not target.is_dir():
        return
    if target == Path.cwd() or target in Path.cwd().parents:
        raise UsageError(f"{path} is the current folder; give the plant package its own folder")
    foreign = sorted({*_Folder(target).names()} - known)
    if foreign:
        raise UsageError(
            f"{path} holds files that are not a plant package's ({foreign[0]}); it was not "
            "changed; choose another folder"
        )
