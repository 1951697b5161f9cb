"""The data that comes with the workbench: robot logs from a twin, missions, bench tables.

``path("prbs")`` is the file of a log, ``path("goal_1m")`` that of a mission; ``names()`` lists
them. README.md beside this file says what is in each and how it was made.
"""

from importlib.resources import files
from pathlib import Path

__all__ = ["folder", "names", "path"]

_KINDS = {"devastator": ".csv", "missions": ".yaml", "bench": ".csv"}


def folder(kind: str | None = None) -> Path:
    """The installed folder of the ``devastator`` logs, ``missions`` or ``bench`` tables, or of all.

    Raises:
        FileNotFoundError: there is no such kind; the message names those there are.
    """
    here = Path(str(files(__name__)))
    if kind is None:
        return here
    _extension(kind)
    return here / kind


def names(kind: str) -> tuple[str, ...]:
    """Names of the bundled files of a kind, sorted, without extension.

    Raises:
        FileNotFoundError: there is no such kind; the message names those there are.
    """
    extension = _extension(kind)
    return tuple(sorted(p.stem for p in folder(kind).iterdir() if p.suffix == extension))


def path(name: str) -> Path:
    """The file of a bundled log or mission, by name with or without its extension.

    Raises:
        FileNotFoundError: there is no such file; the message names those there are.
    """
    for kind, extension in _KINDS.items():
        stem = name.removesuffix(extension)
        if stem in names(kind):
            return folder(kind) / (stem + extension)
    known = ", ".join(n for kind in _KINDS for n in names(kind))
    raise FileNotFoundError(f"no bundled file {name!r}; there are {known}")


def _extension(kind: str) -> str:
    if kind not in _KINDS:
        raise FileNotFoundError(f"no bundled data {kind!r}; there are {', '.join(_KINDS)}")
    return _KINDS[kind]
