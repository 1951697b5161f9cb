"""What other packages add to the workbench: the objects behind their entry points.

Each extension point is a group of entry points; a registry knows what an object of its group must
be, this module how it is found, and what is said where it cannot be used.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


def points(group: str) -> "Mapping[str, EntryPoint]":
    """The entry points of a group by name, the first of equal ones; nothing is imported."""
    from importlib.metadata import entry_points  # slower than all the help of the command line

    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, point)
    return found


def loaded(point: "EntryPoint", what: str) -> Any:
    """Import what an entry point names.

    Args:
        what: what it should be, e.g. "criterion", for the sentence.

    Raises:
        UsageError: it cannot be imported.
    """
    try:
        return point.load()
    except Exception as error:  # whatever a foreign module does while it is imported
        raise unusable(point, what, f"cannot be imported ({error})") from None


def unusable(point: "EntryPoint", what: str, why: str) -> UsageError:
    """The sentence about an extension that is not what its group holds.

    Args:
        why: e.g. "has no step".
    """
    package = point.dist.name if point.dist is not None else point.value
    return UsageError(
        f"the {what} {point.name!r} of the package {package} {why}; mend or uninstall that package"
    )
