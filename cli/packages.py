"""Reading plant packages, and the option about those that were changed after their export."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import ModelError

if TYPE_CHECKING:
    from sysid.plant.package import Package

AcceptChanges = Annotated[
    bool,
    typer.Option("--accept-changes", help="Take a plant package that was changed by hand."),
]


def read(path: Path, accept_changes: bool) -> "Package":
    """A plant package; see :func:`sysid.plant.package.read_package`.

    Raises:
        ModelError: there is none, it is damaged, or changed and the option is not given.
    """
    from sysid.plant.package import ChangedPackageError, read_package

    try:
        return read_package(path, accept_changes)
    except ChangedPackageError as error:
        raise ModelError(f"{error}, or take it as it is with --accept-changes") from None
