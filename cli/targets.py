"""Checks of output paths, made before the work starts."""

from pathlib import Path
from typing import Any

from sysid.errors import DataError, UsageError

from .options import option


def check(path: Path, option: str, new_folder: bool = True) -> None:
    """Refuse a path whose folder does not exist: a typing error must not create folders.

    Args:
        path: the file or folder to write.
        option: what the place was named with.
        new_folder: whether the last folder on the way may be new.
    """
    folder = path.parent.parent if new_folder else path.parent
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise UsageError(f"{option} {path}: the folder {folder} {what}; create it or name another")


def make_folder(path: Path, option: str) -> None:
    """Make the folder of a file that will be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(
            f"{path.parent} cannot be created ({error.strerror}); choose another {option}"
        ) from None


def picture(help: str) -> Any:
    """The option ``--plot``, refused before the work where it cannot be drawn."""
    return picture_target(help, "-p", "--plot")


def picture_target(help: str, *names: str) -> Any:
    """An option for a picture to write, refused before the work where it cannot be drawn."""
    return option("FILE", help, *names, parse=lambda path: check_picture(path, names[-1]))


def data_target(name: str, help: str) -> Any:
    """An option for a table of numbers to write."""
    return target("DATA.csv", help, name, suffixes=(".csv",))


def check_picture(path: Path, option: str = "--plot") -> Path:
    """Refuse a picture that cannot be drawn."""
    from sysid.report.plots import picture_format

    picture_format(path)
    check(path, option, new_folder=False)
    return path


def target(
    metavar: str,
    help: str,
    name: str = "-o",
    *,
    new_folder: bool = True,
    suffixes: tuple[str, ...] = (),
    **more: Any,
) -> Any:
    """An option for a file or folder to write, refused before the work where that cannot be.

    Args:
        name: what is typed.
        new_folder: whether the last folder on the way may be new.
        suffixes: what a name may end in; anything without any.
    """

    def checked(path: Path) -> Path:
        if suffixes and path.suffix.lower() not in suffixes:
            raise UsageError(f"{name} {path}: name a file that ends in {suffixes[0]}")
        check(path, name, new_folder)
        return path

    return option(metavar, help, name, parse=checked, **more)


YAML = (".yaml", ".yml")
