"""What the code of a package must be: made again from its plant.json, which is data alone."""

import io
import zipfile
from collections.abc import Mapping
from typing import NamedTuple

from sysid.errors import ModelError
from sysid.export.package import form_of, package_files
from sysid.plant.package import Package
from sysid.plant.storage import Files
from sysid.version import __version__

FOLDERS = ("c", "fmu", "fmu3", "ros")
"""Folders of a package whose files are code that a runtime takes."""

_BINARIES = "binaries/"
"""Where a unit has what a compiler made, which another compiler makes differently."""


class Foreign(NamedTuple):
    """Why the code of a folder may be of somebody else.

    Attributes:
        sources: whether what is read differs, not just what a compiler made of it.
    """

    words: str
    sources: bool


def foreign_code(package: Package, files: Files) -> dict[str, Foreign]:
    """The folders of a package whose files are not, byte for byte, what this version makes.

    Args:
        files: of the package, by name.

    Returns:
        Folder → why its code runs only where it is trusted.
    """
    there = [f for f in FOLDERS if any(n.startswith(f"{f}/") for n in files)]
    return {f: why for f in there if (why := _difference(package, files, f)) is not None}


def _difference(package: Package, files: Files, folder: str) -> Foreign | None:
    advice = "export the plant again, or run it closed off by `trust=True`"
    try:
        made = package_files(
            package.model(),
            name=str(package.description.get("name", "")),
            formats=[folder],
            form=form_of(package.description, package.where),
        )
    except ModelError as error:
        return Foreign(f"{folder}/ cannot be made from plant.json ({error}); {advice}", True)
    mine, given = (
        {n: data.replace(b"\r\n", b"\n") for n, data in f.items() if n.startswith(f"{folder}/")}
        for f in (made, files)  # ends of lines do not count, as in the hash
    )
    names = sorted(n for n in {*mine, *given} if mine.get(n) != given.get(n))
    if not names:
        return None
    if all(_sources(mine.get(n, b"")) == _sources(given.get(n, b"")) for n in names):
        return Foreign(f"the binary in {names[0]} is not built here: `trust=True` runs it", False)
    more = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
    words = f"{names[0]}{more} is not what sysid {__version__} makes of plant.json; {advice}"
    return Foreign(words, True)


def _sources(unit: bytes) -> Mapping[str, bytes] | bytes:
    """What a unit holds beside its binaries; of any other file, its bytes."""
    try:
        with zipfile.ZipFile(io.BytesIO(unit)) as archive:
            names = [n for n in archive.namelist() if not n.startswith(_BINARIES)]
            if sum(archive.getinfo(n).file_size for n in names) > len(unit):
                return unit  # ours are stored; this one unpacks to more
            return {n: archive.read(n) for n in names}
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError, EOFError):
        return unit
